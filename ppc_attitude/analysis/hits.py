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

"""The sudden disturbances of a run: those that its external torque shows, and scheduled ones."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from ppc_attitude.analysis.envelopes import Envelope
from ppc_attitude.analysis.pulses import (
    LARGEST_ENVIRONMENT,
    MOST_STEPS,
    SMALLEST_STEP,
    Pulse,
    find_pulses,
)
from ppc_attitude.analysis.series import Mask, elapsed, has, step, vectors
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import DISTURBANCE, INJECTOR
from ppc_attitude.science.disturbances.pulses import scheduled_pulses
from ppc_attitude.science.kinds import ENVIRONMENTS
from ppc_attitude.science.signals import ENVIRONMENT_TORQUE


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
