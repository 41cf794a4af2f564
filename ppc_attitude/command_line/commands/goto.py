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

"""`ppc_attitude goto`: an attitude for a running stack to turn to."""

import argparse
import math

from ppc_attitude.command_line.options import add_stack_options, number
from ppc_attitude.processes.exits import DONE, REQUIREMENT_FAILED
from ppc_attitude.science.attitude import unit_quaternion
from ppc_attitude.science.guidance.frames import FRAME_NAMES, from_euler, from_vectors

HELP = "turn a running stack to an attitude"
DESCRIPTION = (
    "Publishes on goal_pose, in the domain that ROS_DOMAIN_ID names, and prints what "
    "guidance/status answers. The stack's reference generator must have mode: goal. Exit codes: 0 "
    "followed; 1 refused, or followed with a warning; 2 bad input, or a stack in another mode; 3 "
    "no answer."
)
EXAMPLES = (
    "ROS_DOMAIN_ID=42 ppc_attitude goto --euler 0 0 90",
    "ROS_DOMAIN_ID=42 ppc_attitude goto --quaternion 0 0 0 1 --frame nadir --at 60",
    "ROS_DOMAIN_ID=42 ppc_attitude goto --vectors 0 0 1 1 0 0 1 0 0 0 0 1",
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    attitude = parser.add_mutually_exclusive_group(required=True)
    attitude.add_argument(
        "--quaternion", metavar=("X", "Y", "Z", "W"), nargs=4, type=number(), help="the attitude"
    )
    attitude.add_argument(
        "--euler",
        metavar=("ROLL", "PITCH", "YAW"),
        nargs=3,
        type=number(),
        help="turns about the fixed axes x, y, z, in this order [deg]",
    )
    attitude.add_argument(
        "--vectors",
        metavar="N",
        nargs=12,
        type=number(),
        help=(
            "a body axis, the direction that it shall point along, a second body axis, and the "
            "direction that it shall be nearest to: three numbers each"
        ),
    )
    parser.add_argument(
        "--frame", choices=FRAME_NAMES, default=FRAME_NAMES[0], help="frame of attitude or vectors"
    )
    add_stack_options(parser, "at which the turn begins")


def execute(arguments: argparse.Namespace) -> int:
    """Send the goal and print the answer."""
    from ppc_attitude.nodes.goto import go_to
    from ppc_attitude.nodes.visiting import visiting

    if arguments.quaternion:
        attitude = unit_quaternion("--quaternion", arguments.quaternion)
    elif arguments.euler:
        attitude = from_euler(*map(math.radians, arguments.euler))
    else:
        n = arguments.vectors
        attitude = from_vectors(n[:3], n[3:6], n[6:9], n[9:])
    with visiting("goto", arguments.namespace) as node:
        answer = go_to(node, attitude, arguments.frame, arguments.at or 0.0)
    print(answer.text)
    return DONE if answer.followed else REQUIREMENT_FAILED
