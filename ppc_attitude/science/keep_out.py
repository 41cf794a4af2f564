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

"""Keep-out cones: body axes that must stay away from directions, and turns that keep away.

A cone is kept if angle(R(q) b, s) ≥ its half angle, body axis b, direction s (inertial). The test
of a turn is exact, and the planner puts stops beside the cones where the direct turn crosses one.
"""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import normalised, product, rotate
from ppc_attitude.science.guidance.rotation import about, duration, profile, turn_between
from ppc_attitude.science.kernel import (
    Quaternion,
    Vector,
    add,
    cross,
    dot,
    kernel,
    norm,
    quaternion,
    scale,
    store,
    store_quaternion,
    vector,
)
from ppc_attitude.science.parameter import record_type

MOST_CONES = 16
FIXED, SUN, NADIR = range(3)  # kinds of directions
CONES = record_type(
    ("count", np.int64),
    ("body_axis", np.float64, (MOST_CONES, 3)),  # unit
    ("kind", np.int64, (MOST_CONES,)),
    ("direction", np.float64, (MOST_CONES, 3)),  # unit, inertial, of the fixed ones
    ("half_angle", np.float64, (MOST_CONES,)),  # [rad]
)
_BITS: Any = np.array([0, -1])  # NumPy's integers, for the reason given in `frames`
NO_CONE, EVERY_CONE = _BITS
FOUND, GOAL_INSIDE, NO_WAY = range(3)  # outcomes of planning

_STOP_MARGIN = math.radians(0.5)
_TIE = 1e-9  # share by which a way must be shorter to count as such: less may be rounding
# Of stops beyond a cone's half angle; the last one only where the others lead to no goal, such as
# between two cones that leave 4° to a body axis.
_DISTANCES = (math.radians(3.0), math.radians(25.0), math.radians(0.75))
_BEARINGS = 12
_ROLLS = 4
_EACH = _BEARINGS * 2 * _ROLLS  # stops at each distance beside each cone, at most
_HALF_TURN = math.pi - 1e-11  # [rad] from here on a turn may as well go the other way round
_ROUNDING = 1e-12  # [rad]


@kernel
def angle_between(a: Vector, b: Vector) -> float:
    """Angle [rad] between two vectors, 0 to π."""
    return math.atan2(norm(cross(a, b)), dot(a, b))


@kernel
def closest_angle(b: Vector, axis: Vector, angle: float, s: Vector) -> float:
    """Smallest angle [rad] between a direction s and b while b turns about an axis, all inertial.

    s·b(ψ) = A + B cos ψ + C sin ψ with A = (s·e)(e·b), B = s·b − A, C = s·(e × b): the peak is at
    ψ = atan2(C, B) if the turn reaches it, else at one of its ends.
    """
    constant = dot(s, axis) * dot(axis, b)
    side = cross(axis, b)
    peak = math.atan2(dot(s, side), dot(s, b) - constant) % (2.0 * math.pi)
    if peak <= angle:
        return angle_between(rotate(about(axis, peak), b), s)
    return min(angle_between(b, s), angle_between(rotate(about(axis, angle), b), s))


@kernel
def cone_angle(i: int, q: Quaternion, cones: Any, directions: Any) -> float:
    """Angle [rad] between body axis and direction of a cone at an attitude.

    `directions` are those of all cones [inertial], shape (count, 3).
    """
    return angle_between(rotate(q, vector(cones.body_axis[i])), vector(directions[i]))


@kernel
def violated(q: Quaternion, cones: Any, directions: Any, margin: float) -> int:
    """Index of the first cone that an attitude is inside of, or not clear of by a margin [rad].

    −1: none.
    """
    for i in range(cones.count):
        if cone_angle(i, q, cones, directions) < cones.half_angle[i] + margin - _ROUNDING:
            return i
    return -1


@kernel
def turn_is_clear(
    q: Quaternion, axis: Vector, angle: float, cones: Any, directions: Any, exempt: int
) -> bool:
    """Tell if a turn from q about a body axis keeps all cones.

    `exempt` has the bits of the cones that do not count.
    """
    e = rotate(q, axis)
    for i in range(cones.count):
        if exempt >> i & 1:
            continue
        b = rotate(q, vector(cones.body_axis[i]))
        if closest_angle(b, e, angle, vector(directions[i])) < cones.half_angle[i] - _ROUNDING:
            return False
    return True


