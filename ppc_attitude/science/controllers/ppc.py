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

"""The paper's controller: double-layer prescribed performance control by backstepping (eq. 22).

Read `step` as the block diagram: error system, envelopes, virtual control, torque, saturation.
The widening laws and the auxiliary system hold Δτ of the previous sample: v' and γ contain Δρ',
Δρ' contains Δτ, and Δτ contains u, so evaluated at one instant they would be an algebraic loop
with up to three solutions.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import jacobian_transposed
from ppc_attitude.science.component import BODY, VECTOR, Component
from ppc_attitude.science.controllers import ppc_conditions
from ppc_attitude.science.controllers.common import (
    ATTITUDE_ENVELOPE,
    ATTITUDE_PARAMETERS,
    D_M,
    INERTIA,
    MAX_TORQUE,
    MU,
    RATE_ENVELOPE,
    RATE_PARAMETERS,
    envelope_of,
    of_law,
    smooth_sign,
)
from ppc_attitude.science.controllers.interface import INPUTS, OUTPUTS, error_state, store_command
from ppc_attitude.science.envelope_plan import (
    PLAN,
    carry_on,
    plan_advice,
    plan_envelopes,
    revise_plan,
)
from ppc_attitude.science.inertia import inertia_matrix
from ppc_attitude.science.kernel import (
    ZERO,
    Matrix,
    Vector,
    add,
    apply,
    clamp,
    divide,
    dot,
    kernel,
    magnitudes,
    matrix,
    multiply,
    scale,
    store,
    subtract,
    tanh,
    vector,
)
from ppc_attitude.science.parameter import Parameter, filled, record_type
from ppc_attitude.science.performance import (
    SHAPE,
    nominal,
    widened_attitude_envelope,
    widened_rate_envelope,
)
from ppc_attitude.science.virtual_control import virtual_control

GAINS = (
    Parameter("k", 3.0, "gain k of the virtual control", above=0.0),
    Parameter("M_omega", 0.017, "speed scale M_ω of virtual control", "rad/s", above=0.0, high=1e6),
    Parameter("beta", 3.6, "steepness β of the virtual control", above=0.0),
    Parameter("K_omega", 2.3, "gain K_ω on the rate error z2", "1/s", low=0.0),
    Parameter("K_u", 0.171, "gain K_u on the auxiliary state θ", "1/s", low=0.0),
    Parameter("K_a", 3.81, "decay K_a of the auxiliary state", "1/s", low=0.0),
    Parameter("K_b", 3.09, "saturation-driven decay K_b of the auxiliary state", "s", low=0.0),
    Parameter("C_q", 0.975, "decay C_q of the attitude envelope's widening", "1/s", low=0.0),
    Parameter(
        "C_omega", 0.898, "decay C_ω of the rate envelope's widening", "1/s", low=0.0, high=1e6
    ),
    Parameter("C_tau", 0.00998, "gain C_τ of the attitude envelope's widening", low=0.0),
    Parameter("B_tau", 0.0418, "gain B_τ of the rate envelope's widening", "rad/s", low=0.0),
    Parameter("F1", 1.0, "scale F1 of the attitude barrier", above=0.0),
    Parameter("F2", 1.0, "scale F2 of the rate barrier", above=0.0),
    Parameter("k1", 1.0, "weight k1 of the attitude barrier", above=0.0),
    Parameter("k2", 1.0, "weight k2 of the rate barrier", above=0.0),
    # No smaller one, whose inverse is no number.
    Parameter("sigma", 0.0113, "σ that keeps the cross term's denominator from zero", low=1e-30),
)
PARAMETERS = (
    INERTIA,
    MAX_TORQUE,
    *GAINS,
    D_M,
    MU,
    Parameter("adaptive_envelope", True, "widen the envelopes while the actuator saturates"),
    Parameter(
        "envelope",
        "nominal",
        "nominal: as its parameters give it; auto: planned from the present error",
        choices=("nominal", "auto"),
    ),
    Parameter(
        "virtual_control",
        "componentwise",
        "form of the virtual control: the paper's, or direction-preserving",
        choices=("componentwise", "norm"),
    ),
    *ATTITUDE_PARAMETERS,
    *RATE_PARAMETERS,
)
CONFIGURATION = record_type(
    *GAINS,
    D_M,
    MU,
    MAX_TORQUE,
    ("inertia", np.float64, (3, 3)),
    ("inertia_inverse", np.float64, (3, 3)),
    ("coupling", np.float64, (3, 3)),  # rows of J⁻¹ over their diagonal elements, minus I
    ("adaptive", np.float64),
    ("auto", np.float64),
    ("norm_form", np.float64),
    ("attitude_shape", SHAPE),
    ("rate_shape", SHAPE),
)
MEMORY = record_type(
    ("started", np.float64),
    ("t", np.float64),  # [s] of the last sample
    ("delta_tau", np.float64, (3,)),  # Δτ = sat(u) − u of the last sample [N·m]
    ("delta_rho_q", np.float64, (3,)),  # Δρ_q
    ("delta_rho_omega", np.float64, (3,)),  # Δρ_ω [rad/s]
    ("theta", np.float64, (3,)),  # θ
    ("plan", PLAN),
)
AUXILIARY_STATE = of_law("auxiliary_state", VECTOR, BODY, "1", "anti-saturation state θ")
# δ of the auxiliary system: |θ|² + δ² divides, because the paper divides by zero at θ = 0.
_DELTA = 1e-3


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values.

    Raises
    ------
    ConfigurationError
        Inertia or an envelope is impossible.
    """
    inertia = inertia_matrix("inertia", values["inertia"])
    inverse = np.linalg.inv(inertia)
    return filled(
        CONFIGURATION,
        values,
        inertia=inertia,
        inertia_inverse=inverse,
        coupling=inverse / np.diagonal(inverse)[:, None] - np.eye(3),
        adaptive=values["adaptive_envelope"],
        auto=values["envelope"] == "auto",
        norm_form=values["virtual_control"] == "norm",
        attitude_shape=envelope_of("attitude_envelope", values),
        rate_shape=envelope_of("rate_envelope", values),
    )


