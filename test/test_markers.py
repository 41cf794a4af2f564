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

"""The markers show where the craft points and what acts on it, and TF needs tf2_ros."""

import math
import sys
import time
import types
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from peer import Beside, living
from rclpy.node import Node
from rclpy.parameter import Parameter
from visualization_msgs.msg import Marker, MarkerArray

from ppc_attitude.contract.topics import (
    APPLIED_TORQUE,
    ATTITUDE,
    DISTURBANCE,
    GUIDANCE_STATUS,
    MARKERS_TOPIC,
    REFERENCE_ATTITUDE,
    Topic,
)
from ppc_attitude.nodes.attitude_markers import LONGEST, AttitudeMarkers
from ppc_attitude.nodes.messages import diagnostics, published
from ppc_attitude.runtime.health import OK, Status
from ppc_attitude.science.guidance import scene as guidance

HALF = math.sqrt(0.5)
QUARTER_TURN = (0.0, 0.0, HALF, HALF)  # body x is inertial y
STAMP_NS = 1_500_000_000
INPUTS = (ATTITUDE, REFERENCE_ATTITUDE, APPLIED_TORQUE, DISTURBANCE)


class Scene(Beside):
    """The marker node and a peer that feeds it and collects what it draws."""

    def __init__(self, node: AttitudeMarkers) -> None:
        super().__init__(node, *INPUTS)
        self.drawn: list[MarkerArray] = []
        self.peer.create_subscription(MarkerArray, MARKERS_TOPIC.name, self.drawn.append, 10)
        self.meet()
        self.until(lambda: self.peer.count_publishers(MARKERS_TOPIC.name) >= 1)

    def show(self, topic: Topic, values: tuple[float, ...], stamp_ns: int = STAMP_NS) -> None:
        self.send(topic, stamp_ns, values)

    def arrived(self, *topics: Topic) -> None:
        self.until(lambda: all(topic in self.node._latest._raw for topic in topics))

    def picture(self) -> dict[tuple[str, int], Marker]:
        self.drawn.clear()

        def drawn() -> bool:
            self.node.wake()
            return bool(self.drawn)

        self.until(drawn)
        return {(marker.ns, marker.id): marker for marker in self.drawn[-1].markers}


@pytest.fixture
def make_scene() -> Iterator[Callable[..., Scene]]:
    with ExitStack() as stack:

        def make(*parameters: str, home: str = "/") -> Scene:
            rules = [f"__ns:={home}"]
            node = stack.enter_context(living(AttitudeMarkers, *parameters, rules=rules))
            return stack.enter_context(closing(Scene(node)))

        yield make


def tip(marker: Marker) -> tuple[float, float, float]:
    start, end = marker.points
    return (end.x - start.x, end.y - start.y, end.z - start.z)


def test_the_picture_of_one_state(make_scene: Callable[..., Scene]) -> None:
    scene = make_scene("position:=[5.0, 0.0, 0.0]", "torque_scale:=10.0")
    scene.show(REFERENCE_ATTITUDE, (0.0, 0.0, 0.0, 1.0))
    scene.show(APPLIED_TORQUE, (0.05, 0.0, 0.0))
    scene.show(DISTURBANCE, (0.0, 0.0, 0.8))
    scene.arrived(REFERENCE_ATTITUDE, APPLIED_TORQUE, DISTURBANCE)
    scene.show(ATTITUDE, QUARTER_TURN)
    shapes = scene.picture()

    craft = shapes["craft", 0]
    assert craft.type == Marker.CUBE
    assert craft.header.frame_id == "inertial"
    assert (craft.header.stamp.sec, craft.header.stamp.nanosec) == (1, 500_000_000)
    assert craft.pose.position.x == 5.0
    assert (craft.pose.orientation.z, craft.pose.orientation.w) == (HALF, HALF)
    assert tip(shapes["body", 0]) == pytest.approx((0.0, 1.0, 0.0), abs=1e-12)
    assert tip(shapes["body", 1]) == pytest.approx((-1.0, 0.0, 0.0), abs=1e-12)
    assert tip(shapes["desired", 0]) == pytest.approx((1.3, 0.0, 0.0), abs=1e-12)
    assert tip(shapes["torque", 0]) == pytest.approx((0.0, 0.5, 0.0), abs=1e-12)
    assert tip(shapes["disturbance", 0]) == pytest.approx((0.0, 0.0, LONGEST))
    assert all(marker.color.a > 0.0 for marker in shapes.values())
    assert all(
        min(m.scale.x, m.scale.y, m.scale.z) > 0.0 for m in shapes.values() if m.action == m.ADD
    )


def test_what_does_not_act_is_taken_away(make_scene: Callable[..., Scene]) -> None:
    scene = make_scene()
    scene.show(APPLIED_TORQUE, (0.0, 0.0, 0.0))
    scene.arrived(APPLIED_TORQUE)
    scene.show(ATTITUDE, QUARTER_TURN)
    shapes = scene.picture()
    assert shapes["torque", 0].action == Marker.DELETE
    assert ("disturbance", 0) not in shapes
    assert ("desired", 0) not in shapes


