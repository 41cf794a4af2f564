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

"""Sudden disturbances: pulses of torque on top of the environment's."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.component import Component
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import Vector, add, array_at, inlined, kernel, store, vector
from ppc_attitude.science.parameter import Parameter, filled, record_type
from ppc_attitude.science.signals import DISTURBANCE, ENVIRONMENT_TORQUE
from ppc_attitude.science.stamps import LATEST, span

TIMES = Parameter("pulse_times", [], "start of each scheduled pulse", "s", low=0.0, high=LATEST)
DURATIONS = Parameter(
    "pulse_durations",
    [],
    "duration of each scheduled pulse; it acts from the first state in it to the first after it",
    "s",
    above=0.0,
    high=LATEST,
)
TORQUES = Parameter(
    "pulse_torques",
    [],
    "torque of each scheduled pulse, three values a pulse, body axes",
    "N·m",
    length=-3,
    low=-1e6,
    high=1e6,
)
PULSE = record_type(
    ("start_ns", np.int64),  # first instant [ns] at which it acts
    ("end_ns", np.int64),  # first instant [ns] at which it no longer acts
    ("torque", np.float64, (3,)),  # [N·m] body
)
CONFIGURATION = record_type(("count", np.int64), ("address", np.uint64))


def pulse(start_ns: int, end_ns: int, torque: Sequence[float]) -> NDArray[Any]:
    """One pulse, as an array of dtype `PULSE` of length 1."""
    return np.array([(start_ns, end_ns, tuple(torque))], PULSE)


def scheduled_pulses(values: Mapping[str, Any]) -> NDArray[Any]:
    """Scheduled pulses, array of dtype `PULSE`, from the injector's parameters.

    Raises
    ------
    ConfigurationError
        Times, durations and torques are not equally many.
    """
    times, durations, torques = (values[each.name] for each in (TIMES, DURATIONS, TORQUES))
    if not len(times) == len(durations) == len(torques) // 3:
        raise ConfigurationError(
            f"pulse_times has {len(times)} values, pulse_durations {len(durations)}, "
            f"pulse_torques {len(torques)}; allowed: n, n and 3 n"
        )
    each = zip(times, durations, np.reshape(torques, (-1, 3)), strict=True)
    return np.array([(*span(at, time), torque) for at, time, torque in each], PULSE)


def configuration_of(pulses: NDArray[Any]) -> tuple[Any, NDArray[Any]]:
    """Record for the step, and the array that it refers to, which must be kept."""
    record = filled(CONFIGURATION, {}, count=pulses.size, address=pulses.ctypes.data)
    return record, pulses


@inlined
def with_pulses(stamp_ns: int, total: Vector, pulses: Any) -> Vector:
    """Return a torque [N·m] and the pulses that act from an instant [ns] on."""
    for i in range(pulses.size):
        if pulses[i].start_ns <= stamp_ns < pulses[i].end_ns:
            total = add(total, vector(pulses[i].torque))
    return total


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Add the pulses that act from an instant on to the torque of the environment."""
    pulses = array_at(configuration.address, configuration.count, PULSE)
    total = with_pulses(inputs.stamp_ns, vector(inputs.environment_torque), pulses)
    store(outputs.disturbance_torque, total)


COMPONENT = Component(
    name="pulses",
    parameters=(TIMES, DURATIONS, TORQUES),
    configure=lambda values: configuration_of(scheduled_pulses(values)),
    configuration=CONFIGURATION,
    inputs=(ENVIRONMENT_TORQUE,),
    outputs=(DISTURBANCE,),
    step=step,
)
