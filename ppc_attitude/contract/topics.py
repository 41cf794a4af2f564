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

"""The table of topics: names, types, frames and who publishes them.

Everything that names a topic takes it from here, or from `declared`, which adds what only some
component declares. A topic that carries one sample per step has a `column`: the name of its array
in a `RunRecord`. This file loads no component, so that the recorder stays light.
"""

from dataclasses import dataclass

from ppc_attitude.science import signals
from ppc_attitude.science.component import (
    BODY,
    FIX,
    GYRO,
    INERTIAL,
    JOINTS,
    MAGNETIC,
    MOTION,
    POINT,
    QUATERNION,
    VECTOR,
    WRENCH,
    Column,
)
from ppc_attitude.science.kinds import (
    ACTUATORS,
    ALLOCATORS,
    CONTROLLERS,
    DISTURBANCES,
    ENVIRONMENTS,
    ESTIMATORS,
    PLANTS,
    REFERENCES,
    SENSORS,
    Kind,
)

MSGTYPES = {
    QUATERNION: "geometry_msgs/msg/QuaternionStamped",
    VECTOR: "geometry_msgs/msg/Vector3Stamped",
    WRENCH: "geometry_msgs/msg/WrenchStamped",
    POINT: "geometry_msgs/msg/PointStamped",
    MAGNETIC: "sensor_msgs/msg/MagneticField",
    **dict.fromkeys((GYRO, FIX, MOTION), "sensor_msgs/msg/Imu"),
    **dict.fromkeys(JOINTS, "sensor_msgs/msg/JointState"),
}
CLOCK = "rosgraph_msgs/msg/Clock"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"

PLANT = "spacecraft_plant"
REFERENCE = "reference_generator"
CONTROLLER = "ppc_controller"
INJECTOR = "disturbance_injector"
ESTIMATOR = "attitude_estimator"
ALLOCATOR = "wheel_allocator"
RECORDER = "bag_recorder"
MARKERS = "attitude_markers"  # draws the run for RViz and Foxglove
NODES = (PLANT, REFERENCE, CONTROLLER, INJECTOR, RECORDER)
"""The nodes of every run."""
OPTIONAL = (ESTIMATOR, ALLOCATOR)
"""Nodes that a run has if a component of theirs is selected."""
OF_A_RUN = (*OPTIONAL, *NODES)
BESIDE = (MARKERS,)
"""Nodes that no run needs."""
SOURCES = (PLANT, ESTIMATOR, REFERENCE, CONTROLLER, ALLOCATOR, INJECTOR)  # of a run's samples

HOSTED: dict[str, tuple[Kind, ...]] = {
    PLANT: (PLANTS, SENSORS, ACTUATORS),
    ESTIMATOR: (ESTIMATORS,),
    REFERENCE: (REFERENCES,),
    INJECTOR: (ENVIRONMENTS, DISTURBANCES),
    CONTROLLER: (CONTROLLERS,),
    ALLOCATOR: (ALLOCATORS,),
}
"""Which kinds of component each node runs."""
NODE_OF = {kind.name: node for node, kinds in HOSTED.items() for kind in kinds}
"""Which node runs the components of a kind."""


@dataclass(frozen=True)
class Topic:
    """One topic of the contract.

    Attributes
    ----------
    name : str
        Relative topic name (absolute for ROS's own topics).
    msgtype : str
        ROS type, ``package/msg/Name``.
    frame_id : str
        Frame in which the numbers are expressed; empty where the type has no header.
    source : str
        Executable that publishes it; empty where anyone may.
    column : str
        Name of the topic's array in a `RunRecord`; empty where it has no sample per step.
    unit : str
        Unit of the numbers.
    meaning : str
        What the numbers are.
    width : int
        How many numbers one sample has.
    form : str
        How they lie in the message (`science.component.Column`), where the type leaves a choice.
    part : str
        Name of a part, where there is a number for each part of a sort.
    late : bool
        True if it comes at some instants only, later than the stamp that it has.
    """

    name: str
    msgtype: str
    frame_id: str = ""
    source: str = ""
    column: str = ""
    unit: str = ""
    meaning: str = ""
    width: int = 0
    form: str = ""
    part: str = ""
    late: bool = False

    @property
    def parts(self) -> tuple[str, ...]:
        """What its numbers are of, such as ``wheel 0``; empty if they are of no parts."""
        return tuple(f"{self.part} {k}" for k in range(self.width if self.part else 0))


