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

"""Sudden disturbances: scheduled ones, and those found from the recorded external torque alone.

The torque of an environment of ours is smooth (the paper's is at most 4.4e-3 N·m and 6.2e-5 N·m/s),
and that of somebody else's is on record and taken away before; a sudden disturbance starts and ends
with a step. So the steps are found first, then paired: a step and the first later step that undoes
it are one pulse, unless the torque is at rest in between. What cannot be paired (pulses that touch)
is read off as stretches of constant extra torque. How large a step is depends on the craft: what is
sudden for one of 1 kg is less than what the environment of a station changes from sample to sample.
So torques are compared with what the actuator gives.
"""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.analysis.envelopes import Envelope
from ppc_attitude.analysis.series import Mask, elapsed, finite, has, step, vectors
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import DISTURBANCE, INJECTOR
from ppc_attitude.science.disturbances.pulses import scheduled_pulses
from ppc_attitude.science.kinds import ENVIRONMENTS
from ppc_attitude.science.signals import ENVIRONMENT_TORQUE

SMALLEST_STEP = 0.02
"""A change of one axis between two samples that is a step and not the environment [actuators]."""

DRIFT = 0.002
"""By how much more the environment may change for each second of a gap [actuators/s]."""

LARGEST_ENVIRONMENT = 0.12
"""Largest torque on an axis that is no pulse, unless the environment's is larger [actuators]."""

SAME_TORQUE = 0.004
"""Two torques that differ by less on every axis are taken as one [actuators]."""

MOST_STEPS = 1000
"""A torque with more steps is a rough signal, in which a step has to stand out."""

STANDS_OUT = 10.0
"""A step of a rough signal counts from so many times the median step; Gaussian noise reaches 8."""

SAME_ROUGH = 3.0
"""Two torques of a rough signal are the same within so many times `SAME_TORQUE`."""


_Found = tuple[int, int, tuple[float, float, float]]


@dataclass(frozen=True)
class Pulse:
    """A stretch of constant extra torque."""

    start_s: float  # in the time given
    duration_s: float  # up to the end of the record if it has not ended by then
    torque: tuple[float, float, float]  # without the environment's, body axes [N·m]


class SweptHit(NamedTuple):
    """A hit of a sweep, and the recovery from it."""

    duration_s: float
    recovery_time_s: float | None  # None if the run did not recover
    outside: Mapping[Envelope, float]  # time outside each envelope that the run has [s]
    settled: bool  # whether the run had settled when it came


def pulses_of(record: RunRecord, actuator: float) -> tuple[Pulse, ...]:
    """Find the sudden disturbances of a run, by start, then by end.

    There are none if its external torque is not on record. Those that are scheduled count even if
    they are too small to be told from an environment, or so many that they would pass for a rough
    signal. `actuator` is the torque that the actuator gives on an axis [N·m].
    """
    if not has(record, DISTURBANCE.column):
        return ()
    t, torque = elapsed(record), vectors(record, DISTURBANCE.column)
    bound = _environment_bound(record)
    if has(record, ENVIRONMENT_TORQUE.name):
        torque, bound = torque - vectors(record, ENVIRONMENT_TORQUE.name), 0.0
    least = first = SMALLEST_STEP * actuator
    if bound != 0.0:  # with which a record begins could be the environment, or hidden by it
        first = 2.0 * max(LARGEST_ENVIRONMENT * actuator, bound or 0.0)
    planned = [*scheduled(record)]
    known = [
        each
        for each in planned
        if 2 * len(planned) > MOST_STEPS
        or np.abs(each.torque).max() <= (least if each.start_s > t[0] else first)
    ]
    torque = torque.copy() if known else torque
    for each in known:  # beside a step of another pulse it would count as part of that step
        acts = (t >= each.start_s) & (np.round(t - each.start_s, 9) < each.duration_s)
        torque[acts] -= each.torque
    found = find_pulses(t, torque, actuator, bound)
    return tuple(sorted((*found, *known), key=lambda each: (each.start_s, each.duration_s)))


def _environment_bound(record: RunRecord) -> float | None:
    """Bound of the environment's torque on an axis [N·m]; None if it declares none."""
    injector = record.parameters.get(INJECTOR, {})
    with suppress(KeyError, TypeError, ValueError):  # a bag may hold any parameters
        environment = ENVIRONMENTS.selected(injector)
        if environment and environment.bound:
            return environment.bound(injector)
    return None


def scheduled(record: RunRecord) -> Iterator[Pulse]:
    """Yield the scheduled pulses that begin or end during a run, as its instants show them.

    A schedule that was changed in flight acts until the new one does.
    """
    t = elapsed(record)
    edges = np.append(t, t[-1] + step(t))  # the last sample acts for so long
    changes = [each for each in record.changes if each.node == INJECTOR]
    for part, told in record.stretches(changes):
        with suppress(KeyError, TypeError, ValueError, OverflowError):  # a bag may hold anything
            for each in scheduled_pulses(told.get(INJECTOR, {})):
                span = np.searchsorted(record.stamps_ns, [each["start_ns"], each["end_ns"]])
                first, end = (int(k) for k in np.clip(span, part.start, part.stop))
                torque = each["torque"].tolist()
                if 0 < end - first < t.size and any(torque):
                    duration = round(float(edges[end] - edges[first]), 9)
                    yield Pulse(float(t[first]), duration, tuple(torque))


