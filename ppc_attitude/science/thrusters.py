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

"""On/off thrusters: their parameters and record, and the on-times that give an impulse.

Thruster j turns the craft by b = r × F d. On-times t ≥ 0 of a period give an angular impulse Σ t b,
and of all that give the wanted impulse, those with the least Σ F t are taken. That is a linear
program, solved by some three thrusters: all threes are tried, with inverses made at the start.
"""

from collections.abc import Iterator, Mapping
from itertools import combinations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.component import BODY, EFFORTS, MAX_THRUSTERS, VECTOR, Column
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import (
    ZERO,
    Vector,
    apply,
    dot,
    kernel,
    largest,
    matrix,
    scale,
    subtract,
    vector,
)
from ppc_attitude.science.parameter import Parameter, at_start, exact_text, record_type
from ppc_attitude.science.stamps import whole_steps

STANDARD_GRAVITY = 9.80665  # g0 [m/s²]
_MOST_THREES = MAX_THRUSTERS * (MAX_THRUSTERS - 1) * (MAX_THRUSTERS - 2) // 6
_FLAT = 1e-9  # length or volume of unit vectors' products, below which they span nothing
_NONE = 1e-9  # share of the longest on-time that counts as none
_TIE = 1e-12  # share of the cost by which a later three must be cheaper
_NEAR_TIE = 1e-9  # share by which rounding may make a three look cheaper than another
_C, _S = 0.9396926207859084, 0.3420201433256687  # cosine and sine of 20°
_X, _Z = 0.3, 0.25  # [m]
POSITIONS = at_start(
    "thrusters.positions",
    [
        *(_X, _X, _Z, _X, -_X, _Z, -_X, _X, _Z, -_X, -_X, _Z),
        *(_X, _X, -_Z, _X, -_X, -_Z, -_X, _X, -_Z, -_X, -_X, -_Z),
    ],
    "position of each thruster from the centre of mass, body axes, three numbers each, up to "
    f"{MAX_THRUSTERS} thrusters",
    "m",
    length=-3,
)
DIRECTIONS = at_start(
    "thrusters.directions",
    [
        *(0.0, -_C, -_S, -_C, 0.0, -_S, _C, 0.0, -_S, 0.0, _C, -_S),
        *(-_C, 0.0, _S, 0.0, _C, _S, 0.0, -_C, _S, _C, 0.0, _S),
    ],
    "direction of the force of each thruster, body axes, three numbers each; normalised",
    length=-3,
)
FORCE = Parameter(
    "thrusters.force",
    [0.1],
    "force F of each thruster; once each, or one for all",
    "N",
    above=0.0,
    high=1e6,
)
SPECIFIC_IMPULSE = Parameter(
    "thrusters.specific_impulse", 65.0, "specific impulse", "s", low=1.0, high=1e5
)
PERIOD = at_start(
    "thrusters.period",
    0.1,
    "pulse period T, a whole number of steps; pulses begin once in it",
    "s",
    low=0.02,
    high=10.0,
)
MIN_ON_TIME = Parameter("thrusters.min_on_time", 0.01, "shortest pulse", "s", low=0.0, high=10.0)
CARRY = Parameter(
    "thrusters.carry",
    True,
    "true: the impulse of a pulse shorter than min_on_time is kept for the next period; false: "
    "the pulse is lost, or made as long as min_on_time if it has half of it",
)
FUEL = Parameter("thrusters.fuel", 0.5, "fuel at t = 0", "kg", low=0.0, high=1e6)
PARAMETERS = (POSITIONS, DIRECTIONS, FORCE, SPECIFIC_IMPULSE, PERIOD, MIN_ON_TIME, CARRY, FUEL)
THRUSTERS = record_type(
    ("count", np.int64),
    ("torque", np.float64, (MAX_THRUSTERS, 3)),  # b [N·m] body
    ("force", np.float64, (MAX_THRUSTERS,)),  # F [N]
    ("flow", np.float64, (MAX_THRUSTERS,)),  # [kg/s] of a thruster that is on
    ("threes", np.int64),
    ("members", np.int64, (_MOST_THREES, 3)),
    ("inverse", np.float64, (_MOST_THREES, 3, 3)),  # from impulse to on-times
    ("rate", np.float64),  # [Hz] of steps
    ("period", np.int64),  # in steps
    ("min_on_time", np.float64),  # [s]
    ("carries", np.float64),
    ("fuel", np.float64),  # [kg]
)
ON_TIME = Column(
    "thruster_on_time",
    "thrusters/on_time",
    EFFORTS,
    BODY,
    "s",
    "commanded on-time of each thruster in the period of the stamp, from its start",
    width=MAX_THRUSTERS,
    part="thruster",
)
FUEL_USED = Column(
    "fuel_used",
    "thrusters/fuel_used",
    VECTOR,
    BODY,
    "kg",
    "fuel used by the thrusters until the end of the step of the stamp",
    width=1,
)