@kernel
def cones_around(q: Quaternion, cones: Any, directions: Any) -> int:
    """Bits of the cones that an attitude is inside of."""
    bits = 0
    for i in range(cones.count):
        if cone_angle(i, q, cones, directions) < cones.half_angle[i] - _ROUNDING:
            bits |= 1 << i
    return bits


@kernel
def perpendicular(s: Vector) -> Vector:
    """Coordinate axis of the smallest |component| of a unit vector, made perpendicular to it."""
    x, y, z = abs(s[0]), abs(s[1]), abs(s[2])
    axis: Vector = (0.0, 0.0, 1.0)
    if x <= y and x <= z:
        axis = (1.0, 0.0, 0.0)
    elif y <= z:
        axis = (0.0, 1.0, 0.0)
    side = add(axis, scale(-dot(axis, s), s))
    return scale(1.0 / norm(side), side)


@kernel
def _smallest_turn(a: Vector, b: Vector) -> Quaternion:
    """Smallest rotation that takes a unit vector to another."""
    normal = cross(a, b)
    sine = norm(normal)
    if sine < 1e-15:
        return about(perpendicular(a), 0.0 if dot(a, b) > 0.0 else math.pi)
    return about(scale(1.0 / sine, normal), math.atan2(sine, dot(a, b)))


@kernel
def _stops(start: Quaternion, goal: Quaternion, cones: Any, directions: Any, distances: int) -> Any:
    """Attitudes beside the cones that are clear of all of them, and last the goal; first the start.

    They are at the first so many distances. Order: cone, distance, bearing, turned from start or
    goal, roll about the body axis.
    """
    nodes = np.empty((distances * _EACH * cones.count + 2, 4))
    store_quaternion(nodes[0], start)
    count = 1
    for i in range(cones.count):
        s = vector(directions[i])
        u = perpendicular(s)
        v = cross(s, u)
        for j in range(distances):
            angle = cones.half_angle[i] + _DISTANCES[j]
            for k in range(_BEARINGS):
                bearing = 2.0 * math.pi * k / _BEARINGS
                across = add(scale(math.cos(bearing), u), scale(math.sin(bearing), v))
                aim = add(scale(math.cos(angle), s), scale(math.sin(angle), across))
                for base in (start, goal):
                    b = rotate(base, vector(cones.body_axis[i]))
                    aimed = product(_smallest_turn(b, aim), base)
                    for roll in range(_ROLLS):
                        q = normalised(product(about(aim, 0.5 * math.pi * roll), aimed))
                        if violated(q, cones, directions, _STOP_MARGIN) < 0:
                            store_quaternion(nodes[count], q)
                            count += 1
    store_quaternion(nodes[count], goal)
    return nodes[: count + 1]


@kernel
def rest_to_rest(angle: float, limits: Any) -> float:
    """Duration [s] of a turn by an angle [rad] within limits (record of dtype `LIMITS`)."""
    return duration(profile(angle, limits.max_rate, limits.max_acceleration, limits.max_jerk))


@kernel
def _clear_axis(
    q: Quaternion, axis: Vector, angle: float, cones: Any, directions: Any, exempt: int
) -> int:
    """1 if the turn is clear, −1 if half a turn is clear the other way round, 0 if neither."""
    if turn_is_clear(q, axis, angle, cones, directions, exempt):
        return 1
    other = scale(-1.0, axis)
    if angle > _HALF_TURN and turn_is_clear(q, other, angle, cones, directions, exempt):
        return -1
    return 0


@kernel
def _way_out(nodes: Any, tried: Any, cones: Any, directions: Any, inside: int) -> int:
    """Index of the stop or goal with the smallest turn from a start inside cones; 0: none.

    The cones round the start do not count on the way out; the others do. Stops that were tried
    already are left out.
    """
    start = quaternion(nodes[0])
    best, smallest = 0, math.inf
    for i in range(1, len(nodes)):
        axis, angle = turn_between(start, quaternion(nodes[i]))
        nearer = angle < smallest * (1.0 - _TIE) and not tried[i]
        if nearer and _clear_axis(start, axis, angle, cones, directions, inside) != 0:
            best, smallest = i, angle
    return best