def window(t: Array, hit: Pulse, hits: Iterable[Pulse]) -> Mask:
    """Instants from the start of a hit to that of the next, shape (n,)."""
    following = min((each.start_s for each in hits if each.start_s > hit.start_s), default=np.inf)
    return np.asarray((t >= hit.start_s) & (t < following))


def find_pulses(
    t: Array, torque: Array, actuator: float, environment: float | None = None
) -> tuple[Pulse, ...]:
    """Find the sudden disturbances in an external torque.

    A torque that never steps has no pulse, however large it is. Of one that steps more than
    `MOST_STEPS` times only the pulses that stand out are found. Equal pulses that touch are one.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Time, increasing [s].
    torque : ndarray, shape (n, 3)
        External torque that acts from each instant on [N·m], after the last one for a nominal
        step; rows not finite are skipped.
    actuator : float
        Torque that the actuator gives on an axis [N·m].
    environment : float or None
        Bound of the environment's torque on an axis [N·m], None if it is unknown; 0: there is none.

    Returns
    -------
    tuple of Pulse
        By start, then by end.
    """
    rows = finite(torque)
    if np.count_nonzero(rows) < 2:
        return ()
    interval = step(t)
    edges = float(t[0]), float(t[-1]) + interval
    if not rows.all():
        t, torque = t[rows], torque[rows]
    drift = 0.0 if environment == 0.0 else DRIFT * np.maximum(np.diff(t) - interval, 0.0)
    unit, same = actuator, SAME_TORQUE
    at, heights = _steps(t, torque, (SMALLEST_STEP + drift) * unit)
    if at.size > MOST_STEPS:
        same *= SAME_ROUGH
        unit = STANDS_OUT * float(np.median(np.abs(heights).max(axis=1))) / SMALLEST_STEP
        at, heights = _steps(t, torque, (SMALLEST_STEP + drift) * unit)
    if not 0 < at.size <= MOST_STEPS:
        return ()
    if environment == 0.0:  # rest is zero
        first = torque[0]
    else:
        most = max(LARGEST_ENVIRONMENT * actuator, environment or 0.0)
        first = _extra_at_start(at, heights, torque, most)
    # The record's own edges are steps as well: from rest to the first level, and back to rest.
    rises = np.vstack([first, heights, -(first + heights.sum(axis=0))])
    times = [edges[0], *t[at].tolist(), edges[1]]
    return tuple(
        Pulse(times[start], round(times[stop] - times[start], 9), extra)
        for start, stop, extra in sorted(_paired(rises, same * unit, SMALLEST_STEP * unit))
    )


def _steps(t: Array, torque: Array, least: float | Array) -> tuple[NDArray[np.intp], Array]:
    """First sample of each new level, and the height of the step without the smooth part."""
    is_step = np.logical_or.reduce(np.abs(np.diff(torque.T)) > least)
    at = np.flatnonzero(is_step)
    # The smooth part goes on at the mean slope of the intervals beside, unless they are steps.
    beside = np.stack([at - 1, at + 1])
    inside = np.clip(beside, 0, is_step.size - 1)
    known = ((beside == inside) & ~is_step[inside])[..., None]
    interval = (t[inside + 1] - t[inside])[..., None]
    slopes = np.where(known, (torque[inside + 1] - torque[inside]) / interval, 0.0)
    smooth = slopes.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return at + 1, torque[at + 1] - torque[at] - smooth * (t[at + 1] - t[at])[:, None]


def _extra_at_start(at: NDArray[np.intp], heights: Array, torque: Array, most: float) -> Array:
    """Extra torque at the first sample, shape (3,): zero unless the record starts in a pulse.

    Rest is the first level that is small enough for an environment.
    """
    stretches = np.split(torque, at)
    levels = np.vstack([np.zeros(3), np.cumsum(heights, axis=0)])
    for stretch, level in zip(stretches, levels, strict=True):
        # The median is small if all of it is, which is sooner told.
        if np.abs(stretch).max() <= most or np.abs(np.median(stretch, axis=0)).max() <= most:
            return np.asarray(-level)
    return np.asarray(np.median(stretches[0], axis=0), dtype=np.float64)


def _paired(rises: Array, same: float, least: float) -> list[_Found]:
    """Pulses as (first step, last step, torque [N·m]); `least` is the smallest step that counts."""
    pulses: list[_Found] = []
    left = np.abs(rises).max(axis=1) > same
    at_rest = _same(np.cumsum(rises, axis=0), np.zeros(3), same)
    rests: NDArray[np.intp] = np.cumsum(at_rest) - at_rest  # before each step
    unpaired = []
    for k in range(len(rises)):
        if not left[k]:
            continue
        left[k] = False
        undoing = np.flatnonzero(left & (rests == rests[k]) & _same(rises, -rises[k], same))
        if undoing.size == 0:
            unpaired.append(k)
            continue
        end = int(undoing[0])
        left[end] = False
        pulses.append((k, end, tuple(((rises[k] - rises[end]) / 2.0).tolist())))
    level = np.zeros(3)
    for k, after in pairwise(unpaired):
        level = level + rises[k]
        if np.abs(level).max() > least:  # as weak a one would not be found alone
            pulses.append((k, after, tuple(level.tolist())))
    return pulses


def _same(torques: Array, other: Array, same: float) -> Mask:
    """Which torques, of shape (…, 3), equal the other but for the environment's drift."""
    return np.asarray(np.abs(torques - other).max(axis=-1) <= same)
