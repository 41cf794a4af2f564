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

"""Allocation of a torque to wheels, so that the most loaded wheel has the least load (minimax).

The largest load is least if the wheels off some plane give their utmost and the rest is left to
those within (Markley, Reynolds, Liu, Lebsock 2010): of all planes that two axes span, with normal
m, it is the one with the largest load = tᵀm / Σ max(low aᵀm, high aᵀm). Here limits may differ
between wheels and directions. The torque that is left lies in the plane, and there the same is done
for the lines of its axes. If the wheels span a plane or a line only, it begins there.
"""

from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.kernel import (
    ZERO,
    Vector,
    copy,
    cross,
    dot,
    kernel,
    norm,
    scale,
    subtract,
    vector,
)

_PARALLEL = 1e-9  # sine of an angle below which an axis counts as within a plane, or along a line
FLAT = 1e-6  # sine of an angle below which wheels do not span the direction


class WheelArray(NamedTuple):
    """Wheels among which a torque is shared."""

    axes: Any  # unit, body, shape (≥ number, 3)
    number: int  # of wheels
    low: Any  # limits of each wheel [N·m]: low < 0 < high
    high: Any
    lost: Any  # a mark for each wheel that takes no part
    given: Any  # room for a mark for each wheel
    torques: Any  # where the torques u [N·m] are written


@kernel
def _support(direction: Vector, wheels: WheelArray) -> float:
    """Torque [N·m] along a direction that the wheels not yet given can give at most."""
    total = 0.0
    for k in range(wheels.number):
        along = dot(vector(wheels.axes[k]), direction)
        if not wheels.given[k] and abs(along) > _PARALLEL:
            total += max(wheels.low[k] * along, wheels.high[k] * along)
    return total


@kernel
def _heavier(
    normal: Vector, t: Vector, wheels: WheelArray, best: tuple[float, Vector]
) -> tuple[float, Vector]:
    """Largest of the best load so far and the loads along ±normal, with its direction."""
    length = norm(normal)
    if length < _PARALLEL:
        return best
    for sign in (1.0, -1.0):
        direction = scale(sign / length, normal)
        demand = dot(t, direction)
        if demand > 0.0:
            load = demand / _support(direction, wheels)
            if load > best[0]:
                best = (load, direction)
    return best


@kernel
def _span(wheels: WheelArray) -> tuple[int, Vector]:
    """Rank of the wheels that are not lost; of rank 2 the plane's normal, of rank 1 the line."""
    rank, found = 0, ZERO
    for k in range(wheels.number):
        if wheels.lost[k]:
            continue
        axis = vector(wheels.axes[k])
        if rank == 0:
            rank, found = 1, axis
        elif rank == 1:
            normal = cross(found, axis)
            if norm(normal) > FLAT:
                rank, found = 2, scale(1.0 / norm(normal), normal)
        elif abs(dot(axis, found)) > FLAT:
            return 3, found
    return rank, found


@kernel
def allocate(t: Vector, wheels: WheelArray) -> tuple[float, int]:
    """Let the wheels together give t [N·m] about the body's axes: A u = t.

    Wheels that span a plane or a line alone give the part of t in it.

    Returns
    -------
    load : float
        Of the most loaded wheel: above 1 the limits do not hold.
    rank : int
        How many dimensions the wheels span.
    """
    copy(wheels.given, wheels.lost)
    wheels.torques[:] = 0.0
    rank, direction = _span(wheels)
    heaviest = line = last = (0.0, ZERO)
    if rank == 3:
        for i in range(wheels.number):
            for j in range(i):
                if not (wheels.lost[i] or wheels.lost[j]):
                    normal = cross(vector(wheels.axes[i]), vector(wheels.axes[j]))
                    heaviest = _heavier(normal, t, wheels, heaviest)
        t = _give(heaviest, t, wheels)
        direction = heaviest[1]
    elif rank == 2:
        t = subtract(t, scale(dot(t, direction), direction))
    else:
        t = scale(dot(t, direction), direction)
    if rank > 1:
        for i in range(wheels.number):
            if not wheels.given[i]:
                line = _heavier(cross(direction, vector(wheels.axes[i])), t, wheels, line)
        t = _give(line, t, wheels)
    for i in range(wheels.number):
        if not wheels.given[i]:
            last = _heavier(vector(wheels.axes[i]), t, wheels, last)
    _give(last, t, wheels)
    return (heaviest[0], line[0], last[0])[3 - max(rank, 1)], rank


@kernel
def _give(heaviest: tuple[float, Vector], t: Vector, wheels: WheelArray) -> Vector:
    """Load each wheel that has a part along a direction; return what is left of t [N·m]."""
    load, direction = heaviest
    for k in range(wheels.number):
        along = dot(vector(wheels.axes[k]), direction)
        if not wheels.given[k] and abs(along) > _PARALLEL:
            wheels.given[k] = 1.0
            wheels.torques[k] = load * (wheels.high[k] if along > 0.0 else wheels.low[k])
            t = subtract(t, scale(wheels.torques[k], vector(wheels.axes[k])))
    return t


def certain_torque(axes: NDArray[np.float64], limits: NDArray[np.float64], order: int = 1) -> float:
    """Torque per axis [N·m] that wheels give in any direction: any |τ_i| up to it can be had.

    With the largest momenta [N·m·s] for limits, it is the momentum that they hold in any direction.

    Parameters
    ----------
    axes : ndarray, shape (n, 3)
        Unit axes.
    limits : ndarray, shape (n,)
        Largest torque of each wheel [N·m].
    order : int
        2 for the norm: any ‖τ‖ up to it can be had.
    """
    normals = [np.cross(a, b) for k, a in enumerate(axes) for b in axes[:k]]
    return min(
        float(np.sum(limits * np.abs(axes @ normal)) / np.linalg.norm(normal, order))
        for normal in normals
        if np.linalg.norm(normal) > _PARALLEL
    )


def largest_torque(axes: NDArray[np.float64], limits: NDArray[np.float64]) -> float:
    """Largest torque on an axis [N·m] that wheels can give: max_j Σ_i τ_i |a_ij|.

    All pull along the axis on which this is largest. Friction and gyroscopic torque can come on
    top. Parameters as of `certain_torque`.
    """
    return float((limits @ np.abs(axes)).max())


def idle_speeds(free: NDArray[np.float64], inertia: NDArray[np.float64]) -> NDArray[np.float64]:
    """Speeds of wheels whose momenta cancel, as shares of the fastest wheel's speed.

    If there is more than one way to cancel, all patterns of signs are tried, and the one is taken
    whose slowest wheel is fastest. A wheel that is in no such way stands. Of equally fast wheels
    the last one turns forwards, because the basis and the rounding differ between processors.

    Parameters
    ----------
    free : ndarray, shape (n, m)
        Basis of the momenta that cancel.
    inertia : ndarray, shape (n,)
        Spin inertia of each wheel.
    """
    ways = free[:, 0] / (inertia / inertia[0])
    if free.shape[1] > 1:
        signs = np.array([*product((1.0, -1.0), repeat=len(free))]) @ free
        every = signs[np.linalg.norm(signs, axis=1) > FLAT] @ free.T / inertia
        moving = np.linalg.norm(free, axis=1) > FLAT
        slowest = np.abs(every)[:, moving].min(axis=1) / np.abs(every).max(axis=1)
        ways = every[np.argmax(slowest > slowest.max() - FLAT)]
    fast = np.abs(ways)
    return np.asarray(ways / ways[np.flatnonzero(fast > (1.0 - FLAT) * fast.max())[-1]])
