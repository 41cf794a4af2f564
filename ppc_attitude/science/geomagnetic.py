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

"""Earth's magnetic field, also along the orbit, by the reference field IGRF-14.

B = −∇V with V = a Σ (a/r)ⁿ⁺¹ (g cos mλ + h sin mλ) P_nm(sin φ), a = 6371.2 km. The harmonics are
those of Cunningham, in Cartesian coordinates, so that nothing is singular over a pole (Montenbruck
and Gill, section 3.2).
"""

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.component import BODY, MAGNETIC, Column
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import Vector, divide, dot, kernel, scale
from ppc_attitude.science.orbit import EPOCH, ORBIT, ORBIT_PARAMETERS, epoch_of, orbit_of
from ppc_attitude.science.parameter import Parameter, filled, record_type
from ppc_attitude.science.sky import EARTH_RATE, days_of, earth_angle

REFERENCE_RADIUS = 6371.2e3  # a [m]
MOST_DEGREE = 13
_TABLE = Path(__file__).with_name("igrf14.csv")
_TESLA = 1e-9  # of the table's nanotesla
_DEGREES = {"igrf": MOST_DEGREE, "dipole": 1}
MODEL = Parameter(
    "orbit.field",
    "igrf",
    "Earth's magnetic field: IGRF-14 to degree 13, or its first degree, which is up to 67 % off",
    choices=tuple(_DEGREES),
    agreed=True,
)
PARAMETERS = (*ORBIT_PARAMETERS, MODEL)
MAGNETIC_FIELD = Column(
    "magnetic_field", "magnetic_field", MAGNETIC, BODY, "T", "Earth's magnetic field at the craft"
)
FIELD = record_type(
    ("degree", np.int64),
    ("g", np.float64, (MOST_DEGREE + 1, MOST_DEGREE + 1)),  # [T] of harmonics not normalised
    ("h", np.float64, (MOST_DEGREE + 1, MOST_DEGREE + 1)),
)
ORBIT_FIELD = record_type(
    ("orbit", ORBIT),
    ("earth_angle", np.float64),  # Greenwich at t = 0 [rad]
    ("harmonics", FIELD),
)


@cache
def _table() -> tuple[list[str], NDArray[np.float64]]:
    """Dates of the epochs, and the rows: n, m, then a coefficient [nT] of each epoch."""
    years = next(row for row in _TABLE.read_text().splitlines() if row.startswith("n,"))
    rows = np.loadtxt(_TABLE, delimiter=",", skiprows=4)
    return [f"{year}-01-01" for year in years.split(",")[2:]], rows


def field_of(days: float, degree: int = MOST_DEGREE) -> Any:
    """Record of dtype `FIELD` at a date.

    Parameters
    ----------
    days : float
        Days from J2000.
    degree : int
        Degree of the series, up to `MOST_DEGREE`; 1 is the tilted dipole.

    Raises
    ------
    ConfigurationError
        The date is outside the model's.
    """
    dates, rows = _table()
    epochs = [days_of(EPOCH.name, date) for date in dates]
    if not epochs[0] <= days <= epochs[-1]:
        raise ConfigurationError(
            f"{EPOCH.name} is {days:.2f} days from 2000-01-01T12:00; allowed with the magnetic "
            f"field: from {dates[0]} to {dates[-1]}"
        )
    record = np.zeros((), FIELD)[()]
    record["degree"] = degree
    for n, m, *values in rows:
        order = abs(int(m))
        schmidt = math.sqrt(
            (2 if order else 1) * math.factorial(int(n) - order) / math.factorial(int(n) + order)
        )
        value = _TESLA * schmidt * np.interp(days, epochs, values)
        record["g" if m >= 0 else "h"][int(n), order] = value
    return record


@kernel
def field_at(r: Vector, field: Any) -> Vector:
    """B [T] at r [m], both in axes that turn with Earth, x through Greenwich.

    Parameters
    ----------
    r
        From Earth's centre [m].
    field
        Record of dtype `FIELD`.
    """
    squared = dot(r, r)
    shrink = REFERENCE_RADIUS * REFERENCE_RADIUS / squared
    x, y, z = divide(scale(REFERENCE_RADIUS, r), (squared, squared, squared))
    bx, by, bz = 0.0, 0.0, 0.0
    # V + iW of degree n and order m, by columns of equal order: first the diagonal n = m.
    v_m, w_m = REFERENCE_RADIUS / math.sqrt(squared), 0.0
    for m in range(field.degree + 2):
        if m > 0:
            v_m, w_m = (2 * m - 1) * (x * v_m - y * w_m), (2 * m - 1) * (x * w_m + y * v_m)
        v, w, v_below, w_below = v_m, w_m, 0.0, 0.0
        for n in range(m, field.degree + 2):
            if n > m:
                rise, fall = (2 * n - 1) * z / (n - m), (n + m - 1) * shrink / (n - m)
                v, v_below = rise * v - fall * v_below, v
                w, w_below = rise * w - fall * w_below, w
            # The gradient of a coefficient of degree n − 1 is made of harmonics of degree n.
            c = n - 1
            if c < 1:
                continue
            if m <= c:
                bz += (n - m) * (field.g[c, m] * v + field.h[c, m] * w)
            if m == 1:
                bx += field.g[c, 0] * v
                by += field.g[c, 0] * w
            elif m > 1:
                g, h = field.g[c, m - 1], field.h[c, m - 1]
                bx += 0.5 * (g * v + h * w)
                by += 0.5 * (g * w - h * v)
            if m + 1 <= c:
                g, h = field.g[c, m + 1], field.h[c, m + 1]
                weight = 0.5 * (n - m) * (n - m - 1)
                bx -= weight * (g * v + h * w)
                by -= weight * (h * v - g * w)
    return bx, by, bz


def largest_field(radius: float, field: Any) -> float:
    """Bound of ‖B‖ [T] at a distance [m] from Earth's centre or farther.

    By the addition theorem the part of degree n is at most (n + 1) (a/r)ⁿ⁺² times the root of the
    sum of its squared coefficients, Schmidt semi-normalised.
    """
    bound = 0.0
    for n in range(1, int(field["degree"]) + 1):
        squares = 0.0
        for order in range(n + 1):
            ratio = math.factorial(n + order) / math.factorial(n - order) / (2 if order else 1)
            squares += ratio * (field["g"][n, order] ** 2 + field["h"][n, order] ** 2)
        bound += (n + 1) * (REFERENCE_RADIUS / radius) ** (n + 2) * math.sqrt(squares)
    return bound


def orbit_field(values: Mapping[str, Any]) -> Any:
    """Record of dtype `ORBIT_FIELD` from checked parameter values.

    Raises
    ------
    ConfigurationError
        The orbit is impossible, or the date is outside the field's model.
    """
    days, orbit = epoch_of(values), orbit_of(values)
    harmonics = field_of(days, _DEGREES[values[MODEL.name]])
    angle = earth_angle(days)
    return filled(ORBIT_FIELD, {}, orbit=orbit, earth_angle=angle, harmonics=harmonics)


@kernel
def magnetic_field(r: Vector, t: float, field: Any) -> Vector:
    """B [T] at r [m] and t [s], inertial axes; the field is a record of dtype `ORBIT_FIELD`."""
    angle = field.earth_angle + EARTH_RATE * t
    c, s = math.cos(angle), math.sin(angle)
    bx, by, bz = field_at((c * r[0] + s * r[1], c * r[1] - s * r[0], r[2]), field.harmonics)
    return (c * bx - s * by, s * bx + c * by, bz)
