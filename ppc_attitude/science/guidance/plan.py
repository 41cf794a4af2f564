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

"""A plan: legs strung together, each a motion relative to one frame, then rest at the goal."""

from typing import Any

import numpy as np

from ppc_attitude.science.guidance.frames import SPINNING, frame_at
from ppc_attitude.science.guidance.rotation import (
    Motion,
    Profile,
    about,
    composed,
    duration,
    exponential_motion,
    moved_by,
    standing,
    turned,
)
from ppc_attitude.science.kernel import (
    ZERO,
    Quaternion,
    Vector,
    add,
    kernel,
    quaternion,
    scale,
    store,
    store_quaternion,
    vector,
)
from ppc_attitude.science.orbit import CURSOR
from ppc_attitude.science.parameter import record_type

MOST_LEGS = 64
LIMITS = record_type(
    ("max_rate", np.float64),  # V [rad/s]
    ("max_acceleration", np.float64),  # A [rad/s²]
    ("max_jerk", np.float64),  # K [rad/s³]
)
LEG = record_type(
    ("frame", np.int64),
    ("begin", np.float64),  # [s]
    ("duration", np.float64),  # [s]
    ("attitude", np.float64, (4,)),  # x y z w, relative to the frame, at the begin
    # A turn about an eigenaxis, or else φ(t) = c1 t + … + c5 t⁵.
    ("axis", np.float64, (3,)),  # unit; zero: the polynomial
    ("profile", np.float64, (4,)),
    ("jerk", np.float64),  # of the profile [rad/s³]
    ("coefficients", np.float64, (5, 3)),  # [rad/s] … [rad/s⁵]
)
PLAN = record_type(
    ("frame", np.int64),  # of the goal
    ("attitude", np.float64, (4,)),  # of the goal, x y z w, relative to the frame
    ("spinning", SPINNING),
    ("end", np.float64),  # [s] from here on at the goal
    ("count", np.int64),
    ("legs", LEG, (MOST_LEGS,)),
)
# Two cursors of the orbit: one for the present, one for looking ahead.
LOOK = record_type(("now", CURSOR), ("ahead", CURSOR))


@kernel
def polynomial(coefficients: Any, t: float) -> tuple[Vector, Vector, Vector]:
    """φ = c1 t + … + c5 t⁵ [rad] at t [s], with φ' [rad/s] and φ'' [rad/s²]."""
    phi, first, second = ZERO, ZERO, ZERO
    for i in range(4, -1, -1):
        second = add(scale(t, second), scale(2.0, first))
        first = add(scale(t, first), phi)
        phi = add(scale(t, phi), vector(coefficients[i]))
    # Horner's rule ran over c1 + … + c5 t⁴ = φ/t.
    return scale(t, phi), add(phi, scale(t, first)), add(scale(2.0, first), scale(t, second))


@kernel
def leg_motion(leg: Any, t: float) -> Motion:
    """Motion of a leg relative to its frame, t [s] after its start."""
    axis = vector(leg.axis)
    start = quaternion(leg.attitude)
    if axis == ZERO:
        return moved_by(start, exponential_motion(*polynomial(leg.coefficients, t)))
    angle, rate, acceleration = turned(t, quaternion(leg.profile), leg.jerk)
    return moved_by(start, (about(axis, angle), scale(rate, axis), scale(acceleration, axis)))


@kernel
def plan_motion(t: float, plan: Any, sky: Any, cursor: Any) -> Motion:
    """q_d, ω_d [rad/s] and ω_d' [rad/s²] of a plan at t [s]."""
    if t >= plan.end:
        frame = frame_at(t, plan.frame, plan.spinning, sky, cursor)[0]
        return composed(frame, standing(quaternion(plan.attitude)))
    i = 0
    while i + 1 < plan.count and plan.legs[i + 1].begin <= t:
        i += 1
    leg = plan.legs[i]
    frame = frame_at(t, leg.frame, plan.spinning, sky, cursor)[0]
    return composed(frame, leg_motion(leg, min(t - leg.begin, leg.duration)))


@kernel
def start_plan(plan: Any, frame: int, attitude: Quaternion, t: float) -> None:
    """Empty a plan: at rest at an attitude relative to a frame, from t [s] on."""
    plan.frame = frame
    store_quaternion(plan.attitude, attitude)
    plan.end = t
    plan.count = 0


@kernel
def append_turn(
    plan: Any, frame: int, begin: float, start: Quaternion, axis: Vector, turn: Profile, jerk: float
) -> bool:
    """Add a turn about an eigenaxis, from rest to rest; False if the plan is full."""
    if not _append_leg(plan, frame, begin, duration(turn), start):
        return False
    leg = plan.legs[plan.count - 1]
    store(leg.axis, axis)
    store_quaternion(leg.profile, turn)
    leg.jerk = jerk
    return True


@kernel
def append_polynomial(
    plan: Any, frame: int, begin: float, length: float, start: Quaternion, coefficients: Any
) -> bool:
    """Add a motion q = start ⊗ Exp(φ(t)), φ = c1 t + … + c5 t⁵; False if the plan is full."""
    if not _append_leg(plan, frame, begin, length, start):
        return False
    leg = plan.legs[plan.count - 1]
    store(leg.axis, ZERO)
    for i in range(5):
        store(leg.coefficients[i], coefficients[i])
    return True


@kernel
def _append_leg(plan: Any, frame: int, begin: float, length: float, start: Quaternion) -> bool:
    """Add a leg whose motion is still to be told; False if the plan is full."""
    if plan.count == MOST_LEGS:
        return False
    leg = plan.legs[plan.count]
    leg.frame = frame
    leg.begin = begin
    leg.duration = length
    store_quaternion(leg.attitude, start)
    plan.end = begin + length
    plan.count += 1
    return True
