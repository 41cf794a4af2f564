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

"""Frames that goals are relative to, each from two moving directions, with exact derivatives.

Also the attitudes that a user gives by roll, pitch and yaw, or by the directions of two body axes.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import conjugate, product
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guidance.rotation import Motion, about, moved_by, standing
from ppc_attitude.science.kernel import (
    STRAIGHT,
    ZERO,
    Quaternion,
    Vector,
    add,
    cross,
    dot,
    kernel,
    norm,
    quaternion,
    scale,
    subtract,
    vector,
)
from ppc_attitude.science.orbit import CURSOR, ORBIT, gravity, gravity_rate, orbit_at
from ppc_attitude.science.parameter import record_type
from ppc_attitude.science.sky import DAY, EARTH_RADIUS, EARTH_RATE, sun_direction

# NumPy's integers: Numba compiles a function anew for every Python constant it is called with.
_NUMBERS: Any = np.arange(5)
INERTIAL, NADIR, GROUND, SUN, SPIN = _NUMBERS
FRAME_NAMES = ("inertial", "nadir", "ground", "sun", "spin")

SKY = record_type(
    ("orbit", ORBIT),
    ("days", np.float64),  # from J2000 to t = 0
    ("earth_angle", np.float64),  # Greenwich at t = 0 [rad]
    ("target", np.float64, (3,)),  # [m], fixed to Earth: z the pole, x Greenwich
)
SPINNING = record_type(
    ("attitude", np.float64, (4,)),  # x y z w, at the begin
    ("axis", np.float64, (3,)),  # unit, body
    ("rate", np.float64),  # [rad/s]
    ("begin", np.float64),  # [s]
)
# |z × s|/|s| of the two directions below which a frame's y axis is ill defined.
LEAST_SINE = 0.1
_STEP = 1.0  # [s] of the grid on which a frame is sampled for its bounds

Direction = tuple[Vector, Vector, Vector]  # a vector and its first two derivatives by time


@kernel
def unit(u: Direction) -> Direction:
    """Unit vector along a moving vector, from the vector and its first two derivatives."""
    length = norm(u[0])
    n = scale(1.0 / length, u[0])
    n1 = scale(1.0 / length, subtract(u[1], scale(dot(n, u[1]), n)))
    along = dot(n1, u[1]) + dot(n, u[2])
    n2 = subtract(subtract(u[2], scale(2.0 * dot(n, u[1]), n1)), scale(along, n))
    return n, n1, scale(1.0 / length, n2)


@kernel
def crossed(a: Direction, b: Direction) -> Direction:
    """Cross product a × b with its first two derivatives, by the product rule."""
    return (
        cross(a[0], b[0]),
        add(cross(a[1], b[0]), cross(a[0], b[1])),
        add(add(cross(a[2], b[0]), scale(2.0, cross(a[1], b[1]))), cross(a[0], b[2])),
    )


@kernel
def quaternion_of(x: Vector, y: Vector, z: Vector) -> Quaternion:
    """Attitude whose axes are x, y, z: the columns of R."""
    trace = x[0] + y[1] + z[2]
    if trace > 0.0:
        s = 2.0 * math.sqrt(1.0 + trace)
        return (y[2] - z[1]) / s, (z[0] - x[2]) / s, (x[1] - y[0]) / s, 0.25 * s
    if x[0] >= y[1] and x[0] >= z[2]:
        s = 2.0 * math.sqrt(1.0 + x[0] - y[1] - z[2])
        return 0.25 * s, (y[0] + x[1]) / s, (z[0] + x[2]) / s, (y[2] - z[1]) / s
    if y[1] >= z[2]:
        s = 2.0 * math.sqrt(1.0 - x[0] + y[1] - z[2])
        return (y[0] + x[1]) / s, 0.25 * s, (z[1] + y[2]) / s, (z[0] - x[2]) / s
    s = 2.0 * math.sqrt(1.0 - x[0] - y[1] + z[2])
    return (z[0] + x[2]) / s, (z[1] + y[2]) / s, 0.25 * s, (x[1] - y[0]) / s


@kernel
def frame_of(primary: Direction, secondary: Direction) -> tuple[Motion, float]:
    """Frame with z along the primary direction and y along z × secondary.

    Returns
    -------
    motion
        Attitude of the frame, its rate [rad/s] and acceleration [rad/s²] in its own axes:
        ω^× = RᵀR', ω'^× = RᵀR'' − (ω^×)².
    sine
        |z × s|/|s|, small where the y axis is ill defined.
    """
    z = unit(primary)
    side = crossed(z, secondary)
    y = unit(side)
    x = crossed(y, z)
    wx, wy, wz = dot(z[0], y[1]), dot(x[0], z[1]), dot(y[0], x[1])
    acceleration = (
        dot(z[0], y[2]) - wy * wz,
        dot(x[0], z[2]) - wz * wx,
        dot(y[0], x[2]) - wx * wy,
    )
    motion = (quaternion_of(x[0], y[0], z[0]), (wx, wy, wz), acceleration)
    return motion, norm(side[0]) / norm(secondary[0])


@kernel
def target_at(t: float, sky: Any) -> Direction:
    """Ground point [m] in inertial axes, its velocity and acceleration: it turns with Earth."""
    angle = sky.earth_angle + EARTH_RATE * t
    c, s = math.cos(angle), math.sin(angle)
    fixed = vector(sky.target)
    r = (c * fixed[0] - s * fixed[1], s * fixed[0] + c * fixed[1], fixed[2])
    spin = (0.0, 0.0, EARTH_RATE)
    v = cross(spin, r)
    return r, v, cross(spin, v)


@kernel
def frame_at(t: float, frame: int, spinning: Any, sky: Any, cursor: Any) -> tuple[Motion, float]:
    """Motion of a goal's frame at t [s], and the sine of `frame_of` (1 where it has none).

    Parameters
    ----------
    t, frame
        Time [s] and the frame's number, an index into `FRAME_NAMES`.
    spinning
        Record of dtype `SPINNING`, for the frame `spin`.
    sky, cursor
        Record of dtype `SKY`, and the cursor of `orbit_at`.
    """
    if frame == INERTIAL:
        return standing(STRAIGHT), 1.0
    if frame == SPIN:
        axis = vector(spinning.axis)
        turn = about(axis, spinning.rate * (t - spinning.begin))
        rate = scale(spinning.rate, axis)
        return moved_by(quaternion(spinning.attitude), (turn, rate, ZERO)), 1.0
    r, v = orbit_at(t, sky.orbit, cursor)
    g, g_rate = gravity(r), gravity_rate(r, v)
    if frame == NADIR:
        return frame_of((scale(-1.0, r), scale(-1.0, v), scale(-1.0, g)), (v, g, g_rate))
    if frame == GROUND:
        point = target_at(t, sky)
        sight = (subtract(point[0], r), subtract(point[1], v), subtract(point[2], g))
        return frame_of(sight, (v, g, g_rate))
    return frame_of(sun_direction(sky.days + t / DAY), crossed((r, v, g), (v, g, g_rate)))


@kernel
def elevation_sine(t: float, sky: Any, cursor: Any) -> float:
    """Sine of the craft's elevation over the ground point's horizon at t [s]; < 0: not in sight."""
    r, _ = orbit_at(t, sky.orbit, cursor)
    point = target_at(t, sky)[0]
    sight = subtract(r, point)
    return dot(sight, point) / (norm(sight) * EARTH_RADIUS)


@kernel
def _largest(frame: int, count: int, spinning: Any, sky: Any, cursor: Any) -> Vector:
    """Largest ‖f‖, ‖f'‖, and ‖Δf'‖ from point to point, at `count` points of the grid."""
    rate, first, change = 0.0, 0.0, 0.0
    before = frame_at(0.0, frame, spinning, sky, cursor)[0][2]
    for i in range(count):
        _, omega, alpha = frame_at(i * _STEP, frame, spinning, sky, cursor)[0]
        rate, first = max(rate, norm(omega)), max(first, norm(alpha))
        change = max(change, norm(subtract(alpha, before)))
        before = alpha
    return rate, first, change


def frame_bounds(frame: int, spin_rate: float, sky: Any, duration: float) -> Vector:
    """Bounds of ‖f‖ [rad/s], ‖f'‖ [rad/s²] and ‖f''‖ [rad/s³] of a frame for a time.

    They are searched on a grid, f'' by differences of f'. The possible growth of f and f' between
    two points is added.

    Parameters
    ----------
    frame : int
        Index into `FRAME_NAMES`.
    spin_rate : float
        Rate of the frame `spin` [rad/s].
    sky : record of dtype SKY
        Orbit, date and ground point.
    duration : float
        Time that the bounds cover [s].
    """
    spinning, cursor = np.zeros((), SPINNING)[()], np.zeros((), CURSOR)[()]
    spinning["axis"], spinning["rate"] = (0.0, 0.0, 1.0), spin_rate
    count = math.ceil(duration / _STEP) + 1
    rate, first, change = _largest(frame, count, spinning, sky, cursor)
    second = change / _STEP
    return rate + 0.5 * _STEP * first, first + 0.5 * _STEP * second, second


def from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Attitude x y z w after turns [rad] about the fixed axes x, y and z, in this order."""
    x = about((1.0, 0.0, 0.0), roll)
    y = about((0.0, 1.0, 0.0), pitch)
    z = about((0.0, 0.0, 1.0), yaw)
    return product(z, product(y, x))


