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

"""What every control law takes and gives, and how the loop and the node call it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype, types

from ppc_attitude.science.attitude import attitude_error, to_body
from ppc_attitude.science.kernel import (
    Quaternion,
    Vector,
    apply,
    cross,
    kernel,
    quaternion,
    store,
    store_quaternion,
    subtract,
    vector,
)
from ppc_attitude.science.parameter import Parameter

MEASUREMENT = np.dtype(
    [
        ("t", np.float64),  # [s]
        ("attitude", np.float64, (4,)),  # x y z w, body to inertial
        ("angular_velocity", np.float64, (3,)),  # [rad/s] body
        ("reference_attitude", np.float64, (4,)),  # x y z w, desired to inertial
        ("reference_angular_velocity", np.float64, (3,)),  # [rad/s] desired
        ("reference_angular_acceleration", np.float64, (3,)),  # [rad/s²] desired
    ],
    align=True,
)
COMMAND = np.dtype(
    [
        ("torque_command", np.float64, (3,)),  # τ = sat(u) [N·m] body
        ("unsaturated_torque", np.float64, (3,)),  # u [N·m] body
        ("attitude_error", np.float64, (4,)),  # q_e, x y z w
        ("attitude_envelope", np.float64, (3,)),  # ρ_q
        ("rate_error", np.float64, (3,)),  # z2 [rad/s] body
        ("rate_envelope", np.float64, (3,)),  # ρ_ω [rad/s]
        ("auxiliary_state", np.float64, (3,)),  # θ
    ],
    align=True,
)
COLUMNS = tuple(COMMAND.names or ())


class Advice(NamedTuple):
    """What a law has to say to its user.

    Attributes
    ----------
    text : str
        The advice.
    warning : bool
        True if the user should act.
    """

    text: str
    warning: bool


def no_advice(memory: Any) -> Advice:
    """Advice of a law that has none."""
    return Advice("", warning=False)


def no_plans(memory: Any) -> int:
    """Number of the latest advice of a law that has none."""
    return 0


@dataclass(frozen=True)
class Controller:
    """A control law.

    Attributes
    ----------
    name : str
        Value of the parameter `controller` that selects it.
    parameters : tuple of Parameter
        What it can be configured with.
    configure : callable
        Checked parameter values to the record the step reads; raises ConfigurationError.
    memory : numpy.dtype
        What the law remembers between steps; all zero before the first.
    step : callable
        Kernel ``step(measurement, memory, configuration, command)``.
    signature : numba type
        The kernel's type.
    columns : tuple of str
        The fields of `COMMAND` that the law fills.
    advice : callable
        From the memory after a step to what the user should know.
    plans : callable
        From the memory to the number of its latest advice, which rises with every new one.
    """

    name: str
    parameters: tuple[Parameter, ...]
    configure: Callable[[Mapping[str, Any]], Any]
    memory: np.dtype[Any]
    step: Callable[[Any, Any, Any, Any], None]
    signature: Any
    columns: tuple[str, ...] = COLUMNS
    advice: Callable[[Any], Advice] = no_advice
    plans: Callable[[Any], int] = no_plans

    def fill(self, command: Any) -> dict[str, float]:
        """Largest |error|/envelope of each envelope the law has; above 1 the error is outside."""
        pairs = {"attitude_envelope": "attitude_error", "rate_envelope": "rate_error"}
        return {
            envelope: float(np.max(np.abs(command[error][:3]) / command[envelope]))
            for envelope, error in pairs.items()
            if envelope in self.columns and np.all(command[envelope] > 0.0)
        }

    def new_memory(self) -> Any:
        """Memory of a law that has not yet run."""
        return np.zeros((), self.memory)[()]


def new_measurement() -> Any:
    """Record to fill and hand to a step."""
    return np.zeros((), MEASUREMENT)[()]


def new_command() -> Any:
    """Record for a step to fill."""
    return np.zeros((), COMMAND)[()]


def step_signature(memory: np.dtype[Any], configuration: np.dtype[Any]) -> Any:
    """Numba type of a law's step."""
    return types.void(
        from_dtype(MEASUREMENT), from_dtype(memory), from_dtype(configuration), from_dtype(COMMAND)
    )


@kernel
def error_state(measurement: Any, inertia: Any) -> tuple[Quaternion, Vector, Vector]:
    """q_e, ω_e [rad/s] and M0 [N·m], the error system of eq. 1.

    ω_e = ω_s − C_e ω_d and M0 = J (ω_e × C_e ω_d) − J C_e ω_d' − ω_s × J ω_s, in body axes.
    """
    q_e = attitude_error(
        quaternion(measurement.attitude), quaternion(measurement.reference_attitude)
    )
    q, q0 = (q_e[0], q_e[1], q_e[2]), q_e[3]
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
    """Write what every law gives."""
    store_quaternion(command.attitude_error, q_e)
    store(command.rate_error, rate_error)
    store(command.unsaturated_torque, unsaturated)
    store(command.torque_command, torque)
