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

"""Goals by topic and service: what the reference generator flies, refuses and tells."""

import itertools
import json
import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, Quaternion, Transform, Twist, Vector3
from guidance_helpers import guided
from peer import Beside, living
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.topics import (
    ATTITUDE,
    CHANGES_TOPIC,
    GOAL_POSE,
    GOAL_TRAJECTORY,
    GUIDANCE_STATUS,
    REFERENCE_ACCELERATION,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    Topic,
)
from ppc_attitude.nodes.goto import Answer, go_to
from ppc_attitude.nodes.guidance_desk import ASKED, GuidanceDesk
from ppc_attitude.nodes.messages import message_class
from ppc_attitude.nodes.reference_generator import ReferenceGenerator
from ppc_attitude.science.guidance.orders import (
    Orders,
    goal_order,
    hold_order,
    profile_order,
    schedule_of,
)
from ppc_attitude.science.guidance.trajectory import points
from ppc_attitude.science.stamps import nanoseconds

START = (0.0, 0.0, 0.0, 1.0)
GOAL = (0.6, 0.0, 0.0, 0.8)
NEAR = (0.0, 0.28, 0.0, 0.96)
REFERENCE = (REFERENCE_ATTITUDE, REFERENCE_RATE, REFERENCE_ACCELERATION)


class Pilot(Beside):
    """A reference generator in this process, and a peer that feeds it and gives it goals."""

    def __init__(self, node: ReferenceGenerator) -> None:
        super().__init__(node, ATTITUDE, GOAL_POSE, GOAL_TRAJECTORY)
        self.heard: dict[str, dict[int, tuple[float, ...]]] = {}
        self.told: list[DiagnosticStatus] = []
        self.told_at: list[float] = []
        for topic in REFERENCE:
            self._hear(topic)

        def hear(message: DiagnosticArray) -> None:
            self.told.extend(message.status)
            stamp = message.header.stamp
            self.told_at.append(stamp.sec + stamp.nanosec / 1e9)

        self.peer.create_subscription(DiagnosticArray, GUIDANCE_STATUS.name, hear, 100)
        self._changes: list[DiagnosticStatus] = []
        self.peer.create_subscription(
            DiagnosticArray, CHANGES_TOPIC.name, lambda m: self._changes.extend(m.status), 100
        )
        self.meet()
        self.until(lambda: self.peer.count_publishers(GUIDANCE_STATUS.name) > 0)

    def _hear(self, topic: Topic) -> None:
        heard = self.heard.setdefault(topic.name, {})

        def receive(data: bytes) -> None:
            sample = Codec(topic).decode(data)
            heard[sample.stamp_ns] = sample.values

        kind = message_class(topic.msgtype)
        self.peer.create_subscription(kind, topic.name, receive, 100, raw=True)

    def state(self, t: float) -> list[float]:
        """Feed the state of an instant [s]; the ten numbers of the reference that answer it."""
        stamp_ns = nanoseconds(t)
        self.send(ATTITUDE, stamp_ns, START)
        self.until(lambda: all(stamp_ns in self.heard[topic.name] for topic in REFERENCE))
        return [x for topic in REFERENCE for x in self.heard[topic.name][stamp_ns]]

    def pose(self, attitude: tuple[float, ...], frame: str = "inertial", at: float = 0.0) -> None:
        goal = PoseStamped()
        goal.header.frame_id = frame
        goal.header.stamp.sec = int(at)
        x, y, z, w = attitude
        goal.pose.orientation = Quaternion(x=x, y=y, z=z, w=w)
        self.give(GOAL_POSE, goal)

    def give(self, topic: Topic, message: Any) -> None:
        """Publish, and wait until the node has looked at it."""
        before = self.seen()
        self.publishers[topic].publish(message)
        self.until(lambda: self.seen() > before)

    def changes(self, count: int) -> list[dict[str, Any]]:
        """What was told on `parameters/changed`, so many times."""
        self.until(lambda: len(self._changes) >= count)
        return [{e.key: json.loads(e.value) for e in each.values} for each in self._changes]

    def seen(self) -> int:
        """How many orders the node has taken or refused."""
        return self.node._desk._book.in_flight + self.node.health.refused.total()

    def hold(self) -> Any:
        return self.call(Trigger, "reference_generator/hold", Trigger.Request())

    def hears(self, text: str) -> DiagnosticStatus:
        def found() -> list[DiagnosticStatus]:
            return [each for each in self.told if text in each.message]

        self.until(found)
        return found()[0]


