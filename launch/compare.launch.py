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

"""Two runs side by side, proposed and traditional controller, each in its namespace, in one bag.

ros2 launch ppc_attitude compare.launch.py bag:=bags/comparison
ppc_attitude compare bags/comparison --figures figures
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from ppc_attitude.command_line.launch_actions import arguments, side_by_side
from ppc_attitude.command_line.launching import SIDE_BY_SIDE, Request

CONFIG = Path(__file__).parent.parent / "config"
HIT = CONFIG / "comparison_hit.yaml"
RUNS = {"/proposed": [HIT], "/traditional": [HIT, CONFIG / "traditional.yaml"]}


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes of both runs, and one recorder."""
    asked = Request(context.launch_configurations)
    runs = {namespace: asked.scenario(CONFIG, overlay) for namespace, overlay in RUNS.items()}
    return side_by_side(runs, asked.nodes())


def generate_launch_description() -> LaunchDescription:
    """Describe the launch."""
    return LaunchDescription([*arguments(SIDE_BY_SIDE), OpaqueFunction(function=nodes)])
