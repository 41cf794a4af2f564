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

"""The paper's actuator: it saturates, has a dead zone, and is otherwise ideal."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.component import Component
from ppc_attitude.science.conditions import Condition, Task, advisable
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import FAULTS, OF_A_TORQUE, RECORD, fails, faults_of, faulty
from ppc_attitude.science.kernel import kernel
from ppc_attitude.science.parameter import Parameter, filled, record_type
from ppc_attitude.science.signals import APPLIED_TORQUE, TORQUE_COMMAND

MAX_TORQUE = Parameter("max_torque", 0.05, "actuator limit per axis", "N·m", above=0.0, high=1e6)
MIN_TORQUE = Parameter(
    "min_torque", 1e-4, "command below which the actuator gives no torque", "N·m", low=0.0, high=1e6
)
LATE_COMMAND = Parameter("late_command", False, "true: a command acts one sample late")
_DEAD_SHARE = 0.1  # of the actuator's limit that its dead zone may take
PARTS = dict.fromkeys(("actuator/x", "actuator/y", "actuator/z"), OF_A_TORQUE)
CONFIGURATION = record_type(MAX_TORQUE, MIN_TORQUE, LATE_COMMAND, ("faults", RECORD))
MEMORY = record_type(("command", np.float64, (3,)))  # [N·m] of the last sample


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values.

    Raises
    ------
    ConfigurationError
        The limits leave no torque, or a fault is invalid.
    """
    if values["min_torque"] >= values["max_torque"]:
        raise ConfigurationError(
            f"min_torque = {values['min_torque']} N·m must be smaller than max_torque = "
            f"{values['max_torque']} N·m"
        )
    return filled(CONFIGURATION, values, faults=faults_of(values, PARTS))


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Give the torque for the command, or for the previous one if commands act late."""
    faults, limit = configuration.faults, configuration.max_torque
    for i in range(3):
        command = (
            inputs.torque_command[i] if configuration.late_command == 0.0 else state.command[i]
        )
        state.command[i] = inputs.torque_command[i]
        torque = min(max(command, -limit), limit)
        if abs(command) < configuration.min_torque:
            torque = 0.0
        if fails(faults, i, inputs.stamp_ns):
            torque = faulty(torque, limit, faults, i, inputs.stamp_ns)
        outputs.applied_torque[i] = torque


def conditions(values: Mapping[str, Any], _: Task) -> Iterator[Condition]:
    """Compare the dead zone with the limit."""
    most = _DEAD_SHARE * values[MAX_TORQUE.name]
    meaning = f"the dead zone is at most {100.0 * _DEAD_SHARE:g} % of {MAX_TORQUE.name}"
    yield advisable(MIN_TORQUE.name, values[MIN_TORQUE.name], most, "N·m", meaning)


COMPONENT = Component(
    name="ideal",
    parameters=(MAX_TORQUE, MIN_TORQUE, LATE_COMMAND, FAULTS),
    configure=configure,
    configuration=CONFIGURATION,
    state=MEMORY,
    inputs=(TORQUE_COMMAND,),
    outputs=(APPLIED_TORQUE,),
    step=step,
    limits=(MAX_TORQUE.name,),
    quiet={MIN_TORQUE.name: 0.0},
    faults=lambda values: PARTS,
    conditions=conditions,
)
