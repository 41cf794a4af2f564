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

"""From any motion to rest at a goal: brake, then turn, both relative to the goal's frame."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ppc_attitude.science.attitude import product, to_body
from ppc_attitude.science.guidance.frames import INERTIAL, frame_at
from ppc_attitude.science.guidance.plan import (
    append_polynomial,
    append_turn,
    leg_motion,
    polynomial,
)
from ppc_attitude.science.guidance.rotation import (
    Motion,
    Profile,
    about,
    duration,
    exponential_motion,
    profile,
    relative_to,
    turn_between,
    turned,
)
from ppc_attitude.science.inertia import gyroscopic_share
from ppc_attitude.science.kernel import (
    ZERO,
    Quaternion,
    Vector,
    add,
    kernel,
    norm,
    quaternion,
    scale,
)

_MOST_ATTEMPTS = 40
SAMPLES = 64  # intervals
ROUNDING = 1.0 + 1e-9
_SHORTEST_BRAKE = 1.0  # [s]
_FASTER = 1.01  # times V that a brake with 2 |α|/K may reach
_LONGER = 1.2  # times the rate with which a brake begins: the most that it may reach
_GOES_ON = 4.0 / 27.0  # times α T: most of s (1 − s)², which α adds to the rate after s T
NO_TURN = 1e-12  # [rad]
_SLOWEST = 0.05  # times V: a turn with it keeps V in the fastest spin that is allowed, too


@kernel
def brake_coefficients(
    omega: Vector, alpha: Vector, length: float
) -> tuple[Vector, Vector, Vector, Vector, Vector]:
    """c1 … c5 of φ = ω t + α t²/2 + c3 t³ + c4 t⁴, which is at rest after `length` [s]."""
    c3 = scale(-1.0 / (3.0 * length * length), add(scale(2.0 * length, alpha), scale(3.0, omega)))
    c4 = scale(0.25 / length**3, add(scale(2.0, omega), scale(length, alpha)))
    return omega, scale(0.5, alpha), c3, c4, ZERO


@kernel
def _peaks(omega: Vector, alpha: Vector, length: float) -> tuple[float, float]:
    """Largest rate [rad/s] and acceleration [rad/s²] of 65 even samples of a brake."""
    coefficients = brake_coefficients(omega, alpha, length)
    rate, acceleration = 0.0, 0.0
    for i in range(SAMPLES + 1):
        moved = exponential_motion(*polynomial(coefficients, length * i / SAMPLES))
        rate = max(rate, norm(moved[1]))
        acceleration = max(acceleration, norm(moved[2]))
    return rate, acceleration


@kernel
def brake_length(omega: Vector, alpha: Vector, limits: Any) -> float:
    """Duration [s] of a brake from relative rate ω and acceleration α; negative: none found.

    The first of T · 1.1ᵏ whose 65 even samples keep A, or the present acceleration if that is
    larger, with T = max(1.5 |ω|/A, 2 |α|/K, 1 s). If it passes V, or the present rate if larger, by
    more than 1 %, the search begins anew without 2 |α|/K: with a small K the rate would go far
    beyond. If the rate goes far beyond all the same, as where A was lowered amid a slew, it begins
    anew with T = max(√(1.5 |ω|/A · 1 s), 1 s), which keeps the bound of the jerk (`slew_bounds`). A
    brake that lasts for turns of a fast frame may go far beyond even so: then there is none.
    """
    allowed = max(limits.max_acceleration, norm(alpha)) * ROUNDING
    present = max(limits.max_rate, norm(omega))
    most = max(present * _LONGER, present + _GOES_ON * norm(alpha) * _SHORTEST_BRAKE)
    steady = 1.5 * norm(omega) / limits.max_acceleration
    firm = max(steady, _SHORTEST_BRAKE)
    smooth = max(firm, 2.0 * norm(alpha) / limits.max_jerk)
    hard = max(math.sqrt(steady * _SHORTEST_BRAKE), _SHORTEST_BRAKE)
    for length, fastest in ((smooth, present * _FASTER), (firm, most), (hard, most)):
        for _ in range(_MOST_ATTEMPTS):
            rate, acceleration = _peaks(omega, alpha, length)
            if acceleration <= allowed:
                if rate <= fastest:
                    return length
                break
            length *= 1.1
    return -1.0


@kernel
def append_brake(plan: Any, frame: int, t: float, motion: Motion, guidance: Any, look: Any) -> bool:
    """Add a brake from a motion at t [s] to rest in a frame; False if none is found."""
    look.ahead = look.now
    moving = frame_at(t, frame, plan.spinning, guidance.sky, look.ahead)[0]
    q, omega, alpha = relative_to(moving, motion)
    length = brake_length(omega, alpha, guidance.limits)
    return length > 0.0 and append_polynomial(
        plan, frame, t, length, q, brake_coefficients(omega, alpha, length)
    )


@kernel
def end_attitude(plan: Any) -> Quaternion:
    """Attitude x y z w at the end of the last leg, relative to the leg's frame."""
    leg = plan.legs[plan.count - 1]
    return leg_motion(leg, leg.duration)[0]


