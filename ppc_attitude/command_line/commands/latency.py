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

"""`ppc_attitude latency`: from a state to the torque that answers it, in real time."""

import argparse
import os
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.command_line.options import (
    PAPER_DURATION,
    POSITIVE,
    add_bag_option,
    add_scenario_options,
    scenario_of,
    see_that_none_is_idle,
)
from ppc_attitude.command_line.recording import Recording
from ppc_attitude.command_line.stack import private_environment
from ppc_attitude.command_line.verdict_view import verdict_table
from ppc_attitude.contract.topics import TORQUE_COMMAND
from ppc_attitude.processes.exits import DONE, RunError

if TYPE_CHECKING:
    from ppc_attitude.nodes.onlooker import Latencies

HELP = "deadline misses and state-to-torque latency in real time"
DESCRIPTION = (
    "Runs the stack in real time as `run --realtime` does, or listens to one that runs already, "
    "and prints deadline misses and percentiles of the latency."
)
EXAMPLES = (
    "ppc_attitude latency --config config/paper.yaml --rate 250 --duration 20",
    "ppc_attitude latency --live --duration 10",
)
_FIRST_STATE = 15.0  # [s] how long a live graph may take to show a state
_JOINING = 1.0  # [s] after it in which a live graph is not measured


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_scenario_options(parser)
    told = "the plant's `rate` [Hz]; with an allocator, set it in a file, under /**"
    parser.add_argument("--rate", metavar="HZ", type=POSITIVE, help=told)
    add_bag_option(parser)
    parser.add_argument(
        "--live", action="store_true", help="listen to the running graph instead of starting one"
    )
    told = "with --live: namespace of the stack"
    parser.add_argument("--namespace", metavar="NS", default="", help=told)


def execute(arguments: argparse.Namespace) -> int:
    """Measure and print."""
    ours, live = "a stack of its own, without --live", arguments.live
    see_that_none_is_idle(arguments, not live, ours, "config", "controller", "rate", "bag")
    see_that_none_is_idle(arguments, live, "a stack that runs: --live", "namespace")
    from ppc_attitude.nodes.onlooker import measure  # before a run: the import takes long

    if live:
        duration = _JOINING + (arguments.duration or PAPER_DURATION)
        result = measure(_live(duration, arguments.namespace), arguments.namespace, _JOINING)
        if lack := _lack(result):
            raise RunError(lack)
        _print(result)
        return DONE
    scenario = scenario_of(arguments, **({"rate": arguments.rate} if arguments.rate else {}))
    os.environ.update(private_environment())  # for the node that looks on
    recording = Recording(arguments.bag)
    record = recording.run(
        scenario, lockstep=False, watch=lambda goes_on: _print(measure(lambda first: goes_on()))
    )
    verdict = Verdict(record)
    print(verdict_table(verdict))
    return recording.judge(verdict)


def _live(duration: float, namespace: str) -> Callable[[float | None], bool]:
    """Return a function that ends a measurement some time [s] after its first state."""
    from ppc_attitude.nodes.visiting import no_state

    begin = time.perf_counter()

    def goes_on(first: float | None) -> bool:
        now = time.perf_counter()
        if first is None and now - begin > _FIRST_STATE:
            raise no_state(namespace, _FIRST_STATE)
        return first is None or now - first < duration

    return goes_on


def _lack(result: "Latencies") -> str:
    """Say why a measurement tells nothing; empty if it does."""
    if result.states < 2:
        return f"{result.states} states were measured; their period follows from two or more"
    if not result.answered.size:
        return f"none of {result.states} states was answered on {TORQUE_COMMAND.name}"
    return ""


def _print(result: "Latencies") -> None:
    if lack := _lack(result):
        print(lack)
        return
    p50, p99, p999 = (1e3 * np.percentile(result.answered, (50.0, 99.0, 99.9))).tolist()
    print(
        f"states {result.states}, deadline {1e3 * result.period:g} ms, missed {result.missed}; "
        f"state to torque: p50 {p50:.3f} ms, p99 {p99:.3f} ms, p99.9 {p999:.3f} ms"
    )
