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

"""`/diagnostics` as users of diagnostic_updater expect it: names, levels, hardware, numbers."""

from collections.abc import Callable, Iterator

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from process_helpers import until
from rclpy.node import Node

from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.topics import ATTITUDE, DIAGNOSTICS_TOPIC
from ppc_attitude.nodes.executors import new_executor
from ppc_attitude.nodes.messages import message_class
from ppc_attitude.nodes.qos import published
from ppc_attitude.nodes.reference_generator import ReferenceGenerator
from ppc_attitude.runtime.health import StepCounter

SECOND = 1_000_000_000
UNIT = (0.0, 0.0, 0.0, 1.0)


class Bench:
    """A reference generator, a peer that sends it states, and what it says of itself."""

    def __init__(self, namespace: str) -> None:
        rclpy.init(args=["--ros-args", "-r", f"__ns:={namespace}"])
        self.node = ReferenceGenerator()
        self.peer = Node("peer")
        self.publisher = self.peer.create_publisher(
            message_class(ATTITUDE.msgtype), ATTITUDE.name, published(ATTITUDE)
        )
        self.said: list[DiagnosticStatus] = []
        self.stamps: list[int] = []
        self.peer.create_subscription(DiagnosticArray, DIAGNOSTICS_TOPIC.name, self.hear, 10)
        self.executor = new_executor()
        self.executor.add_node(self.node)
        self.executor.add_node(self.peer)
        self.until(
            lambda: (
                self.publisher.get_subscription_count() >= 1
                and self.node.count_subscribers(DIAGNOSTICS_TOPIC.name) >= 1
            )
        )

    def hear(self, message: DiagnosticArray) -> None:
        self.said += message.status
        self.stamps.append(message.header.stamp.sec * SECOND + message.header.stamp.nanosec)

    def until(self, condition: Callable[[], bool]) -> None:
        def spin() -> None:
            self.executor.spin_once(timeout_sec=0.02)
            self.node.wake()

        until(condition, "an answer", meanwhile=spin)

    def state(self, stamp_ns: int, attitude: tuple[float, ...] = UNIT) -> None:
        """Send a state and wait until it was judged."""
        judged = self.judged
        self.publisher.publish(Codec(ATTITUDE).encode(stamp_ns, attitude))
        self.until(lambda: self.judged != judged)

    @property
    def judged(self) -> tuple[int | None, int]:
        """Latest state that was accepted, and how many were refused."""
        return self.node.answers._guard.last, self.node.health.refused[ATTITUDE.name]

    def report(self) -> DiagnosticStatus:
        self.until(lambda: bool(self.said))
        return self.said.pop(0)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.peer.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    result = Bench(getattr(request, "param", "/"))
    yield result
    result.close()


def values(status: DiagnosticStatus) -> dict[str, str]:
    return {entry.key: entry.value for entry in status.values}


def test_a_running_node_says_so_once_a_second_with_its_rate(bench: Bench) -> None:
    for step in range(21):
        bench.state(step * SECOND // 10)
    bench.until(lambda: len(bench.said) >= 3)
    assert bench.stamps == [0, SECOND, 2 * SECOND]
    assert [status.level for status in bench.said] == [DiagnosticStatus.OK] * 3
    status = bench.said[-1]
    assert status.name == "reference_generator: status"
    assert status.hardware_id == "/reference_generator"
    assert status.message == "running"
    assert values(status)["measured rate [Hz]"] == "10"


@pytest.mark.parametrize("bench", ["/proposed"], indirect=True)
def test_two_craft_have_names_of_their_own(bench: Bench) -> None:
    bench.state(0)
    status = bench.report()
    assert status.name == "proposed/reference_generator: status"
    assert status.hardware_id == "/proposed/reference_generator"


def test_a_refusal_is_a_warning_once(bench: Bench) -> None:
    bench.state(0)
    assert bench.report().level == DiagnosticStatus.OK
    bench.state(0, (0.0, 0.0, 0.0, 2.0))
    bench.state(SECOND)
    warned = bench.report()
    assert warned.level == DiagnosticStatus.WARN
    assert "refused 1" in warned.message
    assert values(warned)["refused attitude"] == "1"
    bench.state(2 * SECOND)
    calm = bench.report()
    assert calm.level == DiagnosticStatus.OK
    assert values(calm)["refused attitude"] == "1"


def test_a_node_without_input_is_stale(bench: Bench) -> None:
    status = bench.report()
    assert status.level == DiagnosticStatus.STALE
    assert "waiting for attitude" in status.message
    assert values(status)["measured rate [Hz]"] == "0"


def test_repeated_steps_count_once() -> None:
    counter = StepCounter()
    for stamp in (0, 0, 500_000_000, 500_000_000, SECOND):
        counter.add(stamp)
    assert counter.rate() == 2.0
    assert counter.rate() == 0.0
    counter.add(3 * SECOND)
    assert counter.rate() == 0.5
