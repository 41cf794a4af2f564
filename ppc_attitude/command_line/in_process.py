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

"""A run in one process: whether memory can hold it, what it warned of, and whether it diverged.

With `run` the warnings are in the log of the nodes.
"""

import sys
from contextlib import suppress
from pathlib import Path

import numpy as np

from ppc_attitude.analysis.truth import truth_of
from ppc_attitude.contract.cdr import LARGEST
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.processes.exits import RunError
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.stamps import instant
from ppc_attitude.simulation.closed_loop import raised_until
from ppc_attitude.simulation.diagram import recorded_columns
from ppc_attitude.simulation.news import concerns
from ppc_attitude.simulation.scenario import Scenario

# For each recorded number. Measured: 10 with what is not recorded, 15 while the run is judged. The
# rest is for sensors and reports.
_BYTES_PER_NUMBER = 24
_MACHINE, _CONTAINER = Path("/proc/meminfo"), Path("/sys/fs/cgroup")


def check_memory(scenario: Scenario, at_once: int = 1) -> None:
    """See that all samples of a run, or of several at once, can be held.

    Raises
    ------
    ConfigurationError
        The run is too long for this machine; says how long one may be.
    """
    duration, rate = (scenario.number(PLANT, name) for name in ("duration", "rate"))
    width = sum(column.width for column in recorded_columns(scenario.parameters))
    needed = at_once * _BYTES_PER_NUMBER * width * duration * rate
    free = _free()
    if needed > free:
        raise ConfigurationError(
            f"duration = {duration:g} s at {rate:g} Hz: {duration * rate:.3g} instants need "
            f"{needed / 2**30:.3g} GiB of memory, {free / 2**30:.3g} GiB are free; allowed here: "
            f"≤ {duration * free / needed:.3g} s"
        )


def _free() -> float:
    """Memory that this process may still take [bytes]; infinite if the system does not tell."""
    sizes = [float("inf")]
    with suppress(OSError):
        for line in _MACHINE.read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                sizes.append(1024.0 * float(line.split()[1]))
    with suppress(OSError, ValueError):  # "max" is no number
        limit, taken = (
            float((_CONTAINER / f"memory.{name}").read_text(encoding="ascii"))
            for name in ("max", "current")
        )
        lines = (_CONTAINER / "memory.stat").read_text(encoding="ascii").splitlines()
        # Cached files that nobody reads any more count as taken, but are given up when needed.
        idle = sum(float(line.split()[1]) for line in lines if line.startswith("inactive_file "))
        sizes.append(max(limit - taken + idle, 0.0))
    return min(sizes)


def first_lost(record: RunRecord) -> int:
    """Index of the first instant with a rate beyond any craft's; the number of instants if none."""
    rates = record[truth_of(record).angular_velocity]
    kept = np.abs(rates).sum(axis=1) <= LARGEST  # false for NaN, too
    return int(kept.size if kept.all() else kept.argmin())


def tell_concerns(scenario: Scenario, record: RunRecord) -> None:
    """Print what components warned of in a run, and when, as long as its rate is possible."""
    for time, advice in concerns(scenario, record.stamps_ns[: first_lost(record)]):
        kind = "error: " if advice.failed else "warning: " if advice.warning else ""
        print(f"{kind}at t = {time:.3f} s {advice.text}", file=sys.stderr)


def see_that_it_is_bounded(scenario: Scenario, record: RunRecord) -> None:
    """See that no rate is larger than a craft can have, where the plant of `run` would end.

    Raises
    ------
    RunError
        A rate is; the message says when.
    """
    lost = first_lost(record)
    if lost < record.t.size:
        rate, t = record[truth_of(record).angular_velocity][lost], record.t[max(lost - 1, 0)]
        why = raised_until(scenario, record.stamps_ns[: lost + 1])
        raise RunError(
            f"diverged: angular velocity {tuple(rate.tolist())} rad/s at {instant(t)} s{why}"
        )
