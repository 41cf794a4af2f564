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

"""The one table of topics: names, types, frames and who publishes them.

Everything that names a topic (nodes, recorder, reader, in-process loop, documentation tests)
takes it from here. A topic that carries one sample per step has a `column`: the name of its
array in a `RunRecord`.
"""

from dataclasses import dataclass

QUATERNION = "geometry_msgs/msg/QuaternionStamped"
VECTOR = "geometry_msgs/msg/Vector3Stamped"
WRENCH = "geometry_msgs/msg/WrenchStamped"
CLOCK = "rosgraph_msgs/msg/Clock"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
PARAMETER_EVENTS = "rcl_interfaces/msg/ParameterEvent"
MARKER_ARRAY = "visualization_msgs/msg/MarkerArray"

INERTIAL, BODY, DESIRED = "inertial", "body", "desired"

PLANT = "spacecraft_plant"
REFERENCE = "reference_generator"
CONTROLLER = "ppc_controller"
INJECTOR = "disturbance_injector"
RECORDER = "bag_recorder"
NODES = (PLANT, REFERENCE, CONTROLLER, INJECTOR, RECORDER)
SOURCES = (PLANT, REFERENCE, CONTROLLER, INJECTOR)  # of what a run consists of
MARKERS = "attitude_markers"  # draws the run for RViz and Foxglove; no run needs it

WIDTH = {QUATERNION: 4, VECTOR: 3, WRENCH: 3}  # numbers of one sample (of a wrench: the torque)


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
    """

    name: str
    msgtype: str
    frame_id: str
    source: str
    column: str = ""
    unit: str = ""
    meaning: str = ""

    @property
    def width(self) -> int:
        """How many numbers one sample has."""
        return WIDTH[self.msgtype]


ATTITUDE = Topic(
    "attitude", QUATERNION, INERTIAL, PLANT, "attitude", "1", "attitude, body to inertial, x y z w"
)
ANGULAR_VELOCITY = Topic(
    "angular_velocity", VECTOR, BODY, PLANT, "angular_velocity", "rad/s", "angular velocity"
)
APPLIED_TORQUE = Topic(
    "applied_torque",
    WRENCH,
    BODY,
    PLANT,
    "applied_torque",
    "N·m",
    "actuator torque that acts from the stamp on",
)
REFERENCE_ATTITUDE = Topic(
    "reference/attitude",
    QUATERNION,
    INERTIAL,
    REFERENCE,
    "reference_attitude",
    "1",
    "desired attitude, desired frame to inertial, x y z w",
)
REFERENCE_RATE = Topic(
    "reference/angular_velocity",
    VECTOR,
    DESIRED,
    REFERENCE,
    "reference_angular_velocity",
    "rad/s",
    "desired angular velocity",
)
REFERENCE_ACCELERATION = Topic(
    "reference/angular_acceleration",
    VECTOR,
    DESIRED,
    REFERENCE,
    "reference_angular_acceleration",
    "rad/s²",
    "desired angular acceleration",
)
TORQUE_COMMAND = Topic(
    "torque_command",
    WRENCH,
    BODY,
    CONTROLLER,
    "torque_command",
    "N·m",
    "commanded torque τ = sat(u)",
)
DISTURBANCE = Topic(
    "disturbance/torque",
    WRENCH,
    BODY,
    INJECTOR,
    "disturbance_torque",
    "N·m",
    "all external torque",
)
INJECT = Topic("disturbance/inject", WRENCH, BODY, "", "", "N·m", "extra torque, from anyone")
ATTITUDE_ERROR = Topic(
    "control/attitude_error",
    QUATERNION,
    DESIRED,
    CONTROLLER,
    "attitude_error",
    "1",
    "attitude error q_e, x y z w",
)
ATTITUDE_ENVELOPE = Topic(
    "control/attitude_envelope",
    VECTOR,
    BODY,
    CONTROLLER,
    "attitude_envelope",
    "1",
    "envelope ρ_q of the attitude error",
)
RATE_ERROR = Topic(
    "control/rate_error", VECTOR, BODY, CONTROLLER, "rate_error", "rad/s", "rate error z2"
)
RATE_ENVELOPE = Topic(
    "control/rate_envelope",
    VECTOR,
    BODY,
    CONTROLLER,
    "rate_envelope",
    "rad/s",
    "envelope ρ_ω of the rate error",
)
AUXILIARY_STATE = Topic(
    "control/auxiliary_state",
    VECTOR,
    BODY,
    CONTROLLER,
    "auxiliary_state",
    "1",
    "anti-saturation state θ",
)
UNSATURATED_TORQUE = Topic(
    "control/unsaturated_torque",
    WRENCH,
    BODY,
    CONTROLLER,
    "unsaturated_torque",
    "N·m",
    "torque u before saturation",
)
CLOCK_TOPIC = Topic("/clock", CLOCK, "", PLANT, "", "s", "simulated time")
DIAGNOSTICS_TOPIC = Topic("/diagnostics", DIAGNOSTICS, "", "", "", "", "health of every node")
PARAMETER_EVENTS_TOPIC = Topic(
    "/parameter_events", PARAMETER_EVENTS, "", "", "", "", "changed parameters"
)
MARKERS_TOPIC = Topic(
    "markers", MARKER_ARRAY, INERTIAL, MARKERS, "", "m", "craft, frames and torques as shapes"
)

SAMPLED = (
    ATTITUDE,
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    REFERENCE_ACCELERATION,
    TORQUE_COMMAND,
    DISTURBANCE,
    ATTITUDE_ERROR,
    ATTITUDE_ENVELOPE,
    RATE_ERROR,
    RATE_ENVELOPE,
    AUXILIARY_STATE,
    UNSATURATED_TORQUE,
)
EVENTS = (INJECT, CLOCK_TOPIC, DIAGNOSTICS_TOPIC, PARAMETER_EVENTS_TOPIC)
TOPICS = SAMPLED + EVENTS
BY_NAME = {topic.name: topic for topic in TOPICS}
BY_COLUMN = {topic.column: topic for topic in SAMPLED}
# What only some controllers have; the rest is in every complete run.
OPTIONAL = (ATTITUDE_ENVELOPE, RATE_ENVELOPE, AUXILIARY_STATE)
