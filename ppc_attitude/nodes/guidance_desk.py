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

"""Where the reference generator takes goals: two topics and a service in, one topic out."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, Quaternion
from numpy.typing import NDArray
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

from ppc_attitude.contract.topics import GOAL_POSE, GOAL_TRAJECTORY, GUIDANCE_STATUS, Topic
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.messages import diagnostics, publisher_of, subscribe
from ppc_attitude.runtime.health import OK, WARN, Status
from ppc_attitude.science.component import INERTIAL
from ppc_attitude.science.guidance.orders import (
    GOAL_ATTITUDES,
    GOAL_FRAMES,
    PROFILE,
    PROFILING,
    Make,
    OrderBook,
    Orders,
    goal_order,
    hold_order,
    profile_order,
    schedule_of,
    scheduled_orders,
)
from ppc_attitude.science.guidance.sight import warnings_of
from ppc_attitude.science.guidance.trajectory import points
from ppc_attitude.science.part import Part
from ppc_attitude.science.references.goal import configuration_of, facts
from ppc_attitude.science.stamps import LATEST, NANOSECONDS, instant, nanoseconds, seconds

ASKED = "asked"  # key of the orders that a status answers, by which a sender finds its answer
_BODY = "body"  # the joint of a trajectory


class GuidanceDesk:
    """Passes orders from messages and a service to the reference, and tells what becomes of them.

    The node has the topics and the service; the part runs its component `goal`.
    """

    def __init__(self, node: BaseNode, part: Part) -> None:
        self._node = node
        self._part = part
        self._scheduled = scheduled_orders(node.parameters.values)
        self._orders = self._scheduled
        self._kept: list[Any] = []  # what the reference's configuration refers to by address
        self._profiles = self._scheduled.profiles
        self._book = OrderBook(self._scheduled.listed)
        self._stamp = 0  # the latest instant [ns]
        self._awaited = ""  # name, in a status, of the last order that waits for the next instant
        self._told = -1  # number of the advice that was told last
        self._details: dict[str, Any] = {}  # that were told last
        self._look_again = 0  # [ns] when they may have changed
        self._publisher = publisher_of(node, GUIDANCE_STATUS)
        self._listen(GOAL_POSE, self._on_pose, pose_asked)
        self._listen(GOAL_TRAJECTORY, self._on_trajectory, lambda _: PROFILING)
        node.create_service(Trigger, "~/hold", self._on_hold)

    def _listen(
        self, topic: Topic, handle: Callable[[Any], None], name: Callable[[Any], str]
    ) -> None:
        """Pass on the messages of a topic; the answer to a refused one names what it asked for."""

        def receive(message: Any) -> None:
            try:
                handle(message)
            except ValueError as reason:
                self._node.refuse(topic.name, f"{topic.name}: {reason}")
                text = f"refused {topic.name}: {reason}"
                self._say(self._stamp, WARN, text, {ASKED: name(message)})

        subscribe(self._node, topic, receive)

    def before(self, stamp_ns: int) -> None:
        """Let the orders act that have come, before the step of an instant [ns]."""
        self._stamp, self._awaited = stamp_ns, ""
        orders = self._book.at(stamp_ns)
        if orders is None:
            return
        timed = orders["frame"] == PROFILE
        # The book forgets old orders: a stream of trajectories must not be kept for ever.
        kept, orders["profile"][timed] = np.unique(orders["profile"][timed], return_inverse=True)
        self._profiles = self._profiles[kept]
        self._orders = Orders(orders, self._profiles)
        self.configure()
        if self._book.in_flight:
            waiting = orders[orders["stamp_ns"] >= self._part.state[0]["open_ns"]]
            told = schedule_of(self._orders._replace(listed=waiting))
            self._node.tell_changes(stamp_ns, told)

    def configure(self) -> None:
        """Let the reference fly with the node's present parameters and all orders."""
        record, *self._kept = configuration_of(self._node.parameters.values, self._orders)
        self._part.hold(record)

    def after(self, stamp_ns: int) -> None:
        """Tell what became of the orders of an instant [ns], after its step.

        Also tell, once a second of simulated time, where a moving goal or cone is.
        """
        state = self._part.state[0]
        if not state["begun"] or (self._part.advices == self._told and stamp_ns < self._look_again):
            return
        self._look_again = (stamp_ns // NANOSECONDS + 1) * NANOSECONDS
        details = facts(seconds(stamp_ns), self._part.configuration[0], state)
        if self._part.advices == self._told and details == self._details:
            return
        listed = self._orders.listed  # old orders may be forgotten: count from the latest
        due = np.searchsorted(listed["stamp_ns"], stamp_ns, side="right")
        taken = listed[due - (details["order"] - self._details.get("order", 0)) : due]
        self._told, self._details = self._part.advices, details
        advice = self._part.advice
        told = {ASKED: self._asked(taken), **details} if taken.size else details
        self._say(stamp_ns, WARN if advice.warning else OK, advice.text, told)

    def _asked(self, taken: NDArray[Any]) -> str:
        schedule = schedule_of(Orders(taken, self._orders.profiles))
        attitudes = np.reshape(schedule[GOAL_ATTITUDES.name], (-1, 4))
        return "; ".join(map(asked, schedule[GOAL_FRAMES.name], attitudes))

    @property
    def concern(self) -> str:
        """The present warning; empty if there is none."""
        return " and ".join(warnings_of(self._part.state[0]["watch"]))

    def begin_again(self) -> bool:
        """Forget all orders in flight: time has begun again. Return whether there were any."""
        if in_flight := bool(self._book.in_flight):
            self._node.told |= schedule_of(self._scheduled)
        self._book.begin_again()
        self._profiles = self._scheduled.profiles
        return in_flight

    def tell_again(self) -> None:
        """Tell anew what becomes of the orders: the reference begins anew."""
        self._told, self._details, self._look_again = -1, {}, 0

    def _say(self, stamp_ns: int, level: bytes, text: str, details: Mapping[str, Any]) -> None:
        name = self._node.get_fully_qualified_name()
        status = Status(level, text, details)
        self._publisher.publish(diagnostics(stamp_ns, name, "guidance", status))

    def _accept(self, kind: str, make: Make, stamp_ns: int, name: str = "") -> str:
        """Take an order; its sender is told at once if it acts later, else when it acts."""
        when = self._book.accept(make, stamp_ns)
        blind = self._stamp > 0 and not self._part.state[0]["begun"]
        if blind and stamp_ns <= self._stamp:
            when = "from the first attitude on"
        self._node.mention(kind, f"{kind}: acts {when}")
        if stamp_ns > self._stamp or blind:
            self._say(self._stamp, OK, f"{kind} acts {when}", {ASKED: name})
        else:
            self._awaited = name
        return when

    def _on_pose(self, message: PoseStamped) -> None:
        frame, attitude = _goal_of(message)
        make = partial(goal_order, frame=frame, attitude=attitude)
        make(0)  # what is wrong with it is told at once
        stamp, name = _stamp_of(message.header.stamp), pose_asked(message)
        if stamp > self._stamp or name != self._awaited:  # else the same order has come again
            self._accept(GOAL_POSE.name, make, stamp, name)

    def _on_trajectory(self, message: MultiDOFJointTrajectory) -> None:
        if list(message.joint_names) != [_BODY]:
            raise ValueError(f"joint_names = {list(message.joint_names)}; allowed: ['{_BODY}']")
        if message.header.frame_id not in {INERTIAL, ""}:
            raise ValueError(f"frame_id = {message.header.frame_id!r}; allowed: '{INERTIAL}'")
        stamp = _stamp_of(message.header.stamp)
        attitudes, rates, accelerations, offsets = [], [], [], []
        for i, point in enumerate(message.points):
            if len(point.transforms) != 1:
                raise ValueError(f"point {i} has {len(point.transforms)} transforms; allowed: 1")
            attitudes.append(_numbers(point.transforms[0].rotation))
            rates.append(_angular(f"point {i}: velocities", point.velocities))
            accelerations.append(_angular(f"point {i}: accelerations", point.accelerations))
            offsets.append(point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec)

        def profile_from(begin: float) -> Any:
            times = [begin + offset for offset in offsets]
            return points(times, attitudes, rates, accelerations)

        def make(stamp_ns: int) -> NDArray[Any]:
            profile = profile_from(seconds(stamp or stamp_ns))
            self._profiles = np.append(self._profiles, profile)
            return profile_order(stamp_ns, self._profiles.size - 1)

        for begin in (0.0, LATEST):  # what is wrong with it is told at once
            profile_from(begin)  # at late times, points that are nanoseconds apart coincide
        self._accept(GOAL_TRAJECTORY.name, make, stamp, PROFILING)

    def _on_hold(self, request: Any, response: Any) -> Any:
        """Answer the service: brake, and stay where that ends."""
        try:
            told = f"holds {self._accept('~/hold', hold_order, 0)}"
        except ValueError as reason:
            return Trigger.Response(success=False, message=str(reason))
        return Trigger.Response(success=True, message=told)


def asked(frame: str, attitude: Iterable[float]) -> str:
    """How a status names a goal: its frame and its attitude x y z w."""
    return f"{frame} {' '.join(repr(float(x)) for x in attitude)}"


def pose_asked(message: PoseStamped) -> str:
    """How a status names the goal of a message."""
    return asked(*_goal_of(message))


def _goal_of(message: PoseStamped) -> tuple[str, list[float]]:
    return message.header.frame_id or INERTIAL, _numbers(message.pose.orientation)


def _numbers(q: Quaternion) -> list[float]:
    return [q.x, q.y, q.z, q.w]


def _angular(name: str, twists: Any) -> list[float] | None:
    """Angular part of the only twist; None if there is none."""
    if len(twists) > 1:
        raise ValueError(f"{name} has {len(twists)} entries; allowed: up to 1")
    return [twists[0].angular.x, twists[0].angular.y, twists[0].angular.z] if twists else None


def _stamp_of(stamp: Any) -> int:
    stamp_ns: int = stamp.sec * NANOSECONDS + stamp.nanosec
    if not 0 <= stamp_ns <= nanoseconds(LATEST):
        raise ValueError(
            f"stamp = {instant(seconds(stamp_ns))} s; allowed: 0 to {LATEST:g}, in simulated time: "
            "a tool that stamps by the wall clock needs use_sim_time:=true"
        )
    return stamp_ns
