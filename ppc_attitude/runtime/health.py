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

"""The health of a node: levels, refusals, steps a second, and how often it reports."""

from collections import Counter
from collections.abc import Mapping
from typing import Any, NamedTuple

from ppc_attitude.science.stamps import NANOSECONDS, seconds

# As in diagnostic_msgs/DiagnosticStatus.
OK, WARN, ERROR, STALE = b"\x00", b"\x01", b"\x02", b"\x03"
_LOG_PERIOD = 1.0  # [s] the same complaint is logged at most this often
_IDLE = 2.0  # [s] of silence after which diagnostics follow the wall clock


class Status(NamedTuple):
    """The status that a node reports."""

    level: bytes
    summary: str
    details: Mapping[str, Any]


class Health:
    """Refusals, complaints and steps of one node; `now` is always the wall clock's time [s]."""

    def __init__(self, now: float) -> None:
        self.refused: Counter[str] = Counter()
        self.time_ns = 0  # the latest stamp that was reported
        self._reported_refusals = 0
        self._last_log: dict[str, float] = {}
        self._active_at = self._reported_at = now
        self._next_report_ns = 0
        self._steps = StepCounter()

    def may_log(self, kind: str, now: float, period: float = _LOG_PERIOD) -> bool:
        """True if a complaint of this kind has not been logged for a period [s]; it is now."""
        due = now - self._last_log.get(kind, -period) >= period
        if due:
            self._last_log[kind] = now
        return due

    def step(self, stamp_ns: int, now: float) -> bool:
        """Count a step; True once per simulated second, when diagnostics are due."""
        self._active_at = now
        self._steps.add(stamp_ns)
        self.time_ns = stamp_ns
        due = stamp_ns >= self._next_report_ns
        if due:
            self._next_report_ns = stamp_ns + NANOSECONDS
        return due

    def begin_again(self) -> None:
        """Let the reports begin anew after time has gone back."""
        self._next_report_ns = self.time_ns = 0
        self._steps = StepCounter()

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
        if level == OK and newly_refused:
            level, summary = WARN, f"{summary}; refused {newly_refused} since the last report"
        if failure:
            level, summary = ERROR, failure
        refusals = {f"refused {name}": count for name, count in sorted(self.refused.items())}
        pace = {"time [s]": seconds(self.time_ns), "measured rate [Hz]": self._steps.rate()}
        return Status(level, summary, {**pace, **details, **refusals})


class StepCounter:
    """Steps per second of simulated time, over the time since the last look."""

    def __init__(self) -> None:
        self._since: int | None = None
        self._latest = -1
        self._count = 0

    def add(self, stamp_ns: int) -> None:
        """Count a step; a repeated one counts once."""
        if self._since is None:
            self._since = stamp_ns
        elif stamp_ns > self._latest:
            self._count += 1
        self._latest = stamp_ns

    def rate(self) -> float:
        """Rate [Hz] since the last call; 0 if no time has passed."""
        passed = self._latest - (self._latest if self._since is None else self._since)
        rate = self._count * NANOSECONDS / passed if passed > 0 else 0.0
        if passed > 0:
            self._since, self._count = self._latest, 0
        return rate
