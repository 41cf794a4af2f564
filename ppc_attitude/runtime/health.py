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

"""The health of a node, as it reports it, and whether a run still goes on."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from math import inf
from typing import Any, NamedTuple

from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science.stamps import NANOSECONDS, seconds

# As in diagnostic_msgs/DiagnosticStatus.
OK, WARN, ERROR, STALE = b"\x00", b"\x01", b"\x02", b"\x03"
_LOG_PERIOD = 1.0  # [s] the same complaint is logged at most this often
_IDLE = 2.0  # [s] of silence after which diagnostics follow the wall clock
_STALLED = 30.0  # [s] without a step after which a run is given up
_UNSEEN = 5.0  # [s] without a look that show that the one who looks was paused, too


class Status(NamedTuple):
    """The status that a node reports."""

    level: bytes
    summary: str
    details: Mapping[str, Any]


class Health:
    """Refusals, complaints and steps of one node; `now` is always the wall clock's time [s]."""

    def __init__(self, now: float) -> None:
        self.refused: Counter[str] = Counter()
        self.time_ns = 0  # the latest stamp [ns]
        self._reported_refusals = 0
        self._last_log: dict[str, float] = {}
        self._active_at = self._reported_at = now
        self._next_report_ns = 0
        self._counted_from: int | None = None  # stamp [ns] of the step before the first counted one
        self._steps = 0

    def may_log(self, kind: str, now: float, period: float = _LOG_PERIOD) -> bool:
        """True if a complaint of this kind was not logged for a period [s]; it counts as logged."""
        due = now - self._last_log.get(kind, -period) >= period
        if due:
            self._last_log[kind] = now
        return due

    def step(self, stamp_ns: int, now: float) -> bool:
        """Count a step; True once per simulated second, when diagnostics are due."""
        if self._counted_from is None:
            self._counted_from = stamp_ns
            self._active_at = now
        elif stamp_ns > self.time_ns:  # a repeated one counts once, and time stands still
            self._steps += 1
            self._active_at = now
        self.time_ns = stamp_ns
        due = stamp_ns >= self._next_report_ns
        if due:
            self._next_report_ns = stamp_ns + NANOSECONDS
        return due

    def begin_again(self) -> None:
        """Let the reports begin anew after time has gone back."""
        self._next_report_ns = self.time_ns = self._steps = 0
        self._counted_from = None

    def is_idle(self, now: float) -> bool:
        """True if no step has come for a while."""
        return now - self._active_at > 0.5 * _IDLE

    def idle_report_is_due(self, now: float) -> bool:
        """True once a second if no step has come for a while."""
        due = now - self._active_at > _IDLE and now - self._reported_at > 0.5 * _IDLE
        if due:
            self._reported_at = now
        return due

    def report(self, status: Status, failure: str) -> Status:
        """Add time, rate, refusals and the cause of a failure to the status of a node."""
        level, summary, details = status
        newly_refused = self.refused.total() - self._reported_refusals
        self._reported_refusals += newly_refused
        if newly_refused:
            level = WARN if level == OK else level
            summary = f"{summary}; refused {newly_refused} messages since the last report"
        if failure:
            level, summary = ERROR, failure
        refusals = {f"refused {name}": count for name, count in sorted(self.refused.items())}
        pace = {"time [s]": seconds(self.time_ns), "measured rate [Hz]": self._rate()}
        return Status(level, summary, {**pace, **details, **refusals})

    def _rate(self) -> float:
        """Steps per second of simulated time [Hz] since the last call; 0 if no time has passed."""
        if self._counted_from is None or self.time_ns <= self._counted_from:
            return 0.0
        rate = self._steps * NANOSECONDS / (self.time_ns - self._counted_from)
        self._counted_from, self._steps = self.time_ns, 0
        return rate


class Stall:
    """Tells when a run has stalled; `now` is always the time of the wall clock [s].

    Time in which a node waited for the processor does not count: nobody's fault. Time in which a
    node uses the processor counts: one that computes for ever never answers. Time in which nobody
    looked does not count either: a container that is paused pauses the nodes and who looks.
    """

    def __init__(self, now: float) -> None:
        self._advanced = self._looked = now
        self._heard = inf  # when the plant told its time, be it the same as before
        self._starved: Mapping[str, float] = {}

    def look(self, now: float) -> None:
        """Take that somebody looks, as happens several times a second."""
        if (unseen := now - self._looked) > _UNSEEN:
            self._advanced += unseen
            self._heard += unseen
        self._looked = now

    def advance(self, now: float, starved: Mapping[str, float]) -> None:
        """Take that simulated time went on, and how long each node had starved by then [s]."""
        self._advanced, self._starved = now, starved

    def hear(self, now: float) -> None:
        """Take that the plant has told its time."""
        self._heard = now

    def reason(
        self,
        now: float,
        starvation: Callable[[], Mapping[str, float]],
        hindrances: Callable[[], Iterable[str]],
    ) -> str:
        """Say why the run is to be given up; empty if it goes on, or nobody knows what hinders it.

        Parameters
        ----------
        starvation : callable
            Gives how long each node has starved [s].
        hindrances : callable
            Gives what the nodes say that they wait for, or what else is known.
        """
        silent = now - self._advanced
        if silent < _STALLED:
            return ""
        lost = max(total - self._starved.get(name, 0.0) for name, total in starvation().items())
        if silent - lost < _STALLED:
            return ""
        why = "; ".join(dict.fromkeys(filter(None, hindrances())))
        if now - self._heard - lost >= _STALLED:
            why = why or f"{PLANT} neither goes on nor ends"
        return why and f"no step for {_STALLED:g} s: {why}"
