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

import numpy as np
import pytest
from estimation_helpers import angles_between
from record_helpers import new_record
from scipy.integrate import solve_ivp

from ppc_attitude.science.references.paper import (
    COMPONENT,
    CURSOR,
    PERIOD_CONSTANT,
    REFERENCE,
    desired_acceleration,
    desired_attitude,
    desired_rate,
    motion_bounds,
)

HALF_DEGREE = np.deg2rad(0.5)


def paper() -> np.void:
    record = new_record(REFERENCE)
    start = np.array([0.2, -0.5, -0.5, -0.6782])
    record["initial_attitude"] = start / np.linalg.norm(start)
    record["amplitude"] = HALF_DEGREE
    record["period_constant"] = (30.0, 20.0, 40.0)
    return record


def rate(t: float) -> np.ndarray:
    """ω_d as the paper prints it, in rad/s."""
    return HALF_DEGREE * np.array([np.cos(t / 30.0), np.sin(t / 20.0), -np.cos(t / 40.0)])


def test_rate_is_the_papers() -> None:
    for t in (0.0, 1.0, 37.5, 119.99):
        assert np.allclose(desired_rate(t, paper()), rate(t), rtol=1e-15)


def test_a_run_may_begin_at_a_later_instant_of_the_motion() -> None:
    later = paper()
    later["begin"] = 37.5
    for t in (0.0, 1.0, 119.99):
        assert desired_rate(t, later) == desired_rate(t + 37.5, paper())
        assert desired_acceleration(t, later) == desired_acceleration(t + 37.5, paper())


def test_largest_rate_is_as_stated() -> None:
    times = np.linspace(0.0, 120.0, 12_001)
    norms = [np.linalg.norm(desired_rate(t, paper())) for t in times]
    assert np.rad2deg(max(norms)) == pytest.approx(0.797, abs=5e-4)


def test_acceleration_is_the_derivative_of_the_rate() -> None:
    for t in np.linspace(0.0, 120.0, 50):
        h = 1e-3
        expected = (rate(t + h) - rate(t - h)) / (2.0 * h)
        assert np.allclose(desired_acceleration(t, paper()), expected, rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("period", [PERIOD_CONSTANT.low, 0.05, 0.7])
def test_attitude_is_the_integral_of_the_fastest_swing_that_is_allowed(period: float) -> None:
    """About one axis the angle is ∫ a cos(t/T) dt = a T sin(t/T)."""
    swing, cursor = paper(), new_record(CURSOR)
    swing["initial_attitude"] = (0.0, 0.0, 0.0, 1.0)
    swing["amplitude"], swing["period_constant"] = (1.0, 0.0, 0.0), (period, 1.0, 1.0)
    for t in np.arange(0.0, 60.0, 0.13):
        x, y, z, w = desired_attitude(t, swing, cursor)
        angle = period * np.sin(t / period)
        assert 2.0 * np.arctan2(x, w) == pytest.approx(angle, rel=0.0, abs=4e-6)
        assert (y, z) == (0.0, 0.0)


def test_attitude_solves_the_kinematics() -> None:
    def slope(t: float, q: np.ndarray) -> np.ndarray:
        x, y, z, w = q
        a, b, c = rate(t)
        return 0.5 * np.array(
            [
                w * a + y * c - z * b,
                w * b + z * a - x * c,
                w * c + x * b - y * a,
                -x * a - y * b - z * c,
            ]
        )

    times = np.linspace(0.0, 120.0, 13)
    true = solve_ivp(
        slope,
        (0.0, 120.0),
        paper()["initial_attitude"],
        method="DOP853",
        t_eval=times,
        rtol=1e-13,
        atol=1e-15,
    ).y.T
    cursor = new_record(CURSOR)
    for t, q in zip(times, true, strict=True):
        ours = np.array(desired_attitude(float(t), paper(), cursor))
        assert angles_between(ours, q) < 1e-11


def test_bounds_of_long_motions_are_searched_with_wider_steps() -> None:
    """Of 1e7 s a grid as fine as that of an hour has 1e10 points."""
    values = {each.name: each.default for each in COMPONENT.parameters}
    hour, months = motion_bounds(values, 3600.0), motion_bounds(values, 1e7)
    assert all(a <= b <= 1.05 * a for a, b in zip(hour, months, strict=True))


TIMES = [0.0, 0.004, 0.01, 3.3333, 59.995, 60.0, 119.99]
ORDERS = {
    "forward": TIMES,
    "backward": TIMES[::-1],
    "after a later one": [200.0, *TIMES],
    "finely": [*np.arange(0.0, 119.99, 0.007), 119.99],
}


@pytest.mark.parametrize("order", ORDERS)
def test_attitude_is_a_function_of_time_alone(order: str) -> None:
    cursor = new_record(CURSOR)
    found = {t: desired_attitude(t, paper(), cursor) for t in ORDERS[order]}
    for t in found.keys() & TIMES:
        assert found[t] == desired_attitude(t, paper(), new_record(CURSOR))  # to the last bit


def test_a_fixed_attitude_stays() -> None:
    record = paper()
    record["amplitude"] = 0.0
    q = desired_attitude(500.0, record, new_record(CURSOR))
    omega, acceleration = desired_rate(500.0, record), desired_acceleration(500.0, record)
    assert np.allclose(q, record["initial_attitude"], atol=1e-15)
    assert np.all(np.array([*omega, *acceleration]) == 0.0)
