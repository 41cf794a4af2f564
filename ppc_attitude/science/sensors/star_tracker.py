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

"""A star tracker: a whole attitude, noisier about its boresight z, that arrives late.

It has no fix while the craft turns too fast, while it is blinded, and at random; and a fix may be
false. Which fix arrives at which instant follows from the stamps alone (`Slots`), as an estimator's
node must know.
"""

import math
from collections.abc import Mapping
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import exponential, normalised, product, unit_quaternion
from ppc_attitude.science.component import Component
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import (
    NO_ATTITUDE,
    Quaternion,
    Vector,
    kernel,
    multiply,
    norm,
    quaternion,
    scale,
    vector,
)
from ppc_attitude.science.noise import normal_vector, uniform
from ppc_attitude.science.parameter import Parameter, at_start, filled, record_type
from ppc_attitude.science.stamps import LATEST, NANOSECONDS, nanoseconds, span

_share = partial(Parameter, low=0.0, high=1.0)
CROSS_NOISE = _share(
    "star_tracker.cross_noise", 0.0, "σ of a fix about each axis across the boresight", "rad"
)
BORESIGHT_NOISE = _share(
    "star_tracker.boresight_noise", 0.0, "σ of a fix about the boresight", "rad"
)
DROPOUTS = _share("star_tracker.dropout_probability", 0.0, "share of slots without a fix")
OUTLIERS = _share("star_tracker.outlier_probability", 0.0, "share of false fixes")
MOUNTING = Parameter(
    "star_tracker.mounting",
    [0.0, 0.0, 0.0, 1.0],
    "attitude of the tracker in the body, x y z w, tracker to body; boresight z",
    length=4,
    quaternion=True,
)
RATE = at_start(
    "star_tracker.rate",
    10.0,
    "fixes per second; `rate` is a multiple of it",
    "Hz",
    low=1e-9,
    agreed=True,
)
LATENCY = at_start(
    "star_tracker.latency",
    0.0,
    "time from a fix's validity to its arrival; rounded up to whole steps",
    "s",
    low=0.0,
    high=10.0,
    agreed=True,
)
OUTLIER_SIZE = Parameter(
    "star_tracker.outlier_size",
    0.0,
    "angle by which a false fix is off",
    "rad",
    low=0.0,
    high=math.pi,
)
INITIAL_FIX = at_start(
    "initial_fix",
    True,
    "the tracker ran before the start: its first fix comes at once",
    agreed=True,
)
MAX_RATE = Parameter(
    "star_tracker.max_rate",
    100.0,
    "there is no fix while the craft turns faster",
    "rad/s",
    above=0.0,
    high=100.0,
)
PARAMETERS = (
    CROSS_NOISE,
    BORESIGHT_NOISE,
    MOUNTING,
    RATE,
    LATENCY,
    MAX_RATE,
    DROPOUTS,
    OUTLIERS,
    OUTLIER_SIZE,
    # At start only: one without the other would be refused, and `ros2 param set` sets one.
    at_start(
        "star_tracker.blinding_times", [], "start of each blinding", "s", low=0.0, high=LATEST
    ),
    at_start(
        "star_tracker.blinding_durations",
        [],
        "duration of each blinding",
        "s",
        above=0.0,
        high=LATEST,
    ),
)
_ERRORS = CROSS_NOISE, BORESIGHT_NOISE, DROPOUTS, OUTLIERS
QUIET = {
    **dict.fromkeys((each.name for each in _ERRORS), 0.0),
    "star_tracker.blinding_times": [],
    "star_tracker.blinding_durations": [],
}
"""Parameters with which every fix comes, and is the truth."""
ROUNDING = 7e-7
"""Stamps are rounded, and latencies are written, with errors below this [s].

A fix may arrive this much before its latency is over. No latency that is written in microseconds
exceeds a whole number of steps by just this much, so sender and receiver never disagree.
"""
TOLERANCE = nanoseconds(ROUNDING)
"""How far a fix's stamp may be from its slot [ns]."""
_SAY_WHEN = (RATE, LATENCY, INITIAL_FIX)
MAX_BLINDINGS = 32
MAX_DELAY = 1000  # [steps] a late fix must find the state of its validity among so many
STAR_TRACKER = record_type(
    ("sigma", np.float64, (3,)),  # [rad] in tracker axes
    ("mounting", np.float64, (4,)),  # tracker to body, x y z w
    ("every", np.int64),  # [steps] from slot to slot
    ("delay", np.int64),  # [steps] from validity to arrival
    ("max_rate", np.float64),  # [rad/s]
    ("dropout_probability", np.float64),
    ("outlier_probability", np.float64),
    ("outlier_size", np.float64),  # [rad]
    ("blindings", np.int64),  # how many
    ("blinding", np.int64, (MAX_BLINDINGS, 2)),  # [ns] first instant, first instant after
    ("seed", np.int64),
)
NO_FIX = NO_ATTITUDE
_NOISE, _OUTLIER_AXIS = 12, 14
_DROPOUT, _OUTLIER = 0, 1


