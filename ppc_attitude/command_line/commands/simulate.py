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

"""`ppc_attitude simulate`: the closed loop in process, without ROS."""

import argparse
import shlex
import sys
from dataclasses import replace

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.export import export
from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.command_line.in_process import check_memory, see_that_it_is_bounded, tell_concerns
from ppc_attitude.command_line.options import (
    add_bag_option,
    add_judging_options,
    add_scenario_options,
    exit_code,
    print_verdict,
    requirements_of,
    scenario_of,
    write_report_of,
)
from ppc_attitude.command_line.paths import new_file
from ppc_attitude.command_line.stopping import stoppable
from ppc_attitude.contract.topics import PLANT, RECORDER
from ppc_attitude.contract.versions import versions
from ppc_attitude.processes.exits import RunError
from ppc_attitude.simulation.closed_loop import simulate

HELP = "run the closed loop in process, without ROS"
DESCRIPTION = (
    "Runs the same loop as `run`, with the same kernels, in one process without ROS. Warnings that "
    "the nodes would log go to standard error, with the simulated time."
)
EXAMPLES = (
    "ppc_attitude simulate --config config/paper.yaml --json",
    "ppc_attitude simulate --controller quaternion_feedback --report simulated.html",
    "ppc_attitude simulate --duration 30 --bag bags/simulated --export simulated.csv",
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_scenario_options(parser)
    add_bag_option(parser, "folder of the bag; default none")
    parser.add_argument(
        "--export",
        metavar="FILE",
        type=new_file(".csv", ".parquet"),
        help="write the samples as a table, .csv or .parquet",
    )
    add_judging_options(parser)
    parser.add_argument("--json", action="store_true", help="print the verdict as JSON")


def execute(arguments: argparse.Namespace) -> int:
    """Simulate, judge, write, print."""
    scenario, required = scenario_of(arguments), requirements_of(arguments)
    check_memory(scenario)
    duration = scenario.number(PLANT, "duration")
    record = stoppable(lambda: simulate(scenario, duration))
    tell_concerns(scenario, record)
    see_that_it_is_bounded(scenario, record)
    record = replace(record, metadata={**versions(), "command": shlex.join(sys.argv)})
    verdict = Verdict(record, required)
    print_verdict(verdict, as_json=arguments.json)
    output = sys.stderr if arguments.json else sys.stdout
    if arguments.bag:
        try:
            write_run(record, arguments.bag, storage=scenario.parameters[RECORDER]["storage"])
        except BagError as error:  # its place was free: this is no mistake of the input
            raise RunError(str(error)) from None
        print(f"bag: {arguments.bag}", file=output)
    if arguments.export:
        export(record, arguments.export)
        print(f"table: {arguments.export}", file=output)
    write_report_of(arguments, [verdict], output)
    return exit_code(verdict)
