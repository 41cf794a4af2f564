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

ANYWHERE = Path(__file__).parent / "fast_dds.xml"
THIS_HOST = Path(__file__).parent / "fast_dds_this_host.xml"
_PROFILE = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
# ROS asks these first, or adds what they say to the range.
_OTHERS = ("ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS")


def tune_transport(environment: MutableMapping[str, str] = os.environ) -> None:
    """Let Fast DDS read our profile; to be called before `rclpy.init`.

    With the range LOCALHOST, ROS would choose the transports, shared memory among them; a profile
    that knows no interface but loopback keeps to this host as well, and leaves the choice to us.
    """
    if not get_rmw_implementation_identifier().startswith("rmw_fastrtps"):
        return
    if any(name in environment for name in (*_PROFILE, _TRANSPORTS)):
        return
    if environment.get(_RANGE) == "LOCALHOST" and not any(map(environment.get, _OTHERS)):
        environment[_RANGE] = "SYSTEM_DEFAULT"
        environment[_PROFILE[0]] = str(THIS_HOST)
    else:
        environment[_TRANSPORTS] = "UDPv4"
        environment[_PROFILE[0]] = str(ANYWHERE)
