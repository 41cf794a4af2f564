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

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import euler_step, exponential, kinematics, normalised, product
from ppc_attitude.science.compiled_stamps import step_of
from ppc_attitude.science.component import Component
from ppc_attitude.science.faults import (
    FAULTS,
    RECORD,
    Failure,
    How,
    acting,
    fault_texts,
    faults_of,
    number_of,
)
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
from ppc_attitude.science.parameter import RATE, Parameter, at_start, filled, record_type
from ppc_attitude.science.signals import TOLD, TRUTH

_size = partial(Parameter, low=0.0, high=1.0)
_SIZES = (
    _size("attitude_noise", 0.0, "standard deviation of the measured attitude, per axis", "rad"),
    _size("rate_noise", 0.0, "standard deviation of the measured rate, per axis", "rad/s"),
)
SEED = at_start("seed", 0, "seed of the sensor noise", low=0, high=2**53)
_ATTITUDE, _RATE = 0, 1
PARTS = {
    f"sensor/{name}": (
        Failure(How.FROZEN),
        Failure(How.BIAS, 3, unit=unit),
        Failure(How.NOISE, 1, 0.0, multiplies=(f"{name}_noise",)),
    )
    for name, unit in (("attitude", "rad"), ("rate", "rad/s"))
}
STATE = record_type(
    ("started", np.float64),
    ("attitude", np.float64, (4,)),  # as told last, x y z w
    ("rate", np.float64, (3,)),  # [rad/s] as told last
)
CONFIGURATION = record_type(*_SIZES, SEED, RATE, ("faults", RECORD))


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
def _failed(
    q: Quaternion, omega: Vector, stamp_ns: int, state: Any, faults: Any
) -> tuple[Quaternion, Vector]:
    """Attitude and rate [rad/s] that the sensors give with their faults, from those without."""
    i = acting(faults, _ATTITUDE, How.BIAS, stamp_ns)
    if i >= 0:
        q = normalised(product(q, exponential(vector(faults.fault[i].value))))
    i = acting(faults, _RATE, How.BIAS, stamp_ns)
    if i >= 0:
        omega = add(omega, vector(faults.fault[i].value))
    if state.started != 0.0:
        if acting(faults, _ATTITUDE, How.FROZEN, stamp_ns) >= 0:
            q = quaternion(state.attitude)
        if acting(faults, _RATE, How.FROZEN, stamp_ns) >= 0:
            omega = vector(state.rate)
    return q, omega


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Measure the motion of an instant."""
    faults, stamp_ns = configuration.faults, inputs.stamp_ns
    q, omega = measured(
        quaternion(inputs.truth_attitude),
        vector(inputs.truth_angular_velocity),
        configuration.attitude_noise * number_of(faults, _ATTITUDE, How.NOISE, stamp_ns, 1.0),
        configuration.rate_noise * number_of(faults, _RATE, How.NOISE, stamp_ns, 1.0),
        configuration.seed,
        step_of(stamp_ns, configuration.rate),
    )
    q, omega = _failed(q, omega, stamp_ns, state, faults)
    state.started = 1.0
    store_quaternion(state.attitude, q)
    store(state.rate, omega)
    store_quaternion(outputs.attitude, q)
    store(outputs.angular_velocity, omega)


def is_exact(values: Mapping[str, Any]) -> bool:
    """True if there is neither noise nor a fault."""
    faulty = any(text.split()[0] in PARTS for text in fault_texts(values))
    return not (values["attitude_noise"] or values["rate_noise"] or faulty)


def noise(values: Mapping[str, Any], rate: float) -> tuple[float, float, float]:
    """Variances of attitude and bias, and the rate's white noise, as `Component.noise` says."""
    return values["attitude_noise"] ** 2, 0.0, values["rate_noise"] / math.sqrt(rate)


COMPONENT = Component(
    name="direct",
    parameters=(*_SIZES, SEED, FAULTS),
    configure=lambda values: filled(CONFIGURATION, values, faults=faults_of(values, PARTS)),
    configuration=CONFIGURATION,
    state=STATE,
    inputs=TRUTH,
    outputs=TOLD,
    step=step,
    quiet=dict.fromkeys((each.name for each in _SIZES), 0.0),
    exact=is_exact,
    faults=lambda values: PARTS,
    noise=noise,
)
