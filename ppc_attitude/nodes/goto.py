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

    The attitude q_goal is a unit quaternion x y z w: q_d = q_frame ⊗ q_goal. The goal begins at the
    simulated time `at` [s]; 0 means now. If it begins later, the answer says that it is accepted.

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
    modes: list[str] = []  # as the generator tells them; empty where it has no such parameter
    client = node.create_client(GetParameters, f"{REFERENCE}/get_parameters")

    def ask_mode() -> None:
        if client.service_is_ready():
            called = client.call_async(GetParameters.Request(names=[REFERENCES.selector]))
            called.add_done_callback(
                lambda told: modes.extend(each.string_value for each in told.result().values)
            )

    def can_go() -> bool:
        if others := set(modes) - {GOAL.name, ""}:
            raise ConfigurationError(
                f"{REFERENCE}: {REFERENCES.selector} = {others.pop()!r}; allowed: {GOAL.name!r}, "
                "which takes goals"
            )
        return answers.get_publisher_count() > 0 and _all_listen(node, publisher)

    await_answer(
        node,
        can_go,
        f"no node listens on {node.resolve_topic_name(GOAL_POSE.name)}: a stack must run there, "
        f"with {REFERENCES.selector} = {GOAL.name}",
        ask_mode,
    )
    heard.clear()
    await_answer(
        node,
        lambda: bool(heard),
        f"no answer came on {node.resolve_topic_name(GUIDANCE_STATUS.name)}",
        lambda: publisher.publish(goal),
    )
    return Answer(heard[0].message, heard[0].level == DiagnosticStatus.OK)


def _all_listen(node: Node, publisher: Publisher) -> bool:
    """True if every reader of goals would hear one now: the generator, and a recorder."""
    following = [
        each
        for each in node.get_subscriptions_info_by_topic(publisher.topic_name)
        if each.qos_profile.durability == DurabilityPolicy.VOLATILE  # others hear no such publisher
    ]
    return publisher.get_subscription_count() >= len(following) > 0


def _answers(status: DiagnosticStatus, asked: str) -> bool:
    """True if a status tells what became of a goal, not of another order or of what moves."""
    return any(each.key == ASKED and asked in each.value.split("; ") for each in status.values)
