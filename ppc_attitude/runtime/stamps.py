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

"""Keeping step by stamps: which one is new, when its messages are complete, what answers it.

No handshake and no clock: every peer answers a state with messages of the same stamp, and a
repeated state with the same answer. The plant repeats a state that stays unanswered, so a peer
that is late, restarts or lost a message is served by the same mechanism as every other.
"""

from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from math import inf

from ppc_attitude.contract.topics import Topic
from ppc_attitude.science.stamps import LARGEST_STEP, LATEST, NANOSECONDS, nanoseconds, seconds

Values = tuple[float, ...]
Inputs = Mapping[str, Values]
Outputs = dict[str, Values]
_LATEST_NS = nanoseconds(LATEST)
_AHEAD = 10  # incomplete instants that may be: a source is ahead, or a plant has just ended
_SOONEST_START = 1.0  # [s] from a state at stamp zero to another one that begins time again
SILENCE = 2.0
"""Time [s] after which the last message is no sign that others come."""


class RefusedError(ValueError):
    """A message must not be used; says why."""


def out_of_order(name: str, stamp_ns: int) -> RefusedError:
    """Refusal of a message whose stamp [ns] does not follow those before, or is beyond `LATEST`."""
    stamp = f"{name}: stamp {seconds(stamp_ns):.6f} s"
    if stamp_ns > _LATEST_NS:
        # A clock that counts since 1970, most likely. References integrate from zero to the stamp.
        return RefusedError(f"{stamp}; allowed: up to {LATEST:g} s from the start of the run")
    return RefusedError(f"{stamp} is out of order")


class StampKind(Enum):
    """The kind of a stamp, compared with those before."""

    NEW = "new"
    REPEATED = "repeated"
    STALE = "stale"
    RESTART = "restart"


class StampGuard:
    """Judge the stamps of one stream.

    A stamp that goes back, or leaps ahead by more than `LARGEST_STEP`, is refused as out of order,
    unless time has begun again: at stamp zero, or when `CONFIRMATIONS` messages in a row agree on
    the other time. A plant in lock-step cannot go on without an answer, so a state that it repeats
    counts as agreement too, if it comes after `SOONEST_REPEAT`: the copies of a flood come sooner.
    No stamp beyond `LATEST` is accepted.
    """

    CONFIRMATIONS = 3
    LATEST_START = 86_400 * NANOSECONDS  # a first stamp after this needs confirmation as well
    SOONEST_REPEAT = 0.1  # [s] no plant repeats a state sooner

    def __init__(self) -> None:
        self.last: int | None = None
        self._candidate: int | None = None
        self._confirmed = 0
        self._confirmed_at = 0.0

    def judge(self, stamp_ns: int, now: float) -> StampKind:
        """Classify a stamp [ns] that came at a time [s], and remember it unless it is stale."""
        if stamp_ns == self.last:
            return StampKind.REPEATED
        if stamp_ns > _LATEST_NS:
            return StampKind.STALE
        if self._goes_on(stamp_ns):
            return self._accept(stamp_ns, StampKind.NEW)
        self._weigh(stamp_ns, now)
        if stamp_ns == 0 or self._confirmed >= self.CONFIRMATIONS:
            return self._accept(stamp_ns, StampKind.RESTART)
        return StampKind.STALE

    def _weigh(self, stamp_ns: int, now: float) -> None:
        """Count how many stamps in a row agree on another time."""
        if stamp_ns == self._candidate and now - self._confirmed_at < self.SOONEST_REPEAT:
            return
        candidate = self._candidate
        agrees = candidate is not None and 0 <= stamp_ns - candidate <= LARGEST_STEP
        self._confirmed = self._confirmed + 1 if agrees else 1
        self._candidate = stamp_ns
        self._confirmed_at = now

    def _goes_on(self, stamp_ns: int) -> bool:
        if self.last is None:
            return stamp_ns <= self.LATEST_START
        return 0 < stamp_ns - self.last <= LARGEST_STEP

    def _accept(self, stamp_ns: int, kind: StampKind) -> StampKind:
        self.last = stamp_ns
        self._candidate = None
        return kind


class States:
    """Which states tell the time to a node that reads nothing else.

    Those of the truth do where it is sent, because the world goes on whether or not an estimator
    does; else what the controller is told does. A node that joins a run, or was paused, may hear
    many estimates before the truth of the same instants: time has not gone back.
    """

    def __init__(self) -> None:
        self._truth_at = -inf  # [s] when the last true state came
        self._told, self._told_at = 0, -inf  # stamp [ns] taken instead, and when [s]

    def tells(self, stamp_ns: int, true: bool, now: float) -> bool:
        """Whether a state, of the truth or not, that comes at a time [s] is to be answered."""
        if true:
            self._truth_at = now
            if 0 < stamp_ns < self._told and now - self._told_at < SILENCE:
                return False
            self._told = 0
            return True
        if now - self._truth_at <= SILENCE:
            return False
        self._told, self._told_at = stamp_ns, now
        return True


