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

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.command_line.options import (
    add_figures_options,
    add_judging_options,
    add_reading_options,
    exit_code,
    print_verdict,
    record_of,
    requirements_of,
    see_that_none_is_idle,
    write_report_of,
)

HELP = "judge a recorded run"
DESCRIPTION = (
    "Prints the verdict on every requirement, the paper's or your own, from the bag alone."
)
EXAMPLES = (
    "ppc_attitude analyse bags/here",
    "ppc_attitude analyse bags/here --figures figures --report here.html",
    "ppc_attitude analyse bags/here --requirements config/requirements.yaml",
    "ppc_attitude analyse bags/comparison --namespace /proposed --json",
    "ppc_attitude analyse bags/rig --topic attitude=/imu/data --topic angular_velocity=/imu/data",
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_reading_options(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_figures_options(parser, "every figure")
    add_judging_options(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Read, judge, print, draw."""
    see_that_none_is_idle(arguments, arguments.figures, "figures: --figures DIR", "figure-format")
    required = requirements_of(arguments)
    verdict = Verdict(record_of(arguments), required)
    print_verdict(verdict, as_json=arguments.json)
    if arguments.figures:
        from ppc_attitude.analysis.drawing import save_all
        from ppc_attitude.analysis.figures import figures_of

        drawn = figures_of(verdict)
        for path in save_all(drawn, arguments.figures, arguments.figure_format):
            print(f"figure: {path}", file=sys.stderr)
    write_report_of(arguments, [verdict], sys.stderr)
    return exit_code(verdict)