def test_goal_cones_and_the_axes_that_must_keep_out(make_scene: Callable[..., Scene]) -> None:
    scene = make_scene()
    surroundings = guidance.Scene(
        QUARTER_TURN,
        (
            guidance.Cone((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.5),
            guidance.Cone((0.0, 0.0, 1.0), (0.0, 0.0, 1.0), 2.0),
        ),
    )
    told = diagnostics(STAMP_NS, "/it", "guidance", Status(OK, "", guidance.told(surroundings)))
    publisher = scene.peer.create_publisher(
        DiagnosticArray, GUIDANCE_STATUS.name, published(GUIDANCE_STATUS)
    )
    publisher.publish(told)
    scene.until(lambda: scene.node._scene is not None)
    scene.show(ATTITUDE, QUARTER_TURN)
    shapes = scene.picture()
    assert tip(shapes["goal", 0]) == pytest.approx((0.0, 1.6, 0.0), abs=1e-12)
    assert tip(shapes["boresight", 0]) == pytest.approx((0.0, 2.0, 0.0), abs=1e-12)
    clear, inside = (shapes["boresight", i].color for i in range(2))
    red = shapes["keep_out", 1].color
    assert (clear.r, clear.g, clear.b) != (red.r, red.g, red.b) == (inside.r, inside.g, inside.b)
    for number, half_angle in ((0, 0.5), (1, 2.0)):
        cone = shapes["keep_out", number]
        assert cone.type == Marker.TRIANGLE_LIST
        assert len(cone.points) % 3 == 0
        corners = {(p.x, p.y, p.z) for p in cone.points}
        apex = (0.0, 0.0, 0.0)
        assert apex in corners
        for point in corners - {apex}:
            assert math.dist(apex, point) == pytest.approx(2.0)
            assert point[2] == pytest.approx(2.0 * math.cos(half_angle))


def test_cones_that_went_are_taken_away(make_scene: Callable[..., Scene]) -> None:
    scene = make_scene()
    cones = (guidance.Cone((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.5),) * 2
    actions = []
    for count, stamp_ns in ((2, STAMP_NS), (1, 2 * STAMP_NS)):
        scene.node._scene = guidance.Scene(QUARTER_TURN, cones[:count])
        scene.show(ATTITUDE, QUARTER_TURN, stamp_ns)
        shapes = scene.picture()
        actions.append([shapes[name, 1].action for name in ("keep_out", "boresight")])
    assert actions == [[Marker.ADD] * 2, [Marker.DELETE] * 2]


def test_no_picture_without_an_attitude(make_scene: Callable[..., Scene]) -> None:
    scene = make_scene()
    scene.show(ATTITUDE, (0.0, 0.0, 0.0, 0.0))
    scene.arrived(ATTITUDE)
    scene.node._draw()
    assert scene.node._drawn == 0
    scene.show(ATTITUDE, QUARTER_TURN, 2 * STAMP_NS)
    assert scene.picture()["craft", 0].pose.orientation.w == HALF


def test_no_picture_of_nonsense(make_scene: Callable[..., Scene]) -> None:
    scene = make_scene()
    scene.show(ATTITUDE, (0.0, 0.0, 0.0, 2.0))
    scene.arrived(ATTITUDE)
    scene.node.wake()
    scene.until(lambda: scene.node.health.refused[ATTITUDE.name] > 0 or not scene.node.wake())
    for _ in range(3):  # no new message
        scene.node._draw()
    assert scene.node.health.refused[ATTITUDE.name] == 1
    scene.show(ATTITUDE, QUARTER_TURN, 2 * STAMP_NS)
    assert scene.picture()["craft", 0].header.stamp.sec == 3
    assert len(scene.drawn) == 1
    scene.show(ATTITUDE, QUARTER_TURN)  # time has begun again
    assert scene.picture()["craft", 0].header.stamp.sec == 1
    said = Status(OK, "", {"goal in inertial axes": "north"})
    scene.node._on_guidance(diagnostics(STAMP_NS, "/it", "guidance", said))
    assert scene.node.health.refused[GUIDANCE_STATUS.name] == 1


def test_a_rate_that_is_set_acts_at_once(make_scene: Callable[..., Scene]) -> None:
    """The old one would keep the next picture waiting."""
    scene = make_scene("update_rate:=0.1")
    scene.show(ATTITUDE, QUARTER_TURN)
    scene.arrived(ATTITUDE)
    scene.picture()
    scene.show(ATTITUDE, QUARTER_TURN, 2 * STAMP_NS)
    scene.node.set_parameters([Parameter("update_rate", value=100.0)])
    begin = time.monotonic()
    scene.picture()
    assert time.monotonic() - begin < 9.0


@pytest.mark.parametrize(("namespace", "prefix"), [("/", ""), ("/proposed", "proposed/")])
def test_transforms_where_tf2_ros_is_installed(
    make_scene: Callable[..., Scene], monkeypatch: pytest.MonkeyPatch, namespace: str, prefix: str
) -> None:
    sent: list[Any] = []

    class TransformBroadcaster:
        def __init__(self, node: Node) -> None:
            assert isinstance(node, Node)

        def sendTransform(self, transforms: list[Any]) -> None:
            sent.extend(transforms)

    stand_in = types.ModuleType("tf2_ros")
    monkeypatch.setattr(stand_in, "TransformBroadcaster", TransformBroadcaster, raising=False)
    monkeypatch.setitem(sys.modules, "tf2_ros", stand_in)
    scene = make_scene(home=namespace)
    scene.show(REFERENCE_ATTITUDE, (1.0, 0.0, 0.0, 0.0))
    scene.arrived(REFERENCE_ATTITUDE)
    scene.show(ATTITUDE, QUARTER_TURN)
    scene.picture()
    assert [t.child_frame_id for t in sent] == [f"{prefix}body", f"{prefix}desired"]
    assert {t.header.frame_id for t in sent} == {"inertial"}
    assert sent[0].transform.rotation.w == HALF
    assert sent[1].transform.rotation.x == 1.0


def test_without_tf2_ros_there_are_still_markers(
    make_scene: Callable[..., Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "tf2_ros", None)
    scene = make_scene()
    scene.show(ATTITUDE, QUARTER_TURN)
    assert ("craft", 0) in scene.picture()
    assert scene.node.status()[2]["transforms"] == "none: no tf2_ros"
