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

"""Quaternion feedback with rate and torque limits (Wie and Lu, 1995): the practitioner's baseline.

The attitude error is limited so that the rate never exceeds the limit while the craft slews about
its eigenaxis, and the torque is scaled as a vector, which keeps that axis. Feedforward of the
reference (M0) makes it a tracking law.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.component import Component
from ppc_attitude.science.controllers.common import INERTIA, MAX_TORQUE
from ppc_attitude.science.controllers.interface import INPUTS, OUTPUTS, error_state, store_command
from ppc_attitude.science.inertia import inertia_matrix
from ppc_attitude.science.kernel import (
    Vector,
    add,
    apply,
    clamp,
    kernel,
    largest,
    matrix,
    norm,
    scale,
    store,
    subtract,
    vector,
)
from ppc_attitude.science.parameter import Parameter, filled, record_type
from ppc_attitude.science.virtual_control import sign

_OWN = (
    Parameter(
        "quaternion_feedback.natural_frequency",
        0.5,
        "natural frequency of the loop",
        "rad/s",
        low=1e-9,
        high=1e6,
    ),
    Parameter("quaternion_feedback.damping", 1.0, "damping ratio of the loop", above=0.0, high=1e6),
    Parameter(
        "quaternion_feedback.integral_time", 10.0, "time constant T of the integral", "s", low=1e-9
    ),
    Parameter(
        "quaternion_feedback.max_rate", 0.03, "limit of the slew rate error", "rad/s", above=0.0
    ),
)
PARAMETERS = (INERTIA, MAX_TORQUE, *_OWN)
CONFIGURATION = record_type(
    ("stiffness", np.float64),  # 2k [1/s²] on q_ev
    ("damping", np.float64),  # c [1/s]
    *_OWN[2:],
    MAX_TORQUE,
    ("inertia", np.float64, (3, 3)),
)
MEMORY = record_type(
    ("started", np.float64),
    ("t", np.float64),  # [s] of the last sample
    ("integral", np.float64, (3,)),  # ∫ q_ev dt [s]
)


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values.

    Raises
    ------
    ConfigurationError
        The inertia is impossible.
    """
    frequency = values["quaternion_feedback.natural_frequency"]
    return filled(
        CONFIGURATION,
        values,
        "quaternion_feedback.",
        # A small error has q_ev = φ/2: stiffness 2 ω_n² gives φ'' = −ω_n² φ.
        stiffness=2.0 * frequency**2,
        damping=2.0 * values["quaternion_feedback.damping"] * frequency,
        max_torque=values["max_torque"],
        inertia=inertia_matrix("inertia", values["inertia"]),
    )


@kernel
def limited(a: Vector, limit: float) -> Vector:
    """Scale a so that its norm is at most `limit`: the direction is kept."""
    length = norm(a)
    if length <= limit:
        return a
    return scale(limit / length, a)


@kernel
def step(measurement: Any, memory: Any, gains: Any, command: Any) -> None:
    """Compute one sample of the law: reads `measurement`, updates `memory`, fills `command`.

    u = −J (2k e + c ω_e) − M0 [N·m], where e = s q_ev + ∫ s q_ev dt/T is limited, s = sgn(q_e0).
    """
    inertia = matrix(gains.inertia)
    q_e, omega_e, m_0 = error_state(measurement, inertia)
    error = scale(sign(q_e[3]), vector(q_e))
    h = measurement.t - memory.t if memory.started != 0.0 else 0.0
    memory.started = 1.0
    memory.t = measurement.t
    # Rate limit: at the limit the damping torque balances the limited error, c ω = 2k L.
    error_limit = gains.damping * gains.max_rate / gains.stiffness
    integral = vector(memory.integral)
    slewing = norm(error) > error_limit
    if not slewing and h > 0.0:
        # Anti-windup: the integral rests while the error is limited, and is bounded by the limit.
        integral = limited(add(integral, scale(h, error)), error_limit * gains.integral_time)
        store(memory.integral, integral)
    demand = limited(add(error, scale(1.0 / gains.integral_time, integral)), error_limit)
    acceleration = add(scale(gains.stiffness, demand), scale(gains.damping, omega_e))
    u = subtract(scale(-1.0, apply(inertia, acceleration)), m_0)
    peak = largest(u)
    torque = scale(gains.max_torque / peak, u) if peak > gains.max_torque else u
    torque = clamp(torque, gains.max_torque)  # rounding may leave it an ulp above
    store_command(command, q_e, omega_e, u, torque)


COMPONENT = Component(
    name="quaternion_feedback",
    parameters=PARAMETERS,
    configure=configure,
    configuration=CONFIGURATION,
    state=MEMORY,
    inputs=INPUTS,
    outputs=OUTPUTS,
    step=step,
)
