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

"""The parts of a verdict: requirements and how they came out, and the numbers behind them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ppc_attitude.analysis.hits import Pulse
from ppc_attitude.analysis.series import Span, span_text

MET, NOT_MET, NOT_JUDGED = "met", "NOT MET", "not judged"


@dataclass(frozen=True)
class Requirement:
    """One requirement and how it came out."""

    key: str  # what it is for programs
    name: str  # what is required
    value: float | None  # what the run reached; None if there is no such number
    limit: float  # what the value may reach
    unit: str  # of both; empty for a number of things
    met: bool | None  # None if the run could not be judged by it
    span: Span | None  # the part of the run that was judged; None if nothing was
    strict: bool = False  # the value must stay below the limit, and may not equal it
    reason: str = ""  # why it is not judged, or what a reader must know of the value
    without: tuple[Span, ...] = ()  # parts of the span that were left out

    @property
    def outcome(self) -> str:
        """One of `MET`, `NOT_MET`, `NOT_JUDGED`."""
        return NOT_JUDGED if self.met is None else MET if self.met else NOT_MET

    @property
    def value_text(self) -> str:
        """The value for a reader, without its unit."""
        return "–" if self.value is None else number_text(self.value)

    @property
    def limit_text(self) -> str:
        """The limit for a reader, with its unit."""
        return f"{'<' if self.strict else '≤'} {number_text(self.limit)} {self.unit}".rstrip()

    @property
    def span_text(self) -> str:
        """The part of the run that was judged, for a reader."""
        return span_text(self.span)

    @property
    def note(self) -> str:
        """A remark for the reader."""
        gaps = ", ".join(span_text(each) for each in self.without)
        return "; ".join(filter(None, (self.reason, gaps and f"without {gaps}")))

    def to_json(self) -> dict[str, Any]:
        """Row of ``analyse --json``."""
        told: dict[str, Any] = {
            "name": self.name,
            "value": self.value,
            "limit": self.limit,
            "unit": self.unit,
            "pass": self.met,
            "span": self.span and list(self.span),
        }
        if self.without:
            told["without"] = [list(each) for each in self.without]
        if self.reason:
            told["reason"] = self.reason
        return told


@dataclass(frozen=True)
class Disturbance(Pulse):
    """One sudden disturbance and the recovery from it."""

    recovery_time_s: float | None
    """From its start to the last instant, before the next one or the end, at which the attitude
    error is not settled; 0 if it always is, for the time allowed at least where the record ends;
    None if the record shows no recovery."""
    judged_by: str  # recovery, or, before the settling deadline, the envelope if there is one

    @property
    def outcome(self) -> str:
        """How it came out, for a reader."""
        if self.recovery_time_s is None:
            return "no recovery on record"
        return f"recovered after {number_text(self.recovery_time_s)} s"


@dataclass(frozen=True)
class Metrics:
    """The numbers of a run; None where the record cannot show one."""

    settling_time_s: float | None
    """Last instant before the first sudden disturbance at which the attitude error is not settled;
    0 if there is none. None if no error before it is known, or the record begins late, when it was
    settled."""
    error_after_settling_deadline: float | None
    """Largest max_i |q_ev,i| from the deadline on, without recoveries from sudden disturbances."""
    terminal_error: float | None  # largest max_i |q_ev,i| of the last part
    # Largest ‖ω_s‖ and largest component before the first sudden disturbance.
    max_rate_deg_s: float | None
    max_rate_axis_deg_s: float | None
    max_applied_torque: float | None  # largest component of the actuator torque [N·m]
    # Time with a component of the law's own error beyond its envelope; None without one.
    time_outside_attitude_envelope_s: float | None
    time_outside_rate_envelope_s: float | None
    time_pointing_outside_attitude_envelope_s: float | None  # the same of the true attitude error
    error_from_deadline_with_recoveries: float | None  # largest max_i |q_ev,i|
    # Largest ‖ω_s‖ and largest component of the whole run.
    max_rate_whole_run_deg_s: float | None
    max_rate_axis_whole_run_deg_s: float | None
    settled: bool | None
    """Whether the attitude error is settled at the last instant before the first sudden
    disturbance: if not, there is no settling time yet."""
    converged: bool | None  # whether the attitude error stays settled over the last part
    further: Mapping[str, float]  # `time_outside_<bound>_s` of the envelopes of other errors
    disturbances: tuple[Disturbance, ...]  # by start
    spans: Mapping[str, Span]  # name of a number above to the part of the run it is taken over


@dataclass(frozen=True)
class ErrorSize:
    """One of the three attitude errors (`truth`), over a part of the run."""

    name: str
    meaning: str
    max_deg: float | None  # largest angle [deg]; None if it is not known
    rms_deg: float | None  # its root mean square [deg]
    span: Span
    without: tuple[Span, ...] = ()  # what of the span is not on record

    @property
    def span_text(self) -> str:
        """The part of the run, and what of it is not on record, for a reader."""
        return ", without ".join(map(span_text, (self.span, *self.without)))


def torque_text(disturbance: Disturbance) -> str:
    """Torque of a sudden disturbance [N·m], by component."""
    # It is a difference of torques: what rounding leaves of nothing is nothing.
    least = 1e-8 * max(map(abs, disturbance.torque))
    told = (each if abs(each) > least else 0.0 for each in disturbance.torque)
    return ", ".join(map(number_text, told))


def number_text(value: float) -> str:
    """Write a number as a reader wants it: four digits."""
    return f"{value:.4g}"
