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

"""The yardstick: the same closed loop in Basilisk.

The same body, start, rate, integrator (RK4, torque held over a step) and desired motion as our
scenario; no disturbance, no telemetry kept. What Basilisk has no module for is given to it in the
fastest way we found: our reference comes from a table that is made beforehand and read by a
NumbaModel (10.3 µs a step of the whole loop; its `waypointReference`, which reads the same rows as
text, makes it 12.1 µs). So Basilisk looks the reference up, where our loop integrates it.
"""

from collections.abc import Mapping
from typing import Any, Literal, TypeAlias

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.fswAlgorithms import attTrackingError, mrpFeedback
from Basilisk.simulation import extForceTorque, simpleNav, spacecraft, svIntegrators
from Basilisk.utilities import SimulationBaseClass, macros
from scipy.spatial.transform import Rotation

from bench.basilisk_models import (
    DAMPING,
    STIFFNESS,
    NumbaFeedback,
    PythonFeedback,
    TableReference,
    reference_table,
)
from bench.basilisk_sensors import Navigation
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science.attitude import unit_quaternion
from ppc_attitude.science.sensors import gyro_star_tracker
from ppc_attitude.science.sensors.star_tracker import RATE
from ppc_attitude.simulation.scenario import Scenario

Law: TypeAlias = Literal["compiled", "numba", "python"]


class BasiliskLoop:
    """Rigid body, navigation, reference, error, feedback and torque at one rate.

    Where the scenario has sensors, navigation is Basilisk's star tracker, IMU and inertial filter.

    Parameters
    ----------
    scenario : Scenario
        Whose body, start, rate and reference it takes.
    duration : float
        Length of a run [s].
    law : {'compiled', 'numba', 'python'}
        Basilisk's own mrpFeedback, or the same feedback as a NumbaModel or a Python SysModel.
    """

    def __init__(self, scenario: Scenario, duration: float, law: Law = "compiled") -> None:
        rate = scenario.number(PLANT, "rate")
        self.sim = SimulationBaseClass.SimBaseClass()
        inertia = np.array(scenario.parameters[PLANT]["inertia"], dtype=np.float64)
        self.body = _body(scenario, inertia)
        torque = extForceTorque.ExtForceTorque()
        self.body.addDynamicEffector(torque)
        reference = TableReference(reference_table(scenario, duration))
        self._error = attTrackingError.attTrackingError()
        control, *kept = _control(law, inertia)
        follow = (reference, self._error, control, torque)
        tasks: tuple[tuple[float, tuple[Any, ...]], ...]  # rate [Hz], models in their order
        if scenario.parameters[PLANT]["sensors"] == gyro_star_tracker.COMPONENT.name:
            navigation = Navigation(scenario, self.body.scStateOutMsg, inertia)
            fixes = scenario.number(PLANT, RATE.name)
            tasks = (
                (rate, (self.body,)),
                (fixes, navigation.at_fixes),
                (rate, (*navigation.at_steps, *follow)),
            )
        else:
            navigation = simpleNav.SimpleNav()
            navigation.scStateInMsg.subscribeTo(self.body.scStateOutMsg)
            tasks = ((rate, (self.body, navigation, *follow)),)
        self._error.attNavInMsg.subscribeTo(navigation.attOutMsg)
        self._error.attRefInMsg.subscribeTo(reference.attRefOutMsg)
        control.guidInMsg.subscribeTo(self._error.attGuidOutMsg)
        torque.cmdTorqueInMsg.subscribeTo(control.cmdTorqueOutMsg)
        process = self.sim.CreateNewProcess("process")
        for place, (frequency, models) in enumerate(tasks):
            name = f"task_{place}"
            task = self.sim.CreateNewTask(name, macros.sec2nano(1.0 / frequency))
            process.addTask(task, len(tasks) - place)
            for order, model in enumerate(models):
                self.sim.AddModelToTask(name, model, len(models) - order)
        self._kept = (tasks, navigation, kept)  # Basilisk holds what it was given by bare pointers
        self._duration = duration

    def prepare(self) -> None:
        """Reset every model; compile those that are NumbaModels, or take them from the cache."""
        self.sim.InitializeSimulation()
        self.sim.ConfigureStopTime(macros.sec2nano(self._duration))

    def run(self) -> Array:
        """Run to the end; return σ of the attitude error there.

        Raises
        ------
        RuntimeError
            The error is not gone after two minutes: this is not the loop that was meant.
        """
        self.sim.ExecuteSimulation()
        error = np.array(self._error.attGuidOutMsg.read().sigma_BR)
        if self._duration >= 120.0 and not np.abs(error).max() < 1e-3:
            raise RuntimeError(f"Basilisk's loop does not follow the reference: σ = {error}")
        return error


def _body(scenario: Scenario, inertia: Array) -> Any:
    values: Mapping[str, Any] = scenario.parameters[PLANT]
    attitude = unit_quaternion("initial_attitude", values["initial_attitude"])
    body = spacecraft.Spacecraft()
    body.hub.mHub = 100.0  # [kg] it moves nowhere
    body.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
    body.hub.IHubPntBc_B = inertia.reshape(3, 3).tolist()
    body.hub.sigma_BNInit = Rotation.from_quat(attitude).as_mrp().reshape(3, 1).tolist()
    body.hub.omega_BN_BInit = [[part] for part in values["initial_angular_velocity"]]
    body.setIntegrator(svIntegrators.svIntegratorRK4(body))
    return body


def _control(law: Law, inertia: Array) -> tuple[Any, ...]:
    """Return the model of the feedback, and what must live as long."""
    if law == "numba":
        return (NumbaFeedback(inertia),)
    if law == "python":
        return (PythonFeedback(inertia),)
    control = mrpFeedback.mrpFeedback()
    control.K, control.P, control.Ki = STIFFNESS, DAMPING, -1.0
    payload = messaging.VehicleConfigMsgPayload()
    payload.ISCPntB_B = inertia.tolist()
    message = messaging.VehicleConfigMsg().write(payload)
    control.vehConfigInMsg.subscribeTo(message)
    return control, message
