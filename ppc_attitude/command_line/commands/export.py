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

"""`ppc_attitude export`: the samples of a bag as one table for pandas and spreadsheets."""

import argparse
import sys

from ppc_attitude.bags.export import export_csv, export_parquet
from ppc_attitude.command_line.options import add_reading_options, record_of
from ppc_attitude.command_line.paths import new_file
from ppc_attitude.processes.exits import DONE

HELP = "write a bag's samples as a table"
DESCRIPTION = (
    "Writes a table with one row for each instant and one column for each component of a quantity."
)
EXAMPLES = (
    "ppc_attitude export bags/here --parquet here.parquet",
    "ppc_attitude export bags/here --csv here.csv",
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_reading_options(parser)
    kind = parser.add_mutually_exclusive_group(required=True)
    for form, name in (("parquet", "Parquet"), ("csv", "CSV")):
        kind.add_argument(f"--{form}", metavar="FILE", type=new_file(), help=f"a new {name} file")


def execute(arguments: argparse.Namespace) -> int:
    """Export."""
    record = record_of(arguments)
    write = export_parquet if arguments.parquet else export_csv
    if lacking := write(record, arguments.parquet or arguments.csv):
        print(f"warning: {lacking}", file=sys.stderr)
    print(f"table: {arguments.parquet or arguments.csv}")
    return DONE