@pytest.fixture
def pilot(ros_domain: int) -> Iterator[Pilot]:
    with living(ReferenceGenerator, "mode:=goal", rules=["__ns:=/craft"]) as node:
        made = Pilot(node)
        yield made
        made.close()


def flown(orders: list[Any], times: list[float], profiles: Any = ()) -> list[list[float]]:
    part = guided(orders, profiles)
    return [list(part.step(nanoseconds(t), START)) for t in times]


def test_goals_and_hold_act_from_the_next_state_as_in_process(pilot: Pilot) -> None:
    times = [*map(float, range(30)), 29.5]
    given = [pilot.state(t) for t in times[:2]]
    pilot.pose(GOAL)
    given += [pilot.state(t) for t in times[2:8]]
    assert pilot.hold().success
    pilot.pose(NEAR, "nadir", at=20.0)
    given += [pilot.state(t) for t in times[8:]]
    orders = [
        goal_order(nanoseconds(2.0), "inertial", GOAL),
        hold_order(nanoseconds(8.0)),
        goal_order(nanoseconds(20.0), "nadir", NEAR),
    ]
    assert given == flown(orders, times)
    # Each change tells what was yet to come, else a stream of goals would be told again and again.
    assert [each["goals.times"] for each in pilot.changes(2)] == [[2.0], [8.0, 20.0]]
    # Where a goal that moves has come to is told once a second, of others nothing is told again.
    told_at = [0.0, 2.0, 7.0, 8.0, *times[20:30]]
    pilot.until(lambda: len(pilot.told_at) >= len(told_at))
    status = pilot.hears("order 3 is followed: nadir frame")
    # What was asked is told once when it acts; before, if that is later.
    told = [entry.value for each in pilot.told for entry in each.values if entry.key == ASKED]
    assert [asked.split()[0] for asked in told] == ["inertial", "nadir", "hold", "nadir"]
    assert status.level == DiagnosticStatus.OK
    assert {entry.key: entry.value for entry in status.values}["frame"] == "nadir"
    assert pilot.told_at == told_at


def trajectory(*timed: tuple[int, tuple[float, ...]]) -> MultiDOFJointTrajectory:
    """A timed profile: time [s] after its begin and attitude of each point, at rest in all."""
    message = MultiDOFJointTrajectory(joint_names=["body"])
    for seconds, (x, y, z, w) in timed:
        point = MultiDOFJointTrajectoryPoint(
            transforms=[Transform(rotation=Quaternion(x=x, y=y, z=z, w=w))], velocities=[Twist()]
        )
        point.time_from_start.sec = seconds
        message.points.append(point)
    return message


def test_timed_profile_by_topic(pilot: Pilot) -> None:
    pilot.state(0.0)
    pilot.give(GOAL_TRAJECTORY, trajectory((60, START), (110, NEAR)))
    times = [1.0 + 4.5 * k for k in range(26)]
    given = [pilot.state(t) for t in times]
    profile = points([61.0, 111.0], [START, NEAR], [[0.0] * 3] * 2, [None] * 2)
    orders = [profile_order(nanoseconds(1.0), 0)]
    assert given == flown(orders, [0.0, *times], [profile])[1:]
    assert given[-1] == pytest.approx([*NEAR, *[0.0] * 6])
    # What was flown is told as the schedule that flies it again.
    schedule = schedule_of(Orders(np.concatenate(orders), np.array([profile])))
    assert pilot.changes(1) == [schedule]


