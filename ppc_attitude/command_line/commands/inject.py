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

"""`ppc_attitude inject`: a sudden torque into a running stack, without the ros2 command."""

import argparse

from ppc_attitude.command_line.options import POSITIVE, add_stack_options, number
from ppc_attitude.processes.exits import DONE

HELP = "inject a torque into a running stack"
DESCRIPTION = (
    "Asks the injector, in the domain that ROS_DOMAIN_ID names, to add a torque, and prints from "
    "when to when it will act. The torque that really acts is on disturbance/torque."
)
EXAMPLES = (
    "ROS_DOMAIN_ID=42 ppc_attitude inject 0.5 0.5 0.5",
    "ROS_DOMAIN_ID=42 ppc_attitude inject 0 -0.2 0 --at 60 --duration 0.5",
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    for axis in "xyz":
        about = "torque, body axes [N·m]"
        parser.add_argument(axis, metavar=axis.upper(), type=number(), help=about)
    parser.add_argument(
        "--duration",
        metavar="S",
        type=POSITIVE,
        help="how long the torque acts [s]; default the injector's `injection_duration`",
    )
    add_stack_options(parser, "at which the torque begins")


def execute(arguments: argparse.Namespace) -> int:
    """Inject and say what the injector answered."""
    from ppc_attitude.nodes.visiting import inject

    torque = (arguments.x, arguments.y, arguments.z)
    print(inject(torque, arguments.at or 0.0, arguments.duration, arguments.namespace))
    return DONE
