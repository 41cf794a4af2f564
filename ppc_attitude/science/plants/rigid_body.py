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

"""The plant of the paper: a rigid body with any inertia (Euler's equation, eq. 1)."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import euler_step, kinematics, runge_kutta, unit_quaternion
from ppc_attitude.science.compiled_stamps import seconds
from ppc_attitude.science.component import Component
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.inertia import inertia_matrix
from ppc_attitude.science.kernel import (
    Matrix,
    Quaternion,
    Vector,
    add,
    apply,
    cross,
    dot,
    inlined,
    kernel,
    matrix,
    norm,
    quaternion,
    scale,
    store,
    store_quaternion,
    subtract,
    vector,
)
from ppc_attitude.science.parameter import Parameter, at_start, record_type
from ppc_attitude.science.signals import APPLIED_TORQUE, DISTURBANCE, TRUTH

INERTIA = Parameter(
    "inertia",
    [2.8, 0.0, 0.0, 0.0, 2.5, 0.0, 0.0, 0.0, 1.9],
    "inertia J of the craft, row-major; symmetric positive definite",
    "kg·m²",
    length=9,
    agreed=True,
)
INITIAL_ATTITUDE = at_start(
    "initial_attitude",
    [0.1554, 0.4271, 0.4792, 0.7509],
    "attitude at t = 0, x y z w, body to inertial; normalised if within 1e-3",
    length=4,
    quaternion=True,
)
INITIAL_RATE = at_start(
    "initial_angular_velocity",
    [0.0, 0.0, 0.0],
    "angular velocity at t = 0, body axes",
    "rad/s",
    length=3,
    low=-100.0,
    high=100.0,
)
_MOST_TURN = 0.3  # [rad] in a step at the start; no law could follow a faster body
TURNED = 0.007  # [rad] in a part of a step; there Runge-Kutta is off by 1e-10 rad after a minute
MOST_PARTS = 64.0  # into which a step is divided
CONFIGURATION = record_type(
    ("inertia", np.float64, (3, 3)),  # [kg·m²]
    ("inertia_inverse", np.float64, (3, 3)),
    ("initial_attitude", np.float64, (4,)),  # x y z w, body to inertial
    ("initial_rate", np.float64, (3,)),  # [rad/s] body
)
STATE = record_type(
    ("started", np.float64),
    ("stamp_ns", np.int64),  # of the motion below
    ("attitude", np.float64, (4,)),  # x y z w, body to inertial
    ("rate", np.float64, (3,)),  # [rad/s] body
)


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values.

    Raises
    ------
    ConfigurationError
        Inertia or initial attitude is impossible, or the body turns too far in a step.
    """
    record = np.zeros((), CONFIGURATION)[()]
    inertia = inertia_matrix("inertia", values["inertia"])
    record["inertia"] = inertia
    record["inertia_inverse"] = np.linalg.inv(inertia)
    record["initial_attitude"] = unit_quaternion("initial_attitude", values["initial_attitude"])
    record["initial_rate"] = values[INITIAL_RATE.name]
    # Without a loop the parameter `rate` may be absent: then nothing is known of the steps.
    turn = float(np.linalg.norm(record["initial_rate"])) / values.get("rate", np.inf)
    if turn > _MOST_TURN:
        raise ConfigurationError(
            f"{INITIAL_RATE.name} = {values[INITIAL_RATE.name]} rad/s turns by {turn:.3g} rad in a "
            f"step of rate = {values['rate']:g} Hz; allowed: at most {_MOST_TURN:g} rad"
        )
    return record


@kernel
def angular_acceleration(
    omega: Vector, torque: Vector, inertia: Matrix, inertia_inverse: Matrix
) -> Vector:
    """ω' = J⁻¹ (τ − ω × J ω) [rad/s²], torque τ [N·m] in body axes."""
    return apply(inertia_inverse, subtract(torque, cross(omega, apply(inertia, omega))))


@inlined
def rigid_body_step(
    q: Quaternion, omega: Vector, torque: Vector, inertia: Matrix, inertia_inverse: Matrix, h: float
) -> tuple[Quaternion, Vector]:
    """Attitude and rate after h [s] under a torque held over the step: classical Runge-Kutta.

    The total torque [N·m] is in body axes; the quaternion is normalised after the step.
    """
    q1 = kinematics(q, omega)
    a1 = angular_acceleration(omega, torque, inertia, inertia_inverse)
    w2 = add(omega, scale(0.5 * h, a1))
    q2 = kinematics(euler_step(q, 0.5 * h, q1), w2)
    a2 = angular_acceleration(w2, torque, inertia, inertia_inverse)
    w3 = add(omega, scale(0.5 * h, a2))
    q3 = kinematics(euler_step(q, 0.5 * h, q2), w3)
    a3 = angular_acceleration(w3, torque, inertia, inertia_inverse)
    w4 = add(omega, scale(h, a3))
    q4 = kinematics(euler_step(q, h, q3), w4)
    a4 = angular_acceleration(w4, torque, inertia, inertia_inverse)
    mean = add(add(a1, a4), scale(2.0, add(a2, a3)))
    return runge_kutta(q, h, q1, q2, q3, q4), add(omega, scale(h / 6.0, mean))


@kernel
def step(inputs: Any, body: Any, configuration: Any, outputs: Any) -> None:
    """Carry the motion from the last stamp to this one, both torques held since then."""
    if body.started == 0.0:
        body.started = 1.0
        store_quaternion(body.attitude, quaternion(configuration.initial_attitude))
        store(body.rate, vector(configuration.initial_rate))
    elif inputs.stamp_ns > body.stamp_ns:
        torque = add(vector(inputs.applied_torque), vector(inputs.disturbance_torque))
        q, omega = quaternion(body.attitude), vector(body.rate)
        inertia, inverse = matrix(configuration.inertia), matrix(configuration.inertia_inverse)
        h, parts = seconds(inputs.stamp_ns - body.stamp_ns), 1
        if h * h * dot(omega, omega) > TURNED * TURNED:  # a hit has spun the body fast
            parts = math.ceil(min(h * norm(omega) / TURNED, MOST_PARTS))
        for _ in range(parts):
            q, omega = rigid_body_step(q, omega, torque, inertia, inverse, h / parts)
        store_quaternion(body.attitude, q)
        store(body.rate, omega)
    body.stamp_ns = inputs.stamp_ns
    store_quaternion(outputs.truth_attitude, quaternion(body.attitude))
    store(outputs.truth_angular_velocity, vector(body.rate))


COMPONENT = Component(
    name="rigid_body",
    parameters=(INERTIA, INITIAL_ATTITUDE, INITIAL_RATE),
    configure=configure,
    configuration=CONFIGURATION,
    state=STATE,
    inputs=(APPLIED_TORQUE, DISTURBANCE),
    outputs=TRUTH,
    step=step,
)
