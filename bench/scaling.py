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

"""How the cost of a run over ROS grows: rate, duration, telemetry, number of spacecraft.

No yardstick: each row differs from the first, the paper's case, in one thing.
"""

import random
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from bench.lockstep import stack_steps_per_s
from ppc_attitude.contract.topics import CONTROLLER, PLANT
from ppc_attitude.nodes.discovery import unused_domains
from ppc_attitude.science.parameter import NodeParameters

RATES = (50.0, 250.0, 1000.0)  # [Hz]
DURATIONS = (10.0, 200.0)  # [s]
CRAFT = (2, 4)
_BASE_RATE, _BASE_DURATION = 100.0, 40.0


def row(
    what: str,
    duration: float = _BASE_DURATION,
    values: NodeParameters | None = None,
    recorder: bool = True,
    craft: int = 1,
) -> dict[str, Any]:
    """Run as many stacks side by side as there are craft, each in its own domain.

    Returns
    -------
    dict
        What was changed; steps a second of all craft together; CPU time [us] and bytes of the bag
        for one step of one craft; memory [MB] of one craft's processes.
    """
    domains = random.sample(unused_domains(), craft)
    with ThreadPoolExecutor(craft) as pool:
        runs = list(
            pool.map(lambda domain: stack_steps_per_s(duration, values, recorder, domain), domains)
        )
    return {
        "what": what,
        "steps_per_s": sum(run["steps_per_s"] for run in runs),
        "cpu_us_per_step": sum(sum(run["cpu_us_per_step"].values()) for run in runs) / craft,
        "memory_mb": sum(sum(run["memory_mb"].values()) for run in runs) / craft,
        "bag_bytes_per_step": runs[0]["bag_bytes_per_step"],
    }


def measure(quick: bool) -> list[dict[str, Any]]:
    """Measure ``scaling``, one row for each change."""
    if quick:
        return [row("100 Hz, 10 s, recorder, one craft", 10.0)]
    same = _BASE_RATE * _BASE_DURATION  # steps
    law = {CONTROLLER: {"controller": "quaternion_feedback"}}
    return [
        row(f"{_BASE_RATE:g} Hz, {_BASE_DURATION:g} s, recorder, one craft"),
        *(row(f"{rate:g} Hz", same / rate, {PLANT: {"rate": rate}}) for rate in RATES),
        *(row(f"{duration:g} s", duration) for duration in DURATIONS),
        row("without recorder", recorder=False),
        row("quaternion_feedback: three topics fewer", values=law),
        *(row(f"{craft} craft, a domain each", craft=craft) for craft in CRAFT),
    ]
