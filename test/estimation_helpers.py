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

"""Sensor suites as shipped, and compiled loops around the filter's kernels."""

from functools import cache
from typing import Any

import numpy as np
import yaml
from craft_helpers import ROOT, dotted
from scipy.spatial.transform import Rotation

from ppc_attitude.contract.run_record import Array
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.estimators.late_fixes import (
    MEMORY,
    newest,
    recalled,
    take_fix,
    take_sample,
)
from ppc_attitude.science.estimators.mekf import filter_record
from ppc_attitude.science.kernel import kernel
from ppc_attitude.science.parameter import resolved
from ppc_attitude.science.sensors import gyro, star_tracker

SUITES = ("flagship", "smallsat", "cubesat")
STEP_NS = 10_000_000  # of 100 Hz
MOUNTING = [0.33441742171096, 0.668834843421919, -0.33441742171096, 0.573576436351046]
"""A star tracker's, in no plane of the body."""


def suite(name: str, **given: Any) -> dict[str, Any]:
    """Complete parameters of sensors and filter of a shipped overlay; dots of names as __."""
    text = (ROOT / "config" / f"sensors_{name}.yaml").read_text(encoding="utf-8")
    groups = yaml.safe_load(text)["/**"]["ros__parameters"]
    values = {
        f"{group}.{key}": value
        for group in ("gyro", "star_tracker")
        for key, value in groups[group].items()
    }
    values |= dotted(given)
    table = {p.name: p for p in (*gyro.PARAMETERS, *star_tracker.PARAMETERS, *mekf.PARAMETERS)}
    return dict(resolved(table.values(), values, "suite"))


def new_memory() -> Any:
    return np.zeros((), MEMORY)[()]


@kernel
def known_now(memory: Any) -> Any:
    return recalled(memory, newest(memory))


@kernel
def write_knowledge(memory: Any, row: Any) -> None:
    """Write q̂, b̂ and the standard deviations of δθ and δb: 13 numbers."""
    q, b, theta, _, bias = known_now(memory)
    for i in range(4):
        row[i] = q[i]
    for i in range(3):
        row[4 + i] = b[i]
    row[7], row[8], row[9] = theta[0] ** 0.5, theta[3] ** 0.5, theta[5] ** 0.5
    row[10], row[11], row[12] = bias[0] ** 0.5, bias[3] ** 0.5, bias[5] ** 0.5


@kernel
def filtered(
    memory: Any, settings: Any, rates: Any, valid: Any, arrival: Any, fixes: Any, rows: Any
) -> None:
    """Run a filter over gyro samples (row 0 at step 0) and fixes in the order of arrival.

    Parameters
    ----------
    valid, arrival
        Steps of each fix.
    rows
        What is known after each step, by `write_knowledge`; untouched without an estimate.
    """
    j = 0
    for k in range(rates.shape[0]):
        take_sample(memory, settings, k * STEP_NS, (rates[k, 0], rates[k, 1], rates[k, 2]))
        while j < arrival.size and arrival[j] == k:
            fix = (fixes[j, 0], fixes[j, 1], fixes[j, 2], fixes[j, 3])
            take_fix(memory, settings, valid[j] * STEP_NS, fix)
            j += 1
        if memory.knows != 0.0:
            write_knowledge(memory, rows[k])


def angles_between(q: Array, p: Array) -> Array:
    """Angles [rad] between attitudes, exact where the arc cosine is not."""
    chord = np.minimum(np.linalg.norm(q - p, axis=-1), np.linalg.norm(q + p, axis=-1))
    return np.asarray(4.0 * np.arcsin(0.5 * chord))


def run(settings: Any, rates: Array, valid: Any, arrival: Any, fixes: Array) -> tuple[Any, Array]:
    memory, rows = new_memory(), np.full((len(rates), 13), np.nan)
    filtered(memory, settings, rates, valid, arrival, fixes, rows)
    return memory, rows


@cache
def turning(seconds: float) -> tuple[Array, Array]:
    """Rates [rad/s] held over each step of 0.01 s (row k ends at step k) and exact attitudes."""
    t = 0.01 * np.arange(round(100 * seconds) + 1)
    rates = 0.02 * np.stack([np.cos(t / 3), np.sin(t / 2), -np.cos(t / 4)], axis=1)
    q = [Rotation.from_quat([0.1554, 0.4271, 0.4792, 0.7509])]
    for turn in Rotation.from_rotvec(0.01 * rates[1:]):
        q.append(q[-1] * turn)
    return rates, Rotation.concatenate(q).as_quat()


SLOTS = {"smallsat": 10, "cubesat": 20}


def noisy(name: str, seconds: float, seed: int) -> tuple[Any, Array, Array, Any, Any, Array]:
    """`turning` as the sensors of a suite see it; noise of NumPy's generator, bias as drawn."""
    values, rng = suite(name), np.random.default_rng(seed)
    every = SLOTS.get(name, 10)
    rates, truth = turning(seconds)
    n, h = len(rates), 0.01
    white = np.hypot(
        values["gyro.angular_random_walk"], values["gyro.resolution"] * np.sqrt(h / 12.0)
    )
    walk = values["gyro.rate_random_walk"] * np.sqrt(h) * rng.normal(size=(n, 3))
    bias = values["gyro.initial_bias_sigma"] * rng.normal(size=3) + walk.cumsum(axis=0)
    measured = rates + bias + white / np.sqrt(h) * rng.normal(size=(n, 3))
    valid = np.arange(0, n, every)
    sigma = [values["star_tracker.cross_noise"]] * 2 + [values["star_tracker.boresight_noise"]]
    noise = Rotation.from_rotvec(rng.normal(size=(valid.size, 3)) * sigma)
    fixes = (Rotation.from_quat(truth[valid]) * noise).as_quat()
    return filter_record(values), measured, truth, valid, valid + every, fixes


def begun(steps: int, at: int = 0, valid: int = 0) -> tuple[Any, Array, Any]:
    """Settings, truth and memory after so many steps, at one of which the first fix came."""
    settings, rates, truth, *_ = noisy("smallsat", 12.0, 3)
    memory = new_memory()
    for k, rate in enumerate(rates[:steps].tolist()):
        take_sample(memory, settings, k * STEP_NS, tuple(rate))
        if k == at:
            take_fix(memory, settings, valid * STEP_NS, tuple(truth[valid]))
    return settings, truth, memory
