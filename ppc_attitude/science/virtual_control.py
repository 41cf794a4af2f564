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

"""The virtual control v of the attitude layer (eq. 12) and its time derivative in closed form.

v = −s k M_ω G w with s = sgn(q_e0). The paper writes (|q_e0|/2) F_e⁻¹, which is s G: no inverse.
Two forms of w:

componentwise (the paper's)  w_i = ρ_i tanh(β ε_i); ‖v‖ ≤ √3 k M_ω max ρ (the paper's bound
                             k M_ω is wrong by √3).
norm (direction-preserving)  w = diag(ρ) n tanh(β‖ε‖), n = ε/‖ε‖; ‖v‖ ≤ k M_ω max ρ exactly.
                             As diag(ρ) ε = q it is w = q g, g = tanh(β‖ε‖)/‖ε‖.

v' needs ρ' but neither ρ'' nor ω_e'.
"""

import math

from ppc_attitude.science.attitude import (
    jacobian,
    jacobian_inverse_scaled,
    jacobian_inverse_scaled_rate,
)
from ppc_attitude.science.kernel import (
    Vector,
    add,
    divide,
    dot,
    inlined,
    kernel,
    multiply,
    scale,
    subtract,
)

# Where ‖ε‖ is below the first, and β‖ε‖ below the second, the quotients of the norm form are taken
# from their series.
_SMALL, _SMALL_SHAPE = 1e-4, 1e-3


@kernel
def sign(q0: float) -> float:
    """Sign sgn(q0), with sgn(0) = 1, so that the craft always has a way to turn."""
    return -1.0 if q0 < 0.0 else 1.0


@kernel
def _componentwise_axis(
    q: float, q_rate: float, rho: float, rho_rate: float, beta: float
) -> tuple[float, float]:
    epsilon = q / rho
    shape = math.tanh(beta * epsilon)
    slope = beta * (1.0 - shape * shape)
    return rho * shape, rho_rate * (shape - epsilon * slope) + slope * q_rate


@kernel
def componentwise(
    q: Vector, q_rate: Vector, rho: Vector, rho_rate: Vector, beta: float
) -> tuple[Vector, Vector]:
    """w_i = ρ_i tanh(β ε_i) and w_i' = ρ_i' [tanh(β ε_i) − ε_i H_i] + H_i q_i'."""
    w0, r0 = _componentwise_axis(q[0], q_rate[0], rho[0], rho_rate[0], beta)
    w1, r1 = _componentwise_axis(q[1], q_rate[1], rho[1], rho_rate[1], beta)
    w2, r2 = _componentwise_axis(q[2], q_rate[2], rho[2], rho_rate[2], beta)
    return (w0, w1, w2), (r0, r1, r2)


@kernel
def directional(
    q: Vector, q_rate: Vector, rho: Vector, rho_rate: Vector, beta: float
) -> tuple[Vector, Vector]:
    """Return w = q g(‖ε‖) and w' = q' g + q g' ‖ε‖', with g(e) = tanh(β e)/e."""
    epsilon = divide(q, rho)
    epsilon_rate = divide(subtract(q_rate, multiply(rho_rate, epsilon)), rho)
    e = math.sqrt(dot(epsilon, epsilon))
    if e < _SMALL and beta * e < _SMALL_SHAPE:
        g = beta * (1.0 - (beta * e) ** 2 / 3.0)
        g_rate_by_e = -2.0 / 3.0 * beta**3
    else:
        shape = math.tanh(beta * e)
        g = shape / e
        g_rate_by_e = (beta * (1.0 - shape * shape) - g) / (e * e)
    g_rate = g_rate_by_e * dot(epsilon, epsilon_rate)
    return scale(g, q), add(scale(g, q_rate), scale(g_rate, q))


@inlined
def virtual_control(
    q: Vector,
    q0: float,
    omega_e: Vector,
    rho: Vector,
    rho_rate: Vector,
    beta: float,
    speed: float,
    norm_form: bool,
) -> tuple[Vector, Vector]:
    """Virtual control v [rad/s] and v' [rad/s²] (eq. 12).

    Parameters
    ----------
    q, q0
        Vector and scalar part of the attitude error.
    omega_e
        Rate error ω_e [rad/s] body.
    rho, rho_rate
        Envelope ρ_q and its rate [1/s].
    beta
        Steepness β.
    speed
        k M_ω [rad/s].
    norm_form
        True for the direction-preserving form.
    """
    q_rate = jacobian(q, q0, omega_e)
    q0_rate = -0.5 * dot(q, omega_e)
    if norm_form:
        w, w_rate = directional(q, q_rate, rho, rho_rate, beta)
    else:
        w, w_rate = componentwise(q, q_rate, rho, rho_rate, beta)
    gain = -sign(q0) * speed
    v = scale(gain, jacobian_inverse_scaled(q, q0, w))
    v_rate = add(
        jacobian_inverse_scaled_rate(q, q0, q_rate, q0_rate, w),
        jacobian_inverse_scaled(q, q0, w_rate),
    )
    return v, scale(gain, v_rate)
