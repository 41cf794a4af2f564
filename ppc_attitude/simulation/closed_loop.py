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

"""The closed loop in process: the kernels of the nodes, called in the order of the lock-step.

At every instant: state, reference and external torque of the stamp; the command from them; then
the plant holds both torques to the next stamp. The nodes do the same over topics, with the same
kernels and the same stamps, so both give the same numbers to the last bit.
"""

from functools import cache
from typing import Any

import numba
import numpy as np
from numba import from_dtype, types
from numpy.typing import NDArray

from ppc_attitude.contract.cdr import stamp_of
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, PLANT, REFERENCE, SAMPLED
from ppc_attitude.science.controllers.interface import (
    COLUMNS,
    COMMAND,
    MEASUREMENT,
    Advice,
    new_command,
    new_measurement,
)
from ppc_attitude.science.controllers.registry import CONTROLLERS
from ppc_attitude.science.disturbance import PULSE, external_torque
from ppc_attitude.science.kernel import OPTIONS, quaternion, store, store_quaternion, vector
from ppc_attitude.science.reference import CURSOR, desired_motion, new_cursor
from ppc_attitude.science.reference import REFERENCE as REFERENCE_RECORD
from ppc_attitude.science.spacecraft import PLANT as PLANT_RECORD
from ppc_attitude.science.spacecraft import applied_torque, measured, plant_step
from ppc_attitude.simulation.scenario import (
    Scenario,
    initial_state,
    plant_record,
    pulses,
    reference_record,
)

_TUPLE: Any = types.UniTuple  # untyped in Numba
_QUATERNION = _TUPLE(types.float64, 4)
_VECTOR = _TUPLE(types.float64, 3)
SAMPLE = np.dtype([(t.column, np.float64, (t.width,)) for t in SAMPLED], align=True)


def _loop(
    step: Any,
    memory: Any,
    configuration: Any,
    plant: Any,
    reference: Any,
    cursor: Any,
    environment: bool,
    disturbances: Any,
    stamps_ns: Any,
    q: Any,
    omega: Any,
    measurement: Any,
    command: Any,
    samples: Any,
) -> None:
    """Run the loop over the stamps and write every topic's sample; the kernel of `simulate`."""
    for k in range(stamps_ns.size):
        t = stamps_ns[k] * 1e-9
        sample = samples[k]
        q_measured, omega_measured = measured(plant, q, omega, k)
        q_d, omega_d, acceleration_d = desired_motion(t, reference, cursor)
        disturbance = external_torque(stamps_ns[k], t, environment, disturbances)

        measurement.t = t
        store_quaternion(measurement.attitude, q_measured)
        store(measurement.angular_velocity, omega_measured)
        store_quaternion(measurement.reference_attitude, q_d)
        store(measurement.reference_angular_velocity, omega_d)
        store(measurement.reference_angular_acceleration, acceleration_d)
        step(measurement, memory, configuration, command)
        applied = applied_torque(plant, vector(command.torque_command))

        store_quaternion(sample.attitude, q_measured)
        store(sample.angular_velocity, omega_measured)
        store(sample.applied_torque, applied)
        store_quaternion(sample.reference_attitude, q_d)
        store(sample.reference_angular_velocity, omega_d)
        store(sample.reference_angular_acceleration, acceleration_d)
        store(sample.torque_command, vector(command.torque_command))
        store(sample.disturbance_torque, disturbance)
        store_quaternion(sample.attitude_error, quaternion(command.attitude_error))
        store(sample.attitude_envelope, vector(command.attitude_envelope))
        store(sample.rate_error, vector(command.rate_error))
        store(sample.rate_envelope, vector(command.rate_envelope))
        store(sample.auxiliary_state, vector(command.auxiliary_state))
        store(sample.unsaturated_torque, vector(command.unsaturated_torque))

        if k + 1 < stamps_ns.size:
            h = (stamps_ns[k + 1] - stamps_ns[k]) * 1e-9
            q, omega = plant_step(plant, q, omega, applied, disturbance, h)


