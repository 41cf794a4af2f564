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

"""Where the Sun stands and how far Earth has turned, by the date.

Days n are counted from J2000 (2000-01-01 12:00); UTC is taken as UT1 and as dynamical time.
"""

import math
import re
from datetime import datetime, timezone

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import Vector, add, cross, dot, kernel, norm, scale, subtract

DAY = 86400.0  # [s]
EARTH_RATE = 7.292115e-5  # [rad/s]
EARTH_RADIUS = 6378137.0  # R_E [m]
ASTRONOMICAL_UNIT = 1.495978707e11  # [m]
_SUN_RADIUS = 6.957e8  # [m]


@kernel
def sun_direction(days: float) -> tuple[Vector, Vector, Vector]:
    """Unit vector to the Sun and its first two derivatives [1/s], [1/s²].

    Low-precision formula of the Astronomical Almanac, geocentric, mean equator and equinox of date;
    good to 0.011° from 1900 to 2100 (`days_of` takes no other date).
    """
    per_day = math.radians(1.0) / DAY  # degrees a day in rad/s
    g = math.radians(357.528 + 0.9856003 * days)
    g_rate = 0.9856003 * per_day
    longitude = math.radians(
        280.460 + 0.9856474 * days + 1.915 * math.sin(g) + 0.020 * math.sin(2.0 * g)
    )
    rate = (
        0.9856474 * per_day + math.radians(1.915 * math.cos(g) + 0.040 * math.cos(2.0 * g)) * g_rate
    )
    curvature = -math.radians(1.915 * math.sin(g) + 0.080 * math.sin(2.0 * g)) * g_rate * g_rate
    tilt = math.radians(23.439 - 4e-7 * days)
    tilt_rate = -4e-7 * per_day
    cos_l, sin_l = math.cos(longitude), math.sin(longitude)
    cos_e, sin_e = math.cos(tilt), math.sin(tilt)
    # s = x (cos λ) + up (sin λ) with x fixed and up = (0, cos ε, sin ε) turning about x.
    x: Vector = (1.0, 0.0, 0.0)
    up: Vector = (0.0, cos_e, sin_e)
    side: Vector = (0.0, -sin_e, cos_e)
    sin_rate = cos_l * rate
    direction = add(scale(cos_l, x), scale(sin_l, up))
    first = add(scale(-sin_l * rate, x), add(scale(sin_rate, up), scale(sin_l * tilt_rate, side)))
    second = add(
        scale(-cos_l * rate * rate - sin_l * curvature, x),
        add(
            scale(cos_l * curvature - sin_l * rate * rate - sin_l * tilt_rate * tilt_rate, up),
            scale(2.0 * sin_rate * tilt_rate, side),
        ),
    )
    return direction, first, second


@kernel
def sun_distance(days: float) -> float:
    """Distance to the Sun [AU], from the same source as `sun_direction`."""
    g = math.radians(357.528 + 0.9856003 * days)
    return 1.00014 - 0.01671 * math.cos(g) - 0.00014 * math.cos(2.0 * g)


@kernel
def lit_fraction(r: Vector, sun: Vector) -> float:
    """Part of the Sun's disc that Earth leaves free, 0 to 1 (Montenbruck and Gill, section 3.4).

    Earth is a sphere. Angles are taken by their tangents: by cosines the part would be wrong by
    5e-9.

    Parameters
    ----------
    r, sun
        Craft and Sun from Earth's centre [m].
    """
    towards = subtract(sun, r)
    distance, radius = norm(towards), norm(r)
    a = math.asin(_SUN_RADIUS / distance)  # half-angles of the two discs, and between their centres
    b = math.asin(min(EARTH_RADIUS / radius, 1.0))
    c = math.atan2(norm(cross(r, towards)), -dot(r, towards))
    if c >= a + b:
        return 1.0
    if c <= b - a:
        return 0.0
    if c <= a - b:
        return 1.0 - (b / a) ** 2
    x = ((c - b) * (c + b) + a * a) / (2.0 * c)
    y = math.sqrt(max(a * a - x * x, 0.0))
    hidden = a * a * math.atan2(y, x) + b * b * math.atan2(y, c - x) - c * y
    return 1.0 - hidden / (math.pi * a * a)


@kernel
def sun_from(r: Vector, days: float) -> tuple[Vector, float]:
    """Unit vector to the Sun from r [m], and the part of its disc that Earth leaves free there."""
    sun = scale(sun_distance(days) * ASTRONOMICAL_UNIT, sun_direction(days)[0])
    towards = subtract(sun, r)
    return scale(1.0 / norm(towards), towards), lit_fraction(r, sun)


def earth_angle(days: float) -> float:
    """Greenwich mean sidereal time [rad], 0 to 2π: from the equinox of date to Greenwich.

    It grows by `EARTH_RATE` a second.
    """
    centuries = days / 36525.0
    turns = 0.7790572732640 + 0.00273781191135448 * days + days % 1.0
    precession = 0.014506 + 4612.156534 * centuries + 1.3915817 * centuries**2  # arcseconds
    return (math.tau * turns + math.radians(1.0) / 3600.0 * precession) % math.tau


def days_of(name: str, epoch: str) -> float:
    """Days from J2000 of an ISO date, with or without a time of day (UTC), of a parameter.

    Raises
    ------
    ConfigurationError
        Not a date, or none of 1900 to 2100.
    """
    try:
        # Python 3.10 does not know the Z of UTC.
        instant = datetime.fromisoformat(re.sub(r"(?<=\d)Z$", "+00:00", epoch))
        if not 1900 <= instant.year <= 2100:
            raise ValueError
    except ValueError:
        raise ConfigurationError(
            f"{name} = {epoch!r}; allowed: a date such as 2025-01-01 or 2025-01-01T06:30:00 (UTC), "
            "from 1900 to 2100"
        ) from None
    if instant.tzinfo is None:
        instant = instant.replace(tzinfo=timezone.utc)
    return (instant - datetime(2000, 1, 1, 12, tzinfo=timezone.utc)).total_seconds() / DAY
