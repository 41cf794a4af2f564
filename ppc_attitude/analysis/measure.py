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

"""The numbers of a run, from its record: what they are taken over, and what the record lacks."""

from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np

from ppc_attitude.analysis.envelopes import Envelope, beyond, bound_of, envelopes_of, outside
from ppc_attitude.analysis.hits import Pulse, pulses_of, window
from ppc_attitude.analysis.requirements import (
    PAPER,
    Accuracy,
    Requirements,
    component_size,
    names_of,
)
from ppc_attitude.analysis.series import (
    Mask,
    Span,
    absent_in,
    absent_spans,
    clipped,
    elapsed,
    has,
    known,
    known_span,
    lacks_too_much,
    largest,
    lasting,
    samples,
    span_text,
    topic_of,
    vectors,
)
from ppc_attitude.analysis.truth import (
    Errors,
    control_errors,
    knowledge_errors,
    pointing_errors,
    truth_of,
)
from ppc_attitude.analysis.verdict import Disturbance, Metrics, Requirement
from ppc_attitude.contract.cdr import LARGEST
from ppc_attitude.contract.declared import ATTITUDE_ERROR, BY_COLUMN, RATE_ERROR
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import (
    APPLIED_TORQUE,
    ATTITUDE,
    CONTROLLER,
    PLANT,
    REFERENCE_ATTITUDE,
)
from ppc_attitude.science.component import FIX, GYRO, MOTION, QUATERNION
from ppc_attitude.science.kinds import ACTUATORS
from ppc_attitude.science.parameter import NodeParameters
from ppc_attitude.science.stamps import instant

PAPER_TORQUE_LIMIT = 0.05
"""Torque limit on an axis [N·m], if the record does not say."""
_NAMED = {
    ATTITUDE_ERROR.column: "time_outside_attitude_envelope_s",
    RATE_ERROR.column: "time_outside_rate_envelope_s",
}
"""Errors whose time outside is a metric of its own, whatever bounds them."""
_THREE = (QUATERNION, GYRO, FIX, MOTION)
"""Forms of a column whose w and variances are no magnitude: −1 says that there is no sample."""
SUMMATION = 1e-12
"""Share of a limit by which rounding may take a number, such as a sum of wheel torques, past it."""


def metric_of(envelope: Envelope) -> str:
    """Name of the metric that is the time outside an envelope."""
    return _NAMED.get(envelope.error, f"time_outside_{envelope.bound}_s")


