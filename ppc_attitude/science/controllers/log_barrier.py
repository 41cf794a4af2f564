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

"""Traditional PPC: one layer, logarithmic barrier.

A reconstruction: the text that the paper compares with was not to be had. The barrier force is not
clipped: once |q_i| > ρ_i it points outward and the state settles outside, near
q*² = ρ² + k_b / (4 K1 K2), which is the behaviour that the paper reports of its benchmark.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import jacobian, jacobian_inverse_scaled, jacobian_transposed
from ppc_attitude.science.component import Component
from ppc_attitude.science.conditions import Condition, Task, advisable
from ppc_attitude.science.controllers.common import (
    ATTITUDE_ENVELOPE,
    ATTITUDE_PARAMETERS,
    D_M,
    INERTIA,
    MAX_TORQUE,
    MU,
    envelope_of,
    smooth_sign,
)
from ppc_attitude.science.controllers.interface import INPUTS, OUTPUTS, error_state, store_command
from ppc_attitude.science.inertia import inertia_matrix
from ppc_attitude.science.kernel import (
    ZERO,
    Vector,
    add,
    apply,
    clamp,
    cross,
    divide,
    dot,
    kernel,
    matrix,
    norm,
    scale,
    store,
    subtract,
    vector,
)
from ppc_attitude.science.parameter import Parameter, filled, record_type
from ppc_attitude.science.performance import SHAPE, nominal

_OWN = (
    Parameter("log_barrier.K1", 0.15, "attitude gain K1", "1/s", above=0.0),
    Parameter("log_barrier.K2", 3.0, "rate gain K2", "N·m·s/rad", above=0.0),
    Parameter("log_barrier.k_b", 1e-3, "barrier gain k_b", "N·m", above=0.0),
)
PARAMETERS = (INERTIA, MAX_TORQUE, D_M, MU, *_OWN, *ATTITUDE_PARAMETERS)
CONFIGURATION = record_type(
    *_OWN, D_M, MU, MAX_TORQUE, ("inertia", np.float64, (3, 3)), ("shape", SHAPE)
)
MEMORY = record_type(("started", np.float64), ("start", np.float64))
# F_e⁻¹ is singular at q_e0 = 0 and χ at |q_i| = ρ_i; a reconstruction keeps that, but never divides
# by zero.
_SMALLEST_SCALAR = 1e-6
_SMALLEST_ROOM = 1e-12  # of ρ_i² − q_i²


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values.

    Raises
    ------
    ConfigurationError
        Inertia or the envelope is impossible.
    """
    return filled(
        CONFIGURATION,
        values,
        "log_barrier.",
        **{each.name: values[each.name] for each in (D_M, MU, MAX_TORQUE)},
        inertia=inertia_matrix("inertia", values["inertia"]),
        shape=envelope_of("attitude_envelope", values),
    )


@kernel
def inverse_jacobian(q: Vector, q0: float, a: Vector) -> Vector:
    """F_e⁻¹ a = (2/q0) G a."""
    return scale(2.0 / q0, jacobian_inverse_scaled(q, q0, a))


@kernel
def _room(rho: float, q: float) -> float:
    room = rho * rho - q * q
    return room if room != 0.0 else _SMALLEST_ROOM


@kernel
def log_barrier_force(q: Vector, rho: Vector) -> Vector:
    """χ_i = q_i / (ρ_i² − q_i²): the traditional barrier's gradient; it points outward outside."""
    return divide(q, (_room(rho[0], q[0]), _room(rho[1], q[1]), _room(rho[2], q[2])))


