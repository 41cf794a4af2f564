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

"""Reaction wheels, and magnetorquers that unload them.

The wheels are those of `actuators.wheels`. The rods turn the craft by m × B on top; the law takes
that as a disturbance, and the wheels give their momentum away against it.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science import magnetorquers, wheels
from ppc_attitude.science.actuators import wheels as driven
from ppc_attitude.science.compiled_stamps import step_of
from ppc_attitude.science.component import Component
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import RECORD, Failure, How, faults_of, faulty
from ppc_attitude.science.geomagnetic import MAGNETIC_FIELD
from ppc_attitude.science.kernel import Vector, add, cross, kernel, store, vector
from ppc_attitude.science.magnetorquers import (
    DIPOLE,
    MAGNETORQUERS,
    MAX_DIPOLE,
    STRONGEST_FIELD,
    magnetorquer_record,
    unloading_dipole,
)

_RODS = dict.fromkeys(
    ("magnetorquer/x", "magnetorquer/y", "magnetorquer/z"),
    (Failure(How.EFFECTIVENESS, 1, 0.0, 1.0), Failure(How.STUCK, 1, unit="A·m²")),
)
CONFIGURATION = np.dtype(
    [("wheels", driven.CONFIGURATION), ("rods", MAGNETORQUERS), ("faults", RECORD)], align=True
)
STATE = np.dtype(
    [
        ("wheels", driven.STATE),
        ("begun", np.int64),  # periods, the present one included
        ("dipole", np.float64, (3,)),  # [A·m²] asked for, held
    ],
    align=True,
)


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values.

    Raises
    ------
    ConfigurationError
        The wheels are impossible or weaker than the rods, or the period of the rods is no whole
        number of steps, or a fault is none.
    """
    record = np.zeros((), CONFIGURATION)[()]
    record["wheels"] = driven.configure(values)
    record["rods"] = magnetorquer_record(values)
    record["faults"] = faults_of(values, _RODS)
    certain, of_rods = wheels.torques(values)[0], torque_of_rods(values)
    if of_rods >= certain:
        raise ConfigurationError(
            f"{MAX_DIPOLE.name} = {values[MAX_DIPOLE.name]:g} A·m²: {of_rods:.3g} N·m in the "
            f"strongest field; allowed: less than the {certain:.3g} N·m that the wheels give"
        )
    return record


def torque_of_rods(values: Mapping[str, Any]) -> float:
    """Largest torque on an axis [N·m]: two rods are across it."""
    return math.sqrt(2.0) * float(values[MAX_DIPOLE.name]) * STRONGEST_FIELD


def parts_of(values: Mapping[str, Any]) -> dict[str, tuple[Failure, ...]]:
    """Return wheels and rods by their names, and how each can fail."""
    return {**wheels.parts_of(values), **_RODS}


@kernel
def _given(m: Vector, configuration: Any, stamp_ns: int) -> Vector:
    """Dipole [A·m²] that the rods give of one that is asked for."""
    most, faults = configuration.rods.max_dipole, configuration.faults
    return (
        faulty(m[0], most, faults, 0, stamp_ns),
        faulty(m[1], most, faults, 1, stamp_ns),
        faulty(m[2], most, faults, 2, stamp_ns),
    )


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Let the wheels give the commanded torque, and add that of the rods."""
    driven.step(inputs, state.wheels, configuration.wheels, outputs)
    rods, b = configuration.rods, vector(inputs.magnetic_field)
    now = step_of(inputs.stamp_ns, 1.0 / configuration.wheels.motors.h)
    if now // rods.period + 1 != state.begun:
        state.begun = now // rods.period + 1
        # The momenta h* to which the drive leads the wheels cancel: all of Σ h a is too much.
        excess = wheels.momentum(configuration.wheels.motors.wheels, inputs.wheel_speed)
        store(state.dipole, unloading_dipole(excess, b, now, rods))
    dipole = vector(state.dipole)
    if configuration.faults.count:
        dipole = _given(dipole, configuration, inputs.stamp_ns)
    store(outputs.magnetorquer_dipole, dipole)
    store(outputs.applied_torque, add(vector(outputs.applied_torque), cross(dipole, b)))


def torques(values: Mapping[str, Any]) -> tuple[float, float]:
    """Torque on an axis [N·m] that wheels give in any direction, rods against it; and at most."""
    certain, most = wheels.torques(values)
    of_rods = torque_of_rods(values)
    return certain - of_rods, most + of_rods


COMPONENT = Component(
    name="wheels_rods",
    parameters=(*driven.COMPONENT.parameters, *magnetorquers.PARAMETERS),
    configure=configure,
    configuration=CONFIGURATION,
    state=STATE,
    inputs=(*driven.COMPONENT.inputs, MAGNETIC_FIELD),
    outputs=(*driven.COMPONENT.outputs, DIPOLE),
    step=step,
    advice=lambda state: driven.advice(state["wheels"]),
    advices=lambda state: driven.COMPONENT.advices(state["wheels"]),
    limits=(*driven.COMPONENT.limits, MAX_DIPOLE.name),
    torque=torques,
    faults=parts_of,
)
