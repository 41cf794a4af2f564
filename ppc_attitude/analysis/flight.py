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

"""The guidance of a run: its reference, flown again from what is on record, and keep-out cones.

How near the craft came to its cones is told by the truth, so that its own error is in it.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.series import has, is_finite, samples, zero_ns
from ppc_attitude.analysis.truth import truth_of
from ppc_attitude.analysis.verdict import Requirement
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import ATTITUDE, ENABLED, REFERENCE
from ppc_attitude.science.attitude import rotate
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guidance.cones import (
    CONE_PARAMETERS,
    DIRECTIONS,
    HALF_ANGLES,
    one_for_each,
)
from ppc_attitude.science.guidance.goals import ACCEPTED
from ppc_attitude.science.guidance.orders import GOAL_TIMES
from ppc_attitude.science.guidance.scene import Cone, scene_at
from ppc_attitude.science.guidance.sight import cone_angles
from ppc_attitude.science.kinds import REFERENCES
from ppc_attitude.science.orbit import CURSOR
from ppc_attitude.science.part import Part
from ppc_attitude.science.references import goal
from ppc_attitude.science.stamps import instant, nanoseconds, seconds

_SAMPLES = 1500  # of the goal and the cones over a run


class Leg(NamedTuple):
    """Part of the way to a goal."""

    begin: float  # [s]
    end: float  # [s]
    turns: bool  # a plain turn


class Word(NamedTuple):
    """A report of the guidance."""

    time: float  # [s]
    text: str
    warning: bool
    legs: tuple[Leg, ...]  # the planned way


@dataclass(frozen=True)
class Flight:
    """The guidance of a run at m of its instants."""

    picked: NDArray[np.int64]  # indices of the instants, shape (m,)
    goals: Array  # inertial attitude of the goal, x y z w, shape (m, 4)
    cones: tuple[tuple[Cone, ...], ...]  # the keep-out cones at each; in flight some come, or go
    names: tuple[str, ...]  # what each cone is about, at the instant that has the most of them
    words: tuple[Word, ...]  # what was said of orders, and warned of
    limits: Array  # limits of a slew [rad/s], [rad/s²] at each, shape (m, 2)


class Approach(NamedTuple):
    """The nearest that a body axis came to the direction of its cone."""

    direction: str  # what the cone is about
    angle: float  # the smallest reached [rad]
    half_angle: float  # the smallest allowed [rad]


def guidance_values(record: RunRecord) -> dict[str, Any] | None:
    """Parameters of a run's guidance, complete; None if it followed no goals."""
    configured: Mapping[str, Any] = record.parameters.get(REFERENCE, {})
    if REFERENCES.selected(configured) is not goal.COMPONENT:
        return None
    return {**goal.COMPONENT.defaults, **configured}


def cone_names(values: Mapping[str, Any]) -> list[str]:
    """The direction that each keep-out cone is about."""
    names = values[DIRECTIONS.name]
    return list(one_for_each(DIRECTIONS.name, names, len(values[HALF_ANGLES.name])))


def flight_of(record: RunRecord) -> Flight | None:
    """Fly the guidance of a run once more; None if it had none, or never knew an attitude.

    Raises
    ------
    ConfigurationError
        The parameters on record are infeasible.
    """
    picked, goals, cones, words, limits = [], [], [], [], []
    names: list[str] = []
    told, obeyed, flown = 0, 0, None
    for k, part, values in _flown(record, _SAMPLES):
        if part is not flown:
            told, obeyed, flown = 0, 0, part
        names = max(names, cone_names(values), key=len)
        t, state = seconds(int(record.stamps_ns[k])), part.state[0]
        if part.advices > told:
            followed = int(state["obeyed"]) > obeyed and state["outcome"] == ACCEPTED
            legs = _legs(state["plans"][state["active"]]) if followed else ()
            advice = part.advice
            words.append(Word(t, advice.text, advice.warning, legs))
        told, obeyed = part.advices, int(state["obeyed"])
        scene = scene_at(t, part.configuration[0], state)
        picked.append(k)
        limits.append([values[goal.MAX_RATE.name], values[goal.MAX_ACCELERATION.name]])
        goals.append(scene.goal)
        cones.append(scene.cones)
    if not picked:
        return None
    return Flight(
        np.array(picked, np.int64),
        np.array(goals, np.float64).reshape(-1, 4),
        tuple(cones),
        tuple(names),
        tuple(words),
        np.array(limits, np.float64),
    )