def from_vectors(
    axis: Sequence[float],
    direction: Sequence[float],
    second_axis: Sequence[float],
    second_direction: Sequence[float],
) -> Quaternion:
    """Attitude x y z w that points a body axis, and a second one as near as it can.

    Parameters
    ----------
    axis, second_axis : three floats
        In body axes, of any length.
    direction, second_direction : three floats
        Where they shall point, in the frame of the attitude.

    Raises
    ------
    ConfigurationError
        The axes, or the directions, are parallel within 6°, or no direction at all.
    """
    seen = _triad("directions", direction, second_direction)
    carried = _triad("body axes", axis, second_axis)
    return product(quaternion_of(*seen), conjugate(quaternion_of(*carried)))


def _triad(
    name: str, first: Sequence[float], second: Sequence[float]
) -> tuple[Vector, Vector, Vector]:
    """Right-handed unit axes: the first along `first`, the third across both."""
    (x, y, z), (u, v, w) = first, second
    across = cross((x, y, z), (u, v, w))
    length, sine = norm((x, y, z)), norm(across)
    if not (math.isfinite(sine) and sine > LEAST_SINE * length * norm((u, v, w))):
        raise ConfigurationError(
            f"the two {name} are {[*map(float, first)]} and {[*map(float, second)]}; allowed: "
            "finite, and at least 6° from being parallel"
        )
    first, third = scale(1.0 / length, (x, y, z)), scale(1.0 / sine, across)
    return first, cross(third, first), third
