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

"""The signals between the blocks of the diagram: what each kind of component must give.

A component may give more columns of its own, which it declares in its own file.
"""

from functools import partial

from ppc_attitude.science.component import (
    BODY,
    DESIRED,
    INERTIAL,
    QUATERNION,
    VECTOR,
    WRENCH,
    Column,
)

_attitude = partial(Column, form=QUATERNION, frame=INERTIAL, unit="1")
_of_body = partial(Column, form=VECTOR, frame=BODY, unit="rad/s")
_of_desired = partial(Column, form=VECTOR, frame=DESIRED)
_torque = partial(Column, form=WRENCH, frame=BODY, unit="N·m")
_DIFFERS = "sent where the controller may get another value"

TRUE_ATTITUDE = _attitude(
    "truth_attitude",
    "truth/attitude",
    meaning=f"true attitude, body to inertial, x y z w; {_DIFFERS}",
)
TRUE_RATE = _of_body(
    "truth_angular_velocity", "truth/angular_velocity", meaning=f"true angular velocity; {_DIFFERS}"
)
ATTITUDE = _attitude("attitude", "attitude", meaning="attitude, body to inertial, x y z w")
ANGULAR_VELOCITY = _of_body("angular_velocity", "angular_velocity", meaning="angular velocity")
REFERENCE_ATTITUDE = _attitude(
    "reference_attitude",
    "reference/attitude",
    meaning="desired attitude, desired frame to inertial, x y z w",
)
REFERENCE_RATE = _of_desired(
    "reference_angular_velocity",
    "reference/angular_velocity",
    unit="rad/s",
    meaning="desired angular velocity",
)
REFERENCE_ACCELERATION = _of_desired(
    "reference_angular_acceleration",
    "reference/angular_acceleration",
    unit="rad/s²",
    meaning="desired angular acceleration",
)
TURN_AHEAD = _of_desired(
    "reference_turn_ahead",
    "reference/turn_ahead",
    unit="rad",
    meaning="∫ω_d over the time ahead, from a reference that knows it",
)
ENVIRONMENT_TORQUE = _torque(
    "environment_torque", "disturbance/environment", meaning="torque of the environment alone"
)
DISTURBANCE = _torque("disturbance_torque", "disturbance/torque", meaning="all external torque")
TORQUE_COMMAND = _torque("torque_command", "torque_command", meaning="commanded torque τ = sat(u)")
APPLIED_TORQUE = _torque(
    "applied_torque", "applied_torque", meaning="actuator torque that acts from the stamp on"
)

TRUTH = (TRUE_ATTITUDE, TRUE_RATE)
TOLD = (ATTITUDE, ANGULAR_VELOCITY)
DESIRED_MOTION = (REFERENCE_ATTITUDE, REFERENCE_RATE, REFERENCE_ACCELERATION)
