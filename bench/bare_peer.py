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

"""One process of the bare step: it takes, it sends, it computes nothing.

``python -m bench.bare_peer ROLE``: `plant SECONDS ANSWERS STATES`, `answer INPUTS
OUTPUTS` or `listen TOPICS`; topics are separated by commas. Everything that costs time on the way
is what the real nodes use: executor, QoS, raw CDR bytes of the contract's messages.
"""

import sys
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TypeVar

import rclpy
import rclpy.utilities
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from ppc_attitude.contract.cdr import Codec, encode_clock, header_stamp
from ppc_attitude.contract.declared import BY_NAME
from ppc_attitude.contract.topics import CLOCK_TOPIC, Topic
from ppc_attitude.nodes.discovery import tune_transport
from ppc_attitude.nodes.messages import PEER, new_executor, publisher_of, recorded, subscribe
from ppc_attitude.nodes.running import stop_requests
from ppc_attitude.processes.leaving import leaving
from ppc_attitude.science.component import QUATERNION

_REPEAT = 0.2  # [s] an unanswered state is sent again after this, as peers are discovered
_UNIT = (0.0, 0.0, 0.0, 1.0)
_Peer = TypeVar("_Peer", bound="Peer")


class Peer(Node):
    """A node that spins until it is told to stop."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.finished = False

    def sender(self, topics: Collection[Topic]) -> Callable[[int], None]:
        """Return the function that publishes a message of a stamp [ns] on each of some topics.

        Its numbers are zeros, those of an attitude a unit quaternion.
        """
        each = [(publisher_of(self, topic).publish, _encoder(topic)) for topic in topics]

        def send(stamp_ns: int) -> None:
            for publish, encode in each:
                publish(encode(stamp_ns))

        return send

    def taker(self, topic: Topic, take: Callable[[bytes], None], recording: bool = False) -> None:
        """Call `take` with the bytes of every message of a topic."""
        qos = recorded(topic) if recording else PEER
        subscribe(self, topic, take, qos, raw=True)

    def act_on(self, topics: Collection[Topic], act: Callable[[int], None]) -> None:
        """Call `act` with the stamp [ns] with which all of some topics have come."""
        came = dict.fromkeys((topic.name for topic in topics), -1)

        def receiver(topic: Topic) -> Callable[[bytes], None]:
            def receive(data: bytes) -> None:
                stamp = header_stamp(data, topic.msgtype) or 0
                came[topic.name] = stamp
                if all(other == stamp for other in came.values()):
                    act(stamp)

            return receive

        for topic in topics:
            self.taker(topic, receiver(topic))

    def wake(self) -> float:
        """Return the longest wait [s] for a message."""
        return 0.1


class Plant(Peer):
    """Sends a state when all answers to the last one are there; prints steps a second."""

    def __init__(self, seconds: float, answers: list[Topic], outputs: list[Topic]) -> None:
        super().__init__("plant")
        self._send = self.sender(outputs)
        self._seconds = seconds
        self._step = 0
        self._first = 0
        self._begin = self._sent = 0.0
        self.act_on(answers, self._advance)

    def _advance(self, step: int) -> None:
        if step != self._step:
            return
        self._step += 1
        now = time.perf_counter()
        if not self._begin:  # every peer has been discovered
            self._begin, self._first = now, self._step
        elif now - self._begin >= self._seconds:
            print((self._step - self._first) / (now - self._begin), flush=True)
            self.finished = True
            return
        self._publish()

    def _publish(self) -> None:
        self._sent = time.monotonic()
        self._send(self._step)

    def wake(self) -> float:
        """Send a state that nobody has answered once more."""
        if time.monotonic() - self._sent > _REPEAT:
            self._publish()
        return super().wake()


def _encoder(topic: Topic) -> Callable[[int], bytes]:
    if topic == CLOCK_TOPIC:
        return encode_clock
    values = _UNIT if topic.form == QUATERNION else (0.0,) * topic.width
    return partial(Codec(topic).encode, values=values)


def make(role: str, arguments: list[str]) -> Peer:
    """Make the node of a role."""
    if role == "plant":
        return Plant(float(arguments[0]), _topics(arguments[1]), _topics(arguments[2]))
    topics, *outputs = map(_topics, arguments)
    if role == "answer":
        node = Peer(f"answer_{outputs[0][0].column}")
        node.act_on(topics, node.sender(outputs[0]))
        return node
    node = Peer("listen")  # takes messages as the recorder does
    for topic in topics:
        node.taker(topic, lambda data: None, recording=True)
    return node


def _topics(names: str) -> list[Topic]:
    return [BY_NAME[name] for name in names.split(",")]


@contextmanager
def spinning(make_node: Callable[[], _Peer]) -> Iterator[tuple[_Peer, Executor]]:
    """Give a node and who spins it; the middleware lets it go in time, or never does."""
    tune_transport()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node, executor = make_node(), new_executor()
    executor.add_node(node)
    yield node, executor
    with leaving(0):
        executor.shutdown()  # else it uses what it waits for until it is destroyed itself
        node.destroy_node()
        rclpy.utilities.try_shutdown()


def main() -> None:
    """Run one process of the bare step."""
    stop = stop_requests()
    with spinning(lambda: make(sys.argv[1], sys.argv[2:])) as (node, executor):
        while not (stop or node.finished):
            executor.spin_once(timeout_sec=node.wake())


if __name__ == "__main__":
    main()
