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

"""Where the craft is by a two-line element set, which SGP4 propagates to the start of the run.

The true equator and mean equinox (TEME) of SGP4 is taken as our inertial frame: they differ by the
nutation, less than 0.006°.
"""

import math
import re
from typing import Any

import numpy as np

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.orbit import EARTH_RADIUS, ORBIT

J2000 = 2451545.0  # Julian date
OLDEST = 30.0  # [d] SGP4 is off by tens of kilometres beyond
_HIGHEST = 1e9  # [m] the Earth holds nothing that far away
_LENGTH = 69
_CRAFT = slice(2, 7)
_NUMBERS = {
    1: {"epoch": slice(18, 32)},
    2: {
        "inclination": slice(8, 16),
        "right ascension": slice(17, 25),
        "eccentricity": slice(26, 33),
        "argument of perigee": slice(34, 42),
        "mean anomaly": slice(43, 51),
        "mean motion": slice(52, 63),
    },
}
"""Where the numbers of each line are that an orbit cannot be without."""


def orbit_by_lines(name: str, text: str, days: float) -> Any:
    """Record of dtype `ORBIT` at t = 0.

    Parameters
    ----------
    name, text : str
        Name of the parameter, for errors, and its two lines.
    days : float
        Days from J2000 to t = 0.

    Raises
    ------
    ConfigurationError
        The package sgp4 is missing, the lines are no element set, or their epoch is too far.
    """
    try:
        from sgp4.api import SGP4_ERRORS, Satrec
    except ImportError:
        raise ConfigurationError(
            f"{name} needs the package sgp4: pip install 'ppc_attitude[orbit]'"
        ) from None
    first, second = _lines(name, text)
    satellite = Satrec.twoline2rv(first, second)
    age = days + (J2000 - satellite.jdsatepoch) - satellite.jdsatepochF
    if not abs(age) <= OLDEST:
        raise ConfigurationError(
            f"orbit.epoch is {age:.1f} days after the epoch of {name}; allowed: within "
            f"{OLDEST:g} days"
        )
    whole = math.floor(days)
    error, position, velocity = satellite.sgp4(J2000 + whole, days - whole)
    if error:
        raise ConfigurationError(f"{name} gives no orbit: {SGP4_ERRORS[error]}")
    record = np.zeros((), ORBIT)[()]
    record["position"] = 1e3 * np.array(position)
    record["velocity"] = 1e3 * np.array(velocity)
    height = float(np.linalg.norm(record["position"])) - EARTH_RADIUS
    if not 0.0 < height <= _HIGHEST:
        raise ConfigurationError(
            f"{name} gives a height of {height:.6g} m; allowed: > 0 and ≤ {_HIGHEST:g}"
        )
    return record


def _lines(name: str, text: str) -> tuple[str, str]:
    """The two lines, with sound checksums; a line with the name of the craft may come first."""
    lines = [line.rstrip() for line in text.strip().splitlines()][-2:]
    if len(lines) != 2:
        raise ConfigurationError(f"{name} has {len(lines)} lines; allowed: 2")
    for number, line in enumerate(lines, start=1):
        if len(line) != _LENGTH or not line.startswith(f"{number} "):
            raise ConfigurationError(
                f"{name} has line {line!r}; allowed: {_LENGTH} characters that begin with "
                f"'{number} '"
            )
        # A minus counts as 1, every other sign as 0.
        total = sum(int(c) if c.isdigit() else c == "-" for c in line[:-1]) % 10
        if line[-1] != str(total):
            raise ConfigurationError(
                f"line {number} of {name} ends in {line[-1]!r}; allowed: its checksum, {total}"
            )
        for what, columns in _NUMBERS[number].items():
            point = "" if what == "eccentricity" else r"\."  # of which only decimals are written
            if not re.fullmatch(rf"\d*{point}\d+", line[columns].replace(" ", "")):
                raise ConfigurationError(
                    f"line {number} of {name} has {what} {line[columns]!r}; allowed: a number"
                )
    first, second = lines
    if first[_CRAFT] != second[_CRAFT]:
        raise ConfigurationError(
            f"{name} has lines of craft {first[_CRAFT]!r} and {second[_CRAFT]!r}; allowed: of one"
        )
    return first, second
