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

from bench import SENSORS, alternating
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.simulation.closed_loop import Loop, stamps_of
from ppc_attitude.simulation.scenario import Scenario, load, scenario

DURATION = 120.0  # [s]
_SAME = 1e-9  # the three forms of Basilisk's law may differ by this: rounding
_OURS_AT_A_TIME = 10  # runs: as much wall time as one of Basilisk's


def ours_s_per_s(run: Scenario, duration: float, repeats: int) -> float:
    """Simulated seconds in a second of wall time, full law, every sample kept."""
    stamps = stamps_of(run.number(PLANT, "rate"), duration)
    loop = Loop(run, stamps)
    loop.run(run)
    begin = time.perf_counter()
    for _ in range(repeats):
        loop.run(run)
    return repeats * duration / (time.perf_counter() - begin)


def measure(quick: bool) -> dict[str, Any]:
    """Measure ``in_process``: loops of one scenario, what prepares them excluded on both sides.

    Raises
    ------
    RuntimeError
        Basilisk's three forms of one law end at different attitudes.
    """
    from bench.basilisk_loop import BasiliskLoop, Law

    ends: dict[Law, Any] = {}
    plain, sensing = scenario({}), load([SENSORS])

    def basilisk_s_per_s(law: Law, run: Scenario = plain) -> float:
        loop = BasiliskLoop(run, DURATION, law)
        loop.prepare()
        begin = time.perf_counter()
        end = loop.run()
        seconds = time.perf_counter() - begin
        if run is plain:
            ends[law] = end
        return DURATION / seconds

    ours, compiled, numba, python, ours_sensing, basilisk_sensing = alternating(
        1 if quick else 9,
        lambda: ours_s_per_s(plain, DURATION, _OURS_AT_A_TIME),
        lambda: basilisk_s_per_s("compiled"),
        lambda: basilisk_s_per_s("numba"),
        lambda: basilisk_s_per_s("python"),
        lambda: ours_s_per_s(sensing, DURATION, _OURS_AT_A_TIME),
        lambda: basilisk_s_per_s("compiled", sensing),
    )
    for law, end in ends.items():
        if not np.allclose(end, ends["compiled"], rtol=0.0, atol=_SAME):
            raise RuntimeError(f"Basilisk's law as {law} ends at σ = {end}: {ends}")
    return {
        "sim_s_per_s": ours,
        "basilisk_compiled": compiled,
        "basilisk_numba": numba,
        "basilisk_python": python,
        "ratio": ours / compiled,
        "sensors": {
            "sim_s_per_s": ours_sensing,
            "basilisk_compiled": basilisk_sensing,
            "ratio": ours_sensing / basilisk_sensing,
            "us_per_step": 1e6 / (ours_sensing * plain.number(PLANT, "rate")),
        },
    }
