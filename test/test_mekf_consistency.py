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

"""Many runs of sensors and filter: what the filter says of its own errors is what they are."""

import math
from typing import Any

import numpy as np
import pytest
from estimation_helpers import MOUNTING, STEP_NS, SUITES, known_now, new_memory, suite

from ppc_attitude.science.attitude import conjugate, exponential, logarithm, normalised, product
from ppc_attitude.science.estimators.late_fixes import take_fix, take_sample
from ppc_attitude.science.estimators.mekf import filter_record
from ppc_attitude.science.kernel import add, kernel, scale, store
from ppc_attitude.science.sensors.gyro import (
    NOISE,
    gyro_noise,
    gyro_record,
    gyro_sample,
    walked_bias,
)
from ppc_attitude.science.sensors.star_tracker import is_slot, star_fix, star_tracker_record

RUNS, SECONDS = 200, 100


@kernel
def run(gyro: Any, tracker: Any, settings: Any, memory: Any, pending: Any, rows: Any) -> Any:
    """Turn a craft for as many seconds as there are rows less one, 100 steps each.

    A row has the error (6) and P: θθ (6), θb (9), bb (6). Returns the sum of NIS and its count.
    """
    h = 0.01
    q = normalised((0.1554, 0.4271, 0.4792, 0.7509))
    bias = (gyro.initial_bias[0], gyro.initial_bias[1], gyro.initial_bias[2])
    nis, count = 0.0, 0
    noise = np.zeros(1, NOISE)[0]
    for k in range(100 * (rows.shape[0] - 1) + 1):
        t = k * h
        rate = (0.02 * math.cos(t / 3), 0.02 * math.sin(t / 2), -0.02 * math.cos(t / 4))
        middle = bias
        white, walk = gyro_noise(gyro, k, noise)
        if k > 0:
            q = normalised(product(q, exponential(scale(h, rate))))
            after = walked_bias(gyro, bias, walk, h)
            middle = scale(0.5, add(bias, after))
            bias = after
        take_sample(memory, settings, k * STEP_NS, gyro_sample(gyro, rate, middle, white, h))
        if is_slot(tracker, k):
            fix = star_fix(tracker, q, rate, k * STEP_NS, k)
            for i in range(4):
                pending[k // tracker.every, i] = fix[i]
        valid = k - tracker.delay
        if is_slot(tracker, valid):
            row = pending[valid // tracker.every]
            z, told = take_fix(memory, settings, valid * STEP_NS, (row[0], row[1], row[2], row[3]))
            if told:
                nis += z[0] * z[0] + z[1] * z[1] + z[2] * z[2]
                count += 1
        if k % 100 == 0:
            estimate, b, theta, cross, bias_covariance = known_now(memory)
            row = rows[k // 100]
            if memory.knows != 0.0:
                store(row, logarithm(product(conjugate(estimate), q)))
                store(row[3:], add(bias, scale(-1.0, b)))
                for i in range(6):
                    row[6 + i] = theta[i]
                    row[21 + i] = bias_covariance[i]
                for i in range(3):
                    store(row[12 + 3 * i :], cross[i])
    return nis, count


def covariances(rows: Any) -> Any:
    p = np.empty((*rows.shape[:-1], 6, 6))
    upper = np.triu_indices(3)
    for start, at in ((0, 6), (3, 21)):
        for i, j, column in zip(*upper, range(at, at + 6), strict=True):
            p[..., start + i, start + j] = p[..., start + j, start + i] = rows[..., column]
    p[..., :3, 3:] = rows[..., 12:21].reshape(*rows.shape[:-1], 3, 3)
    p[..., 3:, :3] = np.swapaxes(p[..., :3, 3:], -1, -2)
    return p


@pytest.mark.parametrize(
    "name",  # the limits of the third are those of the second
    [pytest.param(name, marks=[pytest.mark.long] * (name == "smallsat")) for name in SUITES],
)
def test_errors_are_as_large_as_the_filter_says(name: str) -> None:
    values = suite(name, star_tracker__mounting=MOUNTING)
    settings = filter_record(values)
    rows = np.zeros((RUNS, SECONDS + 1, 27))
    pending = np.zeros((100 * SECONDS + 1, 4))
    sums = np.array(
        [
            run(
                gyro_record({**values, "seed": 100 + seed}),
                star_tracker_record({**values, "rate": 100.0, "seed": 100 + seed}),
                settings,
                new_memory(),
                pending,
                rows[seed],
            )
            for seed in range(RUNS)
        ]
    ).sum(axis=0)
    rows = rows[:, 10:]
    error, p = rows[..., :6], covariances(rows)
    # Scaled, because P has rad² and (rad/s)² side by side.
    scales = np.sqrt(np.diagonal(p, axis1=-2, axis2=-1))
    p = p / (scales[..., :, None] * scales[..., None, :])
    whitened = error / scales
    nees = np.einsum("...i,...i", whitened, np.linalg.solve(p, whitened[..., None])[..., 0])
    ensemble = nees.mean(axis=0)
    inside = np.mean((ensemble >= 5.53) & (ensemble <= 6.49))  # 95 % of χ²_1200/200
    # The flagship's bias correlates over minutes: its instants are few independent ones.
    least, low, high = (0.6, 5.5, 6.5) if name == "flagship" else (0.9, 5.8, 6.2)
    assert inside >= least
    assert low <= ensemble.mean() <= high
    assert 2.97 <= sums[0] / sums[1] <= 3.03
    rms = np.sqrt(np.mean(error[..., :3] ** 2))
    assert rms == pytest.approx(np.sqrt(np.mean(scales[..., :3] ** 2)), rel=0.05)
    # Within 3σ per axis: 99.7 % of a normal error.
    assert np.mean(np.abs(whitened[..., :3]) <= 3.0, axis=(0, 1)).min() >= 0.99
