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

Only times and the transport of Fast DDS are set, no QoS: what ROS asks for stays in force. Another
middleware reads none of this, and a profile of the user's own takes precedence.

Its shared memory is not used: when a reader does not respond for a second, paused or on a busy
machine, a writer makes the port anew, and the reader never hears from it again. A recorder that was
paused for 3 s so lost the rest of one run in six; with UDP of none in six, at the same pace.
"""

import os
from pathlib import Path

PROFILE = Path(__file__).parent / "fast_dds.xml"
# Either names the user's own profiles, by the release of Fast DDS.
_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def tune_transport() -> None:
    """Let Fast DDS read our profile and use UDP; to be called before `rclpy.init`."""
    if not any(name in os.environ for name in _VARIABLES):
        os.environ[_VARIABLES[0]] = str(PROFILE)
        os.environ.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
