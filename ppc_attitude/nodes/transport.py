# Copyright 2026 the ppc_attitude authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""How the middleware is set up before a node begins.

Only times and transports of Fast DDS are set, no QoS: what ROS asks for stays in force. Another
middleware reads none of this, and a profile of the user's own takes precedence.

All goes by UDP. Fast DDS takes the shared-memory port of a process that does not respond for a
second for dead and makes it anew, and who still holds the old one is never heard again.
"""

import os
from collections.abc import MutableMapping
from pathlib import Path

from rclpy.utilities import get_rmw_implementation_identifier

from ppc_attitude.nodes.discovery import (
    LOCALHOST_ONLY,
    MIDDLEWARE,
    PROFILES,
    RANGE,
    TRANSPORTS,
    check_discovery,
    chosen_by_user,
    keeps_to_this_host,
)

ANYWHERE = Path(__file__).parent / "fast_dds.xml"
THIS_HOST = Path(__file__).parent / "fast_dds_this_host.xml"
_NO_OTHER = "SKIP_DEFAULT_XML_FILE"  # Fast DDS would read a file in the current folder as well


def tune_transport(environment: MutableMapping[str, str] = os.environ) -> None:
    """Let Fast DDS read our profile; to be called before `rclpy.init`.

    With the range LOCALHOST, ROS would choose the transports, shared memory among them; a profile
    that knows no interface but loopback keeps to this host as well, and leaves the choice to us.

    Raises
    ------
    ConfigurationError
        The environment names a range, a domain or a peer that is none.
    """
    check_discovery(environment)
    middleware = get_rmw_implementation_identifier()
    if chosen_by_user({**environment, MIDDLEWARE: middleware}):
        return
    environment[_NO_OTHER] = "1"
    if keeps_to_this_host(environment):
        environment.pop(LOCALHOST_ONLY, None)
        environment[RANGE] = "SYSTEM_DEFAULT"
        environment[PROFILES[0]] = str(THIS_HOST)
    else:
        environment[TRANSPORTS] = "UDPv4"
        environment[PROFILES[0]] = str(ANYWHERE)