def topic_of(column: Column, source: str) -> Topic:
    """Topic that carries a column, published by a node."""
    return Topic(
        name=column.topic,
        msgtype=MSGTYPES[column.form],
        frame_id=column.frame,
        source=source,
        column=column.name,
        unit=column.unit,
        meaning=column.meaning,
        width=column.width - column.late,  # without the age, which is no number of the message
        form=column.form,
        part=column.part,
        late=column.late,
    )


ATTITUDE = topic_of(signals.ATTITUDE, PLANT)
ANGULAR_VELOCITY = topic_of(signals.ANGULAR_VELOCITY, PLANT)
TRUE_ATTITUDE = topic_of(signals.TRUE_ATTITUDE, PLANT)
TRUE_RATE = topic_of(signals.TRUE_RATE, PLANT)
APPLIED_TORQUE = topic_of(signals.APPLIED_TORQUE, PLANT)
REFERENCE_ATTITUDE = topic_of(signals.REFERENCE_ATTITUDE, REFERENCE)
REFERENCE_RATE = topic_of(signals.REFERENCE_RATE, REFERENCE)
REFERENCE_ACCELERATION = topic_of(signals.REFERENCE_ACCELERATION, REFERENCE)
TORQUE_COMMAND = topic_of(signals.TORQUE_COMMAND, CONTROLLER)
DISTURBANCE = topic_of(signals.DISTURBANCE, INJECTOR)

STANDARD = (
    ATTITUDE,
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    REFERENCE_ACCELERATION,
    TORQUE_COMMAND,
    DISTURBANCE,
    TRUE_ATTITUDE,
    TRUE_RATE,
)
"""Topics between the nodes, whatever components they run."""

INJECT = Topic(
    "disturbance/inject",
    MSGTYPES[WRENCH],
    BODY,
    unit="N·m",
    meaning="extra torque",
    width=3,
    form=WRENCH,
)
GOAL_POSE = Topic(
    "goal_pose",
    "geometry_msgs/msg/PoseStamped",
    "inertial, nadir, ground, sun or spin",
    unit="1",
    meaning="attitude to go to, relative to its frame; the position is ignored",
)
GOAL_TRAJECTORY = Topic(
    "goal_trajectory",
    "trajectory_msgs/msg/MultiDOFJointTrajectory",
    INERTIAL,
    unit="1",
    meaning="attitudes of the joint `body` at given times",
)
GUIDANCE_STATUS = Topic(
    "guidance/status",
    DIAGNOSTICS,
    source=REFERENCE,
    meaning="answer to each order, from the stamp on; warnings; goal attitude and keep-out cones",
)
CLOCK_TOPIC = Topic("/clock", CLOCK, source=PLANT, unit="s", meaning="simulated time")
DIAGNOSTICS_TOPIC = Topic("/diagnostics", DIAGNOSTICS, meaning="health of every node")
PARAMETER_EVENTS_TOPIC = Topic(
    "/parameter_events", "rcl_interfaces/msg/ParameterEvent", meaning="changed parameters"
)
CHANGES_TOPIC = Topic(
    "parameters/changed", DIAGNOSTICS, meaning="parameters that changed, from the stamp on"
)
ENABLED = "enabled"
"""A name on `CHANGES_TOPIC` that is no parameter. The controller publishes it when its torque is
switched. The recorder publishes it for a node that was started again during a run: a replay lets
that node begin anew there."""
RECORDED_TOPIC = Topic(
    "recorded_until",
    CLOCK,
    source=RECORDER,
    unit="s",
    meaning="the recorder has every state until then",
)
MARKERS_TOPIC = Topic(
    "markers",
    "visualization_msgs/msg/MarkerArray",
    INERTIAL,
    MARKERS,
    unit="m",
    meaning="craft, frames, torques, goal and keep-out cones as shapes",
)
EVENTS = (
    INJECT,
    GOAL_POSE,
    GOAL_TRAJECTORY,
    GUIDANCE_STATUS,
    CLOCK_TOPIC,
    CHANGES_TOPIC,
    DIAGNOSTICS_TOPIC,
    PARAMETER_EVENTS_TOPIC,
)
OWNED = tuple(topic for topic in EVENTS if topic.source)
"""Those that belong to one node, as all samples do."""
