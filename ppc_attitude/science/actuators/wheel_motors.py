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

"""Motors of reaction wheels: from the torque commanded of each to the torque on the body.

    applied = −A (u − f) − ω × Σ J_s Ω a

Each motor gives its command within its limits, or what its faults leave of it. The command comes
from a drive on board (`actuators.wheels`) or, here, from flight software that sends a torque for
each wheel: the node that runs allocators, a program of the user's, or a record that is played.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science import wheels
from ppc_attitude.science.component import Component
from ppc_attitude.science.faults import (
    FAULTS,
    RECORD,
    How,
    acting,
    fails,
    faults_of,
    faulty,
    number_of,
)
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kernel import cross, kernel, scale, store, subtract, vector
from ppc_attitude.science.parameter import filled, record_type
from ppc_attitude.science.signals import APPLIED_TORQUE, TRUE_RATE
from ppc_attitude.science.wheels import TRACE, WHEELS, friction, momentum, room, wheel_record

_SEIZING = 0.1  # [s] in which the speed of a wheel that seizes falls to 1/e
CONFIGURATION = record_type(("wheels", WHEELS), ("faults", RECORD))
STATE = record_type(
    ("full", np.int64),  # wheel that first reached its largest speed, counted from 1; 0: none
    ("fastest", np.float64),  # largest share of its speed that a wheel has had
    ("news", np.int64),
)


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values.

    Raises
    ------
    ConfigurationError
        The wheels are impossible, a fault is invalid, or a step cannot follow the friction.
    """
    given, faults = wheel_record(values), faults_of(values, wheels.parts_of(values))
    for fault in faults["fault"][: faults["count"]]:
        if fault["kind"] == How.DRAG:
            wheels.see_that_a_step_follows(given, int(fault["part"]), float(fault["value"][0]))
    return filled(CONFIGURATION, values, wheels=given, faults=faults)


@kernel
def _failed(motor: float, i: int, speed: float, stamp_ns: int, configuration: Any) -> float:
    """Motor torque [N·m] of a wheel that fails; a fault of its bearing counts as motor torque."""
    faults, craft = configuration.faults, configuration.wheels
    resistance, limit = friction(craft, i, speed), craft.max_torque[i]
    drag = number_of(faults, i, How.DRAG, stamp_ns, 1.0)
    net = faulty(motor, limit, faults, i, stamp_ns)
    if acting(faults, i, How.SEIZED, stamp_ns) >= 0:
        net = -craft.inertia[i] * speed / max(_SEIZING, craft.h)
    elif acting(faults, i, How.STUCK, stamp_ns) < 0:  # a stuck torque is the one at the shaft
        net -= drag * resistance
    slower, faster = room(craft, i, speed)
    return float(resistance + min(max(net, -max(slower, 0.0)), max(faster, 0.0)))


@kernel
def _watch(speeds: Any, configuration: Any, state: Any) -> None:
    """Note how fast the wheels are, and the first that cannot take up more momentum."""
    craft = configuration.wheels
    for i in range(craft.count):
        speed = abs(speeds[i])
        state.fastest = max(state.fastest, speed / craft.max_speed[i])
        if speed >= craft.full[i] and state.full == 0:
            state.full = i + 1
            state.news += 1


@kernel
def act(inputs: Any, asked: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Let the motors give what is asked of them; write the torque that acts on the body.

    Parameters
    ----------
    inputs
        Record with the instant, the true angular velocity, and the speed of each wheel.
    asked
        Motor torque of each wheel [N·m], within its limits.
    state, configuration
        Records of dtype `STATE` and `CONFIGURATION`.
    outputs
        Record with the columns that the actuator gives.
    """
    craft, speeds, stamp_ns = configuration.wheels, inputs.wheel_speed, inputs.stamp_ns
    rate = vector(inputs.truth_angular_velocity)
    applied = scale(-1.0, cross(rate, momentum(craft, speeds)))
    for i in range(craft.count):
        resistance = friction(craft, i, speeds[i])
        motor = asked[i]
        if fails(configuration.faults, i, stamp_ns):
            motor = _failed(motor, i, speeds[i], stamp_ns, configuration)
        outputs.wheel_torque[i] = motor
        applied = subtract(applied, scale(motor - resistance, vector(craft.axes[i])))
    store(outputs.applied_torque, applied)
    _watch(speeds, configuration, state)


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Let the motors give what a node asks of them, within what motor and speed allow."""
    craft, speeds = configuration.wheels, inputs.wheel_speed
    for i in range(craft.count):
        slower, faster = room(craft, i, speeds[i])
        resistance = friction(craft, i, speeds[i])
        # A wheel at its largest speed may be asked for what slows it, and for its friction. The
        # drive may ask for a trace more, which it rounds.
        trace = 2.0 * TRACE * craft.max_torque[i]
        most = min(craft.max_torque[i], resistance + max(faster, 0.0)) + trace
        least = max(-craft.max_torque[i], resistance - max(slower, 0.0)) - trace
        outputs.wheel_torque[i] = min(max(inputs.wheel_torque_command[i], least), most)
    act(inputs, outputs.wheel_torque, state, configuration, outputs)


def advice(state: Any) -> Advice:
    """Warn of a wheel that has reached its largest speed."""
    told = ""
    if full := int(state["full"]):
        told = (
            f"wheel {full - 1} has reached its largest speed: it takes up no more momentum, and "
            "torque is lost"
        )
    fastest = {"fastest wheel [share of its largest speed]": float(state["fastest"])}
    return Advice(told, warning=bool(full), numbers=fastest)


COMPONENT = Component(
    name="wheel_motors",
    parameters=(*wheels.PARAMETERS, FAULTS),
    configure=configure,
    configuration=CONFIGURATION,
    state=STATE,
    inputs=(wheels.COMMAND, TRUE_RATE, wheels.SPEED),
    outputs=(APPLIED_TORQUE, wheels.TORQUE),
    step=step,
    advice=advice,
    advices=lambda state: int(state["news"]),
    limits=(wheels.MAX_TORQUE.name,),
    torque=wheels.torques,
    faults=wheels.parts_of,
)
