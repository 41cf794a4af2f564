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

"""Timed profiles: an attitude at each of many instants, with rates that are given or chosen."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import unit_quaternion
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guidance.frames import INERTIAL
from ppc_attitude.science.guidance.goals import (
    TOO_FAR,
    TOO_FAST,
    TOO_LATE,
    kept_clear,
    no_slew,
    refused,
)
from ppc_attitude.science.guidance.plan import MOST_LEGS, append_polynomial, leg_motion
from ppc_attitude.science.guidance.rotation import rotation_vector_rates, turn_between
from ppc_attitude.science.guidance.slew import ROUNDING, SAMPLES
from ppc_attitude.science.keep_out import EVERY_CONE
from ppc_attitude.science.kernel import (
    Vector,
    kernel,
    norm,
    quaternion,
    scale,
    store_quaternion,
    vector,
)
from ppc_attitude.science.parameter import record_type
from ppc_attitude.science.sky import DAY
from ppc_attitude.science.stamps import LATEST

MOST_POINTS = 40  # the way to the first point needs legs too
_CLOSEST = 1e-12  # [s] between two points: a segment divides by the fifth power of it
_LAST = 2.0 * LATEST  # [s] an order at LATEST may reach as far ahead again
POINTS = record_type(
    ("count", np.int64),
    ("time", np.float64, (MOST_POINTS,)),  # [s], increasing
    ("attitude", np.float64, (MOST_POINTS, 4)),  # x y z w, inertial
    ("rate", np.float64, (MOST_POINTS, 3)),  # [rad/s] desired frame
    ("acceleration", np.float64, (MOST_POINTS, 3)),  # [rad/s²] desired frame
)


def points(
    times: Sequence[float],
    attitudes: Sequence[Sequence[float]],
    rates: Sequence[Sequence[float] | None],
    accelerations: Sequence[Sequence[float] | None],
) -> Any:
    """Record of dtype `POINTS`; missing rates are chosen.

    Parameters
    ----------
    times : sequence of float
        Instants [s].
    attitudes : sequence of four floats
        Unit quaternions x y z w, desired frame to inertial.
    rates, accelerations : sequence of three floats or None
        In the desired frame [rad/s], [rad/s²]. A missing rate is 0 at the ends and the mean of the
        neighbouring turns' mean rates within; a missing acceleration is 0.

    Raises
    ------
    ConfigurationError
        Fewer than two or too many points, times that do not increase, numbers that are not finite,
        attitudes that are not unit, or a first or last point in motion.
    """
    count = len(times)
    if not 2 <= count <= MOST_POINTS:
        raise ConfigurationError(f"a trajectory of {count} points; allowed: 2 to {MOST_POINTS}")
    record = np.zeros((), POINTS)[()]
    record["count"] = count
    quaternions = [
        unit_quaternion(f"attitude of point {i}", each) for i, each in enumerate(attitudes)
    ]
    if not ((np.diff(times) > _CLOSEST).all() and times[-1] <= _LAST):
        raise ConfigurationError(
            f"times of the points are {list(times)}; allowed: finite and increasing by more than "
            f"{_CLOSEST:g} s, up to {_LAST:g} s"
        )
    record["time"][:count] = times
    record["attitude"][:count] = quaternions
    means = [
        np.multiply(*turn_between(a, b)) / length
        for a, b, length in zip(quaternions[:-1], quaternions[1:], np.diff(times), strict=True)
    ]
    for i, (rate, acceleration) in enumerate(zip(rates, accelerations, strict=True)):
        within = 0 < i < count - 1
        chosen = 0.5 * (means[i - 1] + means[i]) if within else np.zeros(3)
        record["rate"][i] = chosen if rate is None else rate
        record["acceleration"][i] = np.zeros(3) if acceleration is None else acceleration
        if not np.isfinite([record["rate"][i], record["acceleration"][i]]).all():
            raise ConfigurationError(f"point {i} has a rate or acceleration that is not finite")
    for i in (0, count - 1):
        if record["rate"][i].any() or record["acceleration"][i].any():
            raise ConfigurationError(
                f"point {i} is in motion: rate {record['rate'][i].tolist()} rad/s, acceleration "
                f"{record['acceleration'][i].tolist()} rad/s²; first and last must be at rest"
            )
    return record


@kernel
def quintic(
    change: Vector, first: Vector, second: Vector, last: Vector, last_second: Vector, length: float
) -> Any:
    """c1 … c5 [rad/s … rad/s⁵] of φ(t) = c1 t + … + c5 t⁵ with given values at both ends.

    φ(T) = change, φ'(0), φ''(0), φ'(T) and φ''(T), T = length [s].
    """
    coefficients = np.empty((5, 3))
    for i in range(3):
        left = change[i] - (first[i] + 0.5 * second[i] * length) * length
        rate = (last[i] - first[i] - second[i] * length) * length
        bend = (last_second[i] - second[i]) * length * length
        coefficients[0, i] = first[i]
        coefficients[1, i] = 0.5 * second[i]
        coefficients[2, i] = (10.0 * left - 4.0 * rate + 0.5 * bend) / length**3
        coefficients[3, i] = (-15.0 * left + 7.0 * rate - bend) / length**4
        coefficients[4, i] = (6.0 * left - 3.0 * rate + 0.5 * bend) / length**5
    return coefficients


@kernel
def _segment(trial: Any, i: int, points: Any, limits: Any) -> float:
    """Add the quintic from point i to the next; return its largest |ω|/V or |α|/A."""
    start = quaternion(points.attitude[i])
    axis, angle = turn_between(start, quaternion(points.attitude[i + 1]))
    change = scale(angle, axis)
    length = points.time[i + 1] - points.time[i]
    last, last_second = rotation_vector_rates(
        change, vector(points.rate[i + 1]), vector(points.acceleration[i + 1])
    )
    coefficients = quintic(
        change, vector(points.rate[i]), vector(points.acceleration[i]), last, last_second, length
    )
    append_polynomial(trial, INERTIAL, points.time[i], length, start, coefficients)
    leg = trial.legs[trial.count - 1]
    share = 0.0
    for k in range(SAMPLES + 1):
        _, omega, alpha = leg_motion(leg, length * k / SAMPLES)
        faster = max(norm(omega) / limits.max_rate, norm(alpha) / limits.max_acceleration)
        share = max(share, faster)
    return share


@kernel
def append_profile(t: float, points: Any, guidance: Any, state: Any) -> int:
    """Add the way through all points of a timed profile to the plan that leads to the first one.

    Parameters
    ----------
    t
        Time at which the profile is ordered [s].
    points
        Record of dtype `POINTS`.
    guidance, state
        Records of dtype `GUIDANCE` and `STATE`.

    Returns
    -------
    outcome
        As of `plan_to`; also `TOO_LATE` if the first point comes before the slew to it has ended,
        `TOO_FAR` if the last one comes more than a day ahead while there are cones, and `TOO_FAST`
        if a segment breaks V or A.
    """
    trial = state.plans[1 - state.active]
    if trial.end > points.time[0]:
        return refused(TOO_LATE, trial.end, points.time[0], state)
    last = points.time[points.count - 1]
    if guidance.cones.count and last > t + DAY:  # the search for cones steps along all of it
        return refused(TOO_FAR, last, t + DAY, state)
    if trial.count + points.count > MOST_LEGS:
        return no_slew(guidance, state)
    approached = trial.end  # the cones are checked until here
    if approached < points.time[0]:
        start, wait = quaternion(points.attitude[0]), points.time[0] - approached
        append_polynomial(trial, INERTIAL, approached, wait, start, np.zeros((5, 3)))
    for i in range(points.count - 1):
        share = _segment(trial, i, points, guidance.limits)
        if share > ROUNDING:
            return refused(TOO_FAST, share, points.time[i], state)
    store_quaternion(trial.attitude, quaternion(points.attitude[points.count - 1]))
    return kept_clear(trial, t, approached, EVERY_CONE, guidance, state)
