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

"""Basilisk's own star tracker, IMU and inertial filter, with the numbers of our sensors.

They do less than ours. The tracker has neither latency nor dropouts. The gyro's bias does not walk,
and the filter (`inertialUKF`: attitude and rate, unscented, square root) does not estimate it, so
there is none here. Between fixes the filter turns the attitude by the gyro's samples; Basilisk has
no module that puts those into the filter's buffer, so a NumbaModel does.
"""

from typing import Any

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.architecture.numbaModel import NumbaModel
from Basilisk.fswAlgorithms import inertialUKF, stComm
from Basilisk.simulation import imuSensor, starTracker
from scipy.spatial.transform import Rotation

from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science.attitude import unit_quaternion
from ppc_attitude.science.sensors.gyro import ANGULAR_RANDOM_WALK, RESOLUTION
from ppc_attitude.science.sensors.star_tracker import sigmas
from ppc_attitude.simulation.scenario import Scenario

_ACCELERATION = 0.02  # [rad/s²] that the filter does not know of: torque limit by inertia
_CUTOFF = 200.0  # [rad/s] of the filter's low pass for the rate, which then hardly delays it


class GyroBuffer(NumbaModel):
    """Puts the IMU's samples into the ring that the filter reads."""

    def __init__(self) -> None:
        super().__init__()
        self.imuInMsg = messaging.IMUSensorMsgReader()
        self.bufferOutMsg = messaging.AccDataMsg()
        self.memory.place = 0

    @staticmethod
    def UpdateStateImpl(
        imuInMsgPayload: Any, bufferOutMsgPayload: Any, CurrentSimNanos: Any, memory: Any
    ) -> None:
        """Write one sample over the oldest."""
        packets = bufferOutMsgPayload.accPkts
        packets[memory.place].measTime = CurrentSimNanos
        for axis in range(3):
            packets[memory.place].gyro_B[axis] = imuInMsgPayload.AngVelPlatform[axis]
        memory.place = (memory.place + 1) % packets.size


class Navigation:
    """The craft's knowledge by sensors; stands where `simpleNav` does without them.

    Attributes
    ----------
    at_fixes, at_steps : tuple
        Models that run at the tracker's rate, and at each step after them; in their order.
    attOutMsg : object
        Attitude and rate that the filter tells.
    """

    def __init__(self, scenario: Scenario, state: Any, inertia: Array) -> None:
        values, h = scenario.parameters[PLANT], 1.0 / scenario.number(PLANT, "rate")
        noise = np.diag(sigmas(values))  # [rad] of a fix
        tracker, telemetry = starTracker.StarTracker(), stComm.stComm()
        tracker.setAMatrix(np.zeros((3, 3)))  # white, no walk
        tracker.PMatrix = noise.tolist()
        tracker.scStateInMsg.subscribeTo(state)
        telemetry.dcm_BP = np.eye(3).ravel().tolist()
        telemetry.stSensorInMsg.subscribeTo(tracker.sensorOutMsg)
        telemetry.stAttOutMsg.write(messaging.STAttMsgPayload())
        gyro, buffer = imuSensor.ImuSensor(), GyroBuffer()
        gyro.setAMatrixGyro(np.zeros((3, 3)))
        gyro.PMatrixGyro = (np.eye(3) * values[ANGULAR_RANDOM_WALK.name] / np.sqrt(h)).tolist()
        gyro.setLSBs(0.0, values[RESOLUTION.name])
        gyro.senRotMax = values["gyro.full_scale"]
        gyro.scStateInMsg.subscribeTo(state)
        buffer.imuInMsg.subscribeTo(gyro.sensorOutMsg)
        known, *self._kept = _filter(values, noise, inertia, h)
        known.STDatasStruct.STMessages[0].stInMsg.subscribeTo(telemetry.stAttOutMsg)
        known.gyrBuffInMsg.subscribeTo(buffer.bufferOutMsg)
        self.at_fixes = (tracker, telemetry)
        self.at_steps = (gyro, buffer, known)
        self.attOutMsg = known.navStateOutMsg


def _filter(values: Any, noise: Array, inertia: Array, h: float) -> tuple[Any, ...]:
    """Return the filter, and what must live as long."""
    known = inertialUKF.inertialUKF()
    known.alpha, known.beta, known.kappa, known.switchMag = 0.02, 2.0, 0.0, 1.2
    attitude = unit_quaternion("initial_attitude", values["initial_attitude"])
    start = messaging.NavAttMsgPayload()
    start.sigma_BN = Rotation.from_quat(attitude).as_mrp().tolist()
    start.omega_BN_B = values["initial_angular_velocity"]
    known.navStateOutMsg.write(start)  # it says nothing itself until its first fix after t = 0
    known.stateInit = [*start.sigma_BN, *start.omega_BN_B]
    known.covarInit = np.diag([1e-4] * 6).ravel().tolist()
    # σ of an MRP is a quarter of the angle's.
    known.qNoise = (_ACCELERATION**2 * np.diag([1 / 16] * 3 + [1.0] * 3)).ravel().tolist()
    fixes = inertialUKF.STMessage()
    fixes.noise = (noise**2 / 16.0).ravel().tolist()
    known.STDatasStruct.STMessages = [fixes]
    known.STDatasStruct.numST = 1
    low_pass = inertialUKF.LowPassFilterData()
    low_pass.hStep, low_pass.omegCutoff = h, _CUTOFF
    known.gyroFilt = [low_pass] * 3
    body = messaging.VehicleConfigMsgPayload()
    body.ISCPntB_B = inertia.tolist()
    messages = (
        messaging.VehicleConfigMsg().write(body),
        messaging.RWArrayConfigMsg().write(messaging.RWArrayConfigMsgPayload()),
        messaging.RWSpeedMsg().write(messaging.RWSpeedMsgPayload()),
    )
    inputs = (known.massPropsInMsg, known.rwParamsInMsg, known.rwSpeedsInMsg)
    for port, message in zip(inputs, messages, strict=True):
        port.subscribeTo(message)
    return known, *messages