@kernel
def barrier_gain(epsilon: Vector, k: float, F: float) -> float:
    """Factor k tanh(εᵀε/F) of ε in the gradient of V_B = (k/2) F ln cosh(εᵀε/F) (eqs. 4, 5).

    V_B is finite everywhere, also outside the envelope, where the logarithmic barrier is singular.
    """
    return k * math.tanh(dot(epsilon, epsilon) / F)


@kernel
def saturation_drive(delta_tau: Vector, inertia_inverse: Matrix) -> Vector:
    """|J⁻¹| |tanh Δτ|, elementwise magnitudes: the drive that widens the envelopes (eq. 24)."""
    if delta_tau == ZERO:
        return ZERO
    x, y, z = inertia_inverse
    return apply((magnitudes(x), magnitudes(y), magnitudes(z)), tanh(magnitudes(delta_tau)))


@kernel
def auxiliary_step(
    theta: Vector, delta_tau: Vector, xi: Vector, inertia_inverse: Matrix, gains: Any, h: float
) -> Vector:
    """θ after h [s]: θ' = −[K_a + K_b |ξJ⁻¹Δτ|²/(|θ|²+δ²)] θ + ξJ⁻¹ tanh Δτ (eq. 23), implicit."""
    pull = push = ZERO
    if delta_tau != ZERO:
        pull = multiply(xi, apply(inertia_inverse, delta_tau))
        push = multiply(xi, apply(inertia_inverse, tanh(delta_tau)))
    decay = gains.K_a + gains.K_b * dot(pull, pull) / (dot(theta, theta) + _DELTA * _DELTA)
    return scale(1.0 / (1.0 + h * decay), add(theta, scale(h, push)))


