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

"""Where the craft is: two bodies and Earth's oblateness (J2), as a function of time alone.

Orbit and date come from a node's parameters: from classical elements, or a two-line element set.
That is propagated to the start of the run by SGP4; its true equator and mean equinox (TEME) are
taken as our inertial axes (x at the equinox of date, z along Earth's axis): they differ by the
nutation, less than 0.006°.
"""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from ppc_attitude.science.errors import ConfigurationError, needed_by
from ppc_attitude.science.kernel import ZERO, Vector, add, dot, kernel, norm, scale, store, vector
from ppc_attitude.science.parameter import at_start, filled, record_type
from ppc_attitude.science.sky import EARTH_RADIUS, days_of

ORBIT = record_type(
    ("position", np.float64, (3,)),  # [m] inertial, at t = 0
    ("velocity", np.float64, (3,)),  # [m/s] inertial, at t = 0
)
CURSOR = record_type(("steps", np.int64), ORBIT)
MU = 3.986004418e14  # [m³/s²]
J2 = 1.08262668e-3
_OBLATENESS = 1.5 * J2 * MU * EARTH_RADIUS**2  # [m⁵/s²]
# The orbit is integrated on this grid whatever the sample rate is, so that it is a function of
# time alone. The error is 3e-7 m after 1800 s.
GRID = 1.0  # [s]
_POLE: Vector = (0.0, 0.0, 1.0)
_of_orbit = partial(at_start, agreed=True)
_angle = partial(_of_orbit, unit="rad", low=-math.tau, high=math.tau)
ALTITUDE = _of_orbit(
    "orbit.altitude",
    550e3,
    "semi-major axis at t = 0, osculating, minus Earth's equatorial radius",
    "m",
    low=100e3,
    high=1e9,
)
ECCENTRICITY = _of_orbit(
    "orbit.eccentricity", 0.0, "eccentricity; the perigee is above ground", low=0.0, high=0.99
)
INCLINATION = _of_orbit(
    "orbit.inclination", 1.7034413499, "inclination (97.6°)", "rad", low=0.0, high=math.pi
)
RAAN = _angle("orbit.raan", 0.0, "right ascension of the ascending node")
ARGUMENT_OF_PERIGEE = _angle("orbit.argument_of_perigee", 0.0, "argument of perigee")
MEAN_ANOMALY = _angle("orbit.mean_anomaly", 0.0, "mean anomaly at t = 0")
EPOCH = _of_orbit("orbit.epoch", "2025-01-01", "date of t = 0, ISO 8601, UTC, 1900 to 2100")
TLE = _of_orbit(
    "orbit.tle",
    "",
    "two-line element set, whose epoch is within 30 days of orbit.epoch; then orbit.altitude "
    "to orbit.mean_anomaly are ignored",
)
ORBIT_PARAMETERS = (
    ALTITUDE,
    ECCENTRICITY,
    INCLINATION,
    RAAN,
    ARGUMENT_OF_PERIGEE,
    MEAN_ANOMALY,
    EPOCH,
    TLE,
)
"""Parameters of every node that knows the orbit."""
J2000 = 2451545.0  # Julian date
OLDEST = 30.0  # [d] SGP4 is off by tens of kilometres beyond
_HIGHEST = 1e9  # [m] the Earth holds nothing that far away
_LENGTH = 69


def orbit_of(values: Mapping[str, Any]) -> Any:
    """Record of dtype `ORBIT` from checked parameter values.

    Raises
    ------
    ConfigurationError
        The perigee is below Earth's surface, or the package sgp4 is missing, the two lines give no
        orbit, or their epoch is too far from that of the run.
    """
    if values[TLE.name]:
        return _by_lines(values)
    semi_major_axis = EARTH_RADIUS + values[ALTITUDE.name]
    eccentricity = values[ECCENTRICITY.name]
    _see_that_it_is_above_ground(semi_major_axis * (1.0 - eccentricity), "the orbit")
    eccentric = _eccentric_anomaly(values[MEAN_ANOMALY.name], eccentricity)
    c, s, root = math.cos(eccentric), math.sin(eccentric), math.sqrt(1.0 - eccentricity**2)
    speed = math.sqrt(MU * semi_major_axis) / (semi_major_axis * (1.0 - eccentricity * c))
    # From perifocal to inertial axes.
    axes = _about(2, values[RAAN.name]) @ _about(0, values[INCLINATION.name])
    axes = axes @ _about(2, values[ARGUMENT_OF_PERIGEE.name])
    position = (semi_major_axis * (c - eccentricity), semi_major_axis * root * s, 0.0)
    velocity = (-speed * s, speed * root * c, 0.0)
    return filled(ORBIT, {}, position=axes @ position, velocity=axes @ velocity)


