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

"""A node's answers to instants: each is computed once, and a repeated instant gets the same one."""

from collections.abc import Callable, Mapping

from ppc_attitude.contract.topics import Topic
from ppc_attitude.runtime.stamps import RefusedError, StampGuard, StampKind, Values, out_of_order
from ppc_attitude.science.stamps import NANOSECONDS, seconds

Inputs = Mapping[str, Values]
Outputs = dict[str, Values]
_SOONEST_START = 1.0  # [s] from a state at stamp zero to another one that begins time again


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
