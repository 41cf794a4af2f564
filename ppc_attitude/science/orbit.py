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

Inertial axes: x at the equinox of date, z along Earth's axis.
"""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.kernel import ZERO, Vector, add, dot, kernel, norm, scale, store, vector
from ppc_attitude.science.parameter import record_type

ORBIT = record_type(
    ("position", np.float64, (3,)),  # [m] inertial, at t = 0
    ("velocity", np.float64, (3,)),  # [m/s] inertial, at t = 0
)
CURSOR = record_type(("steps", np.int64), ORBIT)
MU = 3.986004418e14  # [m³/s²]
EARTH_RADIUS = 6378137.0  # R_E [m]
J2 = 1.08262668e-3
_OBLATENESS = 1.5 * J2 * MU * EARTH_RADIUS**2  # [m⁵/s²]
# The orbit is integrated on this grid whatever the sample rate is, so that it is a function of
# time alone. The error is 3e-7 m after 1800 s.
GRID = 1.0  # [s]
_POLE: Vector = (0.0, 0.0, 1.0)


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
