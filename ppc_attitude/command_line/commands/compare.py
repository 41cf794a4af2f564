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

"""`ppc_attitude compare`: several runs side by side."""

import argparse
import sys

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.bags.reader import read_runs
from ppc_attitude.command_line.options import (
    add_figures_options,
    add_judging_options,
    add_reading_options,
    requirements_of,
    see_that_none_is_idle,
    topics_of,
    write_report_of,
)
from ppc_attitude.command_line.paths import some_path
from ppc_attitude.command_line.verdict_view import verdict_table
from ppc_attitude.processes.exits import DONE
from ppc_attitude.science.errors import ConfigurationError

HELP = "compare recorded runs"
DESCRIPTION = (
    "Prints verdicts and draws figures of several runs side by side; the first run is red."
)
EXAMPLES = (
    "ppc_attitude compare bags/proposed bags/traditional --figures figures",
    "ppc_attitude compare bags/comparison",
    "ppc_attitude compare bags/one bags/two bags/three --report comparison.html",
)
_MOST = 6  # runs, for each has a colour of its own


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument(
        "bags",
        metavar="BAG",
        type=some_path,
        nargs="+",
        help="folders of bags, with two to six runs in all",
    )
    add_reading_options(parser, several=True)
    add_figures_options(parser, "the comparisons")
    add_judging_options(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Read all, print every verdict, draw."""
    see_that_none_is_idle(arguments, arguments.figures, "figures: --figures DIR", "figure-format")
    required = requirements_of(arguments)
    names = topics_of(arguments)
    records = [record for bag in arguments.bags for record in read_runs(bag, names)]
    if not 2 <= len(records) <= _MOST:
        raise ConfigurationError(f"the bags hold {len(records)} runs; allowed: 2 to {_MOST}")
    for record in records:
        for warning in record.warnings:
            print(f"warning: {record.source}: {warning}", file=sys.stderr)
    judged = [Verdict(record, required) for record in records]
    print("\n\n".join(map(verdict_table, judged)))
    if arguments.figures:
        from ppc_attitude.analysis.comparison import comparisons_of
        from ppc_attitude.analysis.drawing import save_all

        drawn, lacking = comparisons_of(judged)
        for path in save_all(drawn, arguments.figures, arguments.figure_format):
            print(f"figure: {path}")
        for warning in lacking:
            print(f"warning: {warning}", file=sys.stderr)
    write_report_of(arguments, judged, sys.stdout)
    return DONE
