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

"""Additions to Basilisk's modules: our reference, and its feedback in two more forms.

The law is that of Basilisk's `mrpFeedback` without integral part, so all three forms give the same
motion. Only `make bench` needs Basilisk.
"""

import json
from functools import lru_cache
from typing import Any

import numpy as np
from Basilisk.architecture import messaging, sysModel
from Basilisk.architecture.numbaModel import NumbaModel
from scipy.spatial.transform import Rotation

from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import PLANT, REFERENCE
from ppc_attitude.science.kernel import kernel
from ppc_attitude.science.kinds import REFERENCES
from ppc_attitude.science.part import Part
from ppc_attitude.simulation.closed_loop import stamps_of
from ppc_attitude.simulation.scenario import Scenario

STIFFNESS, DAMPING = 4.0, 20.0  # [N·m], [N·m·s]: an error is gone after two minutes


def reference_table(scenario: Scenario, duration: float) -> Array:
    """Our desired motion as Basilisk's `AttRefMsg` has it.

    Returns
    -------
    ndarray, shape (steps + 1, 9)
        σ, ω [rad/s] and ω' [rad/s²] of each instant, the latter two in inertial axes.
    """
    parameters = scenario.parameters[REFERENCE]
    return _table(scenario.number(PLANT, "rate"), duration, json.dumps(parameters))


@lru_cache(maxsize=1)
def _table(rate: float, duration: float, parameters: str) -> Array:
    """Make a table once for all runs of a Monte Carlo."""
    values = json.loads(parameters)
    component = REFERENCES.selected(values)
    if component is None:
        raise ValueError(f"{parameters} selects no reference")
    reference = Part(component, values)
    rows = np.array([reference.step(int(stamp)) for stamp in stamps_of(rate, duration)])
    attitude = Rotation.from_quat(rows[:, :4])
    return np.hstack([attitude.as_mrp(), attitude.apply(rows[:, 4:7]), attitude.apply(rows[:, 7:])])


class TableReference(NumbaModel):
    """Sends one row of a table at each step."""

    def __init__(self, table: Array) -> None:
        super().__init__()
        self.attRefOutMsg = messaging.AttRefMsg()
        self.memory.table = table
        self.memory.row = 0

    @staticmethod
    def UpdateStateImpl(attRefOutMsgPayload: Any, memory: Any) -> None:
        """Send a row."""
        row = memory.row
        for axis in range(3):
            attRefOutMsgPayload.sigma_RN[axis] = memory.table[row, axis]
            attRefOutMsgPayload.omega_RN_N[axis] = memory.table[row, 3 + axis]
            attRefOutMsgPayload.domega_RN_N[axis] = memory.table[row, 6 + axis]
        memory.row = row + 1


def feedback(sigma: Any, rate: Any, desired: Any, acceleration: Any, inertia: Any) -> Any:
    """Torque −K σ − P δω + ω_d × J ω + J (ω_d' − ω × ω_d) [N·m], all in body axes."""
    x, y, z = rate[0] + desired[0], rate[1] + desired[1], rate[2] + desired[2]
    h = (
        inertia[0] * x + inertia[1] * y + inertia[2] * z,
        inertia[3] * x + inertia[4] * y + inertia[5] * z,
        inertia[6] * x + inertia[7] * y + inertia[8] * z,
    )
    a = (
        acceleration[0] - (y * desired[2] - z * desired[1]),
        acceleration[1] - (z * desired[0] - x * desired[2]),
        acceleration[2] - (x * desired[1] - y * desired[0]),
    )
    return (
        desired[1] * h[2]
        - desired[2] * h[1]
        + (inertia[0] * a[0] + inertia[1] * a[1] + inertia[2] * a[2])
        - STIFFNESS * sigma[0]
        - DAMPING * rate[0],
        desired[2] * h[0]
        - desired[0] * h[2]
        + (inertia[3] * a[0] + inertia[4] * a[1] + inertia[5] * a[2])
        - STIFFNESS * sigma[1]
        - DAMPING * rate[1],
        desired[0] * h[1]
        - desired[1] * h[0]
        + (inertia[6] * a[0] + inertia[7] * a[1] + inertia[8] * a[2])
        - STIFFNESS * sigma[2]
        - DAMPING * rate[2],
    )


_compiled_feedback = kernel(feedback)


class NumbaFeedback(NumbaModel):
    """The feedback as Basilisk's NumbaModel."""

    def __init__(self, inertia: Array) -> None:
        super().__init__()
        self.guidInMsg = messaging.AttGuidMsgReader()
        self.cmdTorqueOutMsg = messaging.CmdTorqueBodyMsg()
        self.memory.inertia = inertia

    @staticmethod
    def UpdateStateImpl(guidInMsgPayload: Any, cmdTorqueOutMsgPayload: Any, memory: Any) -> None:
        """Compute the torque."""
        torque = _compiled_feedback(
            guidInMsgPayload.sigma_BR,
            guidInMsgPayload.omega_BR_B,
            guidInMsgPayload.omega_RN_B,
            guidInMsgPayload.domega_RN_B,
            memory.inertia,
        )
        for axis in range(3):
            cmdTorqueOutMsgPayload.torqueRequestBody[axis] = torque[axis]


class PythonFeedback(sysModel.SysModel):
    """The feedback as Basilisk's Python SysModel, on plain floats: the fastest that Python has."""

    def __init__(self, inertia: Array) -> None:
        super().__init__()
        self.guidInMsg = messaging.AttGuidMsgReader()
        self.cmdTorqueOutMsg = messaging.CmdTorqueBodyMsg()
        self._inertia = inertia.tolist()

    def UpdateState(self, CurrentSimNanos: int) -> None:
        """Compute the torque."""
        guidance = self.guidInMsg()
        command = messaging.CmdTorqueBodyMsgPayload()
        command.torqueRequestBody = feedback(
            guidance.sigma_BR,
            guidance.omega_BR_B,
            guidance.omega_RN_B,
            guidance.domega_RN_B,
            self._inertia,
        )
        self.cmdTorqueOutMsg.write(command, CurrentSimNanos, self.moduleID)
