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

"""The desired motion: the paper's ω_d, and the attitude that follows from it."""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import kinematics, moved, normalised, runge_kutta
from ppc_attitude.science.kernel import Quaternion, Vector, kernel, quaternion, store_quaternion

REFERENCE = np.dtype(
    [
        ("initial_attitude", np.float64, (4,)),  # x y z w, desired frame to inertial at t = 0
        ("amplitude", np.float64, (3,)),  # [rad/s]
        ("period_constant", np.float64, (3,)),  # [s]
    ],
    align=True,
)
CURSOR = np.dtype([("steps", np.int64), ("attitude", np.float64, (4,))], align=True)
# The attitude is integrated on this grid whatever the sample rate is, so that it is a function of
# time alone: a generator that joins late or restarts gives the same numbers.
GRID = 0.01  # [s]


@kernel
def desired_rate(t: float, reference: Any) -> Vector:
    """ω_d = a [cos(t/T1), sin(t/T2), −cos(t/T3)] [rad/s], desired frame."""
    a, period = reference.amplitude, reference.period_constant
    return (
        a[0] * math.cos(t / period[0]),
        a[1] * math.sin(t / period[1]),
        -a[2] * math.cos(t / period[2]),
    )


@kernel
def desired_acceleration(t: float, reference: Any) -> Vector:
    """ω_d' [rad/s²], desired frame."""
    a, period = reference.amplitude, reference.period_constant
    return (
        -a[0] / period[0] * math.sin(t / period[0]),
        a[1] / period[1] * math.cos(t / period[1]),
        a[2] / period[2] * math.sin(t / period[2]),
    )


@kernel
def _attitude_step(q: Quaternion, t: float, h: float, reference: Any) -> Quaternion:
    """One Runge-Kutta step of q_d' = ½ q_d ⊗ [ω_d, 0]."""
    middle = desired_rate(t + 0.5 * h, reference)
    k1 = kinematics(q, desired_rate(t, reference))
    k2 = kinematics(moved(q, 0.5 * h, k1), middle)
    k3 = kinematics(moved(q, 0.5 * h, k2), middle)
    k4 = kinematics(moved(q, h, k3), desired_rate(t + h, reference))
    return runge_kutta(q, h, k1, k2, k3, k4)


def new_cursor() -> Any:
    """Where the integration of a reference stands; a zero attitude means: not begun."""
    return np.zeros((), CURSOR)[()]


@kernel
def desired_attitude(t: float, reference: Any, cursor: Any) -> Quaternion:
    """q_d(t), x y z w, desired frame to inertial.

    Parameters
    ----------
    t
        Time [s], t ≥ 0.
    reference
        Record of dtype `REFERENCE`.
    cursor
        Record of dtype `CURSOR`: the last grid point, so that the next call goes on from there.
        A call for an earlier time begins again.
    """
    whole = math.floor(t / GRID)
    q = quaternion(cursor.attitude)
    if q == (0.0, 0.0, 0.0, 0.0) or cursor.steps > whole:
        cursor.steps = 0
        q = normalised(quaternion(reference.initial_attitude))
    for step in range(cursor.steps, whole):
        q = _attitude_step(q, step * GRID, GRID, reference)
    cursor.steps = whole
    store_quaternion(cursor.attitude, q)
    rest = t - whole * GRID
    if rest > 0.0:
        return _attitude_step(q, whole * GRID, rest, reference)
    return q


@kernel
def desired_motion(t: float, reference: Any, cursor: Any) -> tuple[Quaternion, Vector, Vector]:
    """q_d, ω_d [rad/s] and ω_d' [rad/s²] at t [s]; the cursor as in `desired_attitude`."""
    return (
        desired_attitude(t, reference, cursor),
        desired_rate(t, reference),
        desired_acceleration(t, reference),
    )


@kernel
def motion_at(t: float, references: Any, cursors: Any) -> tuple[Quaternion, Vector, Vector]:
    """`desired_motion` for a caller in Python: arrays of one record each (`kernel.one`)."""
    return desired_motion(t, references[0], cursors[0])
