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

"""The judgement of a run by its requirements, from its record alone.

What is judged when
-------------------
Time counts from the first instant of the record. Attitude and rate are the truth (`truth`): the
pointing error decides, never what the controller says of itself. Its own errors and envelopes are
judged as its own. Every requirement that applies to a run is met, not met, or not judged; then the
verdict says why. T is the settling deadline and R the time allowed for a recovery.

- *Settling time* is judged unless a sudden disturbance or the end of the run comes before T.
- *Error from T on*: R after the start of a sudden disturbance is left out. It is the time allowed
  for the recovery, which has a requirement of its own.
- *Terminal error*: the last part of the run. As at the start, the scheme has T after a hit to reach
  the terminal accuracy; a run whose last part begins earlier is not judged by it.
- *Angular rate*: up to the first sudden disturbance. A hit adds rate that no actuator can prevent.
- *Envelopes* apply to a controller that has them. An attitude error must stay inside throughout,
  hits before T included: that is how these are judged. A rate error must stay inside until the
  first hit, and may be outside for a time after each, because a hit adds a hundred times the
  envelope's width within one sample. While the law is told no attitude nothing is known of its
  own errors, and that time is left out.
- *Recovery* applies to hits from T on. One that the next hit interrupts within R is judged with
  that one; one that the run's end interrupts within R is not judged.
- *Fuel* applies to a run with thrusters: the tank that the run began with must not become empty.
- *Refused orders* applies to a run with goals, holds or profiles: the reference ignores a refused
  order, so that no error shows it.
- *Keep-out* applies to a run with cones: the truth, so that the craft's error is in it.
- *Certificate*: time outside what the law's certificate promises, while its assumptions, as far as
  the record shows them, held; two samples after one was broken the promise begins anew.
- *Reported error*: what the controller reports against what follows from what it was told.
- *Knowledge*: what the controller was told against the truth, if the record has both: from T on
  within the limit that the requirements set, or else within what the configured noise explains.
- *Filter*: the share of knowledge errors outside the filter's own 3σ, the mean of its squared
  innovations, and the good fixes it refused (`filter_health`).
- *What is not on record* for more than ten steps is left out of errors, rate, envelopes, largest
  numbers, cones and certificate. If it is more than a tenth of a row's span, nobody knows that the
  limit is met; but any later sample tells of the fuel. Where it hides when the error settled, the
  time is told at most, and not judged if it hides on which side of the limit.
- *A limit that was changed in flight* is not that of the whole run: its row is not judged.
- *Messages missing or not finite*: those missing, those that carry a NaN, an infinity or a
  number beyond any craft's (1e30), and an attitude of zeros where it is desired or what the run is
  judged by. Such samples are skipped everywhere else. Of instants without a rhythm nobody knows
  that none is missing.
"""

from collections.abc import Iterator
from dataclasses import asdict
from functools import cached_property
from typing import Any

import numpy as np

from ppc_attitude.analysis.envelopes import Envelope, envelopes_of, outside
from ppc_attitude.analysis.faults import faults_of
from ppc_attitude.analysis.filter_health import judge_filter
from ppc_attitude.analysis.flight import judge_cones, judge_orders
from ppc_attitude.analysis.guarantee import judge_certificate
from ppc_attitude.analysis.hits import window
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.requirements import DEGREES, PAPER, Accuracy, Requirements, outside_names
from ppc_attitude.analysis.reserves import judge_actuators
from ppc_attitude.analysis.series import (
    Mask,
    absent_in,
    absent_spans,
    clipped,
    has,
    is_regular,
    largest,
    not_on_record,
    samples,
    span_text,
    zero_ns,
)
from ppc_attitude.analysis.truth import EXACT, RECORDED, lost, told_noise
from ppc_attitude.analysis.verdict import (
    MET,
    NOT_JUDGED,
    NOT_MET,
    Disturbance,
    ErrorSize,
    Requirement,
    number_text,
)
from ppc_attitude.contract.declared import ATTITUDE_ERROR, BY_COLUMN
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import APPLIED_TORQUE, ATTITUDE, ENABLED, PLANT, TRUE_ATTITUDE
from ppc_attitude.science.kinds import SENSORS
from ppc_attitude.science.stamps import instant

ROUNDING = 1e-9
"""Largest allowed difference of the reported attitude error from the one that we compute [1]."""
NO_RHYTHM = "the steps of the record vary, so nobody knows whether messages are missing"
NOISE_EXPLAINS = 8.0
"""Standard deviations per axis that a turn by noise never reaches: once in 1e13 samples."""