def _flown(record: RunRecord, count: int) -> Iterator[tuple[int, Part, dict[str, Any]]]:
    """Yield the index of each of `_instants`, the reference after its step, and its parameters.

    These follow what was changed in flight. Nothing is yielded before the reference has begun.
    After a restart of its node the reference is a new part.
    """
    values = guidance_values(record)
    if values is None or not has(record, ATTITUDE.column):
        return
    part = Part(goal.COMPONENT, values)
    own = [change for change in record.changes if change.node == REFERENCE]
    changes = [(stamp_ns, [*each]) for stamp_ns, each in groupby(own, attrgetter("stamp_ns"))]
    for k in _instants(record, values, own, count):
        stamp_ns, attitude = int(record.stamps_ns[k]), record[ATTITUDE.column][k]
        while changes and changes[0][0] <= stamp_ns:
            since, together = changes.pop(0)
            values.update({change.name: change.value for change in together})
            if any(change.name == ENABLED for change in together):  # it was started again
                part = Part(goal.COMPONENT, values)
            part.configure(values)
            # A change holds only orders that are yet to come: those of an instant that is not on
            # record would be lost with the next change.
            if since < stamp_ns and part.state[0]["begun"]:
                part.step(since, attitude)
        part.step(stamp_ns, attitude)
        if part.state[0]["begun"]:
            yield k, part, values


def _instants(
    record: RunRecord, values: Mapping[str, Any], changes: list[Any], count: int
) -> list[int]:
    """Indices of the instants to look at: evenly spaced, and those from which something acts.

    Guidance begins with an attitude, so an instant with the first one after zeros is among them.
    """
    seen = np.flatnonzero(is_finite(record, ATTITUDE.column))
    begins = np.flatnonzero(np.diff(np.any(record[ATTITUDE.column][seen], axis=1))) + 1
    times = [values[GOAL_TIMES.name], *(c.value for c in changes if c.name == GOAL_TIMES.name)]
    stamps = {nanoseconds(time) for each in times for time in each}
    stamps |= {change.stamp_ns for change in changes}
    acting = np.searchsorted(record.stamps_ns[seen], sorted(stamps))
    evenly = range(0, seen.size, max(math.ceil(seen.size / count), 1))
    chosen = {*evenly, *begins.tolist(), *acting[acting < seen.size].tolist(), seen.size - 1}
    return [int(seen[i]) for i in sorted(chosen) if i >= 0]


def _legs(plan: Any) -> tuple[Leg, ...]:
    return tuple(
        Leg(float(leg["begin"]), float(leg["begin"] + leg["duration"]), bool(leg["axis"].any()))
        for leg in plan["legs"][: plan["count"]]
    )


def pointed(attitudes: Array, axis: Any) -> Array:
    """Body axis in inertial axes, shape (m, 3), at attitudes x y z w, shape (m, 4).

    NaN where an attitude is of zeros.
    """
    x, y, z = map(float, axis)
    turned = [rotate((q[0], q[1], q[2], q[3]), (x, y, z)) for q in attitudes.tolist()]
    return np.where(attitudes.any(axis=1, keepdims=True), turned, np.nan)


def judge_orders(run: Measured) -> Iterator[Requirement]:
    """Judge that every order was followed: a refused one leaves the reference where it was.

    If there is a limit, the time to the goals that were ordered is judged, too.
    """
    obeyed = refused = 0
    reason, why, flown = "", "", None
    ways: list[tuple[float, float]] = []  # [s] of each order that is followed, and of its arrival
    try:
        for k, part, _ in _flown(run.record, 1):
            if part is not flown:
                flown, before = part, (obeyed, refused)
            state, known = part.state[0], obeyed
            obeyed, refused = before[0] + int(state["obeyed"]), before[1] + int(state["refused"])
            if obeyed > known and state["outcome"] == ACCEPTED:
                arrives = float(state["plans"][state["active"]]["end"])
                ways.append((float(run.t[k]), arrives - seconds(zero_ns(run.record))))
            if refused and not reason and state["outcome"] != ACCEPTED:  # the last of an instant
                reason = part.advice.text
    except ConfigurationError as error:  # a bag may hold any parameters
        why = str(error)
    if obeyed or why:
        yield run.row("refused_orders", float(refused), 0.0, why=why, note=reason)
    if ways and run.required.goal is not None:
        yield _judge_ways(run, ways, run.required.goal)