def slots(rate: float, values: Mapping[str, Any]) -> tuple[int, int]:
    """Steps from fix to fix, and from a fix's validity to its arrival.

    Parameters
    ----------
    rate : float
        Steps per second [Hz].
    values : mapping
        Values of `RATE` and `LATENCY`.

    Raises
    ------
    ConfigurationError
        The tracker's rate does not divide the steps' (names the nearest that does), or the latency
        is more than `MAX_DELAY` steps.
    """
    tracker, latency = values[RATE.name], values[LATENCY.name]
    every = max(1, round(rate / tracker))
    # To the last digit: a node that waits for fixes counts slots by this rate alone, for days.
    if abs(rate / tracker - every) > 1e-14 * every:
        raise ConfigurationError(
            f"{RATE.name} = {tracker} Hz does not divide rate = {rate} Hz, but each fix must "
            f"be at a step; the nearest that does is {rate / every!r} Hz; rate = "
            f"{every * tracker!r} Hz would do too"
        )
    delay = max(0, math.ceil((latency - ROUNDING) * rate))
    if delay > MAX_DELAY:
        raise ConfigurationError(
            f"{LATENCY.name} = {latency} s is {delay} steps at {rate} Hz; allowed: at most "
            f"{MAX_DELAY} steps"
        )
    return every, delay


def unit_mounting(values: Mapping[str, Any]) -> Quaternion:
    """Mounting of the tracker, normalised.

    Raises
    ------
    ConfigurationError
        Its norm differs from 1 by more than 1e-3.
    """
    return unit_quaternion(MOUNTING.name, values[MOUNTING.name])


def sigmas(values: Mapping[str, Any]) -> Vector:
    """σ of a fix about each tracker axis [rad]."""
    cross = values[CROSS_NOISE.name]
    return (cross, cross, values[BORESIGHT_NOISE.name])


def star_tracker_record(values: Mapping[str, Any]) -> Any:
    """Record of dtype `STAR_TRACKER` from checked parameters of the plant.

    Raises
    ------
    ConfigurationError
        See `slots` and `unit_mounting`; or blinding times and durations do not fit each other.
    """
    every, delay = slots(values["rate"], values)
    mounting = unit_mounting(values)
    times = values["star_tracker.blinding_times"]
    durations = values["star_tracker.blinding_durations"]
    if not len(times) == len(durations) <= MAX_BLINDINGS:
        raise ConfigurationError(
            f"star_tracker.blinding_times has {len(times)} values, "
            f"star_tracker.blinding_durations {len(durations)}; allowed: equally many, "
            f"at most {MAX_BLINDINGS}"
        )
    blinding = np.zeros((MAX_BLINDINGS, 2), np.int64)
    blinding[: len(times)] = np.reshape([*map(span, times, durations)], (-1, 2))
    return filled(
        STAR_TRACKER,
        values,
        "star_tracker.",
        every=every,
        delay=delay,
        mounting=mounting,
        sigma=sigmas(values),
        blindings=len(times),
        blinding=blinding,
        seed=values["seed"],
    )


@kernel
def is_slot(tracker: Any, step: int) -> bool:
    """True if a fix is valid at a step."""
    return bool(step >= 0 and step % tracker.every == 0)


@kernel
def _has_fix(tracker: Any, omega: Vector, stamp_ns: int, step: int) -> bool:
    for i in range(tracker.blindings):
        if tracker.blinding[i, 0] <= stamp_ns < tracker.blinding[i, 1]:
            return False
    if norm(omega) > tracker.max_rate:
        return False
    return bool(uniform(tracker.seed, step, _DROPOUT) >= tracker.dropout_probability)


