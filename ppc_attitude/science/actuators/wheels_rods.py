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

"""Reaction wheels, and magnetorquers that unload them, with drive and law on board.

The wheels are those of `actuators.wheels`, the rods those of `actuators.wheel_motors_rods`, and the
law is that of `magnetorquers`.
"""

from typing import Any

from ppc_attitude.science import magnetorquers
from ppc_attitude.science.actuators import wheel_motors_rods, wheels
from ppc_attitude.science.actuators.wheel_motors_rods import RODS, rods_of, turn
from ppc_attitude.science.geomagnetic import MAGNETIC_FIELD
from ppc_attitude.science.kernel import kernel
from ppc_attitude.science.magnetorquers import (
    DIPOLE,
    HELD,
    MAGNETORQUERS,
    magnetorquer_record,
    unload,
)


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Let the wheels give the commanded torque, and add that of the rods."""
    wheels.step(inputs, state, configuration, outputs)
    dipole = unload(inputs, configuration.drive.wheels, state.held, configuration.law)
    turn(inputs, dipole, configuration.rods, outputs)


COMPONENT = wheels.COMPONENT.extended(
    "wheels_rods",
    {"law": (MAGNETORQUERS, magnetorquer_record), "rods": (RODS, rods_of)},
    (("held", HELD),),
    parameters=magnetorquers.PARAMETERS,
    inputs=(MAGNETIC_FIELD,),
    outputs=(DIPOLE,),
    step=step,
    limits=wheel_motors_rods.COMPONENT.limits,
    torque=wheel_motors_rods.torques,
    faults=wheel_motors_rods.parts_of,
    conditions=magnetorquers.conditions,
)
