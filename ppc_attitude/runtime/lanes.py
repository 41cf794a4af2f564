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

"""What a record of a run remembers: the samples and latest messages of topics, gaps of states."""

from dataclasses import dataclass, field
from statistics import median_low

from ppc_attitude.contract.run_record import STEADY
from ppc_attitude.runtime.publishers import Publishers
from ppc_attitude.science.stamps import seconds

_JUST_BEGUN = 3  # instants: the second one may be among the latest two
_FIRST = 9  # steps whose median is the rhythm: the first one alone may be of any length
_MOST_JUMPS = 5  # that are told one by one


@dataclass(slots=True)
class Stretch:
    """The samples of a topic, one for each instant, written between two beginnings of time."""

    count: int = 0
    total: int = 0  # sum of the stamps: equal counts with other stamps give another sum
    last: int = -1  # stamp [ns] of the newest

    @property
    def end(self) -> str:
        """When it ends, for a reader."""
        return f"{seconds(max(self.last, 0)):.6f} s"

    def until(self, stamp_ns: int) -> tuple[int, int]:
        """Count and sum of the stamps, without the last one if it is beyond a stamp."""
        if self.last > stamp_ns:
            return self.count - 1, self.total - self.last
        return self.count, self.total


@dataclass(slots=True)
class Lane:
    """One topic with a sample at each instant."""

    stretches: list[Stretch] = field(default_factory=lambda: [Stretch()])  # the last is present
    heard: int = -1  # the latest stamp [ns]
    latest: tuple[tuple[int, bytes], ...] = ()  # stamps [ns] and bytes of the latest two
    ended: int = 0  # the latest one before its time began again, if it did
    repeatable: frozenset[int] = frozenset()  # what a peer may repeat of before, not the first ones
    surplus: int = 0  # messages beside the first one of their instant
    publishers: Publishers = field(default_factory=Publishers)

    @property
    def came_from_several(self) -> bool:
        """True if several nodes sent it."""
        return self.publishers.several

    def begin_again(self) -> None:
        """Begin another stretch, at stamp zero."""
        repeatable = frozenset(stamp for stamp, _ in self.latest)
        # Time that really begins again comes by these only if it had just begun.
        self.repeatable = repeatable if self.has_run else frozenset()
        self.ended, self.latest = self.heard, ()
        self.stretches.append(Stretch())

    @property
    def has_run(self) -> bool:
        """True if the present stretch has not just begun."""
        return self.stretches[-1].count > _JUST_BEGUN

    @property
    def epoch(self) -> int:
        """How often its time has begun again."""
        return len(self.stretches) - 1

    def went_on(self, stamp_ns: int) -> bool:
        """True if its time never began again, since a stamp [ns] follows zero that goes on."""
        goes_on = self.ended < stamp_ns or 0 < stamp_ns in self.repeatable
        return self.heard == 0 < self.ended and goes_on


@dataclass(slots=True)
class Told:
    """One topic that is no sample, from a node that sends it with a state."""

    epoch: int  # of the states to which its messages belong
    heard: int = -1  # the latest stamp [ns]
    latest: tuple[bytes, ...] = ()  # bytes of the latest two, of which one may be sent ahead
    is_stamped: bool = True  # the latest one, for all that is known: its stamp is not zero again
    publishers: Publishers = field(default_factory=Publishers)

    @property
    def came_from_several(self) -> bool:
        """True if several nodes sent it, or may have: its messages are few, and prove little."""
        return self.publishers.several or self.publishers.stay

    def take(self, stamp_ns: int, data: bytes, epoch: int, state_ns: int) -> bool:
        """Take a message into its epoch, given that of the states and the stamp of the newest.

        The epoch is one ahead of the states' where time begins again with the next state. Returns
        False for a message that came once more, with a repeated state.
        """
        again = data in (self.latest if stamp_ns else self.latest[-1:])
        goes_back = stamp_ns <= self.heard
        if self.epoch < epoch and goes_back and not (again and stamp_ns > state_ns):
            self.epoch = epoch
        elif again:
            return False
        elif self.epoch > epoch:  # after its zero came another stamp, and no state of zero
            self.epoch = epoch
        elif stamp_ns == 0 < self.heard:
            self.epoch += 1
        self.is_stamped = stamp_ns != 0 or self.heard != 0
        self.heard, self.latest = stamp_ns, (*self.latest[-1:], data)
        return True


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
