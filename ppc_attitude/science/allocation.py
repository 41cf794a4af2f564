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

"""Which wheel gives how much of a torque: the least load of the most loaded one.

The largest load of any wheel is least if the wheels off some plane give their utmost and the rest
is left to those within (Markley, Reynolds, Liu, Lebsock 2010): for all planes that two axes span,
with normal m, load = tᵀm / Σ max(low aᵀm, high aᵀm). Here limits may differ between wheels and
directions. What is left lies in the plane, and there the same is done for the lines of its axes.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.kernel import Vector, cross, dot, kernel, norm, scale, subtract, vector

_PARALLEL = 1e-9  # sine of an angle below which an axis counts as within a plane, or along a line


class WheelArray(NamedTuple):
    """Wheels among which a torque is shared.

    Attributes
    ----------
    axes : ndarray, shape (≥ number, 3)
        Unit axes, body.
    number : int
        Number of wheels.
    low, high : ndarray
        Limits of each wheel [N·m]: low < 0 < high.
    given : ndarray
        Room for one mark for each wheel.
    torques : ndarray
        Where the torques u [N·m] are written.
    """

    axes: Any
    number: int
    low: Any
    high: Any
    given: Any
    torques: Any


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
    """Larger load of what was known and the two directions of a normal, with its direction."""
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
def allocate(t: Vector, wheels: WheelArray) -> float:
    """Let the wheels together give t [N·m] about the body's axes: A u = t.

    Returns
    -------
    float
        Load of the most loaded wheel: above 1 the limits do not hold.
    """
    nothing = (0.0, (0.0, 0.0, 0.0))
    wheels.given[:] = 0.0
    wheels.torques[:] = 0.0
    heaviest = nothing
    for i in range(wheels.number):
        for j in range(i):
            normal = cross(vector(wheels.axes[i]), vector(wheels.axes[j]))
            heaviest = _heavier(normal, t, wheels, heaviest)
    t = _give(heaviest, t, wheels)
    line = nothing
    for i in range(wheels.number):
        if not wheels.given[i]:
            line = _heavier(cross(heaviest[1], vector(wheels.axes[i])), t, wheels, line)
    t = _give(line, t, wheels)
    last = nothing
    for i in range(wheels.number):
        if not wheels.given[i]:
            last = _heavier(vector(wheels.axes[i]), t, wheels, last)
    _give(last, t, wheels)
    return heaviest[0]


@kernel
def _give(heaviest: tuple[float, Vector], t: Vector, wheels: WheelArray) -> Vector:
    """Load each wheel that reaches along a direction; return what is left of t [N·m]."""
    load, direction = heaviest
    for k in range(wheels.number):
        along = dot(vector(wheels.axes[k]), direction)
        if not wheels.given[k] and abs(along) > _PARALLEL:
            wheels.given[k] = 1.0
            wheels.torques[k] = load * (wheels.high[k] if along > 0.0 else wheels.low[k])
            t = subtract(t, scale(wheels.torques[k], vector(wheels.axes[k])))
    return t


def certain_torque(axes: NDArray[np.float64], limits: NDArray[np.float64]) -> float:
    """Torque per axis [N·m] that wheels give in any direction: any |τ_i| up to it can be had.

    Parameters
    ----------
    axes : ndarray, shape (n, 3)
        Unit axes.
    limits : ndarray, shape (n,)
        Largest torque of each wheel [N·m].
    """
    normals = [np.cross(a, b) for k, a in enumerate(axes) for b in axes[:k]]
    return min(
        float(np.sum(limits * np.abs(axes @ normal)) / np.sum(np.abs(normal)))
        for normal in normals
        if np.linalg.norm(normal) > _PARALLEL
    )


def largest_torque(axes: NDArray[np.float64], limits: NDArray[np.float64]) -> float:
    """Largest torque on an axis [N·m] that wheels can give: max_j Σ_i τ_i |a_ij|.

    All pull along the axis on which this is largest. Friction and gyroscopic torque can come on
    top. Parameters as of `certain_torque`.
    """
    return float((limits @ np.abs(axes)).max())