@kernel
def integrate(memory: Any, gains: Any, drive: Vector, rate_value: float, h: float) -> None:
    """Carry θ, Δρ_q, Δρ_ω over h [s] with the last sample's Δτ and drive held (eqs. 23, 24)."""
    inertia_inverse = matrix(gains.inertia_inverse)
    delta_tau = vector(memory.delta_tau)
    on = gains.adaptive  # if it is switched off in flight, a widened envelope still closes
    delta_omega = widened_rate_envelope(
        vector(memory.delta_rho_omega), rate_value, scale(on * gains.B_tau, drive), gains.C_omega, h
    )
    store(memory.delta_rho_omega, delta_omega)
    rho_omega = add((rate_value, rate_value, rate_value), delta_omega)
    xi = divide((1.0, 1.0, 1.0), rho_omega)  # ξ = diag(1/ρ_ω)
    opening = scale(on * gains.C_tau, multiply(xi, drive))
    delta_q = widened_attitude_envelope(vector(memory.delta_rho_q), opening, gains.C_q, h)
    store(memory.delta_rho_q, delta_q)
    theta = auxiliary_step(vector(memory.theta), delta_tau, xi, inertia_inverse, gains, h)
    store(memory.theta, theta)


@kernel
def _bounded_axis(rho: float, rho_rate: float) -> tuple[float, float]:
    # |q_ev,i| ≤ 1, so an envelope above 1 says nothing: it is held at 1, and stands still there.
    if rho >= 1.0:
        return 1.0, min(rho_rate, 0.0) if rho == 1.0 else 0.0
    return rho, rho_rate


@kernel
def composite_envelopes(
    memory: Any, gains: Any, drive: Vector, attitude: tuple[float, float], rate: tuple[float, float]
) -> tuple[Vector, Vector, Vector, Vector]:
    """ρ_q, ρ_q' [1/s], ρ_ω [rad/s], ρ_ω' [rad/s²]: nominal part, and adaptive part by eq. 24."""
    delta_q = vector(memory.delta_rho_q)
    delta_omega = vector(memory.delta_rho_omega)
    rho_omega = add((rate[0], rate[0], rate[0]), delta_omega)
    drive = divide(drive, rho_omega)
    on = gains.adaptive
    growth_q = subtract(scale(on * gains.C_tau, drive), scale(gains.C_q, delta_q))
    growth_omega = subtract(scale(on * gains.B_tau, drive), scale(gains.C_omega, delta_omega))
    x, x_rate = _bounded_axis(attitude[0] + delta_q[0], attitude[1] + growth_q[0])
    y, y_rate = _bounded_axis(attitude[0] + delta_q[1], attitude[1] + growth_q[1])
    z, z_rate = _bounded_axis(attitude[0] + delta_q[2], attitude[1] + growth_q[2])
    rho_omega_rate = add((rate[1], rate[1], rate[1]), growth_omega)
    return (x, y, z), (x_rate, y_rate, z_rate), rho_omega, rho_omega_rate


@kernel
def is_outside(q: Vector, rho_q: Vector) -> bool:
    """True if the attitude error is outside its envelope; an envelope at its bound 1 holds all."""
    return bool(
        (abs(q[0]) > rho_q[0] and rho_q[0] < 1.0)
        or (abs(q[1]) > rho_q[1] and rho_q[1] < 1.0)
        or (abs(q[2]) > rho_q[2] and rho_q[2] < 1.0)
    )


@kernel
def disturbance_estimate(epsilon_omega: Vector, rho_omega: Vector, gains: Any) -> Vector:
    """d̂ = D_m tanh(y/μ) [N·m], y = J⁻¹ ξ ε_ω with each axis divided by (J⁻¹ ξ)_ii.

    For a diagonal inertia y is ε_ω.
    """
    others = apply(matrix(gains.coupling), divide(epsilon_omega, rho_omega))
    argument = add(epsilon_omega, multiply(rho_omega, others))
    return smooth_sign(argument, gains.D_m, gains.mu)


@kernel
def cross_term(
    epsilon_q: Vector,
    epsilon_omega: Vector,
    rho_q: Vector,
    rho_omega: Vector,
    q: Vector,
    q0: float,
    gains: Any,
) -> Vector:
    """Acceleration [rad/s²] that cancels the z2 term of V̇1 (last term of eq. 22, corrected).

    The paper prints F_e for F_eᵀ and leaves out k1; only this form cancels exactly at σ = 0.
    """
    weight = barrier_gain(epsilon_q, gains.k1, gains.F1) / (
        barrier_gain(epsilon_omega, gains.k2, gains.F2) + gains.sigma
    )
    direction = jacobian_transposed(q, q0, divide(epsilon_q, rho_q))
    return scale(weight, multiply(multiply(rho_omega, rho_omega), direction))


