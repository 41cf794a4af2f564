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

A command is the torque on the body besides −ω × Jω. The impulse commanded since the last period,
and what that period left over, is made into on-times. In each step their mean torque acts, so that
the impulse is exact. Mass, inertia and centre of mass stay, and the net force does nothing. The
choice of pulses knows of no fault.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science import thrusters
from ppc_attitude.science.compiled_stamps import step_of
from ppc_attitude.science.component import MAX_THRUSTERS, Component
from ppc_attitude.science.faults import (
    FAULTS,
    RECORD,
    Failure,
    How,
    acting,
    faults_of,
    number_of,
)
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kernel import ZERO, add, copy, kernel, scale, store, vector
from ppc_attitude.science.parameter import filled, record_type
from ppc_attitude.science.signals import APPLIED_TORQUE, TORQUE_COMMAND

_HOW = (
    Failure(How.EFFECTIVENESS, 1, 0.0, 1.0),
    Failure(How.STUCK_CLOSED),
    Failure(How.STUCK_OPEN, 1, 0.0, 1.0),
)
CONFIGURATION = record_type(("craft", thrusters.THRUSTERS), ("faults", RECORD))
STATE = record_type(
    ("begun", np.int64),  # periods, the present one included
    ("impulse", np.float64, (3,)),  # [N·m·s] commanded and not yet made into pulses
    ("on_time", np.float64, (MAX_THRUSTERS,)),  # [s] of the present period
    ("used", np.float64),  # [kg] of fuel
    ("empty", np.int64),  # 1 while the fuel is used up
    ("news", np.int64),
)


def parts_of(values: Mapping[str, Any]) -> dict[str, tuple[Failure, ...]]:
    """Return each thruster by its name, and how it can fail."""
    return {f"thruster/{j}": _HOW for j in range(len(values[thrusters.POSITIONS.name]) // 3)}


@kernel
def _given(share: float, j: int, faults: Any, stamp_ns: int) -> float:
    """Share of its force that a thruster gives in a step if `share` is asked for, with faults."""
    if acting(faults, j, How.STUCK_CLOSED, stamp_ns) >= 0:
        return 0.0
    weak = number_of(faults, j, How.EFFECTIVENESS, stamp_ns, 1.0) * share
    return number_of(faults, j, How.STUCK_OPEN, stamp_ns, weak)


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Begin the pulses of a period if one begins; give the mean torque of the step."""
    craft, faults = configuration.craft, configuration.faults
    now = step_of(inputs.stamp_ns, craft.rate)
    commanded = scale(1.0 / craft.rate, vector(inputs.torque_command))
    store(state.impulse, add(vector(state.impulse), commanded))
    if now // craft.period + 1 != state.begun:
        state.begun = now // craft.period + 1
        store(state.impulse, thrusters.pulses(vector(state.impulse), craft, state.on_time))
    empty = int(state.used >= craft.fuel)  # the parameter may change in flight
    state.news += empty != state.empty
    state.empty = empty
    if empty:
        state.on_time[:] = 0.0
    torque, flow = ZERO, 0.0
    for j in range(craft.count):
        asked = thrusters.open_share(state.on_time[j], now % craft.period, craft)
        share = _given(asked, j, faults, inputs.stamp_ns)
        torque = add(torque, scale(share, vector(craft.torque[j])))
        flow += share * craft.flow[j]
    burnt, rest = flow / craft.rate, max(craft.fuel - state.used, 0.0)
    if burnt > rest:
        torque = scale(rest / burnt, torque)
        state.used = max(craft.fuel, state.used)
    else:
        state.used += burnt
    copy(outputs.thruster_on_time, state.on_time)
    outputs.fuel_used[0] = state.used
    store(outputs.applied_torque, torque)


def advice(state: Any) -> Advice:
    """Tell how much fuel is used, and when it is used up."""
    numbers = {"fuel used [kg]": float(state["used"])}
    if not state["empty"]:
        told = "there is fuel again" if state["news"] else ""
        return Advice(told, warning=False, numbers=numbers)
    text = "the fuel is used up: the thrusters give no torque"
    return Advice(text, warning=True, failed=True, numbers=numbers)


def torques(values: Mapping[str, Any]) -> tuple[float, float]:
    """Torque on an axis [N·m] that the thrusters give in any direction, and their largest one."""
    craft = thrusters.thruster_record(values)
    return thrusters.certain_torque(craft), thrusters.largest_torque(craft)


def least_impulse(values: Mapping[str, Any]) -> NDArray[np.float64]:
    """Angular impulse [N·m·s] of the shortest pulse of each thruster, body, shape (n, 3)."""
    return np.asarray(thrusters.torques_of(values)[0] * values[thrusters.MIN_ON_TIME.name])


COMPONENT = Component(
    name="thrusters",
    parameters=(*thrusters.PARAMETERS, FAULTS),
    configure=lambda values: filled(
        CONFIGURATION,
        values,
        craft=thrusters.thruster_record(values),
        faults=faults_of(values, parts_of(values)),
    ),
    configuration=CONFIGURATION,
    state=STATE,
    inputs=(TORQUE_COMMAND,),
    outputs=(APPLIED_TORQUE, thrusters.ON_TIME, thrusters.FUEL_USED),
    step=step,
    advice=advice,
    advices=lambda state: int(state["news"]),
    limits=(thrusters.FORCE.name,),
    quiet={thrusters.MIN_ON_TIME.name: 0.0},
    torque=torques,
    least_impulse=least_impulse,
    period=lambda values: float(values[thrusters.PERIOD.name]),
    faults=parts_of,
)