@kernel
def _rate_kept(
    plan: Any,
    frame: int,
    t: float,
    start: Quaternion,
    axis: Vector,
    turn: Profile,
    guidance: Any,
    look: Any,
) -> bool:
    """Tell if 65 even samples of |ω_d| over a turn keep V, or the rate at its begin if larger."""
    limits = guidance.limits
    look.ahead = look.now
    allowed = 0.0
    for i in range(SAMPLES + 1):
        s = duration(turn) * i / SAMPLES
        moving = frame_at(t + s, frame, plan.spinning, guidance.sky, look.ahead)[0]
        angle, rate, _ = turned(s, turn, limits.max_jerk)
        q = product(start, about(axis, angle))
        total = norm(add(scale(rate, axis), to_body(moving[1], (q[0], q[1], q[2]), q[3])))
        if i == 0:
            allowed = max(limits.max_rate, total) * ROUNDING
        if total > allowed:
            return False
    return True


@kernel
def append_slew(
    plan: Any,
    frame: int,
    t: float,
    start: Quaternion,
    axis: Vector,
    angle: float,
    guidance: Any,
    look: Any,
) -> bool:
    """Add a turn from rest to rest in a frame, which may move; False if none is found.

    V of its profile is the first of V · 0.95ᵏ with which the whole rate keeps V: the frame turns
    too.
    """
    if angle < NO_TURN:
        plan.end = t
        return True
    limits = guidance.limits
    rate = limits.max_rate
    while rate > _SLOWEST * limits.max_rate:
        turn = profile(angle, rate, limits.max_acceleration, limits.max_jerk)
        if frame == INERTIAL or _rate_kept(plan, frame, t, start, axis, turn, guidance, look):
            return append_turn(plan, frame, t, start, axis, turn, limits.max_jerk)
        rate *= 0.95
    return False


@kernel
def append_approach(
    plan: Any, t: float, motion: Motion, at_rest: bool, guidance: Any, look: Any
) -> bool:
    """Add brake and turn from a motion at t [s] to rest at the plan's goal; False if none is found.

    `at_rest` says that the motion is at rest in the goal's frame, so that no brake is needed.
    """
    start = motion[0]
    if not at_rest:
        if not append_brake(plan, plan.frame, t, motion, guidance, look):
            return False
        t = plan.end
        start = end_attitude(plan)
    axis, angle = turn_between(start, quaternion(plan.attitude))
    return append_slew(plan, plan.frame, t, start, axis, angle, guidance, look)


def slew_bounds(limits: Vector, frames: Vector) -> Vector:
    """Bounds of ‖ω_d‖ [rad/s], ‖ω_d'‖ [rad/s²] and ‖ω_d''‖ [rad/s³] of slews and brakes.

    Parameters
    ----------
    limits : tuple of 3 float
        V [rad/s], A [rad/s²] and K [rad/s³].
    frames : tuple of 3 float
        Largest `frame_bounds` of the frames of all goals.

    Notes
    -----
    In a frame that turns with f a slew turns about e with θ' ≤ V, θ'' ≤ A and θ''' ≤ K:

    ω_d = θ' e + f,  ω_d' = θ'' e + f' − θ' e × f,
    ω_d'' = θ''' e + f'' − 2 θ' e × f' − θ'' e × f + θ'² e × (e × f).

    An order during a slew begins with a brake from the present ω and α relative to the new frame.
    Its time T is the largest of 1 s, 1.5 |ω|/A and 2 |α|/K, and longer by tenths until it keeps A,
    which it does from 2.13 |ω|/A on. Its polynomial first goes on with α. So its rate reaches at
    most 1.2 |ω|, or |ω| + 4/27 |α| 1 s if 1 s is enough; before it has V, a slew has α² ≤ 2 K V.
    Where frames change, α has the terms of both frames. A brake that would reach more lasts less,
    but at least √(1.5 |ω|/A 1 s), or is refused. So its jerk is at most 6 |ω|/T² + 4 |α|/T ≤ (4 A +
    4 |α|)/1 s. That the rate keeps its bound where frames change, too, is tested and not derived.
    """
    V, A, K = limits
    f, first, second = frames
    turning = first + V * f
    bending = second + 2.0 * V * first + (A + V * V) * f
    W1 = ROUNDING * (A + 3.0 * turning)
    alpha = min(A, math.sqrt(2.0 * K * V)) + 3.0 * turning
    W = max(_LONGER * V, V + _GOES_ON * alpha * _SHORTEST_BRAKE) + f
    W2 = max(K, 4.0 * (A + W1) / _SHORTEST_BRAKE) + 3.0 * bending
    return W, W1, W2


def slew_torque(inertia: ArrayLike, rate: float, acceleration: float) -> float:
    """Torque [N·m] that is enough for any slew: max |J e| A + max |ω × J ω|, |ω| ≤ V.

    Parameters
    ----------
    inertia : array_like, shape (3, 3)
        J [kg·m²].
    rate, acceleration : float
        V [rad/s] and A [rad/s²].
    """
    J = np.asarray(inertia, dtype=np.float64)
    most = np.linalg.eigvalsh(J)[-1]
    return float(most * acceleration + gyroscopic_share(J) * rate * rate)
