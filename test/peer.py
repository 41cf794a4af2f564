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

"""Peers of nodes: one that hears all of a stack, and one beside a node in this process."""

import time
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from process_helpers import PATIENCE, until
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from synthetic import SAMPLED

from ppc_attitude.contract.cdr import Codec, Sample
from ppc_attitude.contract.topics import APPLIED_TORQUE, DIAGNOSTICS_TOPIC, TORQUE_COMMAND, Topic
from ppc_attitude.nodes.messages import message_class, new_executor, published
from ppc_attitude.science.stamps import stamp_of

_ASK_AGAIN = 10.0  # [s]
_QOS = QoSProfile(
    depth=1000, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE
)


def call(node: Node, kind: Any, name: str, request: Any, wait: Callable[..., Any]) -> Any:
    """Answer of a service; `wait` is `until` for who lets the node work meanwhile."""
    client = node.create_client(kind, name)
    wait(client.service_is_ready, f"service {name}")
    begin, asked = time.monotonic(), list[Any]()

    def answer() -> Any:
        # A server that has not found the client within 0.1 s drops its answer: ask again.
        if time.monotonic() > len(asked) * _ASK_AGAIN + begin:
            asked.append(client.call_async(request))
        return next((future for future in asked if future.done()), None)

    future = wait(answer, f"answer of {name}")
    node.destroy_client(client)
    return future.result()


