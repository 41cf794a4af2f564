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

"""Rotation vectors, motions relative to a frame that moves itself, and turns about one axis.

A motion is attitude, rate [rad/s] and acceleration [rad/s²], both in the moving axes.
"""

import math
from typing import TypeAlias

from ppc_attitude.science.attitude import conjugate, exponential, normalised, product, to_body
from ppc_attitude.science.kernel import (
    ZERO,
    Quaternion,
    Vector,
    add,
    cross,
    dot,
    kernel,
    norm,
    scale,
    subtract,
    vector,
)

Motion: TypeAlias = tuple[Quaternion, Vector, Vector]
# Angle φ [rad], and the times t_j, t_a, t_v [s] of a jerk phase, an acceleration phase, the cruise.
Profile: TypeAlias = tuple[float, float, float, float]

_SMALL = 0.01  # [rad] below this the series are better than the closed forms
_ROUNDED = 1e-12  # of a unit quaternion: a part below this may be zero


@kernel
def about(axis: Vector, angle: float) -> Quaternion:
    """Rotation by an angle [rad] about a unit axis."""
    s = math.sin(0.5 * angle)
    return (s * axis[0], s * axis[1], s * axis[2], math.cos(0.5 * angle))


@kernel
def axis_and_angle(q: Quaternion) -> tuple[Vector, float]:
    """Eigenaxis and angle [rad], 0 to π, of a rotation, the short way.

    For half a turn the axis is the one whose first component beyond rounding is positive. For no
    turn the angle is 0 and the axis arbitrary.
    """
    v = vector(q)
    sine = norm(v)
    if sine == 0.0:
        return (1.0, 0.0, 0.0), 0.0
    sign = 1.0 if q[3] >= 0.0 else -1.0
    if abs(q[3]) < _ROUNDED:
        first = v[2]
        if abs(v[1]) > _ROUNDED:
            first = v[1]
        if abs(v[0]) > _ROUNDED:
            first = v[0]
        sign = 1.0 if first > 0.0 else -1.0
    return scale(sign / sine, v), 2.0 * math.atan2(sine, abs(q[3]))


@kernel
def turn_between(a: Quaternion, b: Quaternion) -> tuple[Vector, float]:
    """Eigenaxis, the same in both, and angle [rad] of the turn from one attitude to another."""
    return axis_and_angle(product(conjugate(a), b))


@kernel
def exponential_motion(phi: Vector, first: Vector, second: Vector) -> Motion:
    """Exp(φ(t)) with its rate and acceleration, from φ, φ' and φ''.

    ω = φ' − a φ × φ' + b φ × (φ × φ'), a = (1 − cos θ)/θ², b = (θ − sin θ)/θ³, θ = |φ|; the
    acceleration is its derivative by the product rule.
    """
    theta = norm(phi)
    squared = theta * theta
    if theta < _SMALL:
        a = 0.5 - squared / 24.0 + squared * squared / 720.0
        b = 1.0 / 6.0 - squared / 120.0 + squared * squared / 5040.0
        a_slope = -1.0 / 12.0 + squared / 180.0  # (da/dθ)/θ
        b_slope = -1.0 / 60.0 + squared / 1260.0
    else:
        half = math.sin(0.5 * theta) / theta
        a = 2.0 * half * half
        b = (theta - math.sin(theta)) / (squared * theta)
        a_slope = (math.sin(theta) / theta - 2.0 * a) / squared
        b_slope = (a - 3.0 * b) / squared
    growth = dot(phi, first)  # θ θ'
    c1 = cross(phi, first)
    cc1 = cross(phi, c1)
    c2 = cross(phi, second)
    cc2 = cross(phi, c2)
    rate = add(first, add(scale(-a, c1), scale(b, cc1)))
    acceleration = add(
        add(second, add(scale(-a, c2), scale(b, cc2))),
        add(
            add(scale(-a_slope * growth, c1), scale(b_slope * growth, cc1)),
            scale(b, cross(first, c1)),
        ),
    )
    return exponential(phi), rate, acceleration


@kernel
def rotation_vector_rates(phi: Vector, omega: Vector, alpha: Vector) -> tuple[Vector, Vector]:
    """φ' and φ'' of Exp(φ(t)) from its ω and α: the inverse of `exponential_motion`.

    φ' = ω + ½ φ × ω + c φ × (φ × ω), c = (1 − (θ/2) cot(θ/2))/θ², |φ| < 2π.
    """
    theta = norm(phi)
    squared = theta * theta
    if theta < _SMALL:
        c = 1.0 / 12.0 + squared / 720.0 + squared * squared / 30240.0
        c_slope = 1.0 / 360.0 + squared / 7560.0  # (dc/dθ)/θ
    else:
        half = 0.5 * theta
        cotangent = half / math.tan(half)
        c = (1.0 - cotangent) / squared
        # d(θ/2 cot θ/2)/dθ = ½ cot − (θ/4)/sin² = (u − θ²/4 − u²)/θ with u = θ/2 cot θ/2
        c_slope = (-(cotangent - half * half - cotangent * cotangent) / squared - 2.0 * c) / squared
    turned = cross(phi, omega)
    first = add(omega, add(scale(0.5, turned), scale(c, cross(phi, turned))))
    turned_rate = add(cross(first, omega), cross(phi, alpha))
    second = add(
        add(alpha, scale(0.5, turned_rate)),
        add(
            scale(c_slope * dot(phi, first), cross(phi, turned)),
            scale(c, add(cross(first, turned), cross(phi, turned_rate))),
        ),
    )
    return first, second


