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

"""A pace of the plant with a clock and peers of the test's own."""

from collections.abc import Mapping
from typing import Any

from ppc_attitude.runtime.pace import Pace, Rules
from ppc_attitude.runtime.stamps import Values

PERIOD = 0.01  # [s]
TORQUE = (0.01, -0.02, 0.03)
ZERO = (0.0, 0.0, 0.0)
COMMAND, DISTURBANCE = "torque_command", "disturbance/torque"
RULES: dict[str, Any] = {
    "rate": 100.0,
    "last_step": None,
    "inputs": {COMMAND: ZERO, DISTURBANCE: ZERO},
    "wait_for": (COMMAND, DISTURBANCE),
    "waits": False,
    "timeout_ns": 500_000_000,
}


class Bench:
    """A pace, the craft that it moves, and the time."""

    def __init__(self, kind: type[Pace], **rules: Any) -> None:
        self.now = 1000.0
        self.stamp = 0
        self.shown: list[int] = []
        self.acted: list[tuple[int, Mapping[str, Values]]] = []
        self.said: list[str] = []
        self.absent: set[str] = set()
        self.pace: Any = kind(self, Rules(**{**RULES, **rules}), self.now)
        self.wake()
        self.begun = self.now

    # What a craft does.

    def begin(self) -> None:
        self.stamp = 0

    def act(self, stamp_ns: int, inputs: Mapping[str, Values]) -> None:
        self._acting = stamp_ns, dict(inputs)

    def move_to(self, stamp_ns: int) -> None:
        self.stamp = stamp_ns

    def show(self) -> None:
        self.shown.append(self.stamp)

    def tell_acted(self) -> None:
        self.acted.append(self._acting)

    def is_published(self, name: str) -> bool:
        return name not in self.absent

    def complain(self, kind: str, text: str) -> None:
        self.said.append(text)

    def announce(self, text: str, warning: bool) -> None:
        self.said.append(text)

    # What the test does.

    def wake(self) -> float:
        return float(self.pace.wake(self.now))

    def passes(self, seconds: float) -> None:
        """Let wall time pass, and wake the pace as often as it asks for."""
        self.now += seconds
        while self.wake() <= 0.0:
            pass

    def runs(self, seconds: float) -> None:
        """Let wall time pass without a hitch."""
        for _ in range(round(seconds / PERIOD)):
            self.passes(PERIOD)

    def follows(self, seconds: float) -> None:
        """Let wall time pass; every state that is shown is answered soon."""
        for _ in range(round(seconds / 0.001)):
            if self.shown[-1] == self.stamp:
                self.answer()
            self.passes(0.001)

    def give(self, name: str, values: Values, ahead: int = 0) -> None:
        """Answer the present state, or one that is to come."""
        self.pace.take(name, self.stamp + ahead * 10_000_000, values, self.now)

    def answer(self) -> None:
        self.give(COMMAND, TORQUE)
        self.give(DISTURBANCE, ZERO)

    @property
    def time(self) -> float:
        return self.shown[-1] * 1e-9

    @property
    def torque(self) -> Values:
        return self.acted[-1][1][COMMAND]


def steps(count: int) -> list[int]:
    return [step * 10_000_000 for step in range(count)]
