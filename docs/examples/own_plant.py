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

"""A plant of your own, or the bridge to your hardware: publish the state, take the torque.

This one is a 1 kg·m² sphere that obeys the command; a bridge reads a gyro and a star tracker in
`tick` and drives wheels in `on_torque`. It ends after `steps` samples and says how many commands
were answers to a state.

python docs/examples/own_plant.py --ros-args -p steps:=600
"""

import math
import sys

import rclpy
from geometry_msgs.msg import QuaternionStamped, Vector3Stamped, WrenchStamped
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

INERTIA = 1.0  # [kg·m²]


class OwnPlant(Node):
    """Publishes `attitude` and `angular_velocity` at a rate of its own."""

    def __init__(self) -> None:
        super().__init__("own_plant")
        rate = self.declare_parameter("rate", 50.0).value
        self.steps = self.declare_parameter("steps", 0).value
        self.h = 1.0 / rate
        self.k = 0
        self.answered = 0
        self.q = [0.1, 0.0, 0.0, math.sqrt(0.99)]  # x y z w, body to inertial
        self.omega = [0.0, 0.0, 0.0]  # [rad/s] body
        self.tau = [0.0, 0.0, 0.0]  # [N·m] body
        self.attitude = self.create_publisher(QuaternionStamped, "attitude", 1000)
        self.rate = self.create_publisher(Vector3Stamped, "angular_velocity", 1000)
        self.create_subscription(WrenchStamped, "torque_command", self.on_torque, 10)
        self.create_timer(self.h, self.tick)

    def tick(self) -> None:
        """Advance one step under the last torque and publish both halves of the state."""
        if not self.answered:
            self.publish()  # the first state again and again, until the stack is there
            return
        if self.steps and self.k >= self.steps:
            raise SystemExit(0 if self.answered > self.steps // 2 else 1)
        self.omega = [w + self.h * t / INERTIA for w, t in zip(self.omega, self.tau, strict=True)]
        x, y, z, w = self.q
        p, q, r = self.omega
        rates = (
            w * p + y * r - z * q,
            w * q + z * p - x * r,
            w * r + x * q - y * p,
            -x * p - y * q - z * r,
        )
        middle = [a + 0.5 * self.h * b for a, b in zip(self.q, rates, strict=True)]
        self.q = [each / math.hypot(*middle) for each in middle]
        self.k += 1
        self.publish()

    def publish(self) -> None:
        """Send the state: one stamp for both messages, x y z w, body axes."""
        attitude, rate = QuaternionStamped(), Vector3Stamped()
        nanoseconds = round(self.k * self.h * 1e9)
        for message, frame in ((attitude, "inertial"), (rate, "body")):
            message.header.frame_id = frame
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(nanoseconds, 10**9)
        quaternion, vector = attitude.quaternion, rate.vector
        quaternion.x, quaternion.y, quaternion.z, quaternion.w = self.q
        vector.x, vector.y, vector.z = self.omega
        self.attitude.publish(attitude)
        self.rate.publish(rate)

    def on_torque(self, command: WrenchStamped) -> None:
        """Hold the torque until the next one."""
        torque = command.wrench.torque
        self.tau = [torque.x, torque.y, torque.z]
        self.answered += 1


def main() -> None:
    """Run until the steps are done or the process is asked to stop."""
    rclpy.init()
    node = OwnPlant()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        print(f"{node.k} states, {node.answered} torques", file=sys.stderr)


if __name__ == "__main__":
    main()
