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

from ppc_attitude.command_line.launching import Request, Stacks, arguments
from ppc_attitude.contract.topics import RECORDER

ARGUMENTS = ("config", "duration", "bag", "realtime", "markers")
CONFIG = Path(__file__).parent.parent / "config"
HIT = CONFIG / "comparison_hit.yaml"
RUNS = {"/proposed": [HIT], "/traditional": [HIT, CONFIG / "traditional.yaml"]}


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes of both runs, and one recorder."""
    request = Request.of(context, *ARGUMENTS)
    scenarios = {name: request.scenario(CONFIG, overlay) for name, overlay in RUNS.items()}
    stacks = Stacks()
    actions = [
        stacks.recorder(
            next(iter(scenarios.values())),
            {name: scenario.parameters for name, scenario in scenarios.items()},
        )
    ]
    names = [name for name in request.nodes() if name != RECORDER]
    for namespace, scenario in scenarios.items():
        actions += stacks.nodes(scenario, names, namespace)
    return actions


def generate_launch_description() -> LaunchDescription:
    """Describe the launch."""
    return LaunchDescription([*arguments(*ARGUMENTS), OpaqueFunction(function=nodes)])
