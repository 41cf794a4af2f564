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

"""Is a recording complete? Judged while it grows, in memory that does not grow with it."""

from collections.abc import Iterable
from dataclasses import dataclass

from ppc_attitude.contract.topics import ATTITUDE
from ppc_attitude.science.stamps import seconds


@dataclass
class _Tally:
    count: int = 0
    total: int = 0  # sum of the stamps: equal counts with other stamps give another sum
    last: int = -1
    previous: int = -1

    def until(self, stamp_ns: int) -> tuple[int, int]:
        """Count and sum of the stamps up to one that is the last or the last but one."""
        if self.last > stamp_ns and self.previous == stamp_ns:
            return self.count - 1, self.total - self.last
        return self.count, self.total


class Completeness:
    """Compare every topic's stamps with those of the states.

    A run that is stopped may lack the answers to its last state; any other difference is a gap.
    After a reset of the plant time begins again: what came before is compared by itself.
    """

    def __init__(self) -> None:
        self._tallies: dict[str, _Tally] = {}
        self._earlier: dict[str, list[_Tally]] = {}  # before each reset
        self._period: int | None = None
        self._jumps: list[str] = []

    def add(self, name: str, stamp_ns: int) -> None:
        """Count one message of a topic."""
        tally = self._tallies.get(name) or self._tallies.setdefault(name, _Tally())
        if stamp_ns == 0 < tally.last:
            self._earlier.setdefault(name, []).append(tally)
            tally = self._tallies[name] = _Tally()
        if name == ATTITUDE.name and tally.count:
            self._look_for_jump(tally.last, stamp_ns)
        tally.count += 1
        tally.total += stamp_ns
        tally.previous, tally.last = tally.last, stamp_ns

    def _look_for_jump(self, last: int, stamp_ns: int) -> None:
        step = stamp_ns - last
        if self._period is None and step > 0:
            self._period = step
        elif self._period is not None and step > 1.5 * self._period:
            self._jumps.append(
                f"{ATTITUDE.name} jumps from {seconds(last):.6f} s to {seconds(stamp_ns):.6f} s"
            )

    def gaps(self, expected: Iterable[str] = ()) -> list[str]:
        """Describe what is missing; empty if nothing is.

        Parameters
        ----------
        expected : iterable of str
            Names of topics that must have come, once a state has been answered.
        """
        if ATTITUDE.name not in self._tallies:
            others = [f"{name} without {ATTITUDE.name}" for name in self._tallies]
            return others or [f"{ATTITUDE.name} never came"]
        found = list(self._jumps)
        if ATTITUDE.name in self._earlier or self._tallies[ATTITUDE.name].count > 1:
            found += [f"{name} never came" for name in expected if name not in self._tallies]
        resets = len(self._earlier.get(ATTITUDE.name, []))
        for name in self._tallies:
            if len(self._earlier.get(name, [])) != resets:
                found.append(f"{name} begins again at another time than {ATTITUDE.name}")
        for epoch in range(resets):
            found += self._compare(
                {
                    name: epochs[epoch]
                    for name, epochs in self._earlier.items()
                    if epoch < len(epochs)
                }
            )
        return found + self._compare(self._tallies)

    def _compare(self, tallies: dict[str, _Tally]) -> list[str]:
        """Compare the topics over a stretch of time without a reset."""
        states = tallies[ATTITUDE.name]
        found = []
        for name, tally in tallies.items():
            end = min(tally.last, states.last)
            complete = abs(tally.last - states.last) <= 1.5 * (self._period or 0)
            if not complete or tally.until(end) != states.until(end):
                found.append(
                    f"{name} has {tally.count} messages until {seconds(tally.last):.6f} s, "
                    f"{ATTITUDE.name} {states.count} until {seconds(states.last):.6f} s"
                )
        return found
