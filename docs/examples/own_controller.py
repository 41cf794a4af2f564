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

"""A controller of your own: one subscription, one publisher. It stops a tumbling craft.

python docs/examples/own_controller.py
"""

import contextlib

import rclpy
from geometry_msgs.msg import Vector3Stamped, WrenchStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile

GAIN = 1.0  # [N·m·s/rad]


class RateDamper(Node):
    """Torque against the angular velocity."""

    def __init__(self) -> None:
        super().__init__("rate_damper")
        reliable = QoSProfile(depth=10)  # reliable is the default of a profile
        self.torque = self.create_publisher(WrenchStamped, "torque_command", reliable)
        self.create_subscription(Vector3Stamped, "angular_velocity", self.on_rate, reliable)

    def on_rate(self, rate: Vector3Stamped) -> None:
        """Answer every state, also a repeated one, with a torque of the same stamp."""
        answer = WrenchStamped()
        answer.header = rate.header  # the stamp is what lock-step goes by; the frame is body
        answer.wrench.torque.x = -GAIN * rate.vector.x
        answer.wrench.torque.y = -GAIN * rate.vector.y
        answer.wrench.torque.z = -GAIN * rate.vector.z
        self.torque.publish(answer)


def main() -> None:
    """Run until the process is asked to stop."""
    rclpy.init()
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(RateDamper())


if __name__ == "__main__":
    main()