def test_of_a_stream_of_timed_profiles_only_those_of_orders_that_are_kept_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The reference became slower with each, for as long as the run went on."""
    monkeypatch.setattr("ppc_attitude.science.guidance.orders._MOST", 2)
    ends = [(0.0, 0.02 * k, 0.0, math.sqrt(1.0 - (0.02 * k) ** 2)) for k in range(1, 6)]
    times = [10.0 * k for k in range(len(ends))]
    orders = [profile_order(nanoseconds(t), k) for k, t in enumerate(times)]
    profiles = [
        points([t + 60.0, t + 110.0], [end, START], [[0.0] * 3] * 2, [None] * 2)
        for t, end in zip(times, ends, strict=True)
    ]
    schedule = schedule_of(Orders(orders[0], np.array(profiles[:1])))
    scheduled = [f"{name}:={value}" for name, value in schedule.items()]
    with living(ReferenceGenerator, "mode:=goal", *scheduled) as node:

        def motion(t: float) -> list[float]:
            told = node.compute(nanoseconds(t), {ATTITUDE.column: START})
            return [x for topic in REFERENCE for x in told[topic.column]]

        given = [motion(0.0)]
        for t, end in zip(times[1:], ends[1:], strict=True):
            node._desk._on_trajectory(trajectory((60, end), (110, START)))
            given.append(motion(t))
        kept = node.chain.parts[0].configuration[0]["profiles"]
        node.forget_orders()
        node.arm()
        again = [motion(t) for t in (0.0, 50.0)]
    assert kept == 2
    assert given == flown(orders, times, profiles)
    assert again == flown(orders[:1], [0.0, 50.0], profiles), "that of the schedule"


def test_bad_goals_are_refused_and_the_present_one_goes_on(
    pilot: Pilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    pilot.state(0.0)
    pilot.pose(GOAL)
    pilot.state(1.0)
    nan = float("nan")
    for attitude, frame, at, reason in (
        ((1.0, 1.0, 0.0, 0.0), "inertial", 0.0, "has norm 1.41421"),
        ((nan, 0.0, 0.0, 1.0), "inertial", 0.0, "has norm nan"),
        (GOAL, "moon", 0.0, "frame of a goal = 'moon'; allowed: inertial, nadir, ground, sun"),
        (GOAL, "sun", 1.7e9, "stamp = 1.7e+09 s; allowed: 0 to 1e+08, in simulated time"),
    ):
        pilot.pose(attitude, frame, at)
        assert pilot.hears(reason).level == DiagnosticStatus.WARN
    empty = MultiDOFJointTrajectoryPoint()
    one = MultiDOFJointTrajectoryPoint(transforms=[Transform()])
    soon = MultiDOFJointTrajectoryPoint(transforms=[Transform()])
    soon.time_from_start.nanosec = 1
    turning = MultiDOFJointTrajectoryPoint(transforms=[Transform()])
    turning.accelerations = [Twist(angular=Vector3(x=1.0))]
    turning.time_from_start.sec = 60
    twice = MultiDOFJointTrajectoryPoint(transforms=[Transform()], accelerations=[Twist()] * 2)
    for joints, body, reason in (
        (["wing"], [one, one], "joint_names = ['wing']; allowed: ['body']"),
        (["body"], [one], "a trajectory of 1 points; allowed: 2 to 40"),
        (["body"], [one, one], "times of the points are [0.0, 0.0]; allowed: finite and"),
        (["body"], [one, soon], "times of the points are [100000000.0, 100000000.0]; allowed"),
        (["body"], [one, turning], "point 1 is in motion: "),
        (["body"], [empty, one], "point 0 has 0 transforms; allowed: 1"),
        (["body"], [twice, one], "point 0: accelerations has 2 entries; allowed: up to 1"),
    ):
        pilot.give(GOAL_TRAJECTORY, MultiDOFJointTrajectory(joint_names=joints, points=body))
        assert pilot.hears(f"refused goal_trajectory: {reason}").level == DiagnosticStatus.WARN
    elsewhere = MultiDOFJointTrajectory(joint_names=["body"], points=[one, one])
    elsewhere.header.frame_id = "nadir"
    pilot.give(GOAL_TRAJECTORY, elsewhere)
    pilot.hears("refused goal_trajectory: frame_id = 'nadir'; allowed: 'inertial'")
    monkeypatch.setattr("ppc_attitude.science.guidance.orders._MOST", 0)
    refused = pilot.hold()
    assert not refused.success
    assert refused.message == "0 orders wait; allowed: no more at a time"
    orders = [goal_order(nanoseconds(1.0), "inertial", GOAL)]
    assert pilot.state(6.0) == flown(orders, [0.0, 1.0, 6.0])[-1]


def test_limits_that_change_in_flight_leave_the_goals(
    pilot: Pilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    pilot.state(0.0)
    pilot.pose(GOAL)
    pilot.state(1.0)
    assert pilot.node.set_parameters([Parameter("guidance.max_rate", value=1e-3)])[0].successful
    assert (
        pilot.state(6.0) == flown([goal_order(nanoseconds(1.0), "inertial", GOAL)], [1.0, 6.0])[-1]
    )
    (record,) = pilot.node.chain.parts[0].configuration
    assert (record["limits"]["max_rate"], record["orders"]) == (1e-3, 1)
    monkeypatch.setattr(GuidanceDesk, "concern", "turns too fast")
    assert pilot.node.status().summary == "the desired motion turns too fast"


def test_goto_prints_the_answer_that_is_its_own(
    pilot: Pilot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever moves is told every second, and others give goals; that is no answer."""
    monkeypatch.setattr("ppc_attitude.science.guidance.orders._MOST", 3)  # of those that are kept
    pilot.state(0.0)
    pilot.pose(NEAR, "nadir")
    sender = Node("goto", namespace="/craft")
    times = itertools.count(1)
    with ThreadPoolExecutor(1) as pool:

        def answer(attitude: tuple[float, ...], before: int, at: float = 0.0) -> Answer:
            future = pool.submit(go_to, sender, attitude, "inertial", at)
            pilot.until(lambda: pilot.seen() > before)
            pilot.pose(NEAR)
            pilot.pose((0.0, 0.0, 2.0, 0.0))
            while not future.done():
                pilot.state(float(next(times)))
            return future.result()

        followed = answer(GOAL, pilot.seen())
        refused = answer((2.0, 0.0, 0.0, 0.0), pilot.seen())
        late = answer((0.0, 0.0, 0.6, 0.8), pilot.seen(), at=1.0)
        early = answer((0.0, 0.6, 0.0, 0.8), pilot.seen(), at=1e6)
    sender.destroy_node()
    assert followed.followed
    assert followed.text.startswith("order 3 is followed: inertial frame")
    assert not refused.followed
    assert "refused goal_pose: attitude of a goal = [2.0" in refused.text
    assert "is followed: inertial frame" in late.text  # its time has passed: it acts at once
    assert early == Answer("goal_pose acts from t = 1000000.000000 s on", followed=True)


