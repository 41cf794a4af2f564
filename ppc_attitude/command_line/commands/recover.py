"""`ppc_attitude recover`: finish a bag whose recorder was killed."""

import argparse
from pathlib import Path

from ppc_attitude.bags.recover import recover
from ppc_attitude.command_line.errors import DONE


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "recover",
        help="finish a bag whose recorder was killed",
        description="Writes index and metadata of a cut bag, so that every tool reads it.",
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="folder of the bag")
    parser.set_defaults(execute=execute)


def execute(arguments: argparse.Namespace) -> int:
    """Recover and say what was found."""
    print(recover(arguments.bag))
    return DONE