@kernel
def _search(nodes: Any, root: int, cones: Any, directions: Any, limits: Any) -> Any:
    """Dijkstra's search from a root over rest-to-rest durations; ties go to the lower index.

    A way is not followed further where even the direct turn to the goal would make it no quicker
    than one that is known. Returns each node's predecessor; −1: not reached.
    """
    count = len(nodes)
    goal = count - 1
    cost, previous = np.full(count, math.inf), np.full(count, -1)
    done = np.zeros(count, np.bool_)
    left = np.empty(count)
    for i in range(count):
        angle = turn_between(quaternion(nodes[i]), quaternion(nodes[goal]))[1]
        left[i] = rest_to_rest(angle, limits)
    cost[root] = 0.0
    while True:
        here, least = -1, math.inf
        for i in range(count):
            if not done[i] and cost[i] < least * (1.0 - _TIE):
                here, least = i, cost[i]
        if here < 0 or here == goal:
            return previous
        done[here] = True
        q = quaternion(nodes[here])
        for step in range(count):
            there = goal - step  # the goal first: its cost bounds the others'
            if done[there] or least + left[there] >= cost[goal]:
                continue
            axis, angle = turn_between(q, quaternion(nodes[there]))
            total = least + rest_to_rest(angle, limits)
            quicker = total < cost[there] * (1.0 - _TIE) and total + left[there] < cost[goal]
            if quicker and _clear_axis(q, axis, angle, cones, directions, NO_CONE) != 0:
                cost[there] = total
                previous[there] = here


@kernel
def route(
    start: Quaternion, goal: Quaternion, cones: Any, directions: Any, limits: Any, leaving: int = 0
) -> tuple[int, Any, Any, Any]:
    """Turns from rest to rest that lead from one attitude to another and keep all cones.

    Parameters
    ----------
    start, goal
        Attitudes x y z w. A start inside cones is led out by the smallest turn.
    cones, directions
        Record of dtype `CONES`, and its directions, shape (count, 3).
    limits
        Record of dtype `LIMITS`.
    leaving
        Bits of the cones that the start is inside of, where `directions` are of a later time.

    Returns
    -------
    outcome
        `FOUND`, `GOAL_INSIDE` or `NO_WAY`.
    attitudes, axes, angles
        Where each turn begins, about which body axis (unit) and how far [rad] it goes.
    """
    attitudes, axes, angles = np.empty((0, 4)), np.empty((0, 3)), np.empty(0)
    if violated(goal, cones, directions, 0.0) >= 0:
        return GOAL_INSIDE, attitudes, axes, angles
    inside = leaving | cones_around(start, cones, directions)
    nodes, previous = np.empty((0, 4)), np.full(1, -1)
    for distances in (0, len(_DISTANCES) - 1, len(_DISTANCES)):  # the direct turn has no stops
        if previous[-1] >= 0 or (inside and distances == 0):
            continue
        nodes = _stops(start, goal, cones, directions, distances)
        root = 0
        tried = np.zeros(len(nodes), np.bool_)
        tried[0] = inside != 0
        previous = np.full(len(nodes), -1)
        while previous[-1] < 0:
            if inside:
                root = _way_out(nodes, tried, cones, directions, inside)
            if tried[root]:
                break
            previous = _search(nodes, root, cones, directions, limits)
            previous[root] = 0
            # The goal was not reached from these: none need be tried as a way out again.
            for i in range(len(nodes)):
                tried[i] |= previous[i] >= 0
    if previous[-1] < 0:
        return NO_WAY, attitudes, axes, angles
    count, i = 0, len(nodes) - 1
    while i != 0:
        count, i = count + 1, previous[i]
    attitudes, axes, angles = np.empty((count, 4)), np.empty((count, 3)), np.empty(count)
    i = len(nodes) - 1
    for k in range(count - 1, -1, -1):
        q = quaternion(nodes[previous[i]])
        axis, angle = turn_between(q, quaternion(nodes[i]))
        exempt = inside if k == 0 else NO_CONE
        store_quaternion(attitudes[k], q)
        store(axes[k], scale(_clear_axis(q, axis, angle, cones, directions, exempt), axis))
        angles[k] = angle
        i = previous[i]
    return FOUND, attitudes, axes, angles
