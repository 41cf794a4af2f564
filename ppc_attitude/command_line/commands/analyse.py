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

"""`ppc_attitude analyse`: the verdict on every requirement, from the bag alone."""

import argparse
import sys
from pathlib import Path

from ppc_attitude.analysis.metrics import analyse, verdict_table
from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.options import add_report_option, exit_code, print_json
from ppc_attitude.command_line.paths import new_folder


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "analyse",
        help="judge a recorded run",
        description="Verdict on every requirement of the paper, from the bag alone.",
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="folder of the bag")
    parser.add_argument("--namespace", metavar="NS", help="of the stack, if the bag has several")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--figures", metavar="DIR", type=new_folder, help="draw every figure there")
    add_report_option(parser)
    parser.set_defaults(execute=execute)


def execute(arguments: argparse.Namespace) -> int:
    """Read, judge, print, draw."""
    record = read_run(arguments.bag, arguments.namespace)
    verdict = analyse(record)
    for warning in record.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if arguments.json:
        print_json(verdict.to_json())
    else:
        print(verdict_table(verdict))
    if arguments.figures:
        from ppc_attitude.analysis.figures import save_figures

        for path in save_figures(record, arguments.figures):
            print(f"figure: {path}", file=sys.stderr)
    if arguments.report:
        from ppc_attitude.analysis.report import write_report

        write_report([(record, verdict)], arguments.report)
        print(f"report: {arguments.report}", file=sys.stderr)
    return exit_code(verdict)
