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

from ppc_attitude.science.component import (
    BODY,
    DESIRED,
    INERTIAL,
    QUATERNION,
    VECTOR,
    WRENCH,
    Column,
)

TRUE_ATTITUDE = Column(
    "truth_attitude",
    "truth/attitude",
    QUATERNION,
    INERTIAL,
    "1",
    "true attitude, body to inertial, x y z w; where what the controller is told may differ",
)
TRUE_RATE = Column(
    "truth_angular_velocity",
    "truth/angular_velocity",
    VECTOR,
    BODY,
    "rad/s",
    "true angular velocity; where what the controller is told may differ",
)
ATTITUDE = Column(
    "attitude", "attitude", QUATERNION, INERTIAL, "1", "attitude, body to inertial, x y z w"
)
ANGULAR_VELOCITY = Column(
    "angular_velocity", "angular_velocity", VECTOR, BODY, "rad/s", "angular velocity"
)
REFERENCE_ATTITUDE = Column(
    "reference_attitude",
    "reference/attitude",
    QUATERNION,
    INERTIAL,
    "1",
    "desired attitude, desired frame to inertial, x y z w",
)
REFERENCE_RATE = Column(
    "reference_angular_velocity",
    "reference/angular_velocity",
    VECTOR,
    DESIRED,
    "rad/s",
    "desired angular velocity",
)
REFERENCE_ACCELERATION = Column(
    "reference_angular_acceleration",
    "reference/angular_acceleration",
    VECTOR,
    DESIRED,
    "rad/s²",
    "desired angular acceleration",
)
TURN_AHEAD = Column(
    "reference_turn_ahead",
    "reference/turn_ahead",
    VECTOR,
    DESIRED,
    "rad",
    "∫ω_d of what lies ahead, from a reference that knows it",
)
ENVIRONMENT_TORQUE = Column(
    "environment_torque",
    "disturbance/environment",
    WRENCH,
    BODY,
    "N·m",
    "torque of the environment alone",
)
DISTURBANCE = Column(
    "disturbance_torque", "disturbance/torque", WRENCH, BODY, "N·m", "all external torque"
)
TORQUE_COMMAND = Column(
    "torque_command", "torque_command", WRENCH, BODY, "N·m", "commanded torque τ = sat(u)"
)
APPLIED_TORQUE = Column(
    "applied_torque",
    "applied_torque",
    WRENCH,
    BODY,
    "N·m",
    "actuator torque that acts from the stamp on",
)

TRUTH = (TRUE_ATTITUDE, TRUE_RATE)
TOLD = (ATTITUDE, ANGULAR_VELOCITY)
DESIRED_MOTION = (REFERENCE_ATTITUDE, REFERENCE_RATE, REFERENCE_ACCELERATION)
