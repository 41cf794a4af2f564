"""`ppc_attitude export`: the samples of a bag as one table for pandas and spreadsheets."""

import argparse
from pathlib import Path

from ppc_attitude.bags.export import export_csv, export_parquet
from ppc_attitude.command_line.errors import DONE


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "export",
        help="write a bag's samples as a table",
        description="One row an instant, one column a component.",
    )
    parser.add_argument("bag", metavar="BAG", type=Path, help="folder of the bag")
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument("--parquet", metavar="FILE", type=Path, help="a new Parquet file")
    kind.add_argument("--csv", metavar="FILE", type=Path, help="a new CSV file")
    parser.set_defaults(execute=execute)


def execute(arguments: argparse.Namespace) -> int:
    """Export."""
    if arguments.parquet:
        export_parquet(arguments.bag, arguments.parquet)
    else:
        export_csv(arguments.bag, arguments.csv)
    print(f"table: {arguments.parquet or arguments.csv}")
    return DONE
