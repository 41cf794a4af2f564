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

import math
from typing import Any

import numpy as np
import pytest
from estimation_helpers import MOUNTING, STEP_NS, Array, suite
from scipy.spatial.transform import Rotation

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import kernel, store_quaternion
from ppc_attitude.science.sensors.star_tracker import (
    NO_FIX,
    is_slot,
    slots,
    star_fix,
    star_tracker_record,
)
from ppc_attitude.science.stamps import span

ATTITUDE = Rotation.from_quat([0.1554, 0.4271, 0.4792, 0.7509])
REST = (0.0, 0.0, 0.0)


def fixes(count: int, omega: tuple[float, float, float] = REST, **given: Any) -> Array:
    values = suite("cubesat", star_tracker__mounting=MOUNTING, **given)
    tracker = star_tracker_record({**values, "rate": 100.0, "seed": 11})
    rows = np.zeros((count, 4))
    take_fixes(tracker, tuple(ATTITUDE.as_quat()), omega, rows)
    return rows


@kernel
def take_fixes(tracker: Any, q: Any, omega: Any, rows: Any) -> None:
    for i in range(len(rows)):
        store_quaternion(rows[i], star_fix(tracker, q, omega, 20 * i * STEP_NS, 20 * i))


def errors(rows: Array) -> Array:
    """Rotation vectors [rad] in tracker axes of fixes of `ATTITUDE`."""
    truth = ATTITUDE * Rotation.from_quat(MOUNTING)
    return np.asarray((truth.inv() * Rotation.from_quat(rows)).as_rotvec())


def test_noise_is_normal_in_tracker_axes() -> None:
    error = errors(fixes(4000)) / [4.8481368111e-05, 4.8481368111e-05, 0.000319977029532]
    covariance = np.cov(error.T)
    assert np.abs(covariance - np.eye(3)).max() < 0.08
    assert np.abs(error.mean(axis=0)).max() < 0.06
    # No step says anything of the next.
    assert np.abs(np.mean(error[1:] * error[:-1], axis=0)).max() < 0.06


def test_false_fixes_are_turned_by_their_size() -> None:
    error = errors(
        fixes(
            2000,
            star_tracker__outlier_probability=0.1,
            star_tracker__outlier_size=0.2,
            star_tracker__cross_noise=0.0,
            star_tracker__boresight_noise=0.0,
        )
    )
    size = np.linalg.norm(error, axis=1)
    false = size > 0.1
    assert np.allclose(size[false], 0.2, rtol=1e-12)
    assert np.allclose(size[~false], 0.0, atol=1e-15)
    assert 0.08 < false.mean() < 0.12
    assert np.abs(error[false].mean(axis=0)).max() < 0.03  # the axes point everywhere


def test_a_false_fix_depends_neither_on_the_noise_nor_on_what_is_missing() -> None:
    given = {"star_tracker__dropout_probability": 0.3, "star_tracker__outlier_size": 0.2}
    good = fixes(20000, **given)
    told = (good != NO_FIX).any(axis=1)
    wrong = fixes(20000, star_tracker__outlier_probability=0.2, **given)
    good, wrong = good[told], wrong[told]
    turns = (Rotation.from_quat(good).inv() * Rotation.from_quat(wrong)).as_rotvec()
    false = np.linalg.norm(turns, axis=1) > 0.1
    assert 0.18 < false.mean() < 0.22
    related = np.corrcoef(np.hstack([turns[false], errors(good[false])]).T)
    assert np.abs(related - np.eye(6)).max() < 0.08


def test_no_fix_by_chance_by_speed_or_blinded() -> None:
    missing = (fixes(2000, star_tracker__dropout_probability=0.3) == NO_FIX).all(axis=1)
    assert 0.27 < missing.mean() < 0.33
    limit = math.radians(3.0)
    assert (fixes(20, (0.0, 0.99 * limit, 0.0)) != NO_FIX).any(axis=1).all()
    assert (fixes(20, (0.0, 0.8 * limit, 0.7 * limit)) == NO_FIX).all()
    blind = fixes(
        40, star_tracker__blinding_times=[2.0, 6.0], star_tracker__blinding_durations=[1.0, 0.5]
    )
    without = np.flatnonzero((blind == NO_FIX).all(axis=1))
    assert without.tolist() == [*range(10, 15), *range(30, 33)]
    blinding = {"star_tracker.blinding_times": [1.12], "star_tracker.blinding_durations": [0.64]}
    tracker = star_tracker_record({**suite("cubesat"), **blinding, "rate": 100.0, "seed": 11})
    assert tuple(tracker["blinding"][0]) == span(1.12, 0.64)


def test_slots() -> None:
    given = {"star_tracker.rate": 10.0, "star_tracker.latency": 0.1}
    assert slots(100.0, given) == (10, 10)
    assert slots(1000.0, {**given, "star_tracker.latency": 0.1004}) == (100, 101)
    assert slots(50.0, {**given, "star_tracker.latency": 0.0}) == (5, 0)
    tracker = star_tracker_record({**suite("cubesat"), "rate": 100.0, "seed": 0})
    assert [k for k in range(-20, 60) if is_slot(tracker, k)] == [0, 20, 40]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"star_tracker.rate": 30.0},
            r"rate = 30.0 Hz does not divide .* is 33.3333333333333\d* Hz",
        ),
        (
            {"star_tracker.rate": 150.0},
            r"rate = 150.0 Hz does not divide .* is 100.0 Hz; rate = 150.0 Hz",
        ),
        ({"star_tracker.latency": 10.0}, r"latency = 10.0 s is 10000 steps .* at most 1000"),
        ({"star_tracker.mounting": [0.0, 0.0, 1.0, 1.0]}, r"mounting .* has norm 1.41421"),
        ({"star_tracker.blinding_times": [1.0]}, r"blinding_times has 1 values, .*durations 0"),
    ],
)
def test_bad_numbers_are_named(given: dict[str, Any], message: str) -> None:
    rate = 1000.0 if "star_tracker.latency" in given else 100.0
    with pytest.raises(ConfigurationError, match=message):
        star_tracker_record({**suite("cubesat"), **given, "rate": rate, "seed": 0})
