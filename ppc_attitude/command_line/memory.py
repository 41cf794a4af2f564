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

"""Whether a run can be held in memory, told before it is computed."""

from contextlib import suppress
from pathlib import Path

from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.diagram import recorded_columns
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
