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

"""The spacecraft: a rigid body with any inertia, and its actuator."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppc_attitude.science.attitude import kinematics, moved, normalised, runge_kutta
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import (
    Matrix,
    Quaternion,
    Vector,
    add,
    apply,
    cross,
    kernel,
    matrix,
    scale,
    subtract,
)

PLANT = np.dtype(
    [
        ("inertia", np.float64, (3, 3)),  # [kg·m²]
        ("inertia_inverse", np.float64, (3, 3)),
        ("max_torque", np.float64),  # [N·m] per axis
        ("min_torque", np.float64),  # [N·m] below this the actuator gives nothing
        ("attitude_noise", np.float64),  # [rad] standard deviation per axis
        ("rate_noise", np.float64),  # [rad/s] standard deviation per axis
        ("seed", np.int64),
    ],
    align=True,
)


def inertia_matrix(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Check an inertia [kg·m²] and return it as a 3 × 3 array.

    Parameters
    ----------
    name : str
        What to call it in an error.
    values : array_like
        Nine numbers, row-major.

    Raises
    ------
    ConfigurationError
        Not nine finite numbers, not symmetric, not positive definite, or the principal moments
        break the triangle inequality, so that no rigid body has it.
    """
    array = np.asarray(values, dtype=np.float64).ravel()
    if array.size != 9:
        raise ConfigurationError(f"{name} has {array.size} values, 9 (row-major) are needed")
    if not np.isfinite(array).all():
        raise ConfigurationError(f"{name} = {array.tolist()} must be finite")
    inertia = array.reshape(3, 3)
    if (np.abs(inertia - inertia.T) > 1e-9 * np.abs(inertia)).any():
        raise ConfigurationError(f"{name} = {inertia.tolist()} must be symmetric")
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] <= 0.0:
        raise ConfigurationError(
            f"{name} = {inertia.tolist()} must be positive definite; "
            f"its principal moments are {moments.tolist()} kg·m²"
        )
    if moments[0] + moments[1] < moments[2] * (1.0 - 1e-9):
        raise ConfigurationError(
            f"{name} = {inertia.tolist()} belongs to no rigid body: its principal moments "
            f"{moments.tolist()} kg·m² break the triangle inequality"
        )
    return inertia


@kernel
def angular_acceleration(
    omega: Vector, torque: Vector, inertia: Matrix, inertia_inverse: Matrix
) -> Vector:
    """ω' = J⁻¹ (τ − ω × J ω) [rad/s²], torque τ [N·m] in body axes."""
    return apply(inertia_inverse, subtract(torque, cross(omega, apply(inertia, omega))))


@kernel
def rigid_body_step(
    q: Quaternion,
    omega: Vector,
    torque: Vector,
    inertia: Matrix,
    inertia_inverse: Matrix,
    h: float,
) -> tuple[Quaternion, Vector]:
    """Attitude and rate after h [s] under a torque held over the step: classical Runge-Kutta.

    The total torque [N·m] is in body axes; the quaternion is normalised after the step.
    """
    q1 = kinematics(q, omega)
    a1 = angular_acceleration(omega, torque, inertia, inertia_inverse)
    w2 = add(omega, scale(0.5 * h, a1))
    q2 = kinematics(moved(q, 0.5 * h, q1), w2)
    a2 = angular_acceleration(w2, torque, inertia, inertia_inverse)
    w3 = add(omega, scale(0.5 * h, a2))
    q3 = kinematics(moved(q, 0.5 * h, q2), w3)
    a3 = angular_acceleration(w3, torque, inertia, inertia_inverse)
    w4 = add(omega, scale(h, a3))
    q4 = kinematics(moved(q, h, q3), w4)
    a4 = angular_acceleration(w4, torque, inertia, inertia_inverse)
    mean = add(add(a1, a4), scale(2.0, add(a2, a3)))
    return runge_kutta(q, h, q1, q2, q3, q4), add(omega, scale(h / 6.0, mean))