def thruster_record(values: Mapping[str, Any]) -> Any:
    """Record of dtype `THRUSTERS` from checked parameter values.

    Raises
    ------
    ConfigurationError
        Too many thrusters, lists of different lengths, thrusters that cannot turn the craft every
        way, a period that is no whole number of steps, or a shortest pulse longer than it.
    """
    record = np.zeros((), THRUSTERS)[()]
    torques, forces = torques_of(values)
    count = len(torques)
    record["count"] = count
    record["torque"][:count], record["force"][:count] = torques, forces
    record["flow"][:count] = forces / (STANDARD_GRAVITY * values[SPECIFIC_IMPULSE.name])
    for k, (three, inverse) in enumerate(_threes(torques)):
        record["threes"], record["members"][k], record["inverse"][k] = k + 1, three, inverse
    record["rate"] = values["rate"]
    record["period"] = whole_steps(PERIOD.name, values[PERIOD.name], values["rate"])
    if values[MIN_ON_TIME.name] > values[PERIOD.name]:
        raise ConfigurationError(
            f"{MIN_ON_TIME.name} = {exact_text(values[MIN_ON_TIME.name])} s; allowed: "
            f"at most {PERIOD.name} = {exact_text(values[PERIOD.name])} s"
        )
    record["min_on_time"] = values[MIN_ON_TIME.name]
    record["carries"] = values[CARRY.name]
    record["fuel"] = values[FUEL.name]
    return record


