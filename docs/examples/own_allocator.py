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

"""A wheel allocator of your own: it shares the commanded torque by the pseudo-inverse.

python docs/examples/own_allocator.py
"""

import contextlib

import numpy as np
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

AXES = np.array([[1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1]]) / np.sqrt(3.0)  # of wheels.yaml
NAMES = [f"wheel_{i}" for i in range(8)]  # always eight: those that the craft lacks are zero


class PseudoInverse(Node):
    """Motor torques u of least norm with A u = −τ; it knows of no friction and no momentum."""

    def __init__(self) -> None:
        super().__init__("pseudo_inverse")
        reliable = QoSProfile(depth=10)  # reliable is the default of a profile
        self.motors = self.create_publisher(JointState, "wheels/torque_command", reliable)
        self.create_subscription(WrenchStamped, "torque_command", self.on_command, reliable)
        self.shares = np.linalg.pinv(AXES.T)  # one row a wheel

    def on_command(self, command: WrenchStamped) -> None:
        """Answer every command, also a repeated one, with torques of the same stamp."""
        torque = command.wrench.torque
        shares = -self.shares @ [torque.x, torque.y, torque.z]
        answer = JointState(name=NAMES, effort=[*shares.tolist(), 0.0, 0.0, 0.0, 0.0])
        answer.header = command.header  # the stamp is what lock-step goes by; the frame is body
        self.motors.publish(answer)


def main() -> None:
    """Run until the process is asked to stop."""
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(PseudoInverse())


if __name__ == "__main__":
    main()
