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

Only times of Fast DDS are set, no QoS: what ROS asks for stays in force. Another middleware reads
none of this, and a profile of the user's own takes precedence.
"""

import os
from pathlib import Path

PROFILE = Path(__file__).parent / "fast_dds.xml"
# Either names the user's own profiles, by the release of Fast DDS.
_VARIABLES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def tune_transport() -> None:
    """Let Fast DDS read our profile; to be called before `rclpy.init`."""
    if not any(name in os.environ for name in _VARIABLES):
        os.environ[_VARIABLES[0]] = str(PROFILE)