class Verdict(Measured):
    """One run, judged: the numbers of its record, and the requirements that apply to it.

    What the record lacks is not judged; the module's text says which requirement applies when.

    Raises
    ------
    AnalysisError
        If the record has no instant.
    """

    def __init__(self, record: RunRecord, required: Requirements = PAPER) -> None:
        super().__init__(record, required)
        self.requirements = tuple(self._requirements())

    @property
    def all_met(self) -> bool:
        """True if no requirement is judged and missed."""
        return all(each.met is not False for each in self.requirements)

    @property
    def summary(self) -> str:
        """How many requirements came out how, in one line."""
        outcomes = [each.outcome for each in self.requirements]
        counts = [(outcomes.count(each), each) for each in (NOT_MET, NOT_JUDGED, MET)]
        told = ", ".join(f"{count} {outcome}" for count, outcome in counts if count)
        return f"{told} of {len(outcomes)} requirements"

    @property
    def duration_s(self) -> float:
        """From the first instant to the last [s]."""
        return round(self.end - self.begin, 9)

    @cached_property
    def errors(self) -> tuple[ErrorSize, ...]:
        """Pointing, control and knowledge over the last part of the run."""
        sizes = []
        for name, meaning, errors in (
            ("pointing", "truth against reference", self.pointing),
            ("control", "estimate against reference", self.control),
            ("knowledge", "truth against estimate", self.knowledge),
        ):
            unknown = np.full(self.t.size, np.nan)
            angles = unknown if errors is None else np.rad2deg(errors.angles)
            without = clipped(absent_spans(self.record, np.isfinite(angles)), self.last_span)
            angles = angles[self.last & np.isfinite(angles)]
            most = rms = None
            if angles.size:
                most, rms = float(angles.max()), float(np.sqrt(np.mean(angles**2)))
            elif name == "knowledge" and self.truth.standing == EXACT:
                most = rms = 0.0
            sizes.append(ErrorSize(name, meaning, most, rms, self.last_span, without))
        return tuple(sizes)

    @property
    def faults(self) -> tuple[str, ...]:
        """Faults of the plant's hardware that acted, each in a few words."""
        return tuple(map(str, faults_of(self.record)))

    @property
    def change_rows(self) -> Iterator[tuple[str, str, str]]:
        """Time [s], node and description of each change in flight."""
        for change, before in self.record.told_changes:
            old = "" if before is None else f"{before} → "
            what = f"{change.name} {old}{change.value}"
            if change.name == ENABLED and change.value and before is not False:
                what = "begins anew"  # it was started again, or switched off and on between states
            yield instant((change.stamp_ns - zero_ns(self.record)) / 1e9), change.node, what

    @property
    def changes(self) -> tuple[str, ...]:
        """Parameters that were changed in flight, each in a few words."""
        return tuple(f"{node} {what} from {since} s on" for since, node, what in self.change_rows)

    def to_json(self) -> dict[str, Any]:
        """Return the object that ``ppc_attitude analyse --json`` prints."""
        metrics = asdict(self.metrics)
        metrics |= metrics.pop("further")
        spans = metrics.pop("spans")
        return {
            "bag": self.record.source,
            "controller": self.record.controller,
            "duration_s": self.duration_s,
            "steps": self.t.size,
            "missing_messages": self.record.missing_messages,
            "warnings": list(self.record.warnings),
            "requirements": [each.to_json() for each in self.requirements],
            "metrics": {**metrics, "spans": spans},
            "errors": [asdict(each) for each in self.errors],
            "truth": self.truth.standing,
            "required": self.required.to_json(),
            "changes": list(self.changes),
            "faults": list(self.faults),
        }

    def _requirements(self) -> Iterator[Requirement]:
        required = self.required
        yield self._settling()
        yield self._after_deadline()
        if required.terminal is not None:
            yield self._terminal(required.terminal)
        if required.rate is not None:
            why = self.lacks_calm
            rate = self.metrics.max_rate_deg_s
            note = self._whole_run(rate, self.metrics.max_rate_whole_run_deg_s, "deg/s")
            row = ("rate", rate, required.rate, "deg/s", why, self.rate_spans[0])
            yield self.row(*row, note=note, columns=(self.truth.angular_velocity,))
        if required.torque is not None:
            why = self.lacks_torque_limit
            yield self._column("applied_torque", APPLIED_TORQUE.column, self.torque_limit, why)
        for envelope in envelopes_of(self.record).values():
            yield from self._inside(envelope)
        late = [hit for hit in self.hits if hit.start_s >= required.settling_deadline]
        if late:
            yield self._recovered(late)
        for column, limit in required.limits.items():
            yield self._column(f"limit_{column}", column, limit)
        yield from judge_actuators(self)
        yield from judge_orders(self)
        yield from judge_cones(self)
        yield from judge_certificate(self)
        yield from self._reported()
        yield from self._knowledge()
        yield from judge_filter(self)
        missing = float(lost(self.record))
        why = "" if missing or is_regular(self.record) else NO_RHYTHM
        yield self.row("lost_messages", missing, 0.0, why=why)

    @staticmethod
    def _whole_run(judged: float | None, whole: float | None, unit: str) -> str:
        """Tell the number of the whole run beside the one that is judged, where they differ."""
        told = whole is not None and whole != judged
        return f"over the whole run {number_text(whole or 0.0)} {unit}" if told else ""

    def _settling(self) -> Requirement:
        deadline, (_, until) = self.required.settling_deadline, self.calm_span
        value, settled = self.metrics.settling_time_s, self.metrics.settled
        why, note = self.lacks_settled, ""
        if self.first_hit < deadline:
            hit = f"a sudden disturbance at {instant(until)} s"
            why = f"{hit} comes before the deadline of {deadline:g} s"
        if settled is False:
            note = f"still not settled at {instant(until)} s"
            if (value or 0.0) < deadline:
                why = why or f"a sudden disturbance came when the craft was {note}"
        elif settled and value is None:
            value = self.known_from
            note = "at most: it was settled when the record of the error begins"
            if value >= deadline:
                late = f"the record of the error begins at {instant(value)} s, after the deadline"
                why = why or late
        if value is not None and (unseen := self.hidden.get(None)):
            note = f"at most: {not_on_record(unseen)}"
            if unseen[0] < deadline <= value:  # the error may have settled on either side of it
                why = why or not_on_record(unseen)
        key, span, since = "settling_time", self.calm_span, (value or 0.0, self.end)
        absent = clipped(self.absent, since)
        return self.row(key, value, deadline, "s", why, span, strict=True, note=note, absent=absent)

    def _after_deadline(self) -> Requirement:
        accuracy, why = self.required.settled, self.lacks_settled
        span = self.span_from_deadline
        if not why and not self.settled.any():
            within = f"{self.required.recovery:g} s of a sudden disturbance"
            why = f"every instant from {span_text(span)} s is within {within}"
        return self.row(
            "error_after_deadline",
            largest(self.size(accuracy), self.settled),
            accuracy.limit,
            accuracy.unit,
            why,
            span,
            strict=True,
            without=self.recoveries,
            absent=self.absent,
        )

    def _terminal(self, accuracy: Accuracy) -> Requirement:
        last, deadline = self.required.terminal_window, self.required.settling_deadline
        hit = f"the sudden disturbance at {instant(self.last_hit)} s"
        start = hit if self.last_hit else "the start"
        what = f"{last:g} s that begin {deadline:g} s after {start} are over"
        begins = ""
        if self.shorter_than_window:
            late = f"the record of the error begins at {instant(self.known_from)} s"
            begins = f"{late}, within the last {last:g} s"
        return self.row(
            "terminal_error",
            largest(self.size(accuracy), self.last),
            accuracy.limit,
            accuracy.unit,
            self.lacks_attitude or self.ends_before(self.terminal_from, what) or begins,
            self.last_span,
            strict=True,
            absent=self.absent,
        )

    def _column(self, key: str, column: str, limit: float, why: str = "") -> Requirement:
        """Judge the largest number of a column over the whole run, unless a reason is given."""
        unit = BY_COLUMN[column].unit if column in BY_COLUMN else ""
        value, why = self.largest_of(column), self.lacks(column) or why
        rare = column in self.record.held or (column in BY_COLUMN and BY_COLUMN[column].late)
        columns = () if rare else (column,)
        return self.row(key, value, limit, "" if unit == "1" else unit, why, columns=columns)

    def _inside(self, envelope: Envelope) -> Iterator[Requirement]:
        """Judge the time of the law's own error outside its envelope."""
        beyond, (key, *after_hit) = outside(self.record, envelope), outside_names(envelope)
        time, span, why = self.time(beyond), self.whole, self.lacks_time
        if envelope.jumps:
            time, span, why = self.time(beyond & self.calm), self.calm_span, why or self.lacks_calm
        note = self._whole_run(time, self.time(beyond), "s")
        without = tuple(each for each in self.untold if each[0] < span[1])
        if (span,) == without:
            why = why or f"the law was told no attitude from {span_text(span)} s"
        own = absent_in(self.record, envelope.error, envelope.bound)
        absent = tuple(each for each in own if not any(clipped(self.untold, each)))
        yield self.row(key, time, 0.0, "s", why, span, without=without, note=note, absent=absent)
        limit = self.required.outside_after_hit
        if envelope.jumps and self.hits and limit is not None:
            longest = max(self.time(beyond & window(self.t, hit, self.hits)) for hit in self.hits)
            yield self.row(after_hit[0], longest, limit, "s", span=(self.first_hit, self.end))

    def _recovered(self, hits: list[Disturbance]) -> Requirement:
        """Judge the slowest recovery from the hits that are judged by it."""
        limit, span, note = self.required.recovery, (hits[0].start_s, self.end), ""
        slowest, why, never, unknown = None, self.lacks_attitude, "", ""
        for hit, following in zip(hits, [*hits[1:], None], strict=True):
            stop = min(following.start_s if following else np.inf, self.known_until)
            time = round(stop - hit.start_s, 9)
            # Before the end the error of a hit that has just come may still grow.
            cut = following is None and time < limit
            taken, unseen = hit.recovery_time_s, self.hidden.get(hit.start_s)
            if hides := "" if cut else self._hides(hit, stop):
                unknown = hides
            elif taken is not None and not cut:
                if slowest is None or taken > slowest:
                    note = f"at most: {not_on_record(unseen)}" if unseen else ""
                slowest = max(taken, slowest or 0.0)
            elif time > limit:
                never = f"not recovered from the sudden disturbance at {instant(hit.start_s)} s"
            elif following is None and not never and (slowest or 0.0) <= limit:
                after = f"after the sudden disturbance at {instant(hit.start_s)} s are over"
                why = why or f"{self.ending}, before the {limit:g} s {after}"
        if unknown and not never and (slowest or 0.0) <= limit:
            why = why or unknown
        if never and not why:
            name = self.names["recovery"]
            return Requirement("recovery", name, None, limit, "s", False, span, reason=never)
        return self.row("recovery", slowest, limit, "s", why, span, note=note)

    def _hides(self, hit: Disturbance, stop: float) -> str:
        """Why it is not known whether the craft recovered in time; empty if it is.

        Without a time of recovery nothing up to the stop [s] may follow what is not on record.
        """
        end, unseen = hit.start_s + self.required.recovery, self.hidden.get(hit.start_s)
        gaps = [each for each in self.absent if each[1] >= stop]
        if hit.recovery_time_s is not None:
            gaps = [unseen] if unseen else []
        hiding = (each for each in gaps if each[0] < end < stop and end < each[1])
        return "".join(map(not_on_record, hiding))

    def _reported(self) -> Iterator[Requirement]:
        """Compare the reported error with the one that we compute; q_e and −q_e are the same."""
        told = self.control
        if told is None or not has(self.record, ATTITUDE_ERROR.column):
            return
        reported, computed = samples(self.record, ATTITUDE_ERROR.column), told.quaternions
        apart = np.maximum.reduce(np.abs(reported - computed).T)
        if not (apart < 0.5).all():  # else the opposite of a unit quaternion is farther away
            apart = np.minimum(apart, np.maximum.reduce(np.abs(reported + computed).T))
        columns = (ATTITUDE_ERROR.column, ATTITUDE.column)
        yield self.row("reported_error", largest(apart), ROUNDING, columns=columns)

    def _knowledge(self) -> Iterator[Requirement]:
        """Judge the knowledge error, from T on by the requirement, or else by the known noise."""
        accuracy, columns = self.required.knowledge, (TRUE_ATTITUDE.column, ATTITUDE.column)
        why, span = self.lacks(*columns), self.span_from_deadline
        where: Mask | slice = self.from_deadline
        if accuracy is not None:
            why = why or self.ends_before(self.required.settling_deadline, "the settling deadline")
        else:
            sensors, noise = SENSORS.selected(self.plant), told_noise(self.record.parameters)
            if self.truth.standing != RECORDED or sensors is None or not noise:
                return
            accuracy = Accuracy(float(np.rad2deg(NOISE_EXPLAINS * noise)), DEGREES)
            stretches = self.record.stretches(self.record.changes)
            if any(told_noise(told) != noise for _, told in stretches):
                why = why or self.changed(PLANT, *sensors.defaults)
            where, span = slice(None), self.whole
        value = largest(self.knowledge.in_unit_of(accuracy), where) if self.knowledge else None
        if self.truth.standing == EXACT:
            value, why = 0.0, ""
        absent = absent_in(self.record, *columns) if self.knowledge else ()
        row = ("knowledge", value, accuracy.limit, accuracy.unit, why, span)
        untold = clipped(self.untold, span)
        yield self.row(*row, strict=True, without=untold, absent=absent)
