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

"""A second plant on the same topic: found by what it publishes, and named."""

import time
from collections import deque

from rclpy.node import Node

from ppc_attitude.contract.cdr import header_stamp, seconds
from ppc_attitude.contract.topics import Topic
from ppc_attitude.nodes.messages import message_class
from ppc_attitude.nodes.qos import subscribed

_LOOK_EVERY = 1.0  # [s]
_NEW = 10.0  # [s] a publisher younger than this is the one that came second


class RivalWatch:
    """Look for another node that publishes on a topic of ours.

    A node that was killed stays in the ROS graph for a while. So a second publisher is only a
    reason to listen; a rival is who sends a stamp that we have not sent.

    Parameters
    ----------
    node : Node
        Who publishes.
    topic : Topic
        A stamped topic that nobody else may publish.

    Attributes
    ----------
    found : str
        What was found, in words; empty while there is no rival.
    """

    def __init__(self, node: Node, topic: Topic) -> None:
        self._node = node
        self._topic = topic
        self._since = self._looked = time.monotonic()
        self._sent: deque[int] = deque(maxlen=1000)
        self._listening = False
        self.found = ""

    @property
    def is_new(self) -> bool:
        """True if this node has only just begun to publish."""
        return time.monotonic() - self._since < _NEW

    def sent(self, stamp_ns: int) -> None:
        """Remember a stamp of our own."""
        self._sent.append(stamp_ns)

    def look(self) -> str:
        """Look once a second for a second publisher; return what was found so far."""
        now = time.monotonic()
        if now - self._looked >= _LOOK_EVERY and not self._listening:
            self._looked = now
            if self._node.count_publishers(self._topic.name) > 1:
                self._listening = True
                self._node.create_subscription(
                    message_class(self._topic.msgtype),
                    self._topic.name,
                    self._receive,
                    subscribed(self._topic),
                    raw=True,
                )
        return self.found

    def _receive(self, data: bytes) -> None:
        stamp = header_stamp(data, self._topic.msgtype)
        if stamp is None:
            return
        try:
            self._sent.remove(stamp)  # each of ours comes back once
        except ValueError:
            self.found = (
                f"another node publishes {self._topic.name}: a message of "
                f"{seconds(stamp):.6f} s is not from here"
            )