@cache
def loop_of(name: str) -> Any:
    """Compile the loop around one law's step, which it takes as a first-class function."""
    controller = CONTROLLERS[name]
    step = types.FunctionType(controller.signature)
    arguments = controller.signature.args
    signature = types.void(
        step,
        arguments[1],
        arguments[2],
        from_dtype(PLANT_RECORD),
        from_dtype(REFERENCE_RECORD),
        from_dtype(CURSOR),
        types.boolean,
        from_dtype(PULSE)[::1],
        types.int64[::1],
        _QUATERNION,
        _VECTOR,
        from_dtype(MEASUREMENT),
        from_dtype(COMMAND),
        from_dtype(SAMPLE)[::1],
    )
    return numba.njit(signature, **OPTIONS)(_loop)


def stamps_of(rate: float, duration: float) -> NDArray[np.int64]:
    """Stamps [ns] of a run: both ends included."""
    steps = round(duration * rate)
    return np.array([stamp_of(k, rate) for k in range(steps + 1)], dtype=np.int64)


def run_samples(
    scenario: Scenario, stamps_ns: NDArray[np.int64], samples: NDArray[Any] | None = None
) -> NDArray[Any]:
    """Closed loop of a scenario over the stamps.

    Parameters
    ----------
    scenario : Scenario
        What to run.
    stamps_ns : ndarray of int64, shape (n,)
        Instants [ns].
    samples : ndarray of dtype `SAMPLE`, shape (n,), optional
        Where to write, to use one buffer for many runs.

    Returns
    -------
    ndarray of dtype `SAMPLE`, shape (n,)
    """
    law = scenario.controller
    values = scenario.parameters
    if samples is None:
        samples = np.zeros(stamps_ns.size, SAMPLE)
    q, omega = initial_state(values[PLANT])
    loop_of(law.name)(
        law.step,
        law.new_memory(),
        law.configure(values[CONTROLLER]),
        plant_record(values[PLANT]),
        reference_record(values[REFERENCE]),
        new_cursor(),
        bool(values[INJECTOR]["environment"]),
        pulses(values[INJECTOR]),
        stamps_ns,
        q,
        omega,
        new_measurement(),
        new_command(),
        samples,
    )
    return samples


def simulate(scenario: Scenario, duration: float) -> RunRecord:
    """Run a scenario in process for `duration` [s].

    Returns
    -------
    RunRecord
        The same samples that a recorded run of the nodes gives.
    """
    stamps_ns = stamps_of(scenario.number(PLANT, "rate"), duration)
    return record_of(scenario, stamps_ns, run_samples(scenario, stamps_ns))


def record_of(scenario: Scenario, stamps_ns: NDArray[np.int64], samples: NDArray[Any]) -> RunRecord:
    """Samples of `run_samples` as a record, without a copy."""
    columns = [
        topic.column
        for topic in SAMPLED
        if topic.column not in COLUMNS or topic.column in scenario.controller.columns
    ]
    return RunRecord(
        source="simulate",
        controller=scenario.controller.name,
        stamps_ns=stamps_ns,
        columns={column: samples[column] for column in columns},
        parameters=scenario.parameters,
    )


def warm_up(scenario: Scenario) -> None:
    """Compile every kernel of a scenario, so that processes started next find them cached."""
    run_samples(scenario, stamps_of(scenario.number(PLANT, "rate"), 0.1))


def first_step(scenario: Scenario) -> tuple[Any, Advice]:
    """What the law commands at t = 0 (dtype `COMMAND`), and what it says of the start."""
    law, values = scenario.controller, scenario.parameters
    measurement, command, memory = new_measurement(), new_command(), law.new_memory()
    attitude, rate = initial_state(values[PLANT])
    motion = desired_motion(0.0, reference_record(values[REFERENCE]), new_cursor())
    measurement["attitude"], measurement["angular_velocity"] = attitude, rate
    measurement["reference_attitude"] = motion[0]
    measurement["reference_angular_velocity"] = motion[1]
    measurement["reference_angular_acceleration"] = motion[2]
    law.step(measurement, memory, law.configure(values[CONTROLLER]), command)
    return command, law.advice(memory)
