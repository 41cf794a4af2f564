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

"""Motors of reaction wheels, and magnetorquers, that take what flight software sends.

The motors are those of `actuators.wheel_motors`. Rods with a dipole m turn the craft by m × B.
"""

from collections.abc import Mapping
from typing import Any

from ppc_attitude.science import magnetorquers, wheels
from ppc_attitude.science.actuators import wheel_motors
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import RECORD, Failure, faults_of, faulty
from ppc_attitude.science.geomagnetic import MAGNETIC_FIELD
from ppc_attitude.science.kernel import Vector, add, cross, kernel, store, vector
from ppc_attitude.science.magnetorquers import DIPOLE, MAX_DIPOLE, torque_of_rods, within
from ppc_attitude.science.parameter import filled, record_type

RODS = record_type(MAX_DIPOLE, ("faults", RECORD))


def rods_of(values: Mapping[str, Any]) -> Any:
    """Record of dtype `RODS` from checked parameter values.

    Raises
    ------
    ConfigurationError
        The rods are stronger than the wheels, or a fault is invalid.
    """
    certain, of_rods = wheels.torques(values)[0], torque_of_rods(values)
    if of_rods >= certain:
        raise ConfigurationError(
            f"{MAX_DIPOLE.name} = {values[MAX_DIPOLE.name]:g} A·m² gives {of_rods:.3g} N·m in the "
            f"strongest field; allowed: less than the {certain:.3g} N·m that the wheels give about "
            "every axis"
        )
    return filled(RODS, values, "magnetorquers.", faults=faults_of(values, magnetorquers.RODS))


def parts_of(values: Mapping[str, Any]) -> dict[str, tuple[Failure, ...]]:
    """Return wheels and rods by their names, and how each can fail."""
    return {**wheels.parts_of(values), **magnetorquers.RODS}


@kernel
def turn(inputs: Any, dipole: Vector, rods: Any, outputs: Any) -> None:
    """Let the rods give a dipole [A·m²]; add their torque to that of the wheels.

    Parameters
    ----------
    inputs
        Record with the instant and the true field.
    dipole
        Commanded, body axes; one that is too large is scaled as a whole.
    rods
        Record of dtype `RODS`.
    outputs
        Record with the columns that the actuator gives.
    """
    stamp_ns, b = inputs.stamp_ns, vector(inputs.magnetic_field)
    dipole = within(dipole, rods.max_dipole)
    if rods.faults.count:
        dipole = (
            faulty(dipole[0], rods.max_dipole, rods.faults, 0, stamp_ns),
            faulty(dipole[1], rods.max_dipole, rods.faults, 1, stamp_ns),
            faulty(dipole[2], rods.max_dipole, rods.faults, 2, stamp_ns),
        )
    store(outputs.magnetorquer_dipole, dipole)
    store(outputs.applied_torque, add(vector(outputs.applied_torque), cross(dipole, b)))


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Let motors and rods give what a node asks of them."""
    wheel_motors.step(inputs, state, configuration, outputs)
    turn(inputs, vector(inputs.magnetorquer_dipole_command), configuration.rods, outputs)


def torques(values: Mapping[str, Any]) -> tuple[float, float]:
    """Torque on an axis [N·m] that is given in any direction, rods against it; and the largest."""
    certain, most = wheels.torques(values)
    of_rods = torque_of_rods(values)
    return certain - of_rods, most + of_rods


COMPONENT = wheel_motors.COMPONENT.extended(
    "wheel_motors_rods",
    {"rods": (RODS, rods_of)},
    parameters=(MAX_DIPOLE,),
    inputs=(magnetorquers.COMMAND, MAGNETIC_FIELD),
    outputs=(DIPOLE,),
    step=step,
    limits=(*wheel_motors.COMPONENT.limits, MAX_DIPOLE.name),
    torque=torques,
    faults=parts_of,
)
