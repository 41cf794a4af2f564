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

"""One run: plant, reference, controller, disturbances and recorder.

ros2 launch ppc_attitude paper.launch.py config:=paper.yaml,sudden_disturbance.yaml
ros2 launch ppc_attitude paper.launch.py without:=ppc_controller realtime:=true
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from ppc_attitude.command_line.launch_actions import arguments, stack
from ppc_attitude.command_line.launching import ARGUMENTS, Request

CONFIG = Path(__file__).parent.parent / "config"


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes that the arguments ask for."""
    asked = Request(context.launch_configurations)
    return stack(asked.scenario(CONFIG), asked.nodes(), asked["namespace"])


def generate_launch_description() -> LaunchDescription:
    """Describe the launch."""
    return LaunchDescription([*arguments(ARGUMENTS), OpaqueFunction(function=nodes)])