class Peer:
    """Talks to a stack in this test's domain."""

    def __init__(self, publishes: tuple[Topic, ...] = ()) -> None:
        self.node = Node("peer")
        self.heard: dict[str, list[Sample]] = defaultdict(list)
        self.health: dict[str, dict[str, str]] = {}
        self._own: set[bytes] = set()
        self._publishers = {topic: self._publisher(topic) for topic in publishes}
        for topic in SAMPLED:
            self.listen(topic)
        self.node.create_subscription(DiagnosticArray, DIAGNOSTICS_TOPIC.name, self._on_health, 100)
        self._executor = new_executor()
        self._executor.add_node(self.node)

    def listen(self, topic: Topic) -> None:
        """Hear a topic that only some runs have."""
        self.node.create_subscription(
            message_class(topic.msgtype), topic.name, self._receiver(topic), _QOS, raw=True
        )

    def _publisher(self, topic: Topic) -> Any:
        return self.node.create_publisher(message_class(topic.msgtype), topic.name, _QOS)

    def _receiver(self, topic: Topic) -> Callable[[bytes], None]:
        decode, samples = Codec(topic).decode, self.heard[topic.name]

        def receive(data: bytes) -> None:
            if data not in self._own:
                samples.append(decode(data))

        return receive

    def _on_health(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.health[status.hardware_id.lstrip("/")] = {
                "level": str(status.level[0]),
                "message": status.message,
                **{entry.key: entry.value for entry in status.values},
            }

    def send(self, topic: Topic, data: bytes) -> None:
        self._own.add(data)
        self._publishers[topic].publish(data)

    def matched(self, topic: Topic, readers: Collection[str]) -> None:
        """Wait until these nodes, and whoever else reads a topic, hear what it publishes there."""
        publisher = self._publishers[topic]

        def all_hear() -> bool:
            ends = self.node.get_subscriptions_info_by_topic(publisher.topic_name)
            known = {end.node_name for end in ends}
            return known.issuperset(readers) and publisher.get_subscription_count() >= len(ends)

        self.until(all_hear, f"readers of {topic.name}")

    def until(self, condition: Callable[[], Any], what: str) -> Any:
        """Take messages until a condition holds."""
        end = time.monotonic() + PATIENCE
        while not (result := condition()):
            assert time.monotonic() < end, f"waited in vain for {what}; health: {self.health}"
            self._executor.spin_once(timeout_sec=0.02)
        return result

    def spin(self) -> None:
        self._executor.spin_once(timeout_sec=0.0)

    def time(self, topic: Topic) -> float:
        """Stamp [s] of the latest message that was heard; -1 if none was."""
        samples = self.heard[topic.name]
        return samples[-1].stamp_ns * 1e-9 if samples else -1.0

    def forget(self) -> None:
        """Forget what was heard, before time begins again."""
        for samples in self.heard.values():
            samples.clear()

    def goes_on(self, seconds: float = 0.5) -> None:
        """Wait until the loop has advanced by so much: new states, and torques that answer them."""
        before = max(self.time(APPLIED_TORQUE), 0.0)
        self.until(
            lambda: (
                self.time(APPLIED_TORQUE) >= before + seconds
                and abs(self.time(TORQUE_COMMAND) - self.time(APPLIED_TORQUE)) < 0.2
            ),
            "the loop to go on",
        )

    def hears(self, node: str, text: str) -> None:
        """Wait until a node's diagnostics say something."""
        self.until(lambda: text in self.health.get(node, {}).get("message", ""), f"{node}: {text}")

    def call(self, kind: Any, name: str, request: Any) -> Any:
        return call(self.node, kind, name, request, self.until)

    def set_parameter(self, node: str, name: str, value: Any) -> Any:
        parameter = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        (result,) = self.call(SetParameters, f"/{node}/set_parameters", request).results
        return result

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()


@contextmanager
def node_apart(name: str) -> Iterator[Node]:
    """Give a node of another context than that of nodes and commands in this process."""
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = Node(name, context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


@contextmanager
def peer(*publishes: Topic) -> Iterator[Peer]:
    """Give a peer in this test's domain."""
    rclpy.init(args=[])
    try:
        result = Peer(publishes)
        try:
            yield result
        finally:
            result.close()
    finally:
        rclpy.try_shutdown()


def last_torque(stack: Peer) -> float:
    """Largest component of the torque that acted last."""
    return max(map(abs, stack.heard[APPLIED_TORQUE.name][-1].values))


@contextmanager
def living(kind: Callable[[], Any], *parameters: str, rules: Sequence[str] = ()) -> Iterator[Any]:
    """Give a node in this process, with parameters ``NAME:=VALUE`` and rules ``NAME:=OTHER``."""
    given = [*(("-p", each) for each in parameters), *(("-r", each) for each in rules)]
    rclpy.init(args=["--ros-args", *chain(*given)])
    try:
        node = kind()
        yield node
        node.destroy_node()
    finally:
        rclpy.try_shutdown()


class Beside:
    """A node in this process (see `living`), and a peer in its namespace that feeds it by hand."""

    def __init__(self, node: Any, *feeds: Topic) -> None:
        self.node = node
        self.peer = Node("peer", namespace=node.get_namespace())
        self.publishers = {
            topic: self.peer.create_publisher(
                message_class(topic.msgtype), topic.name, published(topic)
            )
            for topic in feeds
        }
        self.executor = node.new_executor()
        for each in (node, self.peer):
            self.executor.add_node(each)

    def meet(self) -> None:
        """Wait until the node hears what it is fed; the peer subscribes before."""
        self.until(lambda: all(p.get_subscription_count() for p in self.publishers.values()))

    def spin(self) -> None:
        self.executor.spin_once(timeout_sec=0.01)

    def until(self, condition: Callable[[], Any], what: str = "an answer") -> Any:
        return until(condition, what, meanwhile=self.spin)

    def call(self, kind: Any, name: str, request: Any) -> Any:
        return call(self.peer, kind, name, request, self.until)

    def send(self, topic: Topic, stamp_ns: int, values: Sequence[float]) -> None:
        self.publishers[topic].publish(Codec(topic).encode(stamp_ns, values))

    def close(self) -> None:
        self.executor.shutdown()
        self.node.close()
        self.peer.destroy_node()


class Patient(Beside):
    """A node in this process, fed by hand, and what it says on `/diagnostics`."""

    def __init__(self, node: Any, needs: dict[Topic, tuple[float, ...]], *feeds: Topic) -> None:
        self.passed = 0.0  # [s] of silence that nobody had to wait for
        node.now = lambda: time.monotonic() + self.passed
        self.needs = needs
        self.said: list[DiagnosticStatus] = []
        self.stamps: list[float] = []  # [s]
        super().__init__(node, *needs, *feeds)
        self.peer.create_subscription(DiagnosticArray, DIAGNOSTICS_TOPIC.name, self._hear, 100)
        self.meet()
        self.until(self._is_heard)

    def _hear(self, message: DiagnosticArray) -> None:
        self.said += message.status
        self.stamps.append(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)

    def _is_heard(self) -> bool:
        """True once a report has come; a node of which nothing is heard makes one by and by."""
        self.passed += 0.1
        return bool(self.said)

    def spin(self) -> None:
        super().spin()
        if not self.node.finished:
            self.node.wake()

    def give(self, values: dict[Topic, tuple[float, ...]], step: int = 0) -> None:
        for topic, numbers in values.items():
            self.send(topic, stamp_of(step, 100.0), numbers)

    def feed(self, step: int = 0, **changed: tuple[float, ...]) -> None:
        """Give the node all that it needs, some of it other than usual."""
        self.give({t: changed.get(t.column, v) for t, v in self.needs.items()}, step)

    def starve(self) -> None:
        """Let a silence pass, without waiting for it."""
        self.passed += 10.0
        self.said.clear()

    def says(self, level: bytes, text: str = "") -> dict[str, str]:
        """Wait for a report of this level with this text; return its values."""

        def found() -> list[DiagnosticStatus]:
            return [each for each in self.said if each.level == level and text in each.message]

        self.until(lambda: bool(found()))
        status = found()[0]
        name = self.node.get_fully_qualified_name()
        assert status.name == f"{name.lstrip('/')}: status"
        assert status.hardware_id == name
        return {entry.key: entry.value for entry in status.values}
