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

"""The drawing node: draws craft, torques and goals for RViz and Foxglove, and sends TF.

It needs `tf2_ros` for TF. Of guidance it draws what `guidance/status` says, so it does the same for
a bag that is played.
"""

import math
import sys
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, TransformStamped, Vector3
from geometry_msgs.msg import Quaternion as QuaternionMessage
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ppc_attitude.contract.topics import (
    APPLIED_TORQUE,
    ATTITUDE,
    DISTURBANCE,
    GUIDANCE_STATUS,
    MARKERS,
    MARKERS_TOPIC,
    REFERENCE_ATTITUDE,
)
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.messages import LATE_PEER, LatestSamples, publisher_of, subscribe
from ppc_attitude.nodes.running import run_node
from ppc_attitude.runtime.health import OK, STALE, Status
from ppc_attitude.science.attitude import rotate
from ppc_attitude.science.component import BODY, DESIRED, INERTIAL
from ppc_attitude.science.guidance.scene import Scene, heard
from ppc_attitude.science.keep_out import angle_between, perpendicular
from ppc_attitude.science.kernel import (
    Quaternion,
    Vector,
    add,
    cross,
    dot,
    quaternion,
    scale,
    vector,
)

Colour = tuple[float, float, float]  # red, green, blue
LONGEST = 2.0  # [m] of an arrow, whatever the torque
_CONE_LENGTH = 2.0  # [m]
_FACETS = 36
_SHORTEST = 1e-3  # [m] shorter arrows are taken away: a viewer cannot draw them
_BOX = (0.7, 0.6, 0.5)  # [m] longest along the axis of least inertia in the paper's craft
_AXES = (
    ((1.0, 0.0, 0.0), (0.90, 0.20, 0.20)),
    ((0.0, 1.0, 0.0), (0.20, 0.75, 0.25)),
    ((0.0, 0.0, 1.0), (0.25, 0.40, 0.95)),
)
_KEPT_OUT, _CLEAR = (0.85, 0.10, 0.10), (0.10, 0.80, 0.80)
_TORQUES = (
    (APPLIED_TORQUE, "torque", "torque_scale", (1.0, 0.55, 0.0)),
    (DISTURBANCE, "disturbance", "disturbance_scale", (0.85, 0.10, 0.75)),
)


class AttitudeMarkers(BaseNode):
    """Draws the latest state a few times a second; nobody waits for it."""

    executable = MARKERS

    def __init__(self) -> None:
        super().__init__()
        topics = (ATTITUDE, REFERENCE_ATTITUDE, *(topic for topic, *_ in _TORQUES))
        self._latest = LatestSamples(self, topics, self.refuse)
        self._publisher = publisher_of(self, MARKERS_TOPIC)
        self._broadcaster = _broadcaster(self)
        # Frames of several craft in one TF tree need names of their own.
        self._prefix = f"{self.get_namespace()}/".lstrip("/")
        self._scene: Scene | None = None  # of guidance; none in mode `paper`
        self._cones = 0  # that are drawn
        # A node that joins late still gets the last status.
        subscribe(self, GUIDANCE_STATUS, self._on_guidance, LATE_PEER)
        self._stamp = -1
        self._looked_at = 0.0  # [s]
        self._drawn = 0

    def wake(self) -> float:
        """Draw when it is time and there is a new state."""
        now, period = self.now(), 1.0 / float(self.parameters["update_rate"])
        if now >= self._looked_at + period:
            self._looked_at = now
            self._draw()
        return min(super().wake(), self._looked_at + period - now)

    def _draw(self) -> None:
        state = self._latest.get(ATTITUDE)
        if state is None or state.stamp_ns == self._stamp or not any(state.values):
            return  # nothing new, or no attitude is known
        if state.stamp_ns < self._stamp:
            self.health.begin_again()
        self._stamp = state.stamp_ns
        x, y, z = self.parameters["position"]
        position = (x, y, z)
        attitude = quaternion(state.values)
        shown = [_box(position, attitude), *_axes(BODY, position, attitude, 1.0, 1.0)]
        frames = {BODY: attitude}
        desired = self._latest.get(REFERENCE_ATTITUDE)
        if desired is not None:
            frames[DESIRED] = quaternion(desired.values)
            shown += _axes(DESIRED, position, frames[DESIRED], 1.3, 0.4)
        shown += self._torques(position, attitude)
        shown += self._guidance(position, attitude)
        moved = [_transform(self._prefix + name, position, q) for name, q in frames.items()]
        header = Header(stamp=Time(nanoseconds=self._stamp).to_msg(), frame_id=INERTIAL)
        for each in (*shown, *moved):
            each.header = header
        self._publisher.publish(MarkerArray(markers=shown))
        if self._broadcaster is not None:
            self._broadcaster.sendTransform(moved)
        self._drawn += 1
        self.report(self._stamp)

    def _torques(self, position: Vector, attitude: Quaternion) -> list[Any]:
        shown = []
        for topic, name, parameter, colour in _TORQUES:
            sample = self._latest.get(topic)
            if sample is not None:
                torque = rotate(attitude, vector(sample.values))
                extent = scale(self.parameters[parameter], torque)
                shown.append(_arrow((name, 0), position, extent, (colour, 1.0, 0.04)))
        return shown

    def _on_guidance(self, message: DiagnosticArray) -> None:
        for status in message.status:
            facts = {each.key: each.value for each in status.values}
            try:
                self._scene = heard(facts) or self._scene
            except ValueError as reason:
                self.refuse(GUIDANCE_STATUS.name, f"{GUIDANCE_STATUS.name}: {reason}")

    def _guidance(self, position: Vector, attitude: Quaternion) -> list[Any]:
        """Goal, keep-out cones, and the body axes that must keep out of them."""
        if self._scene is None:
            return []
        shown = _axes("goal", position, self._scene.goal, 1.6, 0.25)
        for i, each in enumerate(self._scene.cones):
            pointed = rotate(attitude, each.axis)
            inside = angle_between(pointed, each.direction) < each.half_angle
            shown.append(_cone(i, position, each.direction, each.half_angle, _KEPT_OUT))
            look = (_KEPT_OUT if inside else _CLEAR, 1.0, 0.03)
            extent = scale(_CONE_LENGTH, pointed)
            shown.append(_arrow(("boresight", i), position, extent, look))
        shown += [
            Marker(ns=name, id=i, action=Marker.DELETE)
            for name in ("keep_out", "boresight")
            for i in range(len(self._scene.cones), self._cones)
        ]
        self._cones = len(self._scene.cones)
        return shown

    def status(self) -> Status:
        """Waiting for states, or drawing."""
        details = {
            "pictures": self._drawn,
            "transforms": "none: no tf2_ros" if self._broadcaster is None else "on /tf",
        }
        if self.is_idle():
            return Status(STALE, f"waiting for {ATTITUDE.name}", details)
        return Status(OK, "drawing", details)


