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

"""The error as an axis and an angle, how the axis turns, and the speed limit about it."""

import math

from ppc_attitude.science.kernel import (
    Quaternion,
    Vector,
    add,
    cross,
    dot,
    kernel,
    norm,
    scale,
    subtract,
)

_ZERO: Vector = (0.0, 0.0, 0.0)


@kernel
def error_axis(q_e: Quaternion, way: float) -> tuple[Vector, float]:
    """Axis n and angle φ in [0, 2π) [rad] of the error, going round the given way."""
    length = norm((q_e[0], q_e[1], q_e[2]))
    phi = 2.0 * math.atan2(length, way * q_e[3])
    if length == 0.0:
        return _ZERO, phi
    return scale(way / length, (q_e[0], q_e[1], q_e[2])), phi


@kernel
def speed_limit(
    n: Vector, n_rate: Vector, omega_d: Vector, acceleration_d: Vector, rate_limit: float
) -> tuple[float, float]:
    """V [rad/s], the f at which ‖w_d − f n‖ is the rate limit Ω_e, and V' [rad/s²]."""
    b = dot(n, omega_d)
    root = math.sqrt(max(b * b + rate_limit * rate_limit - dot(omega_d, omega_d), 0.0))
    if root == 0.0 or n == _ZERO:
        return b + root, 0.0
    b_rate = dot(n, acceleration_d) + dot(n_rate, omega_d)
    return b + root, b_rate + (b * b_rate - dot(omega_d, acceleration_d)) / root


@kernel
def axis_rate(n: Vector, phi: float, omega_e: Vector) -> Vector:
    """2 sin(φ/2) n' = cos(φ/2) ω_⊥ + sin(φ/2) n × ω_⊥ [rad/s], finite at φ = 0."""
    across = subtract(omega_e, scale(dot(n, omega_e), n))
    return add(scale(math.cos(0.5 * phi), across), scale(math.sin(0.5 * phi), cross(n, across)))
