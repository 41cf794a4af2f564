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

"""The brake, its cap and the axis of the error, against closed forms and difference quotients."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ppc_attitude.science.controllers.brake import (
    BLEND,
    axis_rate,
    brake,
    capped_brake,
    deceleration,
    error_axis,
    speed_limit,
)

STEP = 1e-6


@pytest.mark.parametrize("cap", [0.01, 0.03, 0.06])
def test_brake_is_smooth_and_never_asks_for_more_than_its_deceleration(cap: float) -> None:
    k, a = 1.3, 0.0127
    for phi in np.linspace(1e-4, 4.0, 2001):
        f, f_phi, f_cap, f_a = capped_brake(phi, k, a, cap)
        right, left = (capped_brake(phi + d, k, a, cap)[0] for d in (STEP, -STEP))
        assert f_phi == pytest.approx((right - left) / (2 * STEP), abs=2e-6)
        right, left = (capped_brake(phi, k, a, cap + d)[0] for d in (STEP, -STEP))
        assert f_cap == pytest.approx((right - left) / (2 * STEP), abs=1e-4)
        right, left = (capped_brake(phi, k, a + d, cap)[0] for d in (STEP, -STEP))
        assert f_a == pytest.approx((right - left) / (2 * STEP), abs=1e-3)
        assert f <= min(brake(phi, k, a)[0], cap) * (1 + 1e-15)
        assert f * f_phi <= a * (1 + 1e-12)


def test_deceleration_is_what_the_torque_allows_about_each_axis() -> None:
    random = np.random.default_rng(2)
    J = np.array([[2.8, 0.2, -0.1], [0.2, 2.5, 0.3], [-0.1, 0.3, 1.9]])
    inertia, torque, most = tuple(map(tuple, J)), (0.034, 0.03, 0.036), 0.017
    for _ in range(200):
        n, omega = (each / np.linalg.norm(each) for each in random.normal(size=(2, 3)))
        n_rate = np.cross(omega, n)
        a, a_rate = deceleration(tuple(n), tuple(n_rate), inertia, torque, most)
        allowed = min(most, *(np.array(torque) / np.abs(J @ n)))
        assert 4.0 ** (-1 / 16) * allowed * (1 - 1e-12) <= a <= allowed

        def at(t: float, n: Any = n, omega: Any = omega) -> float:
            turned = Rotation.from_rotvec(t * omega).apply(n)
            return deceleration(tuple(turned), (0.0, 0.0, 0.0), inertia, torque, most)[0]

        assert a_rate == pytest.approx((at(STEP) - at(-STEP)) / (2 * STEP), abs=1e-7)
    assert deceleration((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), inertia, torque, most) == (most, 0.0)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_cap_is_where_the_commanded_rate_reaches_its_limit_however_the_axis_turns(
    way: float,
) -> None:
    random = np.random.default_rng(3)
    still, limit = (0.0, 0.0, 0.0), 0.05
    assert speed_limit(still, still, (0.0, 0.03, 0.0), still, limit) == (pytest.approx(0.04), 0.0)
    for error in Rotation.random(200, random_state=random):
        omega, omega_d, acceleration_d = random.uniform(-0.02, 0.02, (3, 3))

        def axis_at(t: float, error: Any = error, omega: Any = omega) -> tuple[Any, float]:
            return error_axis(tuple((error * Rotation.from_rotvec(t * omega)).as_quat()), way)

        def cap_at(t: float, of: Any = axis_at, w: Any = omega_d, a: Any = acceleration_d) -> float:
            return speed_limit(of(t)[0], still, tuple(w + t * a), still, limit)[0]

        n, phi = axis_at(0.0)
        assert (error * Rotation.from_rotvec(phi * np.array(n)).inv()).magnitude() < 1e-7
        turn = np.array(axis_rate(n, phi, tuple(omega)))
        n_rate = np.subtract(axis_at(STEP)[0], axis_at(-STEP)[0]) / (2 * STEP)
        assert turn == pytest.approx(2.0 * math.sin(0.5 * phi) * n_rate, abs=1e-8)
        n_rate = tuple(turn / (2.0 * math.sin(0.5 * phi)))
        cap, cap_rate = speed_limit(n, n_rate, tuple(omega_d), tuple(acceleration_d), limit)
        assert cap > n @ omega_d
        assert np.linalg.norm(omega_d - cap * np.array(n)) == pytest.approx(limit, rel=1e-12)
        assert cap_rate == pytest.approx((cap_at(STEP) - cap_at(-STEP)) / (2 * STEP), abs=1e-7)


def test_full_cap_and_no_cap_meet_the_parabola() -> None:
    k, a, cap = 1.3, 0.0127, 0.03
    for x, f in ((1.0 - BLEND, 1.0 - BLEND), (1.0 + BLEND, 1.0)):
        phi = ((x * cap) ** 2 + (a / k) ** 2) / (2 * a)  # where g = x V
        assert capped_brake(phi, k, a, cap)[0] == pytest.approx(f * cap, rel=1e-12)