def torques_of(values: Mapping[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Torque b [N·m] of each thruster, shape (n, 3), and force [N], from parameter values.

    Raises
    ------
    ConfigurationError
        Too many thrusters, lists of different lengths, or a torque that cannot be had.
    """
    positions = np.reshape(np.array(values[POSITIONS.name], np.float64), (-1, 3))
    directions = np.reshape(np.array(values[DIRECTIONS.name], np.float64), (-1, 3))
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    count, forces = len(positions), values[FORCE.name]
    if count > MAX_THRUSTERS or len(directions) != count or len(forces) not in (1, count):
        raise ConfigurationError(
            f"{POSITIONS.name} has {count} thrusters, {DIRECTIONS.name} {len(directions)}, "
            f"{FORCE.name} {len(forces)}; allowed: as many of each, or one force for all, at most "
            f"{MAX_THRUSTERS}"
        )
    if not (lengths > 1e-6).all():
        raise ConfigurationError(
            f"{DIRECTIONS.name} = {values[DIRECTIONS.name]}; allowed: each longer than 1e-6"
        )
    each = np.broadcast_to(np.array(forces, np.float64), count)
    torques = np.cross(positions, each[:, None] * directions / lengths)
    sizes = np.linalg.norm(torques, axis=1)
    torques[sizes <= _FLAT * each * np.linalg.norm(positions, axis=1)] = 0.0  # by rounding alone
    axes = _unit(torques)
    for way in _extreme_ways(axes):
        if (axes @ way).max(initial=0.0) <= _FLAT:
            raise ConfigurationError(
                f"{POSITIONS.name} and {DIRECTIONS.name}: no thruster gives torque about "
                f"{np.round(way, 4).tolist()}; allowed: torque about every axis, both ways"
            )
    return torques, each


def _unit(torques: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors along torques; zero where there is none."""
    sizes = np.linalg.norm(torques, axis=1, keepdims=True)
    return np.asarray(torques / np.where(sizes > 0.0, sizes, 1.0))


def _extreme_ways(axes: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Unit vectors among which is one that no axis has a part along, if there is any at all.

    Such ways form a cone, whose edges are normal to two of the axes; or all axes lie in a plane,
    and its normal is one.
    """
    normals = [np.cross(a, b) for a, b in combinations(axes, 2)]
    flat = np.linalg.svd(np.vstack([axes, np.zeros((3, 3))]))[2][-1]
    for normal in (flat, *normals):
        length = np.linalg.norm(normal)
        if length > _FLAT:
            yield from (normal / length, -normal / length)


def _threes(torques: NDArray[np.float64]) -> Iterator[tuple[tuple[int, ...], Any]]:
    """Threes of thrusters that span space, and the inverse of the matrix of their torques."""
    axes = _unit(torques)
    for three in combinations(range(len(torques)), 3):
        if abs(np.linalg.det(axes[list(three)])) > _FLAT:
            yield three, np.linalg.inv(torques[list(three)].T)


@kernel
def _on_times(k: int, impulse: Vector, craft: Any) -> tuple[Vector, float]:
    """On-times [s] by which a three gives an impulse, and Σ F t [N·s], infinite if it cannot."""
    t = apply(matrix(craft.inverse[k]), impulse)
    if min(t[0], t[1], t[2]) < -_NONE * largest(t):
        return t, np.inf
    a, b, c = craft.members[k]
    return t, dot(t, (craft.force[a], craft.force[b], craft.force[c]))


@kernel
def least_fuel(impulse: Vector, craft: Any, on_time: Any) -> None:
    """Write the on-times [s] that give an angular impulse with the least fuel.

    If several threes need equally little, the first one is taken.

    Parameters
    ----------
    impulse
        [N·m·s], body axes.
    craft
        Record of dtype `THRUSTERS`.
    on_time
        Where the on-times are written; they may be longer than a period.
    """
    on_time[:] = 0.0
    least, best, times = np.inf, 0, ZERO
    for k in range(craft.threes):
        t, cost = _on_times(k, impulse, craft)
        if cost < least * (1.0 - _TIE):
            least, best, times = cost, k, t
    for i in range(3):
        on_time[craft.members[best, i]] = max(times[i], 0.0)


@kernel
def admitted(on_time: float, craft: Any) -> float:
    """On-time [s] that is fired for a wanted one, which may be below the shortest pulse."""
    if on_time >= (1.0 - _NONE) * craft.min_on_time:  # rounding may shorten a whole period
        return on_time
    if craft.carries != 0.0 or 2.0 * on_time < craft.min_on_time:
        return 0.0
    return float(craft.min_on_time)


@kernel
def pulses(impulse: Vector, craft: Any, on_time: Any) -> Vector:
    """Write the on-times [s] of a period; return the impulse [N·m·s] that is left for the next.

    Impulse that a whole period cannot give is dropped: it would pile up while too much is asked.
    """
    least_fuel(impulse, craft, on_time)
    longest = period = craft.period / craft.rate
    for j in range(craft.count):
        longest = max(longest, on_time[j])
    share = period / longest
    left = scale(share, impulse)
    for j in range(craft.count):
        on_time[j] = admitted(share * on_time[j], craft)
        left = subtract(left, scale(on_time[j], vector(craft.torque[j])))
    return left if craft.carries != 0.0 else ZERO


@kernel
def open_share(on_time: float, step: int, craft: Any) -> float:
    """Share of a step, counted from 0 in its period, for which a thruster is on."""
    return float(min(max(on_time * craft.rate - step, 0.0), 1.0))


@kernel
def _longest(impulse: Vector, craft: Any) -> float:
    """Longest on-time [s] by any of the threes that give an impulse with the least fuel."""
    longest, least = 0.0, np.inf
    for k in range(craft.threes):
        t, cost = _on_times(k, impulse, craft)
        if cost < least * (1.0 - _NEAR_TIE):
            longest, least = 0.0, cost
        if cost <= least * (1.0 + _NEAR_TIE):
            longest = max(longest, largest(t))
    return longest


def certain_torque(craft: Any) -> float:
    """Torque per axis [N·m] that thrusters give in any direction: any |τ_i| up to it can be had.

    Among torques that the same three give, the longest on-time is convex, and threes meet in planes
    that two thrusters span. So on a box it is longest at a corner, where such a plane meets an
    edge, or where a thruster's own torque meets a face. Where several threes cost the same, the one
    that takes longest counts: for a torque close by it may be the one that is taken.
    """
    torques = craft["torque"][: craft["count"]]
    torques = torques[torques.any(axis=1)]
    corners = np.array(list(product((-1.0, 1.0), repeat=3)))
    points = [*corners, *(torques / np.abs(torques).max(axis=1, keepdims=True))]
    for normal in (np.cross(a, b) for a, b in combinations(torques, 2)):
        for axis in np.flatnonzero(normal):
            met = corners.copy()
            met[:, axis] -= corners @ normal / normal[axis]
            points += [*met[np.abs(met[:, axis]) <= 1.0]]
    return 1.0 / max(_longest(tuple(point.tolist()), craft) for point in points)


def largest_torque(craft: Any) -> float:
    """Largest torque on an axis [N·m]: three thrusters fire at a time."""
    ways = np.hstack([craft["torque"], -craft["torque"]]).clip(0.0)
    return float(np.sort(ways, axis=0)[-3:].sum(axis=0).max())
