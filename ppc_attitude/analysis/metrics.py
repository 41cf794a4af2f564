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

"""The judgement of a run by the paper's requirements, from its record alone.

What is judged when
-------------------
Time counts from the first instant of the record. A run is judged by every requirement that applies
to it; one that applies but that the record cannot show (a run shorter than the 60 s deadline, say)
has the value None and is not met: a verdict never claims what was not seen.

- *Settling time* applies unless a sudden disturbance comes before the deadline, which leaves no
  undisturbed settling to judge; the error from 60 s on is judged in any case.
- *Error from 60 s on*: the 10 s after the start of a sudden disturbance are left out. They are the
  time allowed for its recovery, which has its own requirement.
- *Terminal error*: the last 20 s; a run shorter than that does not show it. After a hit the scheme
  has as long as at the start, 60 s, to reach the terminal accuracy: a run whose last 20 s begin
  earlier is judged by recovery, and its terminal error is a metric only.
- *Angular rate*: up to the first sudden disturbance. A hit adds rate that no actuator can prevent.
- *Envelopes* apply to a controller that has them. The attitude error must stay inside throughout,
  hits before the deadline included: that is how these are judged. The rate error must stay inside
  until the first hit, and may be outside for 0.5 s a hit after it, because a hit adds a hundred
  times the envelope's width within one sample.
- *Recovery* applies to hits from the deadline on. One that the next hit interrupts within the 10 s
  allowed is judged with that one.
- *Messages missing or not finite*: those missing and those that carry a NaN or an infinity. Such
  samples are skipped everywhere else.
"""

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.analysis.pulses import Pulse, find_pulses
from ppc_attitude.analysis.series import (
    AnalysisError,
    attitude_errors,
    elapsed,
    finite,
    has,
    step,
    vectors,
)
from ppc_attitude.analysis.verdict import Disturbance, Metrics, Requirement, Verdict, verdict_table
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE_ENVELOPE,
    BY_COLUMN,
    DISTURBANCE,
    PLANT,
    RATE_ENVELOPE,
    RATE_ERROR,
)

__all__ = [
    "AnalysisError",
    "analyse",
    "disturbances_of",
    "pulses_of",
    "torque_limit",
    "verdict_table",
]

SETTLED = 5e-3
"""max_i |q_ev,i| below which the attitude has settled [1]."""
SETTLING_DEADLINE = 60.0
"""When it must have settled [s]."""
TERMINAL_LIMIT = 5e-4
"""What max_i |q_ev,i| must stay below at the end [1]."""
TERMINAL_WINDOW = 20.0
"""How long the end is [s]."""
RATE_LIMIT_DEG = 3.0
"""What ‖ω_s‖ may reach [deg/s]."""
PAPER_TORQUE_LIMIT = 0.05
"""What the actuator gives on an axis, if the record does not say [N·m]."""
RECOVERY_LIMIT = 10.0
"""How long the recovery from a sudden disturbance may take [s]."""
OUTSIDE_LIMIT_PER_HIT = 0.5
"""How long a sudden disturbance may put the rate error outside its envelope [s]."""

SETTLING_TIME = "settling time"
ERROR_AFTER_DEADLINE = f"attitude error from {SETTLING_DEADLINE:g} s on"
TERMINAL_ERROR = f"attitude error in the last {TERMINAL_WINDOW:g} s"
RATE = "angular rate (norm)"
APPLIED = "applied torque on an axis"
ATTITUDE_OUTSIDE = "attitude error outside its envelope"
RATE_OUTSIDE = "rate error outside its envelope"
RATE_OUTSIDE_AFTER_HIT = "rate error outside its envelope, a hit"
RECOVERY = "recovery from a sudden disturbance"
LOST = "messages missing or not finite"
REQUIREMENTS = (
    SETTLING_TIME,
    ERROR_AFTER_DEADLINE,
    TERMINAL_ERROR,
    RATE,
    APPLIED,
    ATTITUDE_OUTSIDE,
    RATE_OUTSIDE,
    RATE_OUTSIDE_AFTER_HIT,
    RECOVERY,
    LOST,
)
"""Names of all requirements, in the order of a verdict; a run is judged by those that apply."""

Mask = NDArray[np.bool_]


def analyse(record: RunRecord) -> Verdict:
    """Judge a run by the paper's requirements.

    Parameters
    ----------
    record : RunRecord
        The run. It needs angular velocity, applied torque and the attitude error (or attitude and
        reference attitude); envelopes and disturbance are judged where it has them.

    Returns
    -------
    Verdict
        Requirements and metrics; the module's text says which apply when.

    Raises
    ------
    AnalysisError
        If the record has no instant, or no finite sample of a needed quantity.
    """
    t = elapsed(record)
    h = step(t)
    errors = attitude_errors(record)
    error = _magnitude(errors)
    hits = _disturbances(t, error, pulses_of(record))
    attitude_outside, rate_outside = _outside_attitude(record, errors), _outside_rate(record)
    metrics = Metrics(
        **_attitude_metrics(t, error, hits),
        **_rate_metrics(t, vectors(record, ANGULAR_VELOCITY.column), hits),
        max_applied_torque=float(np.nanmax(np.abs(vectors(record, APPLIED_TORQUE.column)))),
        time_outside_attitude_envelope_s=_time(attitude_outside, h),
        time_outside_rate_envelope_s=_time(rate_outside, h),
        disturbances=hits,
    )
    return Verdict(
        source=record.source,
        controller=record.controller,
        duration_s=float(t[-1]),
        steps=int(t.size),
        missing_messages=record.missing_messages,
        requirements=tuple(_requirements(record, t, h, metrics, rate_outside)),
        metrics=metrics,
    )


