"""`ppc_attitude replay`: a bag's recorded inputs through the control kernel once more."""

import argparse
from dataclasses import asdict
from pathlib import Path

from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.errors import DONE, REQUIREMENT_FAILED
from ppc_attitude.command_line.options import print_json
from ppc_attitude.simulation.replay import replay


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "replay",
        help="feed a bag's recorded inputs to the control kernel",
        description="Reports the largest torque difference; exit code 0 if there is none.",
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="folder of the bag")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(execute=execute)


def execute(arguments: argparse.Namespace) -> int:
    """Replay and report."""
    result = replay(read_run(arguments.bag))
    if arguments.json:
        print_json({"bag": str(arguments.bag), **asdict(result)})
    else:
        print(
            f"{result.steps} steps replayed, {result.skipped} skipped: largest torque difference "
            f"{result.largest_difference:.3g} N·m at t = {result.at:.3f} s"
        )
    return DONE if result.largest_difference == 0.0 else REQUIREMENT_FAILED