class Measured:
    """The numbers of one run, for a judgement by what is required.

    Its sudden disturbances are found in the record, unless they are known.
    """

    def __init__(
        self,
        record: RunRecord,
        required: Requirements = PAPER,
        known_pulses: tuple[Pulse, ...] | None = None,
    ) -> None:
        self.record, self.required = record, required
        self.names = names_of(required)
        self.t = elapsed(record)
        self.begin, self.end = float(self.t[0]), float(self.t[-1])
        self.whole = (self.begin, self.end)
        self.truth = truth = truth_of(record)
        self.pointing = known(pointing_errors, record)
        self.control = known(control_errors, record)
        self.plant = record.parameters.get(PLANT, {})
        self._actuator = ACTUATORS.selected(self.plant)
        size = self.size(required.settled)
        self.known_from, self.known_until = known_span(self.t, size) or self.whole
        self.absent = absent_spans(record, np.isfinite(size))
        # What is not on record and hides when the error settled: at first, and after a hit's start.
        self.hidden: dict[float | None, Span] = {}
        self.lacks_attitude = self.lacks(truth.attitude, REFERENCE_ATTITUDE.column)
        self.lacks_rate = self.lacks(truth.angular_velocity)
        if self.lacks_rate:
            self.rate: Array = np.full((self.t.size, 3), np.nan)
        else:
            self.rate = np.rad2deg(vectors(record, truth.angular_velocity))
        pulses = known_pulses
        if pulses is None:
            pulses = pulses_of(record, self._limit_of(record.parameters))
        self.first_hit = pulses[0].start_s if pulses else np.inf
        self.calm = self.t < self.first_hit
        self.calm_span = (self.begin, min(self.first_hit, self.end))
        stays = any(not each.jumps for each in envelopes_of(record).values())
        early = "the envelope" if stays else "nothing"
        self.hits = tuple(
            Disturbance(
                **vars(pulse),
                recovery_time_s=self._recovery(pulse, pulses),
                judged_by="recovery" if pulse.start_s >= required.settling_deadline else early,
            )
            for pulse in pulses
        )
        recoveries = [(hit.start_s, round(hit.start_s + required.recovery, 9)) for hit in self.hits]
        self.recoveries = tuple(
            (start, min(end, self.end))
            for start, end in recoveries
            if end >= required.settling_deadline
        )
        self.from_deadline = self.t >= required.settling_deadline
        self.settled = self.from_deadline.copy()
        for start, end in self.recoveries:
            self.settled &= (self.t < start) | (self.t > end)
        self.last_hit = max((hit.start_s for hit in self.hits), default=0.0)
        # As at the start, the scheme has the deadline after a hit to reach the terminal accuracy.
        self.terminal_from = round(
            self.last_hit + required.settling_deadline + required.terminal_window, 9
        )
        self.last_span = (max(self.end - required.terminal_window, self.known_from), self.end)
        self.last = self.t >= np.round(self.end - required.terminal_window, 9)

    def lacks(self, *columns: str) -> str:
        """Why something cannot be judged: the topics that the record lacks; empty if none."""
        lacking = [topic_of(each) for each in columns if not has(self.record, each)]
        return f"no topic {' and no topic '.join(lacking)} in the bag" if lacking else ""

    @property
    def ending(self) -> str:
        """Say where the run ends, or the attitude error before it."""
        whole = self.known_until == self.end
        ends = "the run ends at" if whole else "no attitude error is known after"
        return f"{ends} {instant(self.known_until)} s"

    def ends_before(self, needed: float, what: str) -> str:
        """Why an error that ends before some time [s] does not show it; empty if it does."""
        return f"{self.ending}, before {what}" if self.known_until < needed else ""

    @property
    def lacks_time(self) -> str:
        """Why no time can be told; empty if one can."""
        return "the record has one instant, which has no duration" if self.t.size < 2 else ""

    @property
    def lacks_settled(self) -> str:
        """Why the run shows nothing of what comes after the deadline; empty if it does."""
        deadline = self.required.settling_deadline
        return self.lacks_attitude or self.ends_before(deadline, f"the deadline of {deadline:g} s")

    @property
    def lacks_calm(self) -> str:
        """Why nothing is before the first sudden disturbance; empty if something is."""
        never = self.first_hit <= self.begin
        return "a sudden disturbance acts from the first instant on" if never else ""

    @property
    def span_from_deadline(self) -> Span:
        """What is known of the attitude error from the settling deadline on [s]."""
        return (max(self.required.settling_deadline, self.known_from), self.end)

    @property
    def rate_spans(self) -> tuple[Span, Span]:
        """What is known of the rate before the first sudden disturbance, and in all [s]."""
        start, calm = (known_span(self.t, self.rate[:, 0]) or self.whole)[0], self.calm_span
        return (start, calm[1]) if start < calm[1] else calm, (start, self.end)

    def unseen(self, last: float, until: float = 0.0) -> Span | None:
        """What is not on record from the last instant [s] of some error on, or before another.

        Nobody knows when in there the error has settled.
        """
        gaps = (each for each in self.absent if each[1] <= self.known_until)
        found = (each for each in gaps if each[0] <= max(last, until) and each[1] > last)
        return max(found, default=None)

    @property
    def shorter_than_window(self) -> bool:
        """Whether the error is known for less than the last part of which it is asked for."""
        return round(self.end - self.known_from, 9) < self.required.terminal_window

    @cached_property
    def knowledge(self) -> Errors | None:
        """Knowledge errors, if the record has both the truth and what the controller was told."""
        return known(knowledge_errors, self.record)

    @cached_property
    def untold(self) -> tuple[Span, ...]:
        """Parts of the run in which the law was told no attitude: it holds what it said last."""
        if not has(self.record, ATTITUDE.column):
            return ()
        lacks = ~np.logical_or.reduce(self.record[ATTITUDE.column].T)
        if not lacks.any():
            return ()
        edges = np.flatnonzero(np.diff(lacks, prepend=False, append=False))
        times = np.append(self.t, self.end)[edges].reshape(-1, 2)
        return tuple((start, end) for start, end in times.tolist())

    def changed(self, node: str, *names: str) -> str:
        """Why no one limit holds for the whole run: the parameter that was changed in flight."""
        changed = {change.name for change in self.record.changes if change.node == node}
        found = changed.intersection(names)
        return f"{min(found)} was changed in flight" if found else ""

    def row(
        self,
        key: str,
        value: float | None,
        limit: float,
        unit: str = "",
        why: str = "",
        span: Span | None = None,
        *,
        strict: bool = False,
        without: tuple[Span, ...] = (),
        note: str = "",
        columns: tuple[str, ...] = (),
        absent: tuple[Span, ...] = (),
    ) -> Requirement:
        """Compare a value with its limit, unless `why` says why not; the default span is the run.

        It is taken from columns that the record must have. What is absent of them in the span, or
        said to be, is left out; if it is much, a limit that seems met is not judged.
        """
        span, name = span or self.whole, self.names[key]
        why = self.lacks(*columns) or why
        met = None
        if value is None:
            why = why or f"there is no finite sample from {span_text(span)} s"
        elif not why:
            met = value < limit if strict else value <= limit * (1.0 + SUMMATION)
            if columns:
                absent = absent or absent_in(self.record, *columns)
            why = lacks_too_much(absent, span) if met else ""
        if why:
            return Requirement(key, name, None, limit, unit, None, None, strict, why)
        without = tuple(sorted((*without, *clipped(absent, span))))
        return Requirement(key, name, value, limit, unit, met, span, strict, note, without)

    def size(self, accuracy: Accuracy) -> Array:
        """Pointing error in the unit of a limit, shape (n,); NaN where it is not known."""
        if self.pointing is None:
            return np.full(self.t.size, np.nan)
        return self.pointing.in_unit_of(accuracy)

    def _recovery(self, pulse: Pulse, pulses: tuple[Pulse, ...]) -> float | None:
        """`Disturbance.recovery_time_s` of one pulse."""
        error, limit = self.size(self.required.settled), self.required.settled.limit
        after = np.flatnonzero(window(self.t, pulse, pulses) & np.isfinite(error))
        if after.size == 0 or error[after[-1]] >= limit:
            return None
        since = np.round(self.t - pulse.start_s, 9)  # in whole nanoseconds: 90 s − 80 s is 10 s
        above = after[error[after] >= limit]
        last = float(self.t[above[-1]]) if above.size else pulse.start_s
        if unseen := self.unseen(last, pulse.start_s + pulse.duration_s):
            if unseen[1] > self.t[after[-1]]:
                return None
            self.hidden[pulse.start_s] = unseen
            return round(unseen[1] - pulse.start_s, 9)
        if above.size:
            return float(since[above[-1]])
        # Before the end the error of a hit that has just come may still grow.
        ends = self.t[after[-1]] == self.known_until
        return None if ends and since[after[-1]] < self.required.recovery else 0.0

    @cached_property
    def outsides(self) -> dict[Envelope, float]:
        """Time outside [s] each envelope that the run has; none of a run of one instant."""
        found = {} if self.lacks_time else envelopes_of(self.record)
        return {each: self.time(outside(self.record, each)) for each in found.values()}

    @cached_property
    def metrics(self) -> Metrics:
        """Everything that is measured."""
        deadline = self.span_from_deadline
        outsides = {metric_of(each): time for each, time in self.outsides.items()}
        sizes = None if self.pointing is None else self.pointing.sizes
        size, limit = self.size(self.required.settled), self.required.settled.limit
        unsettled = np.flatnonzero(self.calm & (size >= limit))
        settling: float | None = None
        if unsettled.size:
            settling = float(self.t[unsettled[-1]])
            if unseen := self.unseen(settling):
                settling, self.hidden[None] = unseen[1], unseen
        elif not self.known_from and np.isfinite(size[self.calm]).any():
            settling = 0.0
        norm, axis = np.sqrt(np.square(self.rate).T.sum(axis=0)), component_size(self.rate)
        calm_span, whole = self.rate_spans
        measured: dict[str, tuple[float | None, Span]] = {
            "settling_time_s": (settling, self.calm_span),
            "error_after_settling_deadline": (largest(sizes, self.settled), deadline),
            "terminal_error": (
                None if self.shorter_than_window else largest(sizes, self.last),
                self.last_span,
            ),
            "max_rate_deg_s": (largest(norm, self.calm), calm_span),
            "max_rate_axis_deg_s": (largest(axis, self.calm), calm_span),
            "max_applied_torque": (self.largest_of(APPLIED_TORQUE.column), self.whole),
            **{name: (outsides.pop(name, None), self.whole) for name in _NAMED.values()},
            "time_pointing_outside_attitude_envelope_s": (self._pointing_outside(), self.whole),
            "error_from_deadline_with_recoveries": (largest(sizes, self.from_deadline), deadline),
            "max_rate_whole_run_deg_s": (largest(norm), whole),
            "max_rate_axis_whole_run_deg_s": (largest(axis), whole),
        }
        values: dict[str, Any] = {name: value for name, (value, _) in measured.items()}
        spans = {name: span for name, (value, span) in measured.items() if value is not None}
        worst = largest(size, self.last) if values["terminal_error"] is not None else None
        calm = size[self.calm & np.isfinite(size)]
        return Metrics(
            **values,
            settled=bool(calm[-1] < limit) if calm.size else None,
            converged=None if worst is None else worst < limit,
            further=outsides,
            disturbances=self.hits,
            spans=spans,
        )

    def largest_of(self, column: str) -> float | None:
        """Largest magnitude of a number of a column, of some only the first three (`_THREE`).

        None if the record has no such number.
        """
        if not has(self.record, column):
            return None
        width = 3 if column in BY_COLUMN and BY_COLUMN[column].form in _THREE else None
        return largest(np.abs(samples(self.record, column)[:, :width]))

    @property
    def torque_limit(self) -> float:
        """Limit on an axis [N·m]: as required, else that of the actuator."""
        required = self.required.torque
        if isinstance(required, int | float):
            return float(required)
        return self._limit_of(self.record.parameters)

    @property
    def torque_limits(self) -> Array:
        """`torque_limit` at each instant, shape (n,): that of an actuator may change in flight."""
        limits = np.full(self.t.size, self.torque_limit)
        if self.lacks_torque_limit:
            for part, told in self.record.stretches(self.record.changes):
                limits[part] = self._limit_of(told)
        return limits

    def _limit_of(self, parameters: NodeParameters) -> float:
        """What the actuator gives on an axis [N·m]: as configured, as required, or the paper's."""
        torques = None
        with suppress(KeyError, TypeError, ValueError, OverflowError):  # a bag may hold anything
            torques = self._actuator.torques(parameters[PLANT]) if self._actuator else None
        # With a plant that is not ours, only the controller's parameters tell of the actuator.
        told = parameters.get(CONTROLLER, {}).get("max_torque")
        limits = (torques and torques[1], told, self.required.torque, PAPER_TORQUE_LIMIT)
        numbers = (each for each in limits if isinstance(each, int | float))
        return next(float(each) for each in numbers if 0.0 < each <= LARGEST)

    @property
    def lacks_torque_limit(self) -> str:
        """Why no one limit of the actuator is known; empty if it is, or one is required."""
        if isinstance(self.required.torque, int | float):
            return ""
        if self._actuator is None:
            return f"{ACTUATORS.selector} = {self.plant[ACTUATORS.selector]} is not installed here"
        return self.changed(PLANT, ACTUATORS.selector, *self._actuator.limits)

    def _pointing_outside(self) -> float | None:
        """Time of the true attitude error beyond the law's envelope; its own may be inside [s]."""
        name = bound_of(self.record, ATTITUDE_ERROR.column)
        if self.pointing is None or not has(self.record, name) or self.lacks_time:
            return None
        bound = self.record[name]
        return self.time(beyond(self.pointing.quaternions[:, : bound.shape[1]], bound))

    def time(self, instants: Mask) -> float:
        """How long some instants, shape (n,), last together [s]."""
        return round(float(lasting(self.record)[instants].sum()), 9) if instants.any() else 0.0
