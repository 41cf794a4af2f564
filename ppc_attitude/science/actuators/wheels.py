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

"""Reaction wheels with a drive on board: from the commanded torque to that of each motor.

The drive (`allocators.wheel_drive`) knows rate and wheel speeds without error, and the motors
(`actuators.wheel_motors`) give the torques that it asks for in the same instant.
"""

from typing import Any

from ppc_attitude.science import wheels
from ppc_attitude.science.actuators import wheel_motors
from ppc_attitude.science.allocators import wheel_drive
from ppc_attitude.science.component import Component
from ppc_attitude.science.faults import FAULTS
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kernel import kernel, vector
from ppc_attitude.science.parameter import filled, record_type
from ppc_attitude.science.signals import APPLIED_TORQUE, TORQUE_COMMAND, TRUE_RATE

CONFIGURATION = record_type(
    ("drive", wheel_drive.CONFIGURATION), ("motors", wheel_motors.CONFIGURATION)
)
STATE = record_type(("drive", wheel_drive.STATE), ("motors", wheel_motors.STATE))


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Share the commanded torque among the wheels; write the torque that acts on the body."""
    asked, rate = outputs.wheel_torque, vector(inputs.truth_angular_velocity)
    wheel_drive.share(inputs, rate, state.drive, configuration.drive, asked)
    wheel_motors.act(inputs, asked, state.motors, configuration.motors, outputs)


def advice(state: Any) -> Advice:
    """Warn of wheels that are lost, and of one that has reached its largest speed."""
    drive, motors = wheel_drive.advice(state["drive"]), wheel_motors.advice(state["motors"])
    return Advice(
        "; ".join(filter(None, (drive.text, motors.text))),
        warning=drive.warning or motors.warning,
        failed=drive.failed,
        numbers={**motors.numbers, **drive.numbers},
    )


COMPONENT = Component(
    name="wheels",
    parameters=(*wheels.PARAMETERS, *wheel_drive.OWN_PARAMETERS, FAULTS),
    configure=lambda values: filled(
        CONFIGURATION,
        values,
        drive=wheel_drive.COMPONENT.configure(values),
        motors=wheel_motors.COMPONENT.configure(values),
    ),
    configuration=CONFIGURATION,
    state=STATE,
    inputs=(TORQUE_COMMAND, TRUE_RATE, wheels.SPEED),
    outputs=(APPLIED_TORQUE, wheels.TORQUE),
    step=step,
    advice=advice,
    advices=lambda state: int(state["drive"]["news"] + state["motors"]["news"]),
    limits=(wheels.MAX_TORQUE.name,),
    torque=wheels.torques,
    faults=wheels.parts_of,
)
