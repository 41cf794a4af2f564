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

"""One goal: a node publishes on `goal_pose` and waits for the answer."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Pose, PoseStamped, Quaternion
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy
from rclpy.time import Time
from std_msgs.msg import Header

from ppc_attitude.contract.topics import GOAL_POSE, GUIDANCE_STATUS, REFERENCE
from ppc_attitude.nodes.guidance_desk import ASKED, pose_asked
from ppc_attitude.nodes.messages import publisher_of, subscribe
from ppc_attitude.nodes.publisher_watch import node_of
from ppc_attitude.nodes.visiting import await_answer
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kinds import REFERENCES
from ppc_attitude.science.references.goal import COMPONENT as GOAL
from ppc_attitude.science.stamps import nanoseconds


class Answer(NamedTuple):
    """The reference generator's answer to a goal."""

    text: str
    followed: bool


def go_to(node: Node, attitude: Sequence[float], frame: str, at: float) -> Answer:
    """Let a node send a goal, and wait for what becomes of it.

    The attitude is a unit quaternion x y z w, relative to the frame. The goal begins at a simulated
    time [s], 0: now; of a later one the answer is that it is taken.

    Raises
    ------
    ConfigurationError
        The stack's reference generator says that it has another mode, in which it takes no goals.
    TimeoutError
        Nobody listens, or nobody answers.
    """
    heard: list[DiagnosticStatus] = []
    stamp = Time(nanoseconds=nanoseconds(at)).to_msg()
    x, y, z, w = map(float, attitude)
    pose = Pose(orientation=Quaternion(x=x, y=y, z=z, w=w))
    goal = PoseStamped(header=Header(stamp=stamp, frame_id=frame), pose=pose)

    def hear(message: Any) -> None:
        heard.extend(status for status in message.status if _answers(status, pose_asked(goal)))

    answers = subscribe(node, GUIDANCE_STATUS, hear)
    publisher = publisher_of(node, GOAL_POSE)
    mode = _Mode(node)
    await_answer(
        node,
        lambda: (
            mode.takes_goals()
            and answers.get_publisher_count() > 0
            and _all_listen(node, publisher)
        ),
        f"nobody listens on {node.resolve_topic_name(GOAL_POSE.name)}: is a stack running in this "
        "domain, with mode: goal?",
        mode.ask,
    )
    heard.clear()
    await_answer(
        node,
        lambda: bool(heard),
        f"no answer on {GUIDANCE_STATUS.name}",
        lambda: publisher.publish(goal),
    )
    return Answer(heard[0].message, heard[0].level == DiagnosticStatus.OK)


class _Mode:
    """Whether the stack's reference generator takes goals, as far as it has told its mode."""

    def __init__(self, node: Node) -> None:
        self._client = node.create_client(GetParameters, f"{REFERENCE}/get_parameters")
        self._calls: list[Any] = []

    def ask(self) -> None:
        """Ask, if it is there."""
        if self._client.service_is_ready():
            request = GetParameters.Request(names=[REFERENCES.selector])
            self._calls.append(self._client.call_async(request))

    def takes_goals(self) -> bool:
        """True unless it has said otherwise.

        Raises
        ------
        ConfigurationError
            It has.
        """
        for call in self._calls:
            for value in call.result().values if call.done() else ():
                if value.string_value not in {GOAL.name, ""}:
                    told = f"{REFERENCE}: {REFERENCES.selector} = {value.string_value!r}"
                    raise ConfigurationError(f"{told}; allowed: {GOAL.name!r}, for goals")
        return True


def _all_listen(node: Node, publisher: Publisher) -> bool:
    """True if all who follow goals would hear one now: one of them answers, another may record."""
    following = [
        each
        for each in node.get_subscriptions_info_by_topic(publisher.topic_name)
        if each.qos_profile.durability == DurabilityPolicy.VOLATILE  # others hear no such publisher
    ]
    listeners = set(map(node_of, following))
    answerers = set(map(node_of, node.get_publishers_info_by_topic(GUIDANCE_STATUS.name)))
    return bool(listeners & answerers) and publisher.get_subscription_count() >= len(following)


def _answers(status: DiagnosticStatus, asked: str) -> bool:
    """True if a status tells what became of a goal, not of another order or of what moves."""
    return any(each.key == ASKED and asked in each.value.split("; ") for each in status.values)