def _judge_ways(run: Measured, ways: list[tuple[float, float]], limit: float) -> Requirement:
    """Judge the longest time from an order to its goal, of the orders that held for long enough.

    The craft is at a goal when the desired motion is, and its error has settled. An order that
    gave way to the next one sooner than the limit shows nothing.
    """
    settled = run.size(run.required.settled) < run.required.settled.limit  # False for NaN
    longest, note = None, ""
    ends = [*(ordered for ordered, _ in ways[1:]), run.end]
    for (ordered, arrives), until in zip(ways, ends, strict=True):
        if ordered == run.begin > 0.0:  # it may be older than the record
            continue
        there = np.flatnonzero(settled & (run.t >= arrives) & (run.t <= until))
        took = float(run.t[there[0]] if there.size else until) - ordered
        if (there.size or took >= limit) and (longest is None or took > longest):
            longest = took
            at = "" if there.size else ", and was not reached"
            note = f"that of the order at {instant(ordered)} s{at}"
    why = run.lacks_attitude
    if longest is None:
        why = why or f"no order held for {limit:g} s, or until its goal was reached"
    row = ("goal_time", longest, limit, "s", why)
    return run.row(*row, strict=True, note=note, absent=run.absent)


def angles_to_cones(record: RunRecord, column: str, values: Mapping[str, Any]) -> Array:
    """Angle [rad] between body axis and direction of each keep-out cone, shape (n, count).

    By the attitudes, x y z w, in a column of a run, and the parameters of its guidance; NaN where
    an attitude is missing, or of zeros.

    Raises
    ------
    AnalysisError
        As of `samples`.
    ConfigurationError
        The parameters are infeasible.
    """
    attitudes = samples(record, column)
    configuration, *_kept = goal.configure(values)
    angles = np.full((record.stamps_ns.size, int(configuration["cones"]["count"])), np.nan)
    seen = is_finite(record, column) & attitudes.any(axis=1)
    angles[seen] = cone_angles(
        np.ascontiguousarray(record.stamps_ns[seen]),
        np.ascontiguousarray(attitudes[seen], float),
        configuration,
        np.zeros((), CURSOR)[()],
    )
    return angles


def approaches_of(record: RunRecord) -> list[Approach]:
    """Nearest approach to each keep-out cone; none if the run had no cones or no attitude."""
    values, attitude = guidance_values(record), truth_of(record).attitude
    if values is None or not values[HALF_ANGLES.name] or not has(record, attitude):
        return []
    angles = angles_to_cones(record, attitude, values)
    seen = angles[np.isfinite(angles).all(axis=1)]
    if not seen.size:  # of an estimator that never had a fix
        return []
    told = cone_names(values), seen.min(axis=0).tolist(), values[HALF_ANGLES.name]
    return [Approach(*each) for each in zip(*told, strict=True)]


def judge_cones(run: Measured) -> Iterator[Requirement]:
    """Judge how far the craft came into its worst keep-out cone; negative: it stayed out."""
    why = run.changed(REFERENCE, *(each.name for each in CONE_PARAMETERS))
    try:
        approaches = approaches_of(run.record)
    except ConfigurationError as error:  # a bag may hold any parameters
        approaches, why = [], str(error)
    if approaches:
        worst = max(approaches, key=lambda each: each.half_angle - each.angle)
        angle, half_angle = np.rad2deg([worst.angle, worst.half_angle])
        note = f"came within {angle:.4g}° of {worst.direction}, allowed {half_angle:.4g}°"
        row = ("keep_out", float(half_angle - angle), 0.0, "deg", why)
        yield run.row(*row, note=note, columns=(run.truth.attitude,))
    elif why:  # cones that came in flight
        yield run.row("keep_out", None, 0.0, "deg", why)
