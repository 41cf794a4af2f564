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

"""From the last input to the torque command: the controller node, a bare echo, a mere sleep."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np

from bench import ROOT
from bench.lockstep import peers
from ppc_attitude.command_line.stack import Stack
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import ATTITUDE, CONTROLLER, TORQUE_COMMAND
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.scenario import scenario

RATES = (100.0, 250.0, 500.0, 1000.0)  # [Hz]
_PRIORITY = 20  # of SCHED_FIFO: before everything that has no real-time priority
_PATIENCE = 60.0  # [s]


def _probe(rate: float, seconds: float, environment: Mapping[str, str]) -> Array:
    """Round trips [s] of whoever answers; NaN for an answer that never came."""
    command = [sys.executable, "-m", "bench.probe", str(rate), str(seconds)]
    done = subprocess.run(
        command, env=environment, cwd=ROOT, capture_output=True, timeout=_PATIENCE
    )
    if done.returncode:
        raise RuntimeError(done.stderr.decode(errors="replace"))
    return np.array(json.loads(done.stdout), dtype=np.float64)  # null becomes NaN


def summary(trips: Array, rate: float) -> dict[str, float]:
    """Percentiles [us] of round trips [s], and deadlines (one period) missed."""
    answered = trips[~np.isnan(trips)]
    p50, p99, p999 = (1e6 * np.percentile(answered, (50.0, 99.0, 99.9))).tolist()
    missed = int(np.count_nonzero(~(trips <= 1.0 / rate)))
    return {"p50_us": p50, "p99_us": p99, "p999_us": p999, "missed": missed, "sent": trips.size}


def controller_trips(rate: float, seconds: float) -> Array:
    """Round trips [s] of the controller node with all its telemetry."""
    run = scenario({})
    warm_up(run)
    stack = Stack(run, lambda t: None, [CONTROLLER])
    try:
        stack.start()
        return _probe(rate, seconds, stack.environment)
    finally:
        stack.kill()


def echo_trips(rate: float, seconds: float) -> Array:
    """Return the same of a node that answers without any work."""
    with peers([["answer", ATTITUDE.name, TORQUE_COMMAND.name]]) as environment:
        return _probe(rate, seconds, environment)


def sleeps(rate: float, seconds: float) -> Array:
    """Return how late [s] a thread wakes that only sleeps: what the machine takes from any node."""
    start = time.perf_counter()
    late = np.empty(round(rate * seconds))
    for step in range(late.size):
        due = start + (step + 1) / rate
        time.sleep(max(0.0, due - time.perf_counter()))
        late[step] = time.perf_counter() - due
    return late


def measure(quick: bool) -> list[dict[str, Any]]:
    """Measure ``latency``, one row for each rate; controller, echo and sleep in turns.

    A last row is of the highest rate with a real-time priority, if this user may give one.
    """
    rates, seconds, pairs = (RATES[:1], 1.0, 1) if quick else (RATES, 10.0, 2)
    rows = [_row(rate, seconds, pairs, 0) for rate in rates]
    with suppress(PermissionError), _real_time():
        rows.append(_row(rates[-1], seconds, pairs, _PRIORITY))
    return rows


def _row(rate: float, seconds: float, pairs: int, priority: int) -> dict[str, Any]:
    measures = (controller_trips, echo_trips, sleeps)
    turns = [[measured(rate, seconds) for measured in measures] for _ in range(pairs)]
    found = (summary(np.concatenate(trips), rate) for trips in zip(*turns, strict=True))
    row: dict[str, float] = {"rate": rate, "priority": priority}
    for prefix, figures in zip(("", "echo_", "sleep_"), found, strict=True):
        row.update({f"{prefix}{name}": value for name, value in figures.items()})
    return row


@contextmanager
def _real_time() -> Iterator[None]:
    """Give this process a real-time priority, which those that it starts inherit."""
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
