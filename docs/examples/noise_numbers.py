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

"""Print the tables of docs/estimation.md: the paper's case with each sensor suite, many seeds.

python docs/examples/noise_numbers.py
python docs/examples/noise_numbers.py --seeds 8 --suite cubesat --plain
"""

import argparse
import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.truth import knowledge_errors, pointing_errors
from ppc_attitude.contract.topics import CONTROLLER, ESTIMATOR, PLANT
from ppc_attitude.science.estimators.steady_state import steady_state
from ppc_attitude.science.rate_observer import FEEDFORWARD, RATE_OBSERVER
from ppc_attitude.science.sensors.gyro import (
    ANGULAR_RANDOM_WALK,
    INITIAL_BIAS_SIGMA,
    RATE_RANDOM_WALK,
    RESOLUTION,
    effective_white_noise,
)
from ppc_attitude.science.sensors.star_tracker import CROSS_NOISE, RATE
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import Scenario, load

CONFIG = Path(__file__).parents[2] / "config"
SUITES = ("flagship", "smallsat", "cubesat")
FIRST_SEED = 100
SETTLED = 60.0  # [s] from here on torque and chatter are taken
BLIND_FROM, BLIND_FOR = 50.0, 60.0  # [s]
ARCSEC = math.radians(1.0 / 3600.0)


class Flight(NamedTuple):
    """The paper's case once: without hits but for the last number.

    Attributes
    ----------
    terminal : float
        Largest true max_i |q_ev,i| of the last 20 s.
    outside : float
        Time with z2 outside its envelope [s].
    torque, chatter : float
        RMS torque from 60 s on, and RMS of its change from sample to sample [mN·m].
    rate : float
        Largest ‖ω_s‖ [deg/s].
    settled : float
        Settling time [s].
    recovery : float
        From the paper's hit at 80 s until the true error is settled again [s].
    """

    terminal: float
    outside: float
    torque: float
    chatter: float
    rate: float
    settled: float
    recovery: float


class Gap(NamedTuple):
    """The paper's case with a minute without fixes, once.

    Attributes
    ----------
    knowledge, stated : float
        Angle of the knowledge error at the end of the gap, and √(trace P_θθ) [arcsec].
    terminal : float
        Largest true max_i |q_ev,i| of the last 20 s, of which 10 s belong to the gap.
    end : float
        The same at the end, 10 s after the gap.
    """

    knowledge: float
    stated: float
    terminal: float
    end: float


def is_cold(seed: int) -> bool:
    """Every second seed starts cold: the filter knows nothing of the gyro's bias."""
    return seed % 2 == 0


def case(suite: str, seed: int, *overlays: str, plain: bool = False, **plant: Any) -> Scenario:
    """Return the paper's case with a suite; plain: with the paper's law as it is.

    A warm start's bias is as uncertain as the settled filter's, not as at switch-on.
    """
    names = (f"sensors_{suite}", "paper") if plain else ("paper", f"sensors_{suite}")
    files = [CONFIG / f"{name}.yaml" for name in (*names, *overlays)]
    law = {RATE_OBSERVER.name: 0.0, FEEDFORWARD.name: False} if plain else {}
    scenario = load(files, {PLANT: {"seed": seed, **plant}, CONTROLLER: law})
    if is_cold(seed):
        return scenario
    rate, number = scenario.number(PLANT, "rate"), partial(scenario.number, ESTIMATOR)
    white = effective_white_noise(
        number(ANGULAR_RANDOM_WALK.name), number(RESOLUTION.name), 1.0 / rate
    )
    walk, fix = number(RATE_RANDOM_WALK.name), number(CROSS_NOISE.name)
    _, settled = steady_state(fix, white, walk, 1.0 / number(RATE.name))
    bias = {INITIAL_BIAS_SIGMA.name: math.sqrt(settled.bias)}
    return scenario.with_values(PLANT, **bias).with_values(ESTIMATOR, **bias)


def fly(suite: str, seed: int, plain: bool = False) -> Flight:
    """Fly the paper's case of 120 s, and once more with the paper's hits."""
    record = simulate(case(suite, seed, plain=plain), 120.0)
    found = Verdict(record).metrics
    torque = 1e3 * record["torque_command"][record.stamps_ns >= SETTLED * 1e9]
    hit = Verdict(simulate(case(suite, seed, "sudden_disturbance", plain=plain), 120.0)).metrics
    recovery = hit.disturbances[-1].recovery_time_s
    return Flight(
        known(found.terminal_error),
        known(found.time_outside_rate_envelope_s),
        float(np.sqrt(np.mean(torque**2))),
        float(np.sqrt(np.mean(np.diff(torque, axis=0) ** 2))),
        known(found.max_rate_deg_s),
        known(found.settling_time_s),
        known(recovery),
    )


def fly_blind(suite: str, seed: int) -> Gap:
    """Fly the paper's case without fixes from 50 to 110 s."""
    blinding: dict[str, Any] = {
        "star_tracker.blinding_times": [BLIND_FROM],
        "star_tracker.blinding_durations": [BLIND_FOR],
    }
    record = simulate(case(suite, seed, **blinding), 120.0)
    end = int(np.searchsorted(record.stamps_ns, (BLIND_FROM + BLIND_FOR) * 1e9))
    variances = record["estimate"][end, [4, 7, 9]]
    return Gap(
        float(knowledge_errors(record).angles[end]) / ARCSEC,
        math.sqrt(variances.sum()) / ARCSEC,
        known(Verdict(record).metrics.terminal_error),
        float(pointing_errors(record).sizes[-1]),
    )


def known(value: float | None) -> float:
    """Return a number, or what no limit admits where the run has none."""
    return math.inf if value is None else value


def row(cells: Sequence[Any]) -> str:
    """Lay out one row of a Markdown table."""
    texts = [each if isinstance(each, str) else f"{each:.3g}" for each in cells]
    return f"| {' | '.join(texts)} |"


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=80)
    parser.add_argument("--suite", choices=SUITES, action="append")
    parser.add_argument("--plain", action="store_true", help="the paper's law as it is")
    arguments = parser.parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + arguments.seeds)
    chosen = arguments.suite or SUITES
    with ProcessPoolExecutor(2) as pool:
        print(f"worst of {len(seeds)} seeds, every second one a cold start")
        print(row(["", "terminal error (median)", *Flight._fields[1:]]))
        for suite in chosen:
            found = np.array(list(pool.map(partial(fly, suite, plain=arguments.plain), seeds)))
            worst, median = found.max(axis=0), np.median(found[:, 0])
            print(row([suite, f"{worst[0]:.3g} ({median:.3g})", *worst[1:]]))
        if arguments.plain:
            return
        print("a minute without fixes")
        print(row(["", "knowledge RMS", "worst", "stated σ", "error median", "worst", "at 120 s"]))
        for suite in chosen:
            gaps = np.array(list(pool.map(partial(fly_blind, suite), seeds)))
            rms, worst = np.sqrt(np.mean(gaps[:, 0] ** 2)), gaps.max(axis=0)
            stated, median = gaps[:, 1].mean(), np.median(gaps[:, 2])
            print(row([suite, rms, worst[0], stated, median, worst[2], worst[3]]))


if __name__ == "__main__":
    main()