def _broadcaster(node: Node) -> Any:
    """TF broadcaster, or None where tf2_ros is not installed."""
    try:
        from tf2_ros import TransformBroadcaster
    except ImportError:
        node.get_logger().info("tf2_ros is not installed, so no transforms go to /tf")
        return None
    return TransformBroadcaster(node)


# Shapes. Positions [m] are in inertial axes; attitudes are from a frame to inertial.


def _box(position: Vector, attitude: Quaternion) -> Marker:
    """Return the craft."""
    marker = _marker("craft", 0, Marker.CUBE, (0.75, 0.75, 0.80), 0.6)
    marker.pose.position = _point(position)
    marker.pose.orientation = _quaternion(attitude)
    marker.scale = Vector3(x=_BOX[0], y=_BOX[1], z=_BOX[2])
    return marker


def _axes(
    name: str, position: Vector, attitude: Quaternion, length: float, alpha: float
) -> list[Marker]:
    """Return the three axes of a frame, x y z in red, green and blue."""
    return [
        _arrow((name, k), position, scale(length, rotate(attitude, axis)), (colour, alpha, 0.02))
        for k, (axis, colour) in enumerate(_AXES)
    ]


def _arrow(
    identity: tuple[str, int], start: Vector, extent: Vector, look: tuple[Colour, float, float]
) -> Marker:
    """Return an arrow that begins at a place and goes so far [m].

    Its identity is namespace and number of the marker, its look colour, opacity and shaft diameter
    [m].
    """
    colour, alpha, diameter = look
    marker = _marker(*identity, Marker.ARROW, colour, alpha)
    length = math.sqrt(dot(extent, extent))
    if length < _SHORTEST:
        marker.action = Marker.DELETE
        return marker
    shown = scale(min(1.0, LONGEST / length), extent)
    marker.points = [_point(start), _point(add(start, shown))]
    marker.scale = Vector3(x=diameter, y=2.5 * diameter, z=4.0 * diameter)
    return marker


def _cone(
    number: int, apex: Vector, direction: Vector, half_angle: float, colour: Colour
) -> Marker:
    """Return the mantle of a cone, whose axis is along a unit vector.

    With a half angle [rad] above π/2 it opens backwards.
    """
    marker = _marker("keep_out", number, Marker.TRIANGLE_LIST, colour, 0.25)
    marker.scale = Vector3(x=1.0, y=1.0, z=1.0)
    turns = np.linspace(0.0, math.tau, _FACETS + 1)
    u = perpendicular(direction)
    across = np.outer(np.cos(turns), u) + np.outer(np.sin(turns), cross(direction, u))
    edges = math.cos(half_angle) * np.array(direction) + math.sin(half_angle) * across
    rim = map(_point, (apex + _CONE_LENGTH * edges).tolist())
    for left, right in pairwise(rim):
        marker.points += [_point(apex), left, right]
    return marker


def _transform(child: str, position: Vector, attitude: Quaternion) -> TransformStamped:
    """Return the place of a frame in the inertial frame."""
    result = TransformStamped(child_frame_id=child)
    result.transform.translation = Vector3(x=position[0], y=position[1], z=position[2])
    result.transform.rotation = _quaternion(attitude)
    return result


def _marker(name: str, number: int, kind: int, colour: Colour, alpha: float) -> Marker:
    red, green, blue = colour
    marker = Marker(ns=name, id=number, type=kind, action=Marker.ADD)
    marker.pose.orientation.w = 1.0
    marker.color = ColorRGBA(r=red, g=green, b=blue, a=alpha)
    return marker


def _point(a: Vector) -> Point:
    return Point(x=a[0], y=a[1], z=a[2])


def _quaternion(q: Quaternion) -> QuaternionMessage:
    return QuaternionMessage(x=q[0], y=q[1], z=q[2], w=q[3])


main = partial(run_node, AttitudeMarkers)

if __name__ == "__main__":
    sys.exit(main())