@kernel
def composed(frame: Motion, relative: Motion) -> Motion:
    """Motion in inertial space, from a motion relative to a frame that itself moves.

    ω_d = ω_rel + C ω_frame, ω_d' = α_rel + C ω_frame' − ω_rel × C ω_frame.
    """
    q, omega, alpha = relative
    axis, scalar = vector(q), q[3]
    carried = to_body(frame[1], axis, scalar)
    return (
        normalised(product(frame[0], q)),
        add(omega, carried),
        subtract(add(alpha, to_body(frame[2], axis, scalar)), cross(omega, carried)),
    )


@kernel
def relative_to(frame: Motion, motion: Motion) -> Motion:
    """Motion relative to a frame: the inverse of `composed`."""
    q = normalised(product(conjugate(frame[0]), motion[0]))
    axis, scalar = vector(q), q[3]
    carried = to_body(frame[1], axis, scalar)
    omega = subtract(motion[1], carried)
    return (
        q,
        omega,
        add(subtract(motion[2], to_body(frame[2], axis, scalar)), cross(omega, carried)),
    )


@kernel
def standing(q: Quaternion) -> Motion:
    """Motion that stays at an attitude."""
    return q, ZERO, ZERO


@kernel
def moved_by(q: Quaternion, motion: Motion) -> Motion:
    """Motion that starts from an attitude q: its rates stay, its attitude is q ⊗ motion's."""
    return normalised(product(q, motion[0])), motion[1], motion[2]


@kernel
def profile(angle: float, rate: float, acceleration: float, jerk: float) -> Profile:
    """Time-optimal profile from rest to rest: φ ≥ 0 [rad] in V [rad/s], A [rad/s²], K [rad/s³].

    Seven phases: jerk up, hold the acceleration, jerk down, cruise, and the same mirrored.
    """
    jerk_alone = (0.5 * angle / jerk) ** (1.0 / 3.0)
    if rate * jerk >= acceleration * acceleration:
        ramp = acceleration / jerk
        if angle >= rate * (rate / acceleration + ramp):
            return (
                angle,
                ramp,
                rate / acceleration - ramp,
                angle / rate - rate / acceleration - ramp,
            )
        if angle >= 2.0 * acceleration * ramp * ramp:
            peak = 0.5 * acceleration * (math.sqrt(ramp * ramp + 4.0 * angle / acceleration) - ramp)
            return angle, ramp, peak / acceleration - ramp, 0.0
        return angle, jerk_alone, 0.0, 0.0
    ramp = math.sqrt(rate / jerk)
    if angle >= 2.0 * rate * ramp:
        return angle, ramp, 0.0, angle / rate - 2.0 * ramp
    return angle, jerk_alone, 0.0, 0.0


@kernel
def duration(profile: Profile) -> float:
    """T = 4 t_j + 2 t_a + t_v [s]."""
    return 4.0 * profile[1] + 2.0 * profile[2] + profile[3]


@kernel
def _rising(t: float, profile: Profile, jerk: float) -> tuple[float, float, float]:
    """θ, θ' and θ'' before the middle of the profile."""
    _, t_j, t_a, _ = profile
    if t <= t_j:
        return jerk * t**3 / 6.0, 0.5 * jerk * t * t, jerk * t
    acceleration = jerk * t_j
    t -= t_j
    angle, rate = jerk * t_j**3 / 6.0, 0.5 * jerk * t_j * t_j
    if t <= t_a:
        return (
            angle + rate * t + 0.5 * acceleration * t * t,
            rate + acceleration * t,
            acceleration,
        )
    t -= t_a
    angle += rate * t_a + 0.5 * acceleration * t_a * t_a
    rate += acceleration * t_a
    if t <= t_j:
        return (
            angle + rate * t + 0.5 * acceleration * t * t - jerk * t**3 / 6.0,
            rate + acceleration * t - 0.5 * jerk * t * t,
            acceleration - jerk * t,
        )
    t -= t_j
    angle += rate * t_j + 0.5 * acceleration * t_j * t_j - jerk * t_j**3 / 6.0
    rate += 0.5 * acceleration * t_j
    return angle + rate * t, rate, 0.0


@kernel
def turned(t: float, profile: Profile, jerk: float) -> tuple[float, float, float]:
    """Angle θ [rad], θ' [rad/s] and θ'' [rad/s²] at t [s] from the start, 0 ≤ t ≤ T."""
    total = duration(profile)
    if t <= 0.5 * total:
        return _rising(t, profile, jerk)
    angle, rate, acceleration = _rising(max(total - t, 0.0), profile, jerk)
    return profile[0] - angle, rate, -acceleration
