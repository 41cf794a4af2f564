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

"""The latest message of each topic, kept as it came and decoded when somebody asks for it."""

from collections.abc import Callable, Sequence

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from ppc_attitude.contract.cdr import Sample
from ppc_attitude.contract.topics import Topic
from ppc_attitude.nodes.messages import Inbox, message_class

# An onlooker never holds up a publisher, and of what it missed it wants the newest only.
ONLOOKER = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE
)


class LatestSamples:
    """The latest sample of each of some topics.

    Parameters
    ----------
    node : Node
        Subscribes; its namespace is that of the topics.
    topics : sequence of Topic
        Stamped topics of the contract.
    """

    def __init__(self, node: Node, topics: Sequence[Topic]) -> None:
        self._inboxes = {topic: Inbox(topic) for topic in topics}
        self._raw: dict[Topic, bytes] = {}
        for topic in topics:
            node.create_subscription(
                message_class(topic.msgtype), topic.name, self._keeper(topic), ONLOOKER, raw=True
            )

    def _keeper(self, topic: Topic) -> Callable[[bytes], None]:
        def keep(data: bytes) -> None:
            self._raw[topic] = data

        return keep

    def __contains__(self, topic: Topic) -> bool:
        """True if a message of the topic has come."""
        return topic in self._raw

    def get(self, topic: Topic) -> Sample | None:
        """Latest sample of a topic; None if none has come.

        Raises
        ------
        RefusedError
            The message must not be used; says why.
        """
        data = self._raw.get(topic)
        return None if data is None else self._inboxes[topic].read(data)
