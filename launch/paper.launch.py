"""One run: plant, reference, controller, disturbances and recorder.

ros2 launch ppc_attitude paper.launch.py config:=paper.yaml,sudden_disturbance.yaml
ros2 launch ppc_attitude paper.launch.py without:=ppc_controller realtime:=true
"""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from ppc_attitude.command_line.launching import Request, Stacks, arguments

ARGUMENTS = (
    "config",
    "controller",
    "duration",
    "bag",
    "realtime",
    "namespace",
    "without",
    "markers",
)
CONFIG = Path(__file__).parent.parent / "config"


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes that the arguments ask for."""
    request = Request.of(context, *ARGUMENTS)
    return Stacks().nodes(request.scenario(CONFIG), request.nodes(), request["namespace"])


def generate_launch_description() -> LaunchDescription:
    """Describe the launch."""
    return LaunchDescription([*arguments(*ARGUMENTS), OpaqueFunction(function=nodes)])
