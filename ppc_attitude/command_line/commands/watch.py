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

"""`ppc_attitude watch`: a running stack in the terminal, for machines without a screen."""

import argparse
import sys
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from ppc_attitude.command_line.options import POSITIVE, add_namespace_option, see_that_none_is_idle
from ppc_attitude.contract.topics import ATTITUDE
from ppc_attitude.processes.exits import DONE

if TYPE_CHECKING:
    from ppc_attitude.nodes.onlooker import Onlooker

HELP = "look at a running stack in the terminal"
DESCRIPTION = (
    "Errors against envelopes, rates, torques and health of a running stack, live, in the domain "
    "that ROS_DOMAIN_ID names. Ctrl-C ends it; the stack does not notice."
)
EXAMPLES = (
    "ROS_DOMAIN_ID=42 ppc_attitude watch",
    "ROS_DOMAIN_ID=42 ppc_attitude watch --once --namespace /proposed",
)
_TIMEOUT = 10.0  # [s] until the first state, for one picture
_PERIOD = 0.1  # [s] between two pictures
_SETTLE = 3.0  # [s] after the first state in which all other topics come, if they exist
_LAST = 0.5  # [s] to find the other publishers of a node of which some are known


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_namespace_option(parser)
    parser.add_argument("--once", action="store_true", help="print one picture and end")
    parser.add_argument(
        "--timeout",
        metavar="S",
        type=POSITIVE,
        help=f"with --once: how long to wait for a state [s]; default {_TIMEOUT:g}",
    )


def execute(arguments: argparse.Namespace) -> int:
    """Show one picture, or many."""
    see_that_none_is_idle(arguments, arguments.once, "one picture: --once", "timeout")
    from ppc_attitude.nodes.onlooker import Onlooker
    from ppc_attitude.nodes.visiting import listening, visiting

    with visiting("watch", arguments.namespace) as node, listening(node) as listen:
        onlooker = Onlooker(node, listen)
        if arguments.once:
            _show_once(onlooker, arguments.timeout or _TIMEOUT, arguments.namespace)
        else:
            _show(onlooker)
    return DONE


def _show_once(onlooker: "Onlooker", timeout: float, namespace: str) -> None:
    from rich.console import Console

    from ppc_attitude.command_line.watch_view import view
    from ppc_attitude.nodes.visiting import no_state

    end = time.monotonic() + timeout
    while ATTITUDE.name not in (snapshot := onlooker.look(_PERIOD)).samples:
        if time.monotonic() > end:
            raise no_state(namespace, timeout)
    end = time.monotonic() + _SETTLE
    while not snapshot.complete and time.monotonic() < end:
        snapshot = onlooker.look(_PERIOD)
    snapshot = onlooker.look(_LAST)
    Console().print(view(snapshot, silent=0.0))


def _show(onlooker: "Onlooker") -> None:
    from rich.live import Live

    from ppc_attitude.command_line.watch_view import view

    stamp, since = None, time.monotonic()
    # Where there is no terminal, Live prints the last picture only.
    with suppress(KeyboardInterrupt), Live(auto_refresh=False, screen=sys.stdout.isatty()) as live:
        while True:
            snapshot = onlooker.look(_PERIOD)
            state = snapshot.samples.get(ATTITUDE.name)
            if state is not None and state.stamp_ns != stamp:
                stamp, since = state.stamp_ns, time.monotonic()
            silent = time.monotonic() - since
            picture = view(snapshot, silent)
            if len(live.console.render_lines(picture)) > live.console.height:
                picture = view(snapshot, silent, brief=True)
            live.update(picture, refresh=True)