def test_a_goal_that_is_asked_for_again_before_it_acts_is_one(pilot: Pilot) -> None:
    """As by `goto`, which asks every two seconds, while the plant waits for another node."""
    pilot.state(0.0)
    book = pilot.node._desk._book
    pilot.pose(GOAL)
    again = PoseStamped()
    again.pose.orientation = Quaternion(x=GOAL[0], y=GOAL[1], z=GOAL[2], w=GOAL[3])
    pilot.publishers[GOAL_POSE].publish(again)
    pilot.pose(NEAR)
    assert book.in_flight == 2
    pilot.pose(NEAR, at=5.0)
    assert book.in_flight == 3, "that is another one"
    pilot.state(0.01)
    pilot.pose(NEAR)
    assert book.in_flight == 4, "the first one has acted"


def test_a_goal_before_the_first_attitude_is_answered_at_once(pilot: Pilot) -> None:
    """As of a craft that tumbles too fast for its star tracker; else `goto` would ask again."""
    for stamp_ns in (0, 10_000_000):
        pilot.send(ATTITUDE, stamp_ns, (0.0, 0.0, 0.0, 0.0))
        pilot.until(lambda stamp_ns=stamp_ns: stamp_ns in pilot.heard[REFERENCE_RATE.name])
    pilot.pose(GOAL)
    told = pilot.hears("goal_pose acts from the first attitude on")
    assert [each.value for each in told.values if each.key == ASKED] == ["inertial 0.6 0.0 0.0 0.8"]
    pilot.state(0.02)
    pilot.hears("order 1 is followed: inertial frame, turns by 73.74°")


def test_time_that_begins_again_forgets_the_goals(pilot: Pilot) -> None:
    pilot.state(0.0)
    pilot.pose(GOAL)
    pilot.state(4.0)
    assert any(pilot.state(8.0)[4:])
    for topic in REFERENCE:
        pilot.heard[topic.name].clear()
    assert pilot.state(0.0) == [*START, *[0.0] * 6]
    assert pilot.state(8.0) == [*START, *[0.0] * 6]
    assert [each["goals.times"] for each in pilot.changes(2)] == [[4.0], []]


def test_a_gap_of_the_states_forgets_no_goal(pilot: Pilot) -> None:
    """As hardware makes one that is silent for a while: its time has not begun again."""
    pilot.state(0.0)
    pilot.pose(GOAL)
    assert not any(pilot.state(0.1)[4:])
    for t in (60.0, 60.1):
        pilot.send(ATTITUDE, nanoseconds(t), START)
    pilot.state(60.2)  # the third that agrees on the other time
    assert any(pilot.state(64.0)[4:])
