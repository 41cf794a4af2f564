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

"""`ppc_attitude run`: the five nodes as processes, recorded and judged."""

import argparse
import sys

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.command_line.options import (
    add_bag_option,
    add_judging_options,
    add_scenario_options,
    requirements_of,
    scenario_of,
    write_report_of,
)
from ppc_attitude.command_line.paths import new_folder
from ppc_attitude.command_line.recording import Recording
from ppc_attitude.command_line.verdict_view import verdict_table
from ppc_attitude.processes.exits import RunError

HELP = "run the five nodes, record, and judge"
DESCRIPTION = (
    "Starts plant, reference, controller, injector and recorder as processes in lock-step, stops "
    "them all, and prints the verdict from the bag."
)
EXAMPLES = (
    "ppc_attitude run",
    "ppc_attitude run --config config/paper.yaml --config config/sudden_disturbance.yaml",
    "ppc_attitude run --realtime --duration 30 --bag bags/here --report here.html",
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_scenario_options(parser)
    add_bag_option(parser)
    parser.add_argument(
        "--realtime",
        action="store_true",
        help="free-running on the wall clock instead of lock-step",
    )
    parser.add_argument(
        "--secure",
        metavar="KEYS",
        type=new_folder,
        help="authenticate and encrypt all messages (SROS 2) with the keys in this folder; without "
        "keys there, they are made",
    )
    add_judging_options(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run, record, judge."""
    required = requirements_of(arguments)
    recording = Recording(arguments.bag, arguments.secure)
    record = recording.run(scenario_of(arguments), lockstep=not arguments.realtime)
    try:
        verdict = Verdict(record, required)
        print(verdict_table(verdict))
        write_report_of(arguments, [verdict], sys.stdout)
        return recording.judge(verdict)
    except KeyboardInterrupt:
        raise RunError(f"interrupted after the end of the run\n{recording.told}") from None
