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