def apsis_of(orbit: Any) -> tuple[float, float]:
    """Radius of the perigee and semi-major axis [m] of the ellipse that touches an orbit at t = 0.

    Parameters
    ----------
    orbit : record of dtype `ORBIT`
    """
    r, v = orbit["position"], orbit["velocity"]
    radius = float(np.linalg.norm(r))
    eccentricity = float(np.linalg.norm(np.cross(v, np.cross(r, v)) / MU - r / radius))
    semi_major_axis = 1.0 / (2.0 / radius - float(v @ v) / MU)
    return semi_major_axis * (1.0 - eccentricity), semi_major_axis


def _see_that_it_is_above_ground(perigee: float, whose: str) -> None:
    if not perigee > EARTH_RADIUS:
        raise ConfigurationError(
            f"{whose}'s perigee is {perigee - EARTH_RADIUS:.6g} m above Earth's surface; "
            "allowed: > 0"
        )


def epoch_of(values: Mapping[str, Any]) -> float:
    """Days from J2000 to t = 0, from checked parameter values.

    Raises
    ------
    ConfigurationError
        The epoch is no date, or none of 1900 to 2100.
    """
    return days_of(EPOCH.name, values[EPOCH.name])


def _eccentric_anomaly(mean_anomaly: float, eccentricity: float) -> float:
    """E of Kepler's equation M = E − e sin E [rad], by Newton's method."""
    eccentric = mean_anomaly + eccentricity * math.sin(mean_anomaly)
    for _ in range(50):
        change = (eccentric - eccentricity * math.sin(eccentric) - mean_anomaly) / (
            1.0 - eccentricity * math.cos(eccentric)
        )
        eccentric -= change
        if abs(change) < 1e-15:
            break
    return eccentric


def _about(axis: int, angle: float) -> Any:
    """Rotation matrix about a coordinate axis (0: x, 2: z) by an angle [rad]."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = math.cos(angle)
    matrix[i, j], matrix[j, i] = -math.sin(angle), math.sin(angle)
    return matrix


def _by_lines(values: Mapping[str, Any]) -> Any:
    """Record of dtype `ORBIT` from two lines, at t = 0."""
    with needed_by(f"{TLE.name} needs the package sgp4", "orbit"):
        from sgp4.api import SGP4_ERRORS, Satrec
    lines = _lines(values[TLE.name])
    days = epoch_of(values)
    satellite = Satrec.twoline2rv(*lines)
    age = days + (J2000 - satellite.jdsatepoch) - satellite.jdsatepochF
    if not abs(age) <= OLDEST:
        raise ConfigurationError(
            f"{EPOCH.name} is {age:.1f} days after the epoch of {TLE.name}; allowed: within "
            f"{OLDEST:g} days"
        )
    whole = math.floor(days)
    error, position, velocity = satellite.sgp4(J2000 + whole, days - whole)
    if error:
        raise ConfigurationError(f"{TLE.name} gives no orbit: {SGP4_ERRORS[error]}")
    record = filled(ORBIT, {}, position=1e3 * np.array(position), velocity=1e3 * np.array(velocity))
    height = float(np.linalg.norm(record["position"])) - EARTH_RADIUS
    if not height <= _HIGHEST:
        raise ConfigurationError(
            f"{TLE.name} gives a height of {height:.6g} m; allowed: ≤ {_HIGHEST:g}"
        )
    _see_that_it_is_above_ground(apsis_of(record)[0], f"the orbit of {TLE.name}")
    return record


def _lines(text: str) -> list[str]:
    """The two lines, as sgp4 reads them; a line with the name of the craft may come first."""
    from sgp4.earth_gravity import wgs72
    from sgp4.io import compute_checksum, twoline2rv

    given = [line.rstrip() for line in text.strip().splitlines()]
    if len(given) not in (2, 3):
        raise ConfigurationError(
            f"{TLE.name} has {len(given)} lines; allowed: 2, or 3 of which the first is a name"
        )
    lines = given[-2:]
    for number, line in enumerate(lines, start=1):
        if len(line) != _LENGTH or not line.isascii() or not line.startswith(f"{number} "):
            raise ConfigurationError(
                f"{TLE.name} has line {line!r}; allowed: {_LENGTH} characters of ASCII that begin "
                f"with '{number} '"
            )
        total = compute_checksum(line)
        if line[-1] != str(total):
            raise ConfigurationError(
                f"line {number} of {TLE.name} ends in {line[-1]!r}; allowed: its checksum, {total}"
            )
    try:
        twoline2rv(*lines, wgs72)  # a check, as Satrec takes any text for a number
    except (ValueError, ArithmeticError, TypeError) as error:  # TypeError from complex numbers
        told = str(error).partition("\n")[0]
        raise ConfigurationError(
            f"{TLE.name} = {lines} gives no orbit: {told}; allowed: a two-line element set"
        ) from None
    return lines


@kernel
def gravity(r: Vector) -> Vector:
    """g(r) [m/s²] of a point mass and J2; r [m] from Earth's centre."""
    radius = norm(r)
    squared = r[2] * r[2] / (radius * radius)
    oblate = add(scale(1.0 - 5.0 * squared, r), scale(2.0 * r[2], _POLE))
    return add(scale(-MU / radius**3, r), scale(-_OBLATENESS / radius**5, oblate))


