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

"""The paper's desired motion: ω_d (eq. 35), and the attitude that follows from it."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import (
    euler_step,
    kinematics,
    normalised,
    runge_kutta,
    unit_quaternion,
)
from ppc_attitude.science.component import Component
from ppc_attitude.science.kernel import (
    NO_ATTITUDE,
    STRAIGHT,
    Quaternion,
    Vector,
    kernel,
    norm,
    quaternion,
    store,
    store_quaternion,
)
from ppc_attitude.science.parameter import Parameter, at_start, filled, record_type
from ppc_attitude.science.signals import DESIRED_MOTION

HALF_DEGREE = 0.008726646259971648  # 0.5°/s in rad/s
# The attitude is integrated on this grid whatever the sample rate is, so that it is a function of
# time alone: a generator that joins late or restarts gives the same numbers.
GRID = 0.01  # [s]
# Only at start: `ros2 param load` sends a node the sections of all nodes, and the plant's has a
# parameter of this name, too.
INITIAL_ATTITUDE = at_start(
    "initial_attitude",
    [0.2, -0.5, -0.5, -0.6782],
    "desired attitude at t = 0, x y z w, desired frame to inertial; normalised if within 1e-3",
    length=4,
    quaternion=True,
)
AMPLITUDE = Parameter(
    "amplitude",
    [HALF_DEGREE] * 3,
    "a of ω_d = a [cos(t/T1), sin(t/T2), −cos(t/T3)]; zeros: a fixed attitude",
    "rad/s",
    length=3,
    low=-10.0,
    high=10.0,
)
# At the lower bound the attitude is off by 4e-6 rad for each rad/s of the amplitude; far below it
# the grid would not see ω_d change its sign, and the attitude would turn on and on.
PERIOD_CONSTANT = Parameter(
    "period_constant", [30.0, 20.0, 40.0], "T1, T2, T3 of ω_d", "s", length=3, low=GRID
)
BEGIN = Parameter("begin", 0.0, "time of ω_d at which a run begins", "s", low=0.0, high=1e9)
REFERENCE = record_type(INITIAL_ATTITUDE, AMPLITUDE, PERIOD_CONSTANT, BEGIN)
CURSOR = record_type(("steps", np.int64), ("attitude", np.float64, (4,)))
_SEARCHED = 1e-3  # [s] of the grid on which the fastest instant is searched
_MOST = 1e7  # points of that grid


@kernel
def desired_rate(t: float, reference: Any) -> Vector:
    """ω_d = a [cos(t/T1), sin(t/T2), −cos(t/T3)] [rad/s], desired frame."""
    a, period = reference.amplitude, reference.period_constant
    t += reference.begin
    return (
        a[0] * math.cos(t / period[0]),
        a[1] * math.sin(t / period[1]),
        -a[2] * math.cos(t / period[2]),
    )


@kernel
def desired_acceleration(t: float, reference: Any) -> Vector:
    """ω_d' [rad/s²], desired frame."""
    a, period = reference.amplitude, reference.period_constant
    t += reference.begin
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
    k2 = kinematics(euler_step(q, 0.5 * h, k1), middle)
    k3 = kinematics(euler_step(q, 0.5 * h, k2), middle)
    k4 = kinematics(euler_step(q, h, k3), desired_rate(t + h, reference))
    return runge_kutta(q, h, k1, k2, k3, k4)


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values.

    Raises
    ------
    ConfigurationError
        The initial attitude is not a unit quaternion.
    """
    first = unit_quaternion("initial_attitude", values["initial_attitude"])
    return filled(REFERENCE, values, initial_attitude=first)


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
    if q == NO_ATTITUDE or cursor.steps > whole:
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
def step(inputs: Any, cursor: Any, reference: Any, outputs: Any) -> None:
    """Give q_d, ω_d [rad/s] and ω_d' [rad/s²] of an instant."""
    t = inputs.t
    store_quaternion(outputs.reference_attitude, desired_attitude(t, reference, cursor))
    store(outputs.reference_angular_velocity, desired_rate(t, reference))
    store(outputs.reference_angular_acceleration, desired_acceleration(t, reference))


def motion_bounds(values: Mapping[str, Any], duration: float) -> tuple[float, float, float]:
    """Bounds of ‖ω_d‖ [rad/s], ‖ω_d'‖ [rad/s²] and ‖ω_d''‖ [rad/s³] for a time [s].

    The first two are searched on a grid; what they may gain between two points is added.
    """
    record = filled(REFERENCE, values, initial_attitude=STRAIGHT)
    searched = max(_SEARCHED, duration / _MOST)
    first = float(np.linalg.norm(record["amplitude"] / record["period_constant"]))
    second = float(np.linalg.norm(record["amplitude"] / record["period_constant"] ** 2))
    rate, acceleration = _largest_on_grid(math.ceil(duration / searched) + 1, searched, record)
    return rate + 0.5 * searched * first, acceleration + 0.5 * searched * second, second


@kernel
def _largest_on_grid(count: int, grid: float, reference: Any) -> tuple[float, float]:
    """Largest ‖ω_d‖ [rad/s] and ‖ω_d'‖ [rad/s²] at `count` points of the grid."""
    rate, acceleration = 0.0, 0.0
    for i in range(count):
        rate = max(rate, norm(desired_rate(i * grid, reference)))
        acceleration = max(acceleration, norm(desired_acceleration(i * grid, reference)))
    return rate, acceleration


COMPONENT = Component(
    name="paper",
    parameters=(INITIAL_ATTITUDE, AMPLITUDE, PERIOD_CONSTANT, BEGIN),
    configure=configure,
    configuration=REFERENCE,
    state=CURSOR,
    outputs=DESIRED_MOTION,
    step=step,
    quiet={AMPLITUDE.name: [0.0] * 3},
    motion_bounds=motion_bounds,
)