@kernel
def _axis_torque(command: float, max_torque: float, min_torque: float) -> float:
    if abs(command) < min_torque:
        return 0.0
    return min(max(command, -max_torque), max_torque)


@kernel
def actuator(command: Vector, max_torque: float, min_torque: float) -> Vector:
    """Torque [N·m] the actuator gives: saturation at max_torque, nothing below min_torque."""
    return (
        _axis_torque(command[0], max_torque, min_torque),
        _axis_torque(command[1], max_torque, min_torque),
        _axis_torque(command[2], max_torque, min_torque),
    )


@kernel
def plant_step(
    plant: Any, q: Quaternion, omega: Vector, applied: Vector, disturbance: Vector, h: float
) -> tuple[Quaternion, Vector]:
    """Attitude and rate of the plant after h [s], both torques [N·m] held over the step."""
    return rigid_body_step(
        q,
        omega,
        add(applied, disturbance),
        matrix(plant.inertia),
        matrix(plant.inertia_inverse),
        h,
    )


@kernel
def applied_torque(plant: Any, command: Vector) -> Vector:
    """Torque [N·m] that the plant's actuator gives for a command."""
    return actuator(command, plant.max_torque, plant.min_torque)


@kernel
def _bits(seed: int, step: int, draw: int) -> np.uint64:
    # splitmix64 of a counter: any sample can be drawn alone, in any process, after any restart.
    z = np.uint64(seed) * np.uint64(0xD1342543DE82EF95) + np.uint64(step) * np.uint64(
        0x9E3779B97F4A7C15
    )
    z += np.uint64(draw) * np.uint64(0xBF58476D1CE4E5B9) + np.uint64(0x94D049BB133111EB)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@kernel
def _normal_pair(seed: int, step: int, draw: int) -> tuple[float, float]:
    # Box-Muller; the first uniform is in (0, 1], so its logarithm is finite.
    unit = 2.0**-53
    u = (float(_bits(seed, step, 2 * draw) >> np.uint64(11)) + 1.0) * unit
    angle = 2.0 * math.pi * float(_bits(seed, step, 2 * draw + 1) >> np.uint64(11)) * unit
    radius = math.sqrt(-2.0 * math.log(u))
    return radius * math.cos(angle), radius * math.sin(angle)


@kernel
def measured(plant: Any, q: Quaternion, omega: Vector, step: int) -> tuple[Quaternion, Vector]:
    """What the sensors say of attitude and rate at a step: white Gaussian noise on each axis.

    The same seed and step always give the same noise; zero noise gives the truth itself.
    """
    if plant.attitude_noise == 0.0 and plant.rate_noise == 0.0:
        return q, omega
    n0, n1 = _normal_pair(plant.seed, step, 0)
    n2, n3 = _normal_pair(plant.seed, step, 1)
    n4, n5 = _normal_pair(plant.seed, step, 2)
    turn = kinematics(q, scale(plant.attitude_noise, (n0, n1, n2)))
    return normalised(moved(q, 1.0, turn)), add(omega, scale(plant.rate_noise, (n3, n4, n5)))


@kernel
def advance(
    plants: Any, q: Quaternion, omega: Vector, command: Vector, disturbance: Vector, h: float
) -> tuple[Vector, Quaternion, Vector]:
    """Applied torque [N·m], and attitude and rate after it was held for h [s].

    For a caller in Python: `plants` is an array of one record (`kernel.one`).
    """
    plant = plants[0]
    applied = applied_torque(plant, command)
    q, omega = plant_step(plant, q, omega, applied, disturbance, h)
    return applied, q, omega


@kernel
def sensed(plants: Any, q: Quaternion, omega: Vector, step: int) -> tuple[Quaternion, Vector]:
    """`measured` for a caller in Python: `plants` is an array of one record (`kernel.one`)."""
    return measured(plants[0], q, omega, step)
