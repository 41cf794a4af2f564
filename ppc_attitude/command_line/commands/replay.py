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

"""`ppc_attitude replay`: a bag's recorded inputs through the components' kernels once more."""

import argparse
import sys
from dataclasses import asdict

from ppc_attitude.command_line.options import add_reading_options, print_json, record_of
from ppc_attitude.command_line.stopping import stoppable
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.contract.versions import of_another_state
from ppc_attitude.processes.exits import DONE, REQUIREMENT_FAILED
from ppc_attitude.simulation.replay import replay

HELP = "feed a bag's recorded inputs to the components once more"
DESCRIPTION = (
    "Computes every component again from its recorded inputs, and prints the largest difference of "
    "each, and which ones are not installed or cannot be replayed."
)
EXAMPLES = ("ppc_attitude replay bags/here",)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_reading_options(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def execute(arguments: argparse.Namespace) -> int:
    """Replay and report."""
    record = record_of(arguments)
    result = stoppable(lambda: replay(record))
    if arguments.json:
        law = asdict(result.law) if result.law else {}
        print_json(
            {
                "bag": str(arguments.bag),
                "steps": law.get("steps"),
                "skipped": law.get("skipped"),
                "largest_difference": law.get("largest"),
                "at": law.get("at"),
                "components": [asdict(each) for each in result.found],
                "missing": result.missing,
                "left_out": result.left_out,
            }
        )
    else:
        for each in result.found:
            unit = "" if each.unit == "1" else f" {each.unit}"
            print(
                f"{each.component}: {each.steps} steps replayed, {each.skipped} skipped, largest "
                f"difference of {each.column} {each.largest:.3g}{unit} at t = {each.at:.3f} s"
            )
        for name in result.missing:
            print(f"not installed here, so left out: {name}")
        for reason in result.left_out:
            print(f"not replayed: {reason}")
    differs = any(each.largest for each in result.found)
    told = of_another_state(record.metadata)
    if told and (differs or result.missing):
        why = "whose nodes may compute otherwise, or may not tell every change in flight"
        print(f"warning: {told}, {why}", file=sys.stderr)
    if not differs:
        return DONE
    if PLANT not in record.parameters:  # with our plant the reader warns if the run began before
        why = "the record may begin after the run, whose components remember what came before"
        print(f"warning: {why}", file=sys.stderr)
    return REQUIREMENT_FAILED
