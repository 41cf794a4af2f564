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

"""Attitude and rate measured directly: exact, or with white Gaussian noise on each axis."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import euler_step, kinematics, normalised
from ppc_attitude.science.compiled_stamps import step_of
from ppc_attitude.science.component import Component
from ppc_attitude.science.kernel import (
    Quaternion,
    Vector,
    add,
    kernel,
    quaternion,
    scale,
    store,
    store_quaternion,
    vector,
)
from ppc_attitude.science.noise import normal_pair
from ppc_attitude.science.parameter import Parameter
from ppc_attitude.science.signals import TOLD, TRUTH

_SIZES = (
    Parameter(
        "attitude_noise",
        0.0,
        "standard deviation of the measured attitude, per axis",
        "rad",
        low=0.0,
        high=1.0,
    ),
    Parameter(
        "rate_noise",
        0.0,
        "standard deviation of the measured rate, per axis",
        "rad/s",
        low=0.0,
        high=1.0,
    ),
)
SEED = Parameter("seed", 0, "seed of the sensor noise", low=0, high=2**53, read_only=True)
CONFIGURATION = np.dtype(
    [
        ("attitude_noise", np.float64),  # [rad] standard deviation per axis
        ("rate_noise", np.float64),  # [rad/s] standard deviation per axis
        ("seed", np.int64),
        ("rate", np.float64),  # [Hz] of the plant: the noise belongs to a step
    ],
    align=True,
)


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values."""
    record = np.zeros((), CONFIGURATION)[()]
    for name in CONFIGURATION.names or ():
        record[name] = values[name]
    return record


@kernel
def measured(
    q: Quaternion, omega: Vector, attitude_noise: float, rate_noise: float, seed: int, step: int
) -> tuple[Quaternion, Vector]:
    """Measured attitude and rate [rad/s] at a step; noise in [rad] and [rad/s].

    The same seed and step always give the same noise; zero noise gives the truth itself.
    """
    if attitude_noise == 0.0 and rate_noise == 0.0:
        return q, omega
    n0, n1 = normal_pair(seed, step, 0)
    n2, n3 = normal_pair(seed, step, 1)
    n4, n5 = normal_pair(seed, step, 2)
    turn = kinematics(q, scale(attitude_noise, (n0, n1, n2)))
    return normalised(euler_step(q, 1.0, turn)), add(omega, scale(rate_noise, (n3, n4, n5)))


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Measure the motion of an instant."""
    q, omega = measured(
        quaternion(inputs.truth_attitude),
        vector(inputs.truth_angular_velocity),
        configuration.attitude_noise,
        configuration.rate_noise,
        configuration.seed,
        step_of(inputs.stamp_ns, configuration.rate),
    )
    store_quaternion(outputs.attitude, q)
    store(outputs.angular_velocity, omega)


def is_exact(values: Mapping[str, Any]) -> bool:
    """True if there is no noise."""
    return not (values["attitude_noise"] or values["rate_noise"])


COMPONENT = Component(
    name="direct",
    parameters=(*_SIZES, SEED),
    configure=configure,
    configuration=CONFIGURATION,
    inputs=TRUTH,
    outputs=TOLD,
    step=step,
    exact=is_exact,
)