def disturbances_of(record: RunRecord) -> tuple[Disturbance, ...]:
    """Find the sudden disturbances of a run and the recovery from each.

    Parameters
    ----------
    record : RunRecord
        The run; without a recorded disturbance it has none.

    Returns
    -------
    tuple of Disturbance
        By start.

    Raises
    ------
    AnalysisError
        If the record has no instant, or hits but no attitude error.
    """
    pulses = pulses_of(record)
    if not pulses:
        return ()
    return _disturbances(elapsed(record), _magnitude(attitude_errors(record)), pulses)


def pulses_of(record: RunRecord) -> tuple[Pulse, ...]:
    """Find the sudden disturbances of a run, by start; none where none is recorded.

    Raises
    ------
    AnalysisError
        If the record has no instant.
    """
    t = elapsed(record)
    if not has(record, DISTURBANCE.column):
        return ()
    return find_pulses(t, vectors(record, DISTURBANCE.column))


def _disturbances(t: Array, error: Array, pulses: tuple[Pulse, ...]) -> tuple[Disturbance, ...]:
    """Add to each pulse the recovery of the error, shape (n,), from it."""
    return tuple(
        Disturbance(
            pulse.start_s, pulse.duration_s, pulse.torque, _recovery(t, error, pulse, pulses)
        )
        for pulse in pulses
    )


def torque_limit(record: RunRecord) -> float:
    """Limit of the actuator on an axis [N·m]: as the run was configured, else the paper's."""
    limit = record.parameters.get(PLANT, {}).get("max_torque")
    return float(limit) if isinstance(limit, int | float) else PAPER_TORQUE_LIMIT


def _attitude_metrics(
    t: Array, error: Array, hits: tuple[Disturbance, ...]
) -> dict[str, float | None]:
    """Measure the attitude error, shape (n,)."""
    undisturbed = t < _first(hits)
    unsettled = np.flatnonzero(undisturbed & (error >= SETTLED))
    settling = float(t[unsettled[-1]]) if unsettled.size else 0.0
    judged = t >= SETTLING_DEADLINE
    for hit in hits:
        judged &= ~((t >= hit.start_s) & (_since(t, hit.start_s) <= RECOVERY_LIMIT))
    end = t >= np.round(t[-1] - TERMINAL_WINDOW, 9)
    return {
        "settling_time_s": settling if np.isfinite(error[undisturbed]).any() else None,
        "error_after_settling_deadline": _largest(error[judged]),
        "terminal_error": _largest(error[end]) if t[-1] >= TERMINAL_WINDOW else None,
    }


def _rate_metrics(t: Array, rate: Array, hits: tuple[Disturbance, ...]) -> dict[str, float | None]:
    """Largest norm and component of the angular velocity before the first hit."""
    undisturbed = np.rad2deg(rate[: np.searchsorted(t, _first(hits))])
    return {
        "max_rate_deg_s": _largest(np.linalg.norm(undisturbed, axis=1)),
        "max_rate_axis_deg_s": _largest(np.abs(undisturbed)),
    }


def _requirements(
    record: RunRecord, t: Array, h: float, metrics: Metrics, rate_outside: Mask | None
) -> list[Requirement]:
    """Judge the requirements that apply to the run; h is the time between two samples [s]."""
    judged = Requirement.judged
    hits = metrics.disturbances
    rows = []
    if _first(hits) >= SETTLING_DEADLINE:
        settling = metrics.settling_time_s if t[-1] >= SETTLING_DEADLINE else None
        rows.append(judged(SETTLING_TIME, settling, SETTLING_DEADLINE, "s", strict=True))
    after = metrics.error_after_settling_deadline
    rows.append(judged(ERROR_AFTER_DEADLINE, after, SETTLED, "", strict=True))
    if all(_since(t, hit.start_s)[-1] >= SETTLING_DEADLINE + TERMINAL_WINDOW for hit in hits):
        rows.append(judged(TERMINAL_ERROR, metrics.terminal_error, TERMINAL_LIMIT, "", strict=True))
    rows += [
        judged(RATE, metrics.max_rate_deg_s, RATE_LIMIT_DEG, "deg/s"),
        judged(APPLIED, metrics.max_applied_torque, torque_limit(record), "N·m"),
        *_envelope_requirements(t, h, metrics, rate_outside),
    ]
    late = [hit for hit in hits if hit.start_s >= SETTLING_DEADLINE]
    if late:
        recovery = _slowest_recovery(late)
        rows.append(judged(RECOVERY, recovery, RECOVERY_LIMIT, "s"))
    rows.append(judged(LOST, float(_lost(record)), 0.0, ""))
    return rows


