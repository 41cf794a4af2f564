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

"""How fast the error may fall about its axis: a brake at constant deceleration under a cap.

The brake is g = kφ for φ ≤ φ1 = a/k² and √(2aφ − a²/k²) beyond: once differentiable, g g' ≤ a. The
cap is f(φ; V) = V S(g/V) with S(x) = x below 1 − c, 1 above 1 + c, and a parabola between. The
deceleration a is what the torque allows about the axis n of the error, the cap V what the limit of
the rate leaves there.
"""

import math

from ppc_attitude.science.kernel import (
    ZERO,
    Matrix,
    Quaternion,
    Vector,
    add,
    apply,
    cross,
    dot,
    kernel,
    norm,
    scale,
    subtract,
    vector,
)

BLEND = 0.25  # c, half the width of the parabola
ORDER = 16  # of the differentiable norm that stands in for the largest of the axes


@kernel
def error_axis(q_e: Quaternion, way: float) -> tuple[Vector, float]:
    """Axis n and angle φ in [0, 2π) [rad] of the error, going round the given way."""
    length = norm(vector(q_e))
    phi = 2.0 * math.atan2(length, way * q_e[3])
    if length == 0.0:
        return ZERO, phi
    return scale(way / length, vector(q_e)), phi


@kernel
def speed_limit(
    n: Vector, n_rate: Vector, omega_d: Vector, acceleration_d: Vector, rate_limit: float
) -> tuple[float, float]:
    """V [rad/s], the f at which ‖w_d − f n‖ is the rate limit Ω_e, and V' [rad/s²]."""
    b = dot(n, omega_d)  # in desired axes, in which n has the same numbers as in body axes
    root = math.sqrt(max(b * b + rate_limit * rate_limit - dot(omega_d, omega_d), 0.0))
    if root == 0.0 or n == ZERO:
        return b + root, 0.0
    b_rate = dot(n, acceleration_d) + dot(n_rate, omega_d)
    return b + root, b_rate + (b * b_rate - dot(omega_d, acceleration_d)) / root


@kernel
def axis_rate(n: Vector, phi: float, omega_e: Vector) -> Vector:
    """2 sin(φ/2) n' = cos(φ/2) ω_⊥ + sin(φ/2) n × ω_⊥ [rad/s], finite at φ = 0."""
    across = subtract(omega_e, scale(dot(n, omega_e), n))
    return add(scale(math.cos(0.5 * phi), across), scale(math.sin(0.5 * phi), cross(n, across)))


@kernel
def deceleration(
    n: Vector, n_rate: Vector, inertia: Matrix, torque: Vector, most: float
) -> tuple[float, float]:
    """Deceleration a(n) [rad/s²] that needs no more than `torque` [N·m] on any axis, and a'.

    a(n) = 1/‖(Ĵn/T, 1/most)‖₁₆ is below `most` and below every T_i/|Ĵn|_i, by 9 % at the worst.
    """
    needed, changes = apply(inertia, n), apply(inertia, n_rate)
    total, change = 1.0, 0.0
    for i in range(3):
        x = most * needed[i] / torque[i]
        x2 = x * x
        x4 = x2 * x2
        x8 = x4 * x4
        total += x8 * x8
        change += x8 * x4 * x2 * x * (most * changes[i] / torque[i])
    a = most / math.sqrt(math.sqrt(math.sqrt(math.sqrt(total))))
    return a, -a * change / total


@kernel
def brake(phi: float, k: float, a: float) -> tuple[float, float]:
    """Speed g [rad/s] from which a deceleration a [rad/s²] stops in φ [rad], and g' [1/s]."""
    if phi * k * k <= a:
        return k * phi, k
    g = math.sqrt(2.0 * a * phi - a * a / (k * k))
    return g, a / g


@kernel
def capped_brake(phi: float, k: float, a: float, cap: float) -> tuple[float, float, float, float]:
    """f(φ; V) [rad/s], f_φ [1/s], f_V and f_a [s] for a cap V ≥ 0 [rad/s]."""
    g, g_phi = brake(phi, k, a)
    if g >= (1.0 + BLEND) * cap:
        return cap, 0.0, 1.0, 0.0
    g_a = max(phi - a / (k * k), 0.0) / g if g > 0.0 else 0.0
    if g <= (1.0 - BLEND) * cap:
        return g, g_phi, 0.0, g_a
    x = g / cap
    below = x - 1.0 + BLEND
    s, s_x = x - below * below / (4.0 * BLEND), 1.0 - below / (2.0 * BLEND)
    return cap * s, s_x * g_phi, s - x * s_x, s_x * g_a
