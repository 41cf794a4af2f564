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

"""The rhythm of a run's states: which of their steps are longer than usual."""

from statistics import median_low

from ppc_attitude.contract.run_record import STEADY
from ppc_attitude.science.stamps import seconds

_FIRST = 9  # steps whose median is the rhythm: the first one alone may be of any length
_MOST_JUMPS = 5  # that are told one by one


class Rhythm:
    """The steps from state to state, of a topic of this name."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._period = 0  # [ns]; 0 until it is known
        self._steps: list[tuple[int, int]] = []  # pairs of states that are not yet weighed
        self._weighed = self._steady = self._jumped = 0
        self._jumps: list[str] = []
        self._last = 1.0  # the last step, in periods
        # A long step from stamp to stamp [ns], and its length with the step before, in periods.
        self._long: tuple[int, int, float] | None = None

    def add(self, last: int, stamp_ns: int) -> None:
        """Take a step from one stamp [ns] to the next."""
        self._steps.append((last, stamp_ns))
        if len(self._steps) == _FIRST:
            self._weigh()

    def _weigh(self) -> None:
        if not self._period and self._steps:
            self._period = median_low(after - before for before, after in self._steps)
        for before, after in self._steps:
            ratio = (after - before) / self._period
            self._weighed += 1
            self._steady += abs(ratio - 1.0) <= STEADY
            self._settle(ratio)
            if ratio > 1.5:
                self._long = before, after, self._last + ratio
            self._last = ratio
        self._steps.clear()

    def _settle(self, ratio: float) -> None:
        """Count a long step if a state within it is lost, and not if one was only late.

        With the steps beside it, it takes 3 periods if a state was only late, and 4 if one is lost.
        """
        if self._long and self._long[2] + ratio >= 3.5:
            before, after, _ = self._long
            self._jumped += 1
            if self._jumped <= _MOST_JUMPS:
                span = f"from {seconds(before):.6f} s to {seconds(after):.6f} s"
                self._jumps.append(f"{self._name} has a gap {span}")
        self._long = None

    def jumps(self) -> list[str]:
        """Describe the gaps of the states; a rhythm that changes has none."""
        self._weigh()
        self._settle(1.0)
        if 4 * self._steady < 3 * self._weighed:
            return []
        more = self._jumped - len(self._jumps)
        return self._jumps + ([f"{self._name} has {more} more gaps"] if more else [])