def _envelope_requirements(
    t: Array, h: float, metrics: Metrics, rate_outside: Mask | None
) -> list[Requirement]:
    """Time outside the envelopes that the run has."""
    judged = Requirement.judged
    hits = metrics.disturbances
    rows = []
    if metrics.time_outside_attitude_envelope_s is not None:
        rows.append(judged(ATTITUDE_OUTSIDE, metrics.time_outside_attitude_envelope_s, 0.0, "s"))
    if rate_outside is not None:
        before = _time(rate_outside[t < _first(hits)], h)
        rows.append(judged(RATE_OUTSIDE, before, 0.0, "s"))
    if rate_outside is not None and hits:
        after = max(_time_of(rate_outside[_window(t, hit, hits)], h) for hit in hits)
        rows.append(judged(RATE_OUTSIDE_AFTER_HIT, after, OUTSIDE_LIMIT_PER_HIT, "s"))
    return rows


def _slowest_recovery(hits: list[Disturbance]) -> float | None:
    """Longest recovery [s]; None if one is not recovered and no next hit interrupts it."""
    times = []
    for hit, following in zip(hits, [*hits[1:], None], strict=True):
        interrupted = (
            following is not None and round(following.start_s - hit.start_s, 9) <= RECOVERY_LIMIT
        )
        if hit.recovery_time_s is not None:
            times.append(hit.recovery_time_s)
        elif not interrupted:
            return None
    return max(times)


def _recovery(t: Array, error: Array, pulse: Pulse, pulses: tuple[Pulse, ...]) -> float | None:
    """`Disturbance.recovery_time_s` of one pulse; `error` has shape (n,)."""
    window = np.flatnonzero(_window(t, pulse, pulses) & np.isfinite(error))
    if window.size == 0 or error[window[-1]] >= SETTLED:
        return None
    above = window[error[window] >= SETTLED]
    return float(_since(t, pulse.start_s)[above[-1]]) if above.size else 0.0


def _window(
    t: Array, hit: Pulse | Disturbance, hits: tuple[Pulse, ...] | tuple[Disturbance, ...]
) -> Mask:
    """Instants from the start of a hit to that of the next, or to the end."""
    following = min((o.start_s for o in hits if o.start_s > hit.start_s), default=np.inf)
    return np.asarray((t >= hit.start_s) & (t < following))


def _first(hits: tuple[Disturbance, ...]) -> float:
    """Start of the first hit [s]; infinity if there is none."""
    return min((hit.start_s for hit in hits), default=np.inf)


def _since(t: Array, start: float) -> Array:
    """Time since start [s], to the nanosecond, so that a limit met exactly is met."""
    return np.round(t - start, 9)


def _magnitude(errors: Array) -> Array:
    """Largest component of each row of shape (n, 3); NaN where one is."""
    x, y, z = np.abs(errors).T
    return np.asarray(np.maximum(np.maximum(x, y), z))


def _outside_attitude(record: RunRecord, errors: Array) -> Mask | None:
    """Instants with a component of q_ev beyond ρ_q, shape (n,); None without an envelope."""
    if not has(record, ATTITUDE_ENVELOPE.column):
        return None
    return _beyond(errors, record[ATTITUDE_ENVELOPE.column])


def _outside_rate(record: RunRecord) -> Mask | None:
    """Instants with a component of z2 beyond ρ_ω, shape (n,); None without an envelope."""
    if not (has(record, RATE_ENVELOPE.column) and has(record, RATE_ERROR.column)):
        return None
    return _beyond(record[RATE_ERROR.column], record[RATE_ENVELOPE.column])


def _beyond(error: Array, envelope: Array) -> Mask:
    """Rows, finite in both, with a component beyond its envelope."""
    beyond = np.logical_or.reduce(np.abs(error).T > envelope.T)
    return np.asarray(beyond & finite(error) & finite(envelope))


def _time(outside: Mask | None, h: float) -> float | None:
    """Time outside [s]: the samples outside, h each; None if there is nothing to count in."""
    return None if outside is None or outside.size == 0 else _time_of(outside, h)


def _time_of(outside: Mask, h: float) -> float:
    return round(int(np.count_nonzero(outside)) * h, 9)


def _largest(values: Array) -> float | None:
    """Largest number that is not NaN; None if there is none."""
    if values.size and np.isfinite(largest := values.max()):
        return float(largest)
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else None


def _lost(record: RunRecord) -> int:
    """Messages that are missing, and samples that are there but not finite."""
    lost = record.missing_messages
    for column, rows in record.columns.items():
        missing = record.missing.get(BY_COLUMN[column].name, 0)
        lost += max(int(np.count_nonzero(~finite(rows))) - missing, 0)
    return lost