@kernel
def gravity_rate(r: Vector, v: Vector) -> Vector:
    """(∂g/∂r) v [m/s³]: the rate of `gravity` along a motion with velocity v [m/s]."""
    radius = norm(r)
    growth = dot(r, v) / (radius * radius)  # |r|'/|r| [1/s]
    squared = r[2] * r[2] / (radius * radius)
    squared_rate = 2.0 * r[2] * v[2] / (radius * radius) - 2.0 * squared * growth
    point = scale(-MU / radius**3, add(v, scale(-3.0 * growth, r)))
    oblate = add(scale(1.0 - 5.0 * squared, r), scale(2.0 * r[2], _POLE))
    oblate_rate = add(
        add(scale(-5.0 * squared_rate, r), scale(1.0 - 5.0 * squared, v)), scale(2.0 * v[2], _POLE)
    )
    oblate_term = add(oblate_rate, scale(-5.0 * growth, oblate))
    return add(point, scale(-_OBLATENESS / radius**5, oblate_term))


@kernel
def _step(r: Vector, v: Vector, h: float) -> tuple[Vector, Vector]:
    """One classical Runge-Kutta step of r'' = g(r)."""
    a1 = gravity(r)
    v2 = add(v, scale(0.5 * h, a1))
    a2 = gravity(add(r, scale(0.5 * h, v)))
    v3 = add(v, scale(0.5 * h, a2))
    a3 = gravity(add(r, scale(0.5 * h, v2)))
    v4 = add(v, scale(h, a3))
    a4 = gravity(add(r, scale(h, v3)))
    velocity = add(add(v, v4), scale(2.0, add(v2, v3)))
    acceleration = add(add(a1, a4), scale(2.0, add(a2, a3)))
    return add(r, scale(h / 6.0, velocity)), add(v, scale(h / 6.0, acceleration))


@kernel
def orbit_at(t: float, orbit: Any, cursor: Any) -> tuple[Vector, Vector]:
    """Position [m] and velocity [m/s] at t [s], inertial axes.

    Parameters
    ----------
    t
        Time [s], t ≥ 0.
    orbit
        Record of dtype `ORBIT`.
    cursor
        Record of dtype `CURSOR`: the last grid point, so that the next call goes on from there; all
        zero means not begun. A call for an earlier time begins again.
    """
    whole = math.floor(t / GRID)
    r, v = vector(cursor.position), vector(cursor.velocity)
    if r == ZERO or cursor.steps > whole:
        cursor.steps = 0
        r, v = vector(orbit.position), vector(orbit.velocity)
    for _ in range(cursor.steps, whole):
        r, v = _step(r, v, GRID)
    cursor.steps = whole
    store(cursor.position, r)
    store(cursor.velocity, v)
    rest = t - whole * GRID
    if rest > 0.0:
        return _step(r, v, rest)
    return r, v
