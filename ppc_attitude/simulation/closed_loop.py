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

What depends on time alone (desired motion, environment torque) is computed before the loop, so
that a campaign does it once for all its runs.
"""

from functools import cache
from typing import Any

import numba
import numpy as np
from numba import from_dtype, types
from numpy.typing import NDArray

from ppc_attitude.contract.cdr import seconds, stamp_of
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, PLANT, REFERENCE
from ppc_attitude.science.controllers.interface import (
    COLUMNS,
    COMMAND,
    MEASUREMENT,
    new_command,
    new_measurement,
)
from ppc_attitude.science.controllers.registry import CONTROLLERS
from ppc_attitude.science.controllers.runner import INPUTS, LawRunner
from ppc_attitude.science.disturbance import PULSE, environment_torque, external_torque, with_pulses
from ppc_attitude.science.kernel import (
    OPTIONS,
    kernel,
    one,
    quaternion,
    store,
    store_quaternion,
    vector,
)
from ppc_attitude.science.reference import desired_motion, motion_at, new_cursor
from ppc_attitude.science.spacecraft import PLANT as PLANT_RECORD
from ppc_attitude.science.spacecraft import advance, applied_torque, measured, plant_step, sensed
from ppc_attitude.simulation.samples import (
    ROWS,
    columns_of,
    new_samples,
    put,
    put_quaternion,
    taken,
    taken_quaternion,
)
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
_ENVIRONMENT = 10  # first row of the environment torque in a timetable, after the motion
_seconds = kernel(seconds)


@kernel
def _fill_timetable(
    stamps_ns: Any, reference: Any, cursor: Any, environment: bool, timetable: Any
) -> None:
    for k in range(stamps_ns.size):
        t = _seconds(stamps_ns[k])
        q_d, omega_d, acceleration_d = desired_motion(t, reference, cursor)
        put_quaternion(timetable, 0, k, q_d)
        put(timetable, 4, k, omega_d)
        put(timetable, 7, k, acceleration_d)
        if environment:
            put(timetable, _ENVIRONMENT, k, environment_torque(t))


def _loop(
    step: Any,
    memory: Any,
    configuration: Any,
    plant: Any,
    timetable: Any,
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
        q_measured, omega_measured = measured(plant, q, omega, k)
        q_d = taken_quaternion(timetable, 0, k)
        omega_d, acceleration_d = taken(timetable, 4, k), taken(timetable, 7, k)
        disturbance = with_pulses(stamps_ns[k], taken(timetable, _ENVIRONMENT, k), disturbances)

        measurement.t = _seconds(stamps_ns[k])
        store_quaternion(measurement.attitude, q_measured)
        store(measurement.angular_velocity, omega_measured)
        store_quaternion(measurement.reference_attitude, q_d)
        store(measurement.reference_angular_velocity, omega_d)
        store(measurement.reference_angular_acceleration, acceleration_d)
        step(measurement, memory, configuration, command)
        applied = applied_torque(plant, vector(command.torque_command))

        put_quaternion(samples, ROWS.attitude, k, q_measured)
        put(samples, ROWS.angular_velocity, k, omega_measured)
        put(samples, ROWS.applied_torque, k, applied)
        put_quaternion(samples, ROWS.reference_attitude, k, q_d)
        put(samples, ROWS.reference_angular_velocity, k, omega_d)
        put(samples, ROWS.reference_angular_acceleration, k, acceleration_d)
        put(samples, ROWS.torque_command, k, vector(command.torque_command))
        put(samples, ROWS.disturbance_torque, k, disturbance)
        put_quaternion(samples, ROWS.attitude_error, k, quaternion(command.attitude_error))
        put(samples, ROWS.attitude_envelope, k, vector(command.attitude_envelope))
        put(samples, ROWS.rate_error, k, vector(command.rate_error))
        put(samples, ROWS.rate_envelope, k, vector(command.rate_envelope))
        put(samples, ROWS.auxiliary_state, k, vector(command.auxiliary_state))
        put(samples, ROWS.unsaturated_torque, k, vector(command.unsaturated_torque))

        if k + 1 < stamps_ns.size:
            h = _seconds(stamps_ns[k + 1] - stamps_ns[k])
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
        types.float64[:, ::1],
        from_dtype(PULSE)[::1],
        types.int64[::1],
        _QUATERNION,
        _VECTOR,
        from_dtype(MEASUREMENT),
        from_dtype(COMMAND),
        types.float64[:, ::1],
    )
    return numba.njit(signature, **OPTIONS)(_loop)


def stamps_of(rate: float, duration: float) -> NDArray[np.int64]:
    """Stamps [ns] of a run: both ends included."""
    steps = round(duration * rate)
    return np.array([stamp_of(k, rate) for k in range(steps + 1)], dtype=np.int64)


def timetable_of(scenario: Scenario, stamps_ns: NDArray[np.int64]) -> Array:
    """What of a scenario depends on time alone, at the stamps [ns].

    Returns
    -------
    ndarray, shape (13, n)
        Desired attitude x y z w, rate [rad/s] and acceleration [rad/s²] (desired frame);
        environment torque [N·m] (body).
    """
    timetable = np.zeros((_ENVIRONMENT + 3, stamps_ns.size))
    _fill_timetable(
        stamps_ns,
        reference_record(scenario.parameters[REFERENCE]),
        new_cursor(),
        bool(scenario.parameters[INJECTOR]["environment"]),
        timetable,
    )
    return timetable


def run_samples(
    scenario: Scenario,
    stamps_ns: NDArray[np.int64],
    samples: Array | None = None,
    timetable: Array | None = None,
) -> Array:
    """Closed loop of a scenario over the stamps.

    Parameters
    ----------
    scenario : Scenario
        What to run.
    stamps_ns : ndarray of int64, shape (n,)
        Instants [ns].
    samples : ndarray, optional
        Where to write (`new_samples`), to use one buffer for many runs.
    timetable : ndarray, shape (13, n), optional
        `timetable_of` this scenario and stamps, to compute it once for many runs.

    Returns
    -------
    ndarray
        The samples; `columns_of` tells them apart.
    """
    law = scenario.controller
    values = scenario.parameters
    if samples is None:
        samples = new_samples(stamps_ns.size)
    if timetable is None:
        timetable = timetable_of(scenario, stamps_ns)
    q, omega = initial_state(values[PLANT])
    loop_of(law.name)(
        law.step,
        law.new_memory(),
        law.configure(values[CONTROLLER]),
        plant_record(values[PLANT]),
        timetable,
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


def record_of(scenario: Scenario, stamps_ns: NDArray[np.int64], samples: Array) -> RunRecord:
    """Samples of `run_samples` as a record, without a copy."""
    columns = columns_of(samples)
    for name in set(COLUMNS) - set(scenario.controller.columns):
        del columns[name]
    return RunRecord(
        source="simulate",
        controller=scenario.controller.name,
        stamps_ns=stamps_ns,
        columns=columns,
        parameters=scenario.parameters,
    )


def warm_up(scenario: Scenario) -> None:
    """Compile every kernel of a scenario, so that processes started next find them cached."""
    run_samples(scenario, stamps_of(scenario.number(PLANT, "rate"), 0.1))
    _warm_up_nodes(scenario)


def _warm_up_nodes(scenario: Scenario) -> None:
    """Call once what the nodes call: the kernels of the loop, by the ways that Python takes."""
    values = scenario.parameters
    plant, (q, omega) = one(plant_record(values[PLANT])), initial_state(values[PLANT])
    disturbance = external_torque(
        0, 0.0, bool(values[INJECTOR]["environment"]), pulses(values[INJECTOR])
    )
    x, y, z = first_step(scenario).given("torque_command")
    advance(plant, q, omega, (x, y, z), disturbance, 0.01)


def first_step(scenario: Scenario) -> LawRunner:
    """Return the law after its step at t = 0, taken as the nodes take it.

    Raises
    ------
    ConfigurationError
        A parameter of the law is infeasible.
    """
    values = scenario.parameters
    measured_state = sensed(one(plant_record(values[PLANT])), *initial_state(values[PLANT]), 0)
    desired = motion_at(0.0, one(reference_record(values[REFERENCE])), one(new_cursor()))
    law = LawRunner(scenario.controller, values[CONTROLLER])
    law.step(0.0, dict(zip(INPUTS, (*measured_state, *desired), strict=True)))
    return law
