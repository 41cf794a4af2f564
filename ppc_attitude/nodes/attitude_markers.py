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

import sys
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
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
from ppc_attitude.nodes.marker_shapes import (
    CONE_LENGTH,
    arrow,
    axes,
    box,
    cone,
    header,
    transform,
)
from ppc_attitude.nodes.messages import LATE_PEER, LatestSamples, publisher_of, subscribe
from ppc_attitude.nodes.running import run_node
from ppc_attitude.runtime.health import OK, STALE, Status
from ppc_attitude.science.attitude import rotate
from ppc_attitude.science.component import BODY, DESIRED
from ppc_attitude.science.guidance.scene import Scene, heard
from ppc_attitude.science.keep_out import angle_between
from ppc_attitude.science.kernel import Quaternion, Vector, quaternion, scale, vector

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
        shown = [box(position, attitude), *axes(BODY, position, attitude, 1.0, 1.0)]
        frames = {BODY: attitude}
        desired = self._latest.get(REFERENCE_ATTITUDE)
        if desired is not None:
            frames[DESIRED] = quaternion(desired.values)
            shown += axes(DESIRED, position, frames[DESIRED], 1.3, 0.4)
        shown += self._torques(position, attitude)
        shown += self._guidance(position, attitude)
        moved = [transform(self._prefix + name, position, q) for name, q in frames.items()]
        for each in (*shown, *moved):
            each.header = header(self._stamp)
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
                shown.append(arrow((name, 0), position, extent, (colour, 1.0, 0.04)))
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
        shown = axes("goal", position, self._scene.goal, 1.6, 0.25)
        for i, each in enumerate(self._scene.cones):
            pointed = rotate(attitude, each.axis)
            inside = angle_between(pointed, each.direction) < each.half_angle
            shown.append(cone(i, position, each.direction, each.half_angle, _KEPT_OUT))
            look = (_KEPT_OUT if inside else _CLEAR, 1.0, 0.03)
            extent = scale(CONE_LENGTH, pointed)
            shown.append(arrow(("boresight", i), position, extent, look))
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


main = partial(run_node, AttitudeMarkers)

if __name__ == "__main__":
    sys.exit(main())
