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

"""Ten thousand random messages into the four nodes of the loop, which then go on.

The nodes are the real ones; bytes go from one to the other in this process instead of over DDS,
and the wall clock is the test's.
"""

import math
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest
import rclpy
from hypothesis import given, settings
from hypothesis import strategies as st
from test_bad_messages import MAX_TORQUE, READERS

from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.declared import ATTITUDE_ERROR
from ppc_attitude.contract.topics import ATTITUDE, MSGTYPES, TORQUE_COMMAND, Topic
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.disturbance_injector import DisturbanceInjector
from ppc_attitude.nodes.messages import Inbox
from ppc_attitude.nodes.ppc_controller import PpcController
from ppc_attitude.nodes.reference_generator import ReferenceGenerator
from ppc_attitude.nodes.spacecraft_plant import SpacecraftPlant
from ppc_attitude.processes.exits import BROKEN
from ppc_attitude.runtime.stamps import RefusedError
from ppc_attitude.science.component import QUATERNION
from ppc_attitude.science.stamps import NANOSECONDS

EXAMPLES, MESSAGES = 500, 20
Message = tuple[Topic, bytes]


class Loop:
    """The nodes in lock-step, connected by queues; everything they send is checked."""

    def __init__(self) -> None:
        self.now = 0.0
        self._queue: deque[Message] = deque()
        rclpy.init(args=["--ros-args", "-p", "spacecraft_plant:lockstep:=true"])
        self.others = [
            self._node(kind) for kind in (ReferenceGenerator, PpcController, DisturbanceInjector)
        ]
        self.plant = self._node(SpacecraftPlant)

    def _node(self, kind: type[BaseNode]) -> Any:
        """A node with the clock of the loop, whose messages go to the queue."""
        own = {"now": staticmethod(lambda: self.now), "sender": staticmethod(self._sender)}
        return type(kind.__name__, (kind,), own)()

    def _sender(self, topic: Topic) -> Callable[[int, tuple[float, ...]], None]:
        encode = Codec(topic).encode

        def send(stamp_ns: int, values: tuple[float, ...]) -> None:
            assert all(map(math.isfinite, values)), (topic.name, values)
            # A law that begins anew without an attitude has no error: zeros.
            has_none = topic == ATTITUDE_ERROR and not any(values)
            if topic.msgtype == MSGTYPES[QUATERNION] and not has_none:
                assert math.hypot(*values) == pytest.approx(1.0, abs=1e-9)
            if topic is TORQUE_COMMAND:
                assert max(map(abs, values)) <= MAX_TORQUE
            self._queue.append((topic, encode(stamp_ns, values)))

        return send

    def subscriptions(self, topic: Topic) -> list[Any]:
        return [
            each
            for node in (*self.others, self.plant)
            for each in node.subscriptions
            if each.topic_name == f"/{topic.name}"
        ]

    def deliver(self, message: Message) -> None:
        topic, data = message
        for each in self.subscriptions(topic):
            each.callback(data)

    def goes_on(self, steps: int = 3) -> None:
        """Run until the plant has made some steps; it may take repeated states to be believed."""
        target = self.plant.pace.step + steps
        for _ in range(20):
            self.now += 0.25
            self.plant.wake()
            while self._queue and self.plant.pace.step < target and not self.plant.finished:
                self.deliver(self._queue.popleft())
            if self.plant.finished:
                self._replace_plant()
                return
            if self.plant.pace.step >= target:
                return
        raise AssertionError(f"no step: {self.plant.pace.waiting()}")

    def _replace_plant(self) -> None:
        """A torque that is allowed may spin the craft up until it is no craft; that is said."""
        assert self.plant.exit_code == BROKEN
        assert "diverged" in self.plant.failure
        self.plant.destroy_node()
        self.plant = self._node(SpacecraftPlant)
        self._queue.clear()

    def refusals(self) -> Counter[str]:
        return sum((node.health.refused for node in (*self.others, self.plant)), Counter())

    def close(self) -> None:
        for node in (*self.others, self.plant):
            node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def loop() -> Iterator[Loop]:
    result = Loop()
    yield result
    result.close()


ANY_NUMBER = st.floats() | st.sampled_from([0.0, 1e-3, -0.05, 1.0, 1e6, 1e308])
STAMPS = (
    st.integers(-(2**31) * NANOSECONDS, 2**31 * NANOSECONDS - 1)
    | st.integers(-5, 20 * 100).map(lambda step: step * 10_000_000)
    | st.sampled_from([0, 1, -1])
)


@st.composite
def messages(draw: st.DrawFn) -> tuple[Topic, bytes, bool]:
    """A topic, bytes that may be a message of it, and whether the stamp is to be the present."""
    topic = draw(st.sampled_from(list(READERS)))
    if draw(st.integers(0, 9)) == 0:
        return topic, draw(st.binary(max_size=120)), False
    values = draw(st.tuples(*[ANY_NUMBER] * topic.width))
    length = math.hypot(*values)
    if topic.msgtype == MSGTYPES[QUATERNION] and 0.0 < length < 1e300 and draw(st.booleans()):
        scale = draw(st.sampled_from([1.0, 0.9995, 1.0009, 1.01])) / length
        values = tuple(value * scale for value in values)
    frame = draw(st.sampled_from([topic.frame_id] * 4 + ["", "moon"]))
    data = Codec(replace(topic, frame_id=frame)).encode(draw(STAMPS), values)
    return topic, data, draw(st.booleans())


def at(data: bytes, stamp_ns: int) -> bytes:
    head = Codec(ATTITUDE).encode(stamp_ns, (0.0, 0.0, 0.0, 1.0))[4:12]
    return data[:4] + head + data[12:]


def impossible(topic: Topic, data: bytes) -> bool:
    try:
        Inbox(topic).read(data)
    except RefusedError:
        return True
    return False


@pytest.mark.ros
@pytest.mark.long
def test_random_messages_never_make_a_torque_wrong_or_end_the_loop(loop: Loop) -> None:
    loop.goes_on()
    sent = 0

    @settings(max_examples=EXAMPLES)
    @given(st.lists(messages(), min_size=MESSAGES, max_size=MESSAGES))
    def send(batch: list[tuple[Topic, bytes, bool]]) -> None:
        nonlocal sent
        for topic, data, present in batch:
            data = at(data, loop.plant.pace.stamp) if present and len(data) >= 12 else data
            before = loop.refusals()[topic.name]
            loop.deliver((topic, data))
            if impossible(topic, data):
                assert loop.refusals()[topic.name] == before + len(loop.subscriptions(topic))
            sent += 1
        loop.goes_on()

    send()
    assert sent >= EXAMPLES * MESSAGES
