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

"""On/off thrusters: from the commanded torque to pulses that begin with a period.

A command is the torque on the body besides −ω × Jω. What was commanded since the last period, and
what that left over, is made into on-times; in a step their mean torque acts, so that the impulse is
exact. Mass, inertia and centre of mass stay, and the net force does nothing.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science import thrusters
from ppc_attitude.science.compiled_stamps import step_of
from ppc_attitude.science.component import MAX_THRUSTERS, Advice, Component
from ppc_attitude.science.kernel import add, kernel, scale, store, vector
from ppc_attitude.science.signals import APPLIED_TORQUE, TORQUE_COMMAND
from ppc_attitude.science.thrusters import ON_TIME, THRUSTERS, pulses, thrust, thruster_record

STATE = np.dtype(
    [
        ("begun", np.int64),  # periods, the present one included
        ("impulse", np.float64, (3,)),  # [N·m·s] commanded and not yet made into pulses
        ("on_time", np.float64, (MAX_THRUSTERS,)),  # [s] of the present period
        ("used", np.float64),  # [kg] of fuel
        ("empty", np.int64),  # 1 once the fuel has been used up
    ],
    align=True,
)


@kernel
def step(inputs: Any, state: Any, craft: Any, outputs: Any) -> None:
    """Begin the pulses of a period if one begins; give the mean torque of the step."""
    now = step_of(inputs.stamp_ns, craft.rate)
    commanded = scale(1.0 / craft.rate, vector(inputs.torque_command))
    store(state.impulse, add(vector(state.impulse), commanded))
    if now // craft.period + 1 != state.begun:
        state.begun = now // craft.period + 1
        store(state.impulse, pulses(vector(state.impulse), craft, state.on_time))
    if state.used >= craft.fuel:
        state.empty = 1
        state.on_time[:] = 0.0
    torque, flow = thrust(state.on_time, now % craft.period, craft)
    burnt, rest = flow / craft.rate, craft.fuel - state.used
    if burnt > rest:
        torque = scale(rest / burnt, torque)
        state.used = craft.fuel
    else:
        state.used += burnt
    outputs.thruster_on_time[:] = state.on_time
    store(outputs.applied_torque, torque)


def advice(state: Any) -> Advice:
    """Tell how much fuel is used, and when it is used up."""
    numbers = {"fuel used [kg]": float(state["used"])}
    if not state["empty"]:
        return Advice("", warning=False, numbers=numbers)
    text = "the fuel is used up: the thrusters give no torque"
    return Advice(text, warning=True, failed=True, numbers=numbers)


def torques(values: Mapping[str, Any]) -> tuple[float, float]:
    """Torque on an axis [N·m] that the thrusters give in any direction, and at most."""
    craft = thruster_record(values)
    return thrusters.certain_torque(craft), thrusters.largest_torque(craft)


def least_impulse(values: Mapping[str, Any]) -> float:
    """Angular impulse about an axis [N·m·s] of the least pulse of the weakest thruster."""
    turns = np.abs(thrusters.torques_of(values)[0]).max(axis=1)
    return float(turns[turns > 0.0].min() * values[thrusters.MIN_ON_TIME.name])


COMPONENT = Component(
    name="thrusters",
    parameters=thrusters.PARAMETERS,
    configure=thruster_record,
    configuration=THRUSTERS,
    state=STATE,
    inputs=(TORQUE_COMMAND,),
    outputs=(APPLIED_TORQUE, ON_TIME),
    step=step,
    advice=advice,
    advices=lambda state: int(state["empty"]),
    limits=(thrusters.FORCE.name,),
    torque=torques,
    least_impulse=least_impulse,
)
