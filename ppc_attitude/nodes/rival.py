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

from ppc_attitude.contract.cdr import NANOSECONDS, seconds
from ppc_attitude.contract.topics import Topic
from ppc_attitude.nodes.messages import Inbox, RefusedError, message_class
from ppc_attitude.nodes.qos import subscribed

_LOOK_EVERY = 1.0  # [s]
_STAMPS = 10  # so many foreign ones that advance, each by less than this, make a rival
_LARGEST_STEP = NANOSECONDS
_HEARD = 5.0  # [s] after its last message a rival counts as gone
_NEW = 10.0  # [s] a plant that is older than this never gives way


class RivalWatch:
    """Look for another node that publishes on a topic of ours.

    A node that was killed stays in the ROS graph for a while. So a second publisher is only a
    reason to listen; a rival is who goes on sending stamps that we have not sent, and not who
    sends a bad message. Of two that have only just begun the one whose time is behind came second.

    Parameters
    ----------
    node : Node
        Who publishes.
    topic : Topic
        A stamped topic that nobody else may publish.

    """

    def __init__(self, node: Node, topic: Topic) -> None:
        self._node = node
        self._topic = topic
        self._since = self._looked = time.monotonic()
        self._sent: deque[int] = deque(maxlen=1000)
        self._inbox = Inbox(topic)
        self._listening = False
        self._foreign = -1
        self._count = 0
        self._behind = False
        self._found = ""
        self._found_at = 0.0

    @property
    def found(self) -> str:
        """What was found, in words; empty while there is no rival."""
        return self._found if time.monotonic() - self._found_at < _HEARD else ""

    @property
    def came_second(self) -> bool:
        """True if it is this node that has to give way."""
        return self._behind and time.monotonic() - self._since < _NEW

    def sent(self, stamp_ns: int) -> None:
        """Remember a stamp of our own."""
        self._sent.append(stamp_ns)

    def look(self) -> str:
        """Look once a second for a second publisher; return what was found."""
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
        try:
            stamp = self._inbox.read(data).stamp_ns
        except RefusedError:
            return  # every peer refuses it as well
        if stamp in self._sent:
            self._sent.remove(stamp)  # each of ours comes back once
            return
        goes_on = 0 < stamp - self._foreign <= _LARGEST_STEP
        self._foreign = stamp
        self._count = self._count + 1 if goes_on else 1
        if self._count >= _STAMPS:
            self._behind = not self._sent or stamp >= self._sent[-1]
            self._found_at = time.monotonic()
            self._found = (
                f"another node publishes {self._topic.name}: a message of "
                f"{seconds(stamp):.6f} s is not from here"
            )
