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

"""Judge whether a run kept the promise of its certificate, and when that was suspended."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ppc_attitude.analysis.envelopes import beyond
from ppc_attitude.analysis.faults import faults_of
from ppc_attitude.analysis.filter_health import ATTITUDE_VARIANCES, RATE_VARIANCES, sigmas_of
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.series import Mask, has, known, samples
from ppc_attitude.analysis.truth import (
    UNKNOWN,
    errors_of,
    knowledge_errors,
    pointing_errors,
    truth_of,
)
from ppc_attitude.analysis.verdict import Requirement
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    ATTITUDE,
    CONTROLLER,
    DISTURBANCE,
    ENABLED,
    ESTIMATOR,
    INJECTOR,
    PLANT,
    REFERENCE,
    REFERENCE_ACCELERATION,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    TRUE_ATTITUDE,
    TRUE_RATE,
)
from ppc_attitude.science.controllers.tube_parameters import (
    CERTIFICATE,
    LAWS,
    PREFIX,
    digest_of,
)
from ppc_attitude.science.controllers.tube_state import (
    MOMENTUM_ERROR,
    MOMENTUM_TUBE,
    PHASE,
    STOP,
    TURN,
    TURN_ENVELOPE,
)
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.faults import FAULTS
from ppc_attitude.science.guarantee.assumptions import assumptions_of, law_of
from ppc_attitude.science.guarantee.nodes import (
    Nodes,
    actuation_of,
    are_full,
    has_wheels,
    momentum_of,
)
from ppc_attitude.science.guarantee.surroundings import DEVIATIONS, broken_assumptions, fastest_of
from ppc_attitude.science.parameter import NodeParameters
from ppc_attitude.science.wheels import SPEED

# The law sees a torque at the next sample, and begins anew with the one after it.
_SEEN_AFTER = 2
_NEEDED = (
    REFERENCE_RATE.column,
    REFERENCE_ACCELERATION.column,
    *(each.name for each in (MOMENTUM_ERROR, MOMENTUM_TUBE, TURN, TURN_ENVELOPE, PHASE)),
)
_ROUNDING = 1e-12  # [rad] of the angle between equal attitudes
_INEXACT = 1e-9  # [rad], [rad/s] that a reference may be off from sample to sample by its rounding
_MOTION = ("W", "W1", "W2")  # bounds of ‖ω_d‖, ‖ω_d'‖ and ‖ω_d''‖


@dataclass(frozen=True)
class Held:
    """The fate of a certificate during a run."""

    outside: Mask  # outside the promised bounds although the assumptions held, shape (n,)
    reason: str  # why nothing is promised; empty if something is
    note: str  # why the promise was suspended, and for how long; empty if it was not


def certificate_held(record: RunRecord) -> Held | None:
    """Compare a run with its certificate; None if its law has none."""
    values = record.parameters.get(CONTROLLER, {})
    if values.get("controller") not in LAWS or not values.get(CERTIFICATE.name):
        return None
    nothing = np.zeros(record.stamps_ns.size, dtype=np.bool_)
    if absent := [name for name in _NEEDED if not has(record, name)]:
        return Held(nothing, f"the record lacks {', '.join(absent)}", "")
    try:
        different = [each for _, told in _in_flight(record) for each in _broken(told)]
        broken_at = _assumptions(record)
    except KeyError as error:
        return Held(nothing, f"the record lacks the parameter {error.args[0]}", "")
    except ConfigurationError as error:
        return Held(nothing, str(error), "")
    certificates = (each.value for each in record.changes if each.name == CERTIFICATE.name)
    if any(each != values[CERTIFICATE.name] for each in certificates):
        different.append("the certificate was replaced in flight")
    different = different or [f"fault: {each}" for each in faults_of(record)]
    if different:
        return Held(nothing, "; ".join(dict.fromkeys(different)), "")
    outside = _outside(record, values)
    suspended, causes = nothing.copy(), []
    for what, broken in broken_at.items():
        if broken.any():
            causes.append(f"{what} at {np.count_nonzero(broken)} instants")
            for late in range(_SEEN_AFTER + 1):
                suspended[late:] |= broken[: broken.size - late]
    forgiven = outside & _until_inside(suspended, outside)
    if left := np.count_nonzero(forgiven & ~suspended):
        causes.append(f"not yet back within the bounds at {left} instants")
    note = "suspended: " + ", ".join(causes) if causes else ""
    if causes and suspended[1:].all():  # nothing was promised: no step comes before the first
        return Held(nothing, note, "")
    return Held(outside & ~forgiven, "", note)


def _outside(record: RunRecord, values: Mapping[str, Any]) -> Mask:
    """Instants outside the tube, the envelope Φ, or, after the stop phase, the limit of the rate.

    The true error and rate are bounded. Without them on record, what the law was told may be
    e_A [rad] and e_W [rad/s] more; the column of the tube, Y + N, allows for the error of its y.
    """
    truth, bound = truth_of(record), record[TURN_ENVELOPE.name]
    e_A, e_W, Omega = (values[PREFIX + each] for each in ("e_A", "assumed.e_W", "assumed.Omega"))
    outside = beyond(record[MOMENTUM_ERROR.name], record[MOMENTUM_TUBE.name])
    outside |= beyond(record[TURN.name], bound + e_A)
    if truth.standing != UNKNOWN:
        e_A, e_W = _ROUNDING, 0.0
    errors = known(pointing_errors, record)
    if errors is not None:
        outside |= beyond(errors.angles[:, None], bound + e_A)
    if has(record, truth.angular_velocity):
        rate = samples(record, truth.angular_velocity)
        too_fast = np.linalg.norm(rate, axis=1) > Omega + e_W
        outside |= too_fast & (record[PHASE.name][:, 0] > STOP)
    return outside


def _until_inside(suspended: Mask, outside: Mask) -> Mask:
    """Suspended instants, and those after them until the craft is within its bounds again.

    A craft that left its bounds while nothing was promised cannot be back at once.
    """
    instants = np.arange(suspended.size)
    last = np.maximum.accumulate(np.where(suspended, instants, -1))
    inside = np.maximum.accumulate(np.where(suspended | outside, -1, instants))
    return np.asarray(last > inside)


def _in_flight(record: RunRecord) -> Iterator[tuple[slice, NodeParameters]]:
    """Instants between changes in flight, and the parameters that hold there.

    Changes of faults are left out, because `faults_of` tells when each fault acted.
    """
    return record.stretches(each for each in record.changes if each.name != FAULTS.name)


def _broken(parameters: NodeParameters) -> Iterator[str]:
    """Yield why the certificate does not hold for these parameters.

    Those of the reference do not count, because its motion is on record.
    """
    values = parameters[CONTROLLER]
    if not values.get(ENABLED, True):
        yield "the law was switched off"
    if values[CERTIFICATE.name] != digest_of(values):
        yield "the certificate is for other parameter values"
    elif parameters.get(PLANT):
        yield from broken_assumptions(
            assumptions_of(values), law_of(values), nodes_around(parameters)
        )


def nodes_around(parameters: NodeParameters) -> Nodes:
    """Return what surrounds the law, from the parameters of every node."""
    return Nodes(*(parameters.get(each, {}) for each in (PLANT, REFERENCE, INJECTOR, ESTIMATOR)))


def _assumptions(record: RunRecord) -> dict[str, Mask]:
    """Instants at which an assumption that a record shows is broken, by what broke it."""
    values = record.parameters[CONTROLLER]
    found = {}
    external = np.full(record.stamps_ns.size, values[f"{PREFIX}assumed.d"])  # [N·m]
    if has_wheels(record.parameters.get(PLANT, {})):
        assumed = assumptions_of(values)
        fastest = fastest_of(assumed, law_of(values))
        for part, told in _in_flight(record):
            wheels = actuation_of(told[PLANT], assumed.momentum, fastest, assumed.max_torque)
            external[part] = assumed.d - wheels.rest
        found.update(_momentum(record, assumed.momentum))
    if has(record, DISTURBANCE.column):
        torque = np.abs(record[DISTURBANCE.column]).max(axis=1)
        found["a disturbance beyond the assumed one"] = torque > external
    found.update(_reference(record, *(values[f"{PREFIX}assumed.{each}"] for each in _MOTION)))
    found.update(_knowledge(record, values[PREFIX + "e_A"], values[f"{PREFIX}assumed.e_W"]))
    gaps = np.diff(record.stamps_ns, prepend=record.stamps_ns[0])
    found["a late sample"] = gaps > 1e9 * values[PREFIX + "h"] + 1.0
    return found


def _reference(record: RunRecord, W: float, W1: float, W2: float) -> dict[str, Mask]:
    """Instants at which the reference exceeded its bounds, or contradicted itself.

    A rate that is Lipschitz differs from the trapezoid of its derivatives by h² W2/4 in a sample,
    and the attitude, whose rotations do not commute, by h³ (W2 + W W1)/12.
    """
    h = np.diff(record.t, prepend=record.t[0])
    rate, acceleration = record[REFERENCE_RATE.column], record[REFERENCE_ACCELERATION.column]
    gained = np.diff(rate, axis=0, prepend=rate[:1])
    change = np.diff(acceleration, axis=0, prepend=acceleration[:1])
    harder = np.linalg.norm(acceleration, axis=1) > W1
    harder |= np.linalg.norm(change, axis=1) > h * W2 + _ROUNDING
    found = {"a reference faster than assumed": np.linalg.norm(rate, axis=1) > W}
    if has(record, REFERENCE_ATTITUDE.column):
        attitude = record[REFERENCE_ATTITUDE.column]
        error = errors_of(attitude, np.roll(attitude, 1, axis=0)).quaternions
        turned = 2.0 * np.sign(error[:, 3:]) * error[:, :3]  # but for (h W)³/24
        limit = h**3 * ((W2 + W * W1) / 12.0 + W**3 / 24.0)
        found["a reference attitude that contradicts its rate"] = _jumps(turned, rate, h, limit)
    found["a reference that accelerates harder than assumed"] = harder
    limit = 0.25 * h**2 * W2
    found["a reference whose rate jumps"] = _jumps(gained, acceleration, h, limit)
    return found


def _jumps(change: Array, slope: Array, h: Array, limit: Array) -> Mask:
    """Samples over which a change differs from the trapezoid of its slopes by more than a limit."""
    expected = 0.5 * h[:, None] * (slope + np.roll(slope, 1, axis=0))
    jumps = np.linalg.norm(change - expected, axis=1) > limit + _INEXACT
    jumps[:1] = False
    return np.asarray(jumps)


def _momentum(record: RunRecord, most: float) -> dict[str, Mask]:
    """Instants at which wheels, or the craft with them, had more momentum than assumed."""
    rate = truth_of(record).angular_velocity
    if not (has(record, SPEED.name) and has(record, rate)):
        return {"no speed of the wheels on record": np.ones(record.stamps_ns.size, np.bool_)}
    speeds = record[SPEED.name]
    full, momentum = np.zeros(record.stamps_ns.size, np.bool_), np.zeros(record.stamps_ns.size)
    for part, told in _in_flight(record):
        full[part] = are_full(told[PLANT], speeds[part])
        momentum[part] = momentum_of(told[PLANT], record[rate][part], speeds[part])
    return {"more momentum than assumed": momentum > most, "a wheel at its largest speed": full}


def _knowledge(record: RunRecord, e_A: float, e_W: float) -> dict[str, Mask]:
    """Instants at which what the law was told was worse than assumed.

    That is seen in flight by the estimator's covariance, and afterwards by the truth.
    """
    found = {}
    if has(record, mekf.ESTIMATE.name):
        attitude, rate = (
            sigmas_of(record, each).max(axis=1) for each in (ATTITUDE_VARIANCES, RATE_VARIANCES)
        )
        good = (DEVIATIONS * attitude <= e_A) & (DEVIATIONS * rate <= e_W)
        found["no estimate, or one whose covariance is beyond the assumed errors"] = ~good
    columns = (TRUE_RATE, TRUE_ATTITUDE, ANGULAR_VELOCITY, ATTITUDE)
    if all(has(record, each.column) for each in columns):
        off = np.linalg.norm(record[ANGULAR_VELOCITY.column] - record[TRUE_RATE.column], axis=1)
        good = (knowledge_errors(record).angles <= e_A + _ROUNDING) & (off <= e_W)
        found["an estimate that was worse than assumed"] = ~good
    return found


def judge_certificate(run: Measured) -> Iterator[Requirement]:
    """Judge how long the run broke its certificate's promise while the assumptions held."""
    held = certificate_held(run.record)
    if held is not None:
        time = run.time(held.outside)
        why = held.reason or run.lacks_time
        judged = tuple(each for each in (run.truth.attitude, *_NEEDED) if has(run.record, each))
        yield run.row("certificate", time, 0.0, "s", why, note=held.note, columns=judged)