@kernel
def star_fix(
    tracker: Any,
    q: Quaternion,
    omega: Vector,
    stamp_ns: int,
    step: int,
    louder: float = 1.0,
    outliers: float = 0.0,
) -> Quaternion:
    """Fix of the slot that is valid at a step and its stamp [ns]; `NO_FIX` if there is none.

    q_m = q ⊗ q_mount ⊗ exp(n), tracker to inertial; n is normal with the tracker's σ in its own
    axes, times `louder`. A false fix is turned further about a random tracker axis; at least a
    share `outliers` of all is false.
    """
    if not _has_fix(tracker, omega, stamp_ns, step):
        return NO_FIX
    n = normal_vector(tracker.seed, step, _NOISE)
    turn = multiply(scale(louder, vector(tracker.sigma)), n)
    fix = product(product(q, quaternion(tracker.mounting)), exponential(turn))
    if uniform(tracker.seed, step, _OUTLIER) < max(tracker.outlier_probability, outliers):
        axis = normal_vector(tracker.seed, step, _OUTLIER_AXIS)
        fix = product(fix, exponential(scale(tracker.outlier_size / norm(axis), axis)))
    return normalised(fix)


def check_slots(component: Component) -> None:
    """Check that a component that reads a late column has the parameters that say when it comes.

    Raises
    ------
    ConfigurationError
        It lacks a parameter of which `Slots` are made, or it reads several late columns, or no
        other column.
    """
    lacking = [each.name for each in _SAY_WHEN if each.name not in component.defaults]
    late = [column for column in component.inputs if column.late]
    if late and not len(late) == 1 < len(component.inputs):
        raise ConfigurationError(
            f"{component.name} reads late {', '.join(each.name for each in late)}; allowed between "
            "nodes: one such column, beside others; `ppc_attitude simulate` can run this"
        )
    for column in late:
        if lacking:
            raise ConfigurationError(
                f"{component.name} reads {column.name}, which comes late, and has no parameter "
                f"{', '.join(lacking)}, which say when it comes between nodes; "
                "`ppc_attitude simulate` can run this"
            )


class Slots:
    """Which fix arrives when; the first one is valid at stamp zero.

    Parameters
    ----------
    values : mapping of str to value
        Parameters of an estimator: fixes per second, latency [s], and whether the first fix comes
        at once. A fix comes with the first instant that is not before its arrival.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        # Exact, as so many ns for so many slots: a time since 1970 has more digits than a float.
        self._ns, self._slots = (
            NANOSECONDS / Fraction(float(values[RATE.name]))
        ).as_integer_ratio()
        self._latency = nanoseconds(float(values[LATENCY.name])) - TOLERANCE
        self._initial = bool(values[INITIAL_FIX.name])

    def due(self, last_ns: int | None, stamp_ns: int) -> int | None:
        """Validity [ns] of the fix that arrives with a stamp [ns]; None if none does.

        Parameters
        ----------
        last_ns : int or None
            The stamp before; None if nobody knows it.
        stamp_ns : int
            The stamp.
        """
        if stamp_ns == 0 and self._initial:
            return 0
        slot = self._slot(stamp_ns - self._latency)
        known = slot == 0 and self._initial
        if slot < 0 or known or (last_ns is None and stamp_ns > 0):
            return None
        came_before = last_ns is not None and self._slot(last_ns - self._latency) >= slot
        return None if came_before else self._stamp(slot)

    def has(self, valid_ns: int) -> bool:
        """Whether a stamp of validity [ns] is that of a slot."""
        slot = self._slot(valid_ns + TOLERANCE)
        return slot >= 0 and abs(self._stamp(slot) - valid_ns) <= TOLERANCE

    def arrived(self, valid_ns: int, stamp_ns: int) -> bool:
        """Whether a fix that was valid at `valid_ns` should have come by the stamp `stamp_ns`."""
        return self._slot(stamp_ns - self._latency) >= self._slot(valid_ns + TOLERANCE)

    def _slot(self, time_ns: int) -> int:
        """Return the last slot that is not after a time [ns]."""
        return time_ns * self._slots // self._ns

    def _stamp(self, slot: int) -> int:
        return round(Fraction(slot * self._ns, self._slots))