@kernel
def desired_rate_error(
    q: Vector,
    q0: float,
    omega_e: Vector,
    rho: float,
    rho_rate: float,
    rho_acceleration: float,
    K1: float,
) -> tuple[Vector, Vector]:
    """α = F_e⁻¹ g [rad/s] and α' [rad/s²], with g = −(K1 − η) q and η = ρ'/ρ."""
    eta = rho_rate / rho
    eta_rate = rho_acceleration / rho - eta * eta
    q_rate = jacobian(q, q0, omega_e)
    q0_rate = -0.5 * dot(q, omega_e)
    g = scale(eta - K1, q)
    g_rate = add(scale(eta_rate, q), scale(eta - K1, q_rate))
    turning = subtract(scale(q0_rate, g), cross(q_rate, g))
    stretch = scale(1.0 / q0, add(scale(dot(q, g), q_rate), scale(dot(q_rate, g), q)))
    shrink = scale(dot(q, g) * q0_rate / (q0 * q0), q)
    alpha_rate = add(
        inverse_jacobian(q, q0, g_rate), scale(2.0, add(turning, subtract(stretch, shrink)))
    )
    return inverse_jacobian(q, q0, g), alpha_rate


@kernel
def _second_derivative(t: float, shape: Any) -> float:
    """ρ_n''(t) [1/s²]."""
    if t < shape.t1:
        return float(shape.decay * shape.decay * shape.amplitude * math.exp(-shape.decay * t))
    if t < shape.t2:
        return float(2.0 * shape.curvature)
    return 0.0


@kernel
def step(measurement: Any, memory: Any, gains: Any, command: Any) -> None:
    """Compute one sample of the law: reads `measurement`, updates `memory`, fills `command`.

    u = −M0 + J α' − K2 z − k_b F_eᵀ χ − D_m tanh(z/μ) [N·m] with z = ω_e − α; the torque is sat(u).
    """
    q_e, omega_e, m_0 = error_state(measurement, matrix(gains.inertia))
    q, q0 = vector(q_e), math.copysign(max(abs(q_e[3]), _SMALLEST_SCALAR), q_e[3])
    if memory.started == 0.0:
        memory.started = 1.0
        memory.start = measurement.t
    clock = measurement.t - memory.start
    rho, rho_rate = nominal(clock, gains.shape)
    alpha, alpha_rate = desired_rate_error(
        q, q0, omega_e, rho, rho_rate, _second_derivative(clock, gains.shape), gains.K1
    )
    z = subtract(omega_e, alpha)
    chi = log_barrier_force(q, (rho, rho, rho))
    u = subtract(apply(matrix(gains.inertia), alpha_rate), m_0)
    u = subtract(u, scale(gains.K2, z))
    u = subtract(u, scale(gains.k_b, jacobian_transposed(q, q0, chi)))
    u = subtract(u, smooth_sign(z, gains.D_m, gains.mu))
    store_command(command, q_e, z, u, clamp(u, gains.max_torque))
    store(command.attitude_envelope, (rho, rho, rho))


def conditions(values: Mapping[str, Any], task: Task) -> Iterator[Condition]:
    """Compare the rate that the law asks for at the start with what is allowed."""
    if task.rate_limit is None or task.desired_rate is None:
        return
    q0 = math.copysign(max(abs(task.error[3]), _SMALLEST_SCALAR), task.error[3])
    rho, rho_rate = nominal(0.0, envelope_of("attitude_envelope", values))
    K1 = values["log_barrier.K1"]
    alpha, _ = desired_rate_error(vector(task.error), q0, ZERO, rho, rho_rate, 0.0, K1)
    yield advisable(
        "rate of the law",
        math.degrees(norm(alpha) + task.desired_rate),
        task.rate_limit,
        "deg/s",
        "‖α‖ at the start + max‖ω_d‖: the law does not limit the rate, so a craft with a "
        "large error speeds up to this value",
    )


COMPONENT = Component(
    name="log_barrier",
    parameters=PARAMETERS,
    configure=configure,
    configuration=CONFIGURATION,
    state=MEMORY,
    inputs=INPUTS,
    outputs=(*OUTPUTS, ATTITUDE_ENVELOPE),
    step=step,
    conditions=conditions,
)