@kernel
def step(measurement: Any, memory: Any, gains: Any, command: Any) -> None:
    """Compute one sample of the law: reads `measurement`, updates `memory`, fills `command`."""
    inertia = matrix(gains.inertia)
    q_e, omega_e, m_0 = error_state(measurement, inertia)
    q, q0 = vector(q_e), q_e[3]
    t = measurement.t

    if memory.started == 0.0:
        memory.plan.count = 0.0
        plan_envelopes(memory.plan, t, q_e, omega_e, gains)
        memory.started = 1.0
        memory.t = t
    elif memory.plan.auto != gains.auto:  # switched in flight
        plan_envelopes(memory.plan, t, q_e, omega_e, gains)
    elif memory.plan.waiting != 0.0 and t >= memory.plan.start + memory.plan.hold:
        revise_plan(memory.plan, t, q_e, omega_e, gains)
    rate, attitude = carry_on(memory.plan, t, gains)
    drive = saturation_drive(vector(memory.delta_tau), matrix(gains.inertia_inverse))
    if t > memory.t:
        integrate(memory, gains, drive, rate[0], t - memory.t)
    memory.t = t
    rho_q, rho_q_rate, rho_omega, rho_omega_rate = composite_envelopes(
        memory, gains, drive, attitude, rate
    )
    # At the table's initial value no plan is wider, and making one takes longer than many samples.
    if (
        gains.auto != 0.0
        and is_outside(q, rho_q)
        and attitude[0] < nominal(0.0, gains.attitude_shape)[0]
    ):
        plan_envelopes(memory.plan, t, q_e, omega_e, gains)
        rate, attitude = carry_on(memory.plan, t, gains)
        rho_q, rho_q_rate, rho_omega, rho_omega_rate = composite_envelopes(
            memory, gains, drive, attitude, rate
        )

    speed, norm_form = gains.k * gains.M_omega, gains.norm_form != 0.0
    v, v_rate = virtual_control(q, q0, omega_e, rho_q, rho_q_rate, gains.beta, speed, norm_form)
    z2 = subtract(omega_e, v)
    epsilon_q = divide(q, rho_q)
    epsilon_omega = divide(z2, rho_omega)
    gamma = divide(rho_omega_rate, rho_omega)
    theta = vector(memory.theta)

    # Eq. 22 with J taken out: v' − K_ω z2 + γ z2 − K_u ξ⁻¹ θ − cross term.
    acceleration = subtract(v_rate, scale(gains.K_omega, z2))
    acceleration = add(acceleration, multiply(gamma, z2))
    acceleration = subtract(acceleration, scale(gains.K_u, multiply(rho_omega, theta)))
    acceleration = subtract(
        acceleration, cross_term(epsilon_q, epsilon_omega, rho_q, rho_omega, q, q0, gains)
    )
    d_hat = disturbance_estimate(epsilon_omega, rho_omega, gains)
    u = subtract(subtract(apply(inertia, acceleration), m_0), d_hat)
    tau = clamp(u, gains.max_torque)

    store(memory.delta_tau, subtract(tau, u))
    store_command(command, q_e, z2, u, tau)
    store(command.attitude_envelope, rho_q)
    store(command.rate_envelope, rho_omega)
    store(command.auxiliary_state, theta)


COMPONENT = Component(
    name="ppc",
    parameters=PARAMETERS,
    configure=configure,
    configuration=CONFIGURATION,
    state=MEMORY,
    inputs=INPUTS,
    outputs=(*OUTPUTS, ATTITUDE_ENVELOPE, RATE_ENVELOPE, AUXILIARY_STATE),
    step=step,
    advice=lambda memory: plan_advice(memory["plan"]),
    advices=lambda memory: int(memory["plan"]["count"]),
    conditions=lambda values, task: ppc_conditions.conditions(values, configure(values), task),
)