class Instant:
    """Collect the messages of one instant, which has one of each name.

    As many as `DEPTH` incomplete instants are kept: a source may run this far ahead of another.
    """

    DEPTH = 100

    def __init__(self, names: Iterable[str]) -> None:
        self._names = tuple(names)
        self._parts: dict[int, dict[str, Values]] = {}
        self._completed: int | None = None  # the last stamp that was
        self.dropped = 0
        self.waiting_since = 0.0  # [s] when an instant was complete, or the first message came
        self._heard_at = 0.0  # [s]

    def add(self, name: str, stamp_ns: int, values: Values) -> dict[str, Values] | None:
        """Add one message; return the instant's messages once all are there."""
        parts = self._parts.setdefault(stamp_ns, {})
        parts[name] = values
        if len(parts) == len(self._names):
            # Those that began before it are dropped with it, because no topic goes back.
            begun = list(self._parts)
            overtaken = begun[: begun.index(stamp_ns)]
            self.dropped += len(overtaken)
            for stamp in (*overtaken, stamp_ns):
                del self._parts[stamp]
            if self._completed is not None:  # a repeated one, overtaken by this
                self._parts.pop(self._completed, None)
            self._completed = stamp_ns
            return parts
        if len(self._parts) > self.DEPTH:
            # dicts keep insertion order: the first is the one that has waited longest.
            del self._parts[next(iter(self._parts))]
            self.dropped += 1
        return None

    def take(
        self, name: str, stamp_ns: int, values: Values, now: float
    ) -> Iterable[tuple[int, dict[str, Values]]]:
        """Take a message that came at a time [s]; return the instants [ns] that it completes."""
        if not self._parts:
            self.waiting_since = now
        self._heard_at = now
        parts = self.add(name, stamp_ns, values)
        if parts is None:
            return ()
        self.waiting_since = now
        return ((stamp_ns, parts),)

    def is_stuck(self, now: float) -> bool:
        """True if messages come, by a time [s], and too many of them make no instant together."""
        return len(self._parts) > _AHEAD and now - self._heard_at < SILENCE

    def missing(self) -> tuple[str, ...]:
        """Names that no incomplete instant has; all if there is none, or if they do not pair."""
        present = set().union(*self._parts.values())
        return tuple(name for name in self._names if name not in present) or self._names


class Answers:
    """Answers to the instants of a run, in the order in which they come.

    Answers that depend on time alone are sent one instant `ahead`, so that nobody waits for them.
    This needs a period of whole nanoseconds that divides a second: only then is every stamp known
    before its state comes. A foreseen stamp that never comes does no harm, because all other nodes
    wait for the stamps of states. `begin_again` gets the stamp [ns] at which time begins again.
    """

    def __init__(
        self,
        compute: Callable[[int, Inputs], Outputs],
        ahead: bool,
        begin_again: Callable[[int], None],
    ) -> None:
        self._compute = compute
        self._ahead = ahead
        self._begin_again = begin_again
        self._guard = StampGuard()
        self._period = 0
        self._is_steady = False  # the last step was a period
        self._sent: dict[int, Outputs] = {}
        self._answered: Values | None = None  # what was read at the last instant
        self._answered_at = 0.0  # [s]

    def to(self, topic: Topic, stamp_ns: int, inputs: Inputs, now: float) -> dict[int, Outputs]:
        """Return the answers, by stamp [ns], to be sent for an instant that came at a time [s].

        Raises
        ------
        RefusedError
            The stamp is out of order, or stands still while the numbers of `topic` change.
        """
        last, read = self._guard.last, inputs.get(topic.column)
        kind = self._guard.judge(stamp_ns, now)
        if kind is StampKind.REPEATED:
            if read == self._answered:
                return self._sent
            if stamp_ns or now - self._answered_at < _SOONEST_START:
                stamp = f"{topic.name}: stamp {seconds(stamp_ns):.6f} s"
                raise RefusedError(f"{stamp} comes again with other values")
            kind = StampKind.RESTART  # another plant waits at its start
        if kind is StampKind.STALE:
            raise out_of_order(topic.name, stamp_ns)
        self._answered, self._answered_at = read, now
        step = 0 if last is None else stamp_ns - last
        if kind is StampKind.RESTART:
            self._period = 0
            self._sent = {}
            self._begin_again(stamp_ns)
        else:
            self._period = min(self._period or step, step)
        self._is_steady = 0 < step <= self._period + 1  # stamps are rounded
        stamps = [stamp_ns]
        # A step that is longer than others has lost states: then the next stamp is not known.
        if self._ahead and step and step == self.period_ns:
            stamps.append(stamp_ns + step)
        new = {each: self._compute(each, inputs) for each in stamps if each not in self._sent}
        self._sent = {each: new[each] if each in new else self._sent[each] for each in stamps}
        return new

    @property
    def period_ns(self) -> int:
        """Time [ns] from stamp to stamp; 0 as long as nobody can know the stamps to come."""
        return self._period if self._period and NANOSECONDS % self._period == 0 else 0

    @property
    def next_ns(self) -> int | None:
        """The first stamp [ns] that has not been answered; None as long as nobody can know it."""
        return max(self._sent) + self._period if self._is_steady else None
