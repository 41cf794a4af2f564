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

"""When an instant of the estimator is complete: its gyro sample is there, and the fix that is due.

Every slot has one message, with or without a fix, so nobody has to guess whether one still comes.
A fix that no sample waits for is used when it comes. It may be of a tracker whose latency is larger
than its parameter, or that has slots of its own.
"""

from collections.abc import Iterable, Iterator

from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.topics import Topic
from ppc_attitude.runtime.stamps import Instant, StampGuard, StampKind, Values, out_of_order
from ppc_attitude.science.sensors.star_tracker import TOLERANCE, Slots
from ppc_attitude.science.stamps import LARGEST_STEP, nanoseconds, seconds

Parts = dict[str, Values]
_PENDING = 100  # fixes that may be ahead of the samples
_TOLD = 3  # of them that the log names while a sample waits for another one


class Fixes(Instant):
    """Join gyro samples and fixes to instants, in the order of the samples.

    In lock-step a sample waits for its fix, because the plant sends nothing else. On the wall clock
    a sample waits for a fix as long as `patience` says. After a fix was lost, no sample waits until
    the tracker is heard again: until a fix comes that would have been in time.

    Parameters
    ----------
    slots : Slots
        Which fix is due at which stamp.
    late : Topic
        The topic of the fixes.
    names : iterable of str
        Columns that come with every instant: together they are a sample.
    patience : float, optional
        How much later [s] the newest sample may be than one that waits; then its fix is lost.

    Attributes
    ----------
    lost : int
        Slots whose fix did not come in time.
    useless : int
        Fixes that came after a newer one was used.
    """

    def __init__(
        self, slots: Slots, late: Topic, names: Iterable[str], patience: float = 0.1
    ) -> None:
        super().__init__(names)
        self._slots = slots
        self._late = late
        self._none = (0.0,) * (late.width + 1)
        self._patience = nanoseconds(patience)
        self._is_heard = True  # the tracker: false after a lost fix, until one comes in time
        self._guard = StampGuard()
        self._last: int | None = None
        self._used: int | None = None  # validity [ns] of the last fix that was joined
        self._samples: dict[int, Parts] = {}
        self._fixes: dict[int, Values] = {}
        self.lost = self.useless = 0

    def take(
        self, name: str, stamp_ns: int, values: Values, now: float
    ) -> Iterator[tuple[int, Parts]]:
        """Take a message; yield what is complete: each sample with a fix and its age [s].

        Raises
        ------
        RefusedError
            The stamp is out of order.
        """
        if name == self._late.column:
            yield from self._fix(stamp_ns, values)
        elif (parts := self.add(name, stamp_ns, values)) is not None:
            yield from self._sample(BY_COLUMN[name].name, stamp_ns, parts, now)

    def _sample(
        self, topic: str, stamp_ns: int, parts: Parts, now: float
    ) -> Iterator[tuple[int, Parts]]:
        kind = self._guard.judge(stamp_ns, now)
        if kind is StampKind.STALE:
            raise out_of_order(topic, stamp_ns)
        if kind is StampKind.RESTART:
            self._samples.clear()
            self._fixes = {valid: fix for valid, fix in self._fixes.items() if valid <= stamp_ns}
            self._last = self._used = None
            self._is_heard = True
        if not self._samples:
            self.waiting_since = now
        self._samples[stamp_ns] = parts
        yield from self._complete()

    def _fix(self, valid_ns: int, values: Values) -> Iterator[tuple[int, Parts]]:
        newest = self._guard.last
        if newest is not None and valid_ns - newest > LARGEST_STEP:
            raise out_of_order(self._late.name, valid_ns)
        # The tracker is heard again with a fix for which a sample would still have waited.
        last = None if self._last is None else self._last - self._patience
        if self._slots.has(valid_ns) and (last is None or not self._slots.arrived(valid_ns, last)):
            self._is_heard = True
        if valid_ns != self._used:  # the message of a repeated state has been used
            self._fixes[valid_ns] = values
        while len(self._fixes) > _PENDING:
            self._discard(next(iter(self._fixes)))
        yield from self._complete()

    def _discard(self, valid_ns: int) -> None:
        del self._fixes[valid_ns]
        self.useless += 1

    def missing(self) -> tuple[str, ...]:
        """The fixes if a sample waits for one, else what no incomplete sample has."""
        return (self._late.column,) if self._samples else super().missing()

    def waiting(self) -> str:
        """The fix that a sample waits for, in words; empty if none does."""
        if not self._samples:
            return ""
        stamp = next(iter(self._samples))
        slot = self._slots.due(self._last, stamp)
        told = f"waiting at t = {seconds(stamp):.3f} s for {self._late.name}"
        if slot is not None:
            told += f" with the stamp {seconds(slot):.6f} s, as the estimator's parameters say"
        others = ", ".join(f"{seconds(valid):.6f} s" for valid in [*self._fixes][-_TOLD:])
        return f"{told}; fixes came with other stamps: {others}" if others else told

    def _complete(self) -> Iterator[tuple[int, Parts]]:
        while self._samples:
            stamp = next(iter(self._samples))
            if stamp == self._last:
                yield stamp, {**self._samples.pop(stamp), self._late.column: self._none}
                continue
            slot = self._slots.due(self._last, stamp)
            valid = self._unawaited(stamp)
            if slot is not None:
                due = next((each for each in self._fixes if abs(each - slot) <= TOLERANCE), None)
                if due is not None:
                    valid = due
                elif self._is_heard and next(reversed(self._samples)) - stamp <= self._patience:
                    return
                else:
                    self._is_heard = False
                    self.lost += 1
            self._last = stamp
            row = self._none if valid is None else self._taken(valid, stamp)
            yield stamp, {**self._samples.pop(stamp), self._late.column: row}

    def _unawaited(self, stamp_ns: int) -> int | None:
        """Validity [ns] of the oldest unused fix up to a stamp [ns], if no slot still awaits it."""
        new = [each for each in self._fixes if self._used is None or each > self._used]
        if self._last is None or not new:
            return None
        valid = min(new)
        awaited = self._slots.has(valid) and not self._slots.arrived(valid, self._last)
        return None if awaited or valid > stamp_ns else valid

    def _taken(self, valid_ns: int, stamp_ns: int) -> Values:
        """Return a fix and its age [s] at a stamp [ns]; those before it are of no use any more."""
        row = (*self._fixes.pop(valid_ns), seconds(stamp_ns - valid_ns))
        self._used = valid_ns
        for older in [each for each in self._fixes if each < valid_ns]:
            self._discard(older)
        return row
