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
from dataclasses import replace

from ppc_attitude.analysis.metrics import analyse, verdict_table
from ppc_attitude.command_line.options import (
    add_report_option,
    add_scenario_options,
    exit_code,
    print_json,
    scenario_of,
)
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.contract.versions import versions
from ppc_attitude.simulation.closed_loop import simulate


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "simulate",
        help="run the closed loop in process, without ROS",
        description="The same loop as `run`, with the same kernels, in one process.",
    )
    add_scenario_options(parser)
    add_report_option(parser)
    parser.add_argument("--json", action="store_true", help="print the verdict as JSON")
    parser.set_defaults(execute=execute)


def execute(arguments: argparse.Namespace) -> int:
    """Simulate, judge, print."""
    scenario = scenario_of(arguments)
    record = simulate(scenario, scenario.number(PLANT, "duration"))
    record = replace(record, metadata=versions())
    verdict = analyse(record)
    if arguments.json:
        print_json(verdict.to_json())
    else:
        print(verdict_table(verdict))
    if arguments.report:
        from ppc_attitude.analysis.report import write_report

        write_report([(record, verdict)], arguments.report)
        if not arguments.json:
            print(f"report: {arguments.report}")
    return exit_code(verdict)
