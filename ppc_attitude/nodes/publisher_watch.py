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

"""Whether another node publishes what this one does: seen in the graph, proved by its messages."""

from collections.abc import Hashable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ppc_attitude.contract.topics import Topic
from ppc_attitude.nodes.messages import Inbox, Take, message_class, recorded, take_gathered
from ppc_attitude.runtime.publishers import Publishers
from ppc_attitude.runtime.stamps import RefusedError

_LOOK_EVERY = 1.0  # [s]
_UNKNOWN = ("_NODE_NAME_UNKNOWN_", "_CREATED_BY_BARE_DDS_APP_")  # rmw's names for unknown nodes


def node_of(end: TopicEndpointInfo) -> str:
    """Full name of the node that a publisher or subscription belongs to."""
    return f"{end.node_namespace.rstrip('/')}/{end.node_name}"


def publishing_nodes(node: Node, topic: str) -> dict[Hashable, str]:
    """Full name of the node of each publisher of a topic; empty if the graph does not know it."""
    return {
        bytes(end.endpoint_gid): "" if end.node_name in _UNKNOWN else node_of(end)
        for end in node.get_publishers_info_by_topic(topic)
    }


class PublisherWatch:
    """Look once a second for others that publish on the topics of a node that begins now.

    Attributes
    ----------
    found : str
        Who else publishes what this node does; empty if nobody does.
    gives_way : bool
        True if the node is the newer one, and all who listen have had time to hear both.
    """

    def __init__(self, node: Node, now: float) -> None:
        self._node = node
        self._since = self._looked = now
        self._topics: dict[str, Topic] = {}
        self._ear: Node | None = None
        self._heard: dict[str, tuple[Any, Publishers]] = {}  # subscription, and its publishers
        self.found = ""
        self.gives_way = False
        self._shared: dict[str, Publishers] = {}

    def add(self, topic: Topic, name: str) -> None:
        """Watch a topic, given with its full name."""
        self._topics[name] = topic

    def add_shared(self, name: str) -> None:
        """Warn once if others publish a topic, given with its full name, that is no craft's own.

        Its messages prove nothing: they are few, or another craft rightly sends them, too.
        """
        self._shared[name] = Publishers()

    def look(self, now: float) -> None:
        """Look if it is time."""
        if now - self._looked < _LOOK_EVERY:
            return
        self._looked = now
        self._look_for_company(now)
        for name, topic in self._topics.items():
            if name not in self._heard and self._node.count_publishers(name) > 1:
                self._listen(name, topic)
        self.found = ""
        for name, (subscription, publishers) in self._heard.items():
            publishers.see(publishing_nodes(self._node, name), now)
            take_gathered(subscription)
            if publishers.lasts(now):
                found = f"another node publishes {self._topics[name].name}: {publishers.nodes}"
                self.found = self.found or found
                self.gives_way |= publishers.gives_way(self._since, now)

    def _look_for_company(self, now: float) -> None:
        for name, publishers in tuple(self._shared.items()):
            publishers.see(publishing_nodes(self._node, name), now)
            if publishers.stay:
                told = f"several nodes publish {name}, and every reader hears all of them"
                self._node.get_logger().warning(f"{told}: {publishers.nodes}")
                del self._shared[name]

    def _listen(self, name: str, topic: Topic) -> None:
        if self._ear is None:
            self._ear = Node(
                f"_{self._node.get_name()}_ear",
                namespace=self._node.get_namespace(),
                context=self._node.context,
                use_global_arguments=False,
                enable_rosout=False,
                start_parameter_services=False,
            )
        inbox, publishers = Inbox(topic), Publishers()

        def hear(data: bytes, about: Mapping[str, Any]) -> None:
            try:
                stamp_ns = inbox.read(data).stamp_ns
            except RefusedError:
                stamp_ns = -1  # every peer refuses it as well
            publishers.hear(about["publication_sequence_number"], stamp_ns, self._looked)

        # The recorder's queue holds all that comes between two looks.
        kind, profile = message_class(topic.msgtype), recorded(topic)
        take: Take = hear
        subscription = self._ear.create_subscription(kind, name, take, profile, raw=True)
        self._heard[name] = subscription, publishers

    def close(self) -> None:
        """Stop listening."""
        if self._ear is not None:
            self._ear.destroy_node()
