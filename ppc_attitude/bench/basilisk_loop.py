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

"""The yardstick: the same closed loop in Basilisk, with its own compiled attitude feedback."""

from typing import Any

import numpy as np

INERTIA = [20.0, 0.0, 0.9, 0.0, 17.0, 0.0, 0.9, 0.0, 15.0]  # [kg·m²]
STIFFNESS, DAMPING = 0.1, 2.0


class BasiliskLoop:
    """A rigid body by RK4, navigation, reference, feedback and torque: one task at one rate.

    Parameters
    ----------
    law : {'compiled', 'python'}
        Basilisk's own mrpFeedback, or the same feedback as a Python SysModel.
    rate : float
        Steps a second of simulated time.
    """

    def __init__(self, law: str = "compiled", rate: float = 100.0) -> None:
        from Basilisk.fswAlgorithms import attTrackingError, inertial3D
        from Basilisk.simulation import extForceTorque, simpleNav, spacecraft, svIntegrators
        from Basilisk.utilities import SimulationBaseClass, macros

        self.sim = sim = SimulationBaseClass.SimBaseClass()
        self._nanoseconds = macros.sec2nano
        process = sim.CreateNewProcess("process")
        process.addTask(sim.CreateNewTask("task", macros.sec2nano(1.0 / rate)))
        self.body = body = spacecraft.Spacecraft()
        body.hub.mHub = 100.0
        body.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
        body.hub.IHubPntBc_B = np.reshape(INERTIA, (3, 3)).tolist()
        body.hub.sigma_BNInit = [[0.1], [0.2], [-0.3]]
        body.hub.omega_BN_BInit = [[0.001], [-0.001], [0.001]]
        body.setIntegrator(svIntegrators.svIntegratorRK4(body))
        torque = extForceTorque.ExtForceTorque()
        body.addDynamicEffector(torque)
        navigation, reference = simpleNav.SimpleNav(), inertial3D.inertial3D()
        reference.sigma_R0N = [0.0, 0.0, 0.0]
        error = attTrackingError.attTrackingError()
        control = _control(law)
        navigation.scStateInMsg.subscribeTo(body.scStateOutMsg)
        error.attNavInMsg.subscribeTo(navigation.attOutMsg)
        error.attRefInMsg.subscribeTo(reference.attRefOutMsg)
        control.guidInMsg.subscribeTo(error.attGuidOutMsg)
        torque.cmdTorqueInMsg.subscribeTo(control.cmdTorqueOutMsg)
        self._kept: list[Any] = [torque, navigation, reference, error, control]
        for priority, model in enumerate((body, navigation, reference, error, control, torque)):
            sim.AddModelToTask("task", model, 100 - priority)
        if law == "compiled":
            self._kept.append(_vehicle(control))

    def run(self, duration: float) -> float:
        """Run for `duration` [s] from the start; return the largest |σ| at the end."""
        self.sim.InitializeSimulation()
        self.sim.ConfigureStopTime(self._nanoseconds(duration))
        self.sim.ExecuteSimulation()
        return float(np.abs(self.body.scStateOutMsg.read().sigma_BN).max())


def _control(law: str) -> Any:
    from Basilisk.fswAlgorithms import mrpFeedback

    if law == "python":
        return _python_feedback()
    control = mrpFeedback.mrpFeedback()
    control.K, control.P, control.Ki = STIFFNESS, DAMPING, -1.0
    return control


def _vehicle(control: Any) -> Any:
    from Basilisk.architecture import messaging

    payload = messaging.VehicleConfigMsgPayload()
    payload.ISCPntB_B = INERTIA
    message = messaging.VehicleConfigMsg().write(payload)
    control.vehConfigInMsg.subscribeTo(message)
    return message


def _python_feedback() -> Any:
    from Basilisk.architecture import messaging, sysModel

    class Feedback(sysModel.SysModel):
        """The feedback -K sigma - P omega as a Python module."""

        def __init__(self) -> None:
            super().__init__()
            self.guidInMsg = messaging.AttGuidMsgReader()
            self.cmdTorqueOutMsg = messaging.CmdTorqueBodyMsg()

        def UpdateState(self, now: int) -> None:
            guidance = self.guidInMsg()
            sigma, omega = guidance.sigma_BR, guidance.omega_BR_B
            command = messaging.CmdTorqueBodyMsgPayload()
            command.torqueRequestBody = [
                -STIFFNESS * s - DAMPING * w for s, w in zip(sigma, omega, strict=True)
            ]
            self.cmdTorqueOutMsg.write(command, now, self.moduleID)

    return Feedback()
