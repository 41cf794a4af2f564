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

"""`Verdict`: what was judged, how it came out, and how it is told (terminal, JSON)."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from ppc_attitude.analysis.pulses import Pulse
from ppc_attitude.analysis.requirements import Requirements
from ppc_attitude.analysis.truth import EXACT, STANDING
from ppc_attitude.contract.run_record import ToldChange

MET, NOT_MET, NOT_JUDGED = "met", "NOT MET", "not judged"
_MOST_CHANGES = 20  # that a terminal shows: a stream of goals has thousands

Span = tuple[float, float]


@dataclass(frozen=True)
class Requirement:
    """One requirement and how it came out.

    Attributes
    ----------
    key : str
        What it is for programs.
    name : str
        What is required.
    value : float or None
        What the run reached; None if there is no such number.
    limit : float
        What the value may reach.
    unit : str
        Unit of both; empty for a number of things.
    met : bool or None
        None if the run could not be judged by it.
    span : (float, float) or None
        The part of the run that was judged, from and to [s]; None if nothing was.
    strict : bool
        True if the value must stay below the limit, False if it may equal it.
    reason : str
        Why it is not judged, or what a reader must know of the value.
    without : tuple of (float, float)
        Parts of the span that were left out [s].
    """

    key: str
    name: str
    value: float | None
    limit: float
    unit: str
    met: bool | None
    span: Span | None
    strict: bool = False
    reason: str = ""
    without: tuple[Span, ...] = ()

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


def all_met(requirements: Iterable[Requirement]) -> bool:
    """True if none is judged and missed."""
    return all(each.met is not False for each in requirements)


@dataclass(frozen=True)
class Disturbance(Pulse):
    """One sudden disturbance and the recovery from it.

    Attributes
    ----------
    recovery_time_s : float or None
        From its start to the last instant, before the next one or the end, at which the attitude
        error is not settled; 0 if it always is, None if it still is not at the last instant.
    judged_by : str
        What judges it: recovery, or, before the settling deadline, the envelope if there is one.
    """

    recovery_time_s: float | None
    judged_by: str

    @property
    def outcome(self) -> str:
        """How it came out, for a reader."""
        if self.recovery_time_s is None:
            return "not recovered"
        return f"recovered after {number_text(self.recovery_time_s)} s"


@dataclass(frozen=True)
class Metrics:
    """The numbers of a run; None where the record cannot show one.

    Attributes
    ----------
    settling_time_s : float or None
        Last instant before the first sudden disturbance at which the attitude error is not
        settled; 0 if there is none. None if the record begins late, when it was settled.
    error_after_settling_deadline : float or None
        Largest max_i |q_ev,i| from the deadline on, without the recoveries from sudden
        disturbances.
    terminal_error : float or None
        Largest max_i |q_ev,i| of the last part.
    max_rate_deg_s, max_rate_axis_deg_s : float or None
        Largest ‖ω_s‖ and largest component before the first sudden disturbance.
    max_applied_torque : float or None
        Largest component of the actuator torque [N·m].
    time_outside_attitude_envelope_s, time_outside_rate_envelope_s : float or None
        Time with a component of the law's own error beyond its envelope; None without one.
    time_pointing_outside_attitude_envelope_s : float or None
        Time with a component of the true attitude error beyond the law's envelope.
    error_from_deadline_with_recoveries : float or None
        Largest max_i |q_ev,i| from the deadline on.
    max_rate_whole_run_deg_s, max_rate_axis_whole_run_deg_s : float or None
        Largest ‖ω_s‖ and largest component of all.
    settled : bool or None
        Whether the attitude error is settled at the last instant before the first sudden
        disturbance: if not, there is no settling time yet.
    converged : bool or None
        Whether the attitude error stays settled over the last part.
    further : mapping of str to float
        ``time_outside_<bound>_s`` of the envelopes of other errors.
    disturbances : tuple of Disturbance
        The sudden disturbances, by start.
    spans : mapping of str to (float, float)
        Name of a number above to the part of the run that it is taken over [s].
    """

    settling_time_s: float | None
    error_after_settling_deadline: float | None
    terminal_error: float | None
    max_rate_deg_s: float | None
    max_rate_axis_deg_s: float | None
    max_applied_torque: float | None
    time_outside_attitude_envelope_s: float | None
    time_outside_rate_envelope_s: float | None
    time_pointing_outside_attitude_envelope_s: float | None
    error_from_deadline_with_recoveries: float | None
    max_rate_whole_run_deg_s: float | None
    max_rate_axis_whole_run_deg_s: float | None
    settled: bool | None
    converged: bool | None
    further: Mapping[str, float]
    disturbances: tuple[Disturbance, ...]
    spans: Mapping[str, Span]


@dataclass(frozen=True)
class ErrorSize:
    """One of the three attitude errors (`truth`), over a part of the run.

    Attributes
    ----------
    name, meaning : str
        Which error.
    max_deg, rms_deg : float or None
        Largest and root mean square of its angle [deg]; None if it is not known.
    span : (float, float)
        The part of the run [s].
    """

    name: str
    meaning: str
    max_deg: float | None
    rms_deg: float | None
    span: Span


@dataclass(frozen=True)
class Verdict:
    """The judgement of one run.

    Attributes
    ----------
    source : str
        Where the record comes from: the bag's path, or ``simulate``.
    controller : str
        Name of the control law.
    duration_s : float
        From the first instant to the last [s].
    steps : int
        Number of instants.
    missing_messages : int
        How many messages are missing.
    truth : str
        What stands for the truth: a key of `truth.STANDING`.
    requirements : tuple of Requirement
        Those that apply to this run.
    metrics : Metrics
        The numbers behind them.
    errors : tuple of ErrorSize
        Pointing, control and knowledge.
    required : Requirements
        What was asked for.
    changes : tuple of str
        Parameters that were changed in flight, each in a few words.
    faults : tuple of str
        Faults of the plant's hardware that acted, each in a few words.
    """

    source: str
    controller: str
    duration_s: float
    steps: int
    missing_messages: int
    truth: str
    requirements: tuple[Requirement, ...]
    metrics: Metrics
    errors: tuple[ErrorSize, ...]
    required: Requirements
    changes: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()

    @property
    def all_met(self) -> bool:
        """True if no requirement is judged and missed."""
        return all_met(self.requirements)

    @property
    def summary(self) -> str:
        """How many requirements came out how, in one line."""
        outcomes = [each.outcome for each in self.requirements]
        counts = [(outcomes.count(each), each) for each in (NOT_MET, NOT_JUDGED, MET)]
        told = ", ".join(f"{count} {outcome}" for count, outcome in counts if count)
        return f"{told} of {len(outcomes)} requirements"

    def to_json(self) -> dict[str, Any]:
        """Return the object that ``ppc_attitude analyse --json`` prints."""
        metrics = asdict(self.metrics)
        metrics |= metrics.pop("further")
        spans = {name: list(span) for name, span in metrics.pop("spans").items()}
        for disturbance in metrics["disturbances"]:
            disturbance["torque"] = list(disturbance["torque"])
        return {
            "bag": self.source,
            "controller": self.controller,
            "duration_s": self.duration_s,
            "steps": self.steps,
            "missing_messages": self.missing_messages,
            "requirements": [each.to_json() for each in self.requirements],
            "metrics": {**metrics, "disturbances": list(metrics["disturbances"]), "spans": spans},
            "errors": [{**asdict(each), "span": list(each.span)} for each in self.errors],
            "truth": self.truth,
            "required": self.required.to_json(),
            "changes": list(self.changes),
            "faults": list(self.faults),
        }


def verdict_table(verdict: Verdict) -> str:
    """Tell the verdict to a terminal: what was judged, a table of requirements, disturbances.

    The last line has no line break.
    """
    cells = [("requirement", "value", "limit", "judged [s]", "verdict")]
    cells += [
        (each.name, each.value_text, each.limit_text, each.span_text, each.outcome)
        for each in verdict.requirements
    ]
    name, value, limit, span, _ = (max(len(row[k]) for row in cells) for k in range(5))
    rows = [
        f"{row[0]:<{name}}  {row[1]:>{value}}  {row[2]:<{limit}}  {row[3]:<{span}}  {row[4]}"
        for row in cells
    ]
    lines = [
        f"{verdict.source}: controller {verdict.controller}, {verdict.duration_s:g} s, "
        f"{verdict.steps} instants, {verdict.missing_messages} missing messages",
        STANDING[verdict.truth],
        "",
        rows[0],
        "-" * max(len(row) for row in rows),
        *rows[1:],
    ]
    lines += [f"{each.name}: {each.note}" for each in verdict.requirements if each.note]
    kinds = verdict.errors[:1] if verdict.truth == EXACT else verdict.errors
    lines += [error_text(each) for each in kinds if each.max_deg is not None]
    lines += [disturbance_text(each) for each in verdict.metrics.disturbances]
    lines += [f"fault: {each}" for each in verdict.faults]
    if verdict.changes:
        shown, left = verdict.changes[:_MOST_CHANGES], len(verdict.changes) - _MOST_CHANGES
        more = (f"{left} more, all of them with --json",) if left > 0 else ()
        lines.append(f"parameters changed in flight: {'; '.join([*shown, *more])}")
    return "\n".join(lines)


def error_text(error: ErrorSize) -> str:
    """One of the three attitude errors in one line."""
    return (
        f"{error.name} error ({error.meaning}): at most {number_text(error.max_deg or 0.0)} deg, "
        f"{number_text(error.rms_deg or 0.0)} deg RMS, from {span_text(error.span)} s"
    )


def torque_text(disturbance: Disturbance) -> str:
    """Torque of a sudden disturbance [N·m], by component."""
    # It is a difference of torques: what rounding leaves of nothing is nothing.
    return ", ".join(number_text(round(each, 9) + 0.0) for each in disturbance.torque)


def disturbance_text(disturbance: Disturbance) -> str:
    """One sudden disturbance in one line."""
    return (
        f"sudden disturbance at {disturbance.start_s:g} s, ({torque_text(disturbance)}) N·m "
        f"for {disturbance.duration_s:g} s: {disturbance.outcome}, "
        f"judged by {disturbance.judged_by}"
    )


def change_text(told: ToldChange, zero_ns: int) -> str:
    """One parameter that was changed in flight, in a few words; time is zero at a stamp [ns]."""
    change, before = told
    old = "" if before is None else f"{before} → "
    since = f"{(change.stamp_ns - zero_ns) / 1e9:.9g}"
    return f"{change.node} {change.name} {old}{change.value} from {since} s on"


def number_text(value: float) -> str:
    """Write a number as a reader wants it: four digits."""
    return f"{value:.4g}"


def span_text(span: Span | None) -> str:
    """Write a part of a run for a reader."""
    return "–" if span is None else f"{span[0]:g} to {span[1]:g}"
