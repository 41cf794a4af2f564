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

"""The plant on the wall clock, in this process with a clock of the test's own: pace and safety."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from random import Random

import pytest
import rclpy

from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.topics import (
    APPLIED_TORQUE,
    ATTITUDE,
    DISTURBANCE,
    TORQUE_COMMAND,
    Topic,
)
from ppc_attitude.nodes.base import EXIT_BROKEN, WARN, BaseNode
from ppc_attitude.nodes.spacecraft_plant import SpacecraftPlant

PERIOD = 0.01  # [s]
TORQUE = (0.01, -0.02, 0.03)


class Bench:
    """A free-running plant that is woken when the test says so."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        self.sent: dict[str, list[tuple[int, tuple[float, ...]]]] = {}
        monkeypatch.setattr(time, "monotonic", lambda: self.now)
        monkeypatch.setattr(BaseNode, "sender", self._sender)
        rclpy.init(args=[])
        self.plant = SpacecraftPlant()
        self.plant.wake()
        self.begin = self.now

    def _sender(self, topic: Topic) -> Callable[[int, Sequence[float]], None]:
        sent = self.sent.setdefault(topic.name, [])
        return lambda stamp_ns, values: sent.append((stamp_ns, tuple(values)))

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.sent[ATTITUDE.name][-1][0] * 1e-9

    @property
    def acting(self) -> tuple[float, ...]:
        """Torque that the plant last said it applied."""
        return self.sent[APPLIED_TORQUE.name][-1][1]

    def passes(self, seconds: float) -> None:
        """Let wall time pass, and wake the plant as often as it asks for."""
        self.now += seconds
        while self.plant.wake() <= 0.0:
            pass

    def runs(self, seconds: float) -> None:
        """Let wall time pass without a hitch."""
        for _ in range(round(seconds / PERIOD)):
            self.passes(PERIOD)

    def give(self, topic: Topic, values: tuple[float, ...]) -> None:
        """Answer the latest state."""
        stamp = self.sent[ATTITUDE.name][-1][0]
        for subscription in self.plant.subscriptions:
            if subscription.topic_name == f"/{topic.name}":
                subscription.callback(Codec(topic).encode(stamp, values))

    def details(self) -> dict[str, object]:
        return dict(self.plant.status()[2])


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    result = Bench(monkeypatch)
    yield result
    result.plant.destroy_node()
    rclpy.try_shutdown()


@pytest.mark.ros
def test_time_does_not_drift_from_the_wall_clock(bench: Bench) -> None:
    random = Random(0)
    for _ in range(5000):
        bench.passes(random.uniform(0.0, 1.9 * PERIOD))
        assert 0.0 <= bench.now - bench.begin - bench.time <= PERIOD + 1e-6
    assert bench.time > 40.0
    stamps = [stamp for stamp, _ in bench.sent[ATTITUDE.name]]
    assert stamps == [step * 10_000_000 for step in range(len(stamps))]


@pytest.mark.ros
def test_a_step_that_is_late_is_caught_up_and_counted(bench: Bench) -> None:
    bench.runs(0.1)
    assert bench.details()["overruns"] == 0
    bench.passes(0.2)
    assert bench.time == pytest.approx(0.3, abs=PERIOD)
    assert bench.details()["overruns"] > 0


@pytest.mark.ros
def test_a_long_pause_moves_the_time_base_and_leaves_no_gap(bench: Bench) -> None:
    bench.passes(0.1)
    bench.passes(30.0)
    assert bench.time < 0.7, "half a minute is not caught up"
    bench.passes(1.0)
    stamps = [stamp for stamp, _ in bench.sent[ATTITUDE.name]]
    assert stamps == [step * 10_000_000 for step in range(len(stamps))]


@pytest.mark.ros
def test_a_command_acts_a_sample_late_and_not_for_ever(bench: Bench) -> None:
    bench.passes(PERIOD)
    bench.give(TORQUE_COMMAND, TORQUE)
    given_at = bench.time
    while bench.acting != TORQUE:
        bench.passes(PERIOD)
    assert bench.sent[APPLIED_TORQUE.name][-1][0] * 1e-9 == pytest.approx(given_at + PERIOD)
    while bench.acting == TORQUE:
        bench.passes(PERIOD)
    assert bench.acting == (0.0, 0.0, 0.0)
    silent = bench.sent[APPLIED_TORQUE.name][-1][0] * 1e-9 - given_at
    assert silent == pytest.approx(0.5, abs=2.5 * PERIOD)
    level, message, _ = bench.plant.status()
    assert (level, message) == (WARN, f"no {TORQUE_COMMAND.name}: zero torque")

    bench.give(TORQUE_COMMAND, TORQUE)
    bench.passes(3 * PERIOD)
    assert bench.acting == TORQUE
    assert bench.plant.status()[1] == "running"


@pytest.mark.ros
def test_the_torque_of_a_silent_injector_does_not_act_for_ever(bench: Bench) -> None:
    bench.passes(PERIOD)
    bench.give(DISTURBANCE, (0.1, 0.0, 0.0))
    bench.runs(2.0)
    rate = bench.plant._omega
    assert rate[0] > 0.0
    assert DISTURBANCE.name in bench.plant.status()[1]
    bench.runs(1.0)
    assert math.hypot(*bench.plant._omega) == pytest.approx(math.hypot(*rate), rel=1e-2)


@pytest.mark.ros
@pytest.mark.parametrize("limit", [1e6, -1e6])
def test_a_craft_that_diverges_ends_and_says_so(bench: Bench, limit: float) -> None:
    for _ in range(2000):
        bench.passes(PERIOD)
        if bench.plant.finished:
            break
        bench.give(DISTURBANCE, (limit, limit, limit))
    assert bench.plant.finished
    assert bench.plant.exit_code == EXIT_BROKEN
    for name, samples in bench.sent.items():
        for _, values in samples:
            assert all(map(math.isfinite, values)), name
