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

"""Simulated seconds a second of the loop in process, beside Basilisk."""

import time
from typing import Any

import numpy as np

from ppc_attitude.bench.basilisk_loop import BasiliskLoop
from ppc_attitude.bench.pairs import alternating
from ppc_attitude.simulation.closed_loop import SAMPLE, run_samples, stamps_of
from ppc_attitude.simulation.scenario import scenario

RATE = 100.0  # [Hz]


def ours_s_per_s(duration: float, repeats: int) -> float:
    """Simulated seconds in a second of wall time, full law, every sample kept."""
    run = scenario({})
    stamps = stamps_of(RATE, duration)
    samples = np.zeros(stamps.size, SAMPLE)
    run_samples(run, stamps, samples)
    begin = time.perf_counter()
    for _ in range(repeats):
        run_samples(run, stamps, samples)
    return repeats * duration / (time.perf_counter() - begin)


def basilisk_s_per_s(law: str, duration: float) -> float:
    """Return the same of Basilisk, without the time it takes to build the simulation."""
    loop = BasiliskLoop(law, RATE)
    begin = time.perf_counter()
    loop.run(duration)
    return duration / (time.perf_counter() - begin)


def measure(quick: bool) -> dict[str, Any]:
    """Measure ``in_process``."""
    duration, pairs = (20.0, 1) if quick else (120.0, 5)
    ours, compiled, python = alternating(
        pairs,
        lambda: ours_s_per_s(120.0, 5),
        lambda: basilisk_s_per_s("compiled", duration),
        lambda: basilisk_s_per_s("python", duration),
    )
    return {
        "sim_s_per_s": ours,
        "basilisk_compiled": compiled,
        "basilisk_numba": None,  # not measured yet
        "basilisk_python": python,
        "ratio": ours / compiled,
    }
