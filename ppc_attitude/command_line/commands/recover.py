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

"""`ppc_attitude recover`: finish a bag whose recorder was killed."""

import argparse

from ppc_attitude.bags.errors import printable
from ppc_attitude.bags.recover import recover
from ppc_attitude.command_line.paths import some_path
from ppc_attitude.processes.exits import DONE
from ppc_attitude.science.stamps import seconds

HELP = "finish a bag whose recorder was killed"
DESCRIPTION = (
    "Writes index and metadata of a bag that was cut, so that every tool can read it. If more than "
    "its end is missing, BAG stays as it is, and the complete bag is in BAG.recovered."
)
EXAMPLES = ("ppc_attitude recover bags/cut",)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("bag", metavar="BAG", type=some_path, help="folder of the bag")


def execute(arguments: argparse.Namespace) -> int:
    """Recover and say what was found."""
    found = recover(arguments.bag)
    length = seconds(found.end_ns - found.start_ns)
    messages = f"{found.counts.total()} messages on {len(found.counts)} topics"
    print(f"{messages}, received within {length:.3f} s")
    print(f"the bag was cut: {printable('; '.join(found.flaws))}")
    if found.folder != arguments.bag:
        print(f"{arguments.bag} stays as it is: it may hold more than could be read")
    print(f"bag: {found.folder}")
    return DONE
