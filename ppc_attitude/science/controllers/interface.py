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

"""The interface of every control law: the error system, and the columns for it."""

from typing import Any

from ppc_attitude.science.attitude import attitude_error, to_body
from ppc_attitude.science.component import BODY, DESIRED, QUATERNION, VECTOR, WRENCH
from ppc_attitude.science.controllers.common import of_law
from ppc_attitude.science.kernel import (
    Quaternion,
    Vector,
    apply,
    cross,
    inlined,
    kernel,
    quaternion,
    store,
    store_quaternion,
    subtract,
    vector,
)
from ppc_attitude.science.signals import DESIRED_MOTION, TOLD, TORQUE_COMMAND

ATTITUDE_ERROR = of_law("attitude_error", QUATERNION, DESIRED, "1", "attitude error q_e, x y z w")
RATE_ERROR = of_law("rate_error", VECTOR, BODY, "rad/s", "rate error z2")
UNSATURATED_TORQUE = of_law("unsaturated_torque", WRENCH, BODY, "N·m", "torque u before saturation")
INPUTS = (*TOLD, *DESIRED_MOTION)
"""Columns that every law of ours reads."""
OUTPUTS = (TORQUE_COMMAND, ATTITUDE_ERROR, RATE_ERROR, UNSATURATED_TORQUE)
"""Columns that `store_command` writes."""


@inlined
def error_state(measurement: Any, inertia: Any) -> tuple[Quaternion, Vector, Vector]:
    """q_e = q_d⁻¹ ⊗ q_s (x y z w), ω_e [rad/s] and M0 [N·m] of eq. 1; the inertia J is in kg·m².

    ω_e = ω_s − C_e ω_d and M0 = J (ω_e × C_e ω_d) − J C_e ω_d' − ω_s × J ω_s, in body axes.
    """
    q_e = attitude_error(
        quaternion(measurement.attitude), quaternion(measurement.reference_attitude)
    )
    q, q0 = vector(q_e), q_e[3]
    omega_s = vector(measurement.angular_velocity)
    omega_d = to_body(vector(measurement.reference_angular_velocity), q, q0)
    acceleration_d = to_body(vector(measurement.reference_angular_acceleration), q, q0)
    omega_e = subtract(omega_s, omega_d)
    feedforward = apply(inertia, subtract(cross(omega_e, omega_d), acceleration_d))
    gyroscopic = cross(omega_s, apply(inertia, omega_s))
    return q_e, omega_e, subtract(feedforward, gyroscopic)


@kernel
def store_command(
    command: Any, q_e: Quaternion, rate_error: Vector, unsaturated: Vector, torque: Vector
) -> None:
    """Write the columns of `OUTPUTS`: q_e x y z w; rate error [rad/s] and torques [N·m], body."""
    store_quaternion(command.attitude_error, q_e)
    store(command.rate_error, rate_error)
    store(command.unsaturated_torque, unsaturated)
    store(command.torque_command, torque)
