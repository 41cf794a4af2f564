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

"""Keep-out cones: the exact test, the planner on the truth's scenes and on random ones."""

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from guidance_helpers import DEGREE, Array, guidance, quaternion, scenes
from scipy.spatial.transform import Rotation

from ppc_attitude.science.attitude import product, rotate
from ppc_attitude.science.guidance.rotation import about, duration, profile, turn_between, turned
from ppc_attitude.science.keep_out import (
    CONES,
    FOUND,
    GOAL_INSIDE,
    _search,
    angle_between,
    closest_angle,
    cones_around,
    rest_to_rest,
    route,
)
from ppc_attitude.science.kernel import STRAIGHT, Quaternion, kernel

LIMITS = guidance()["limits"]
SCENES = scenes()


class Plan(NamedTuple):
    outcome: int
    attitudes: Array
    axes: Array
    angles: Array

    @property
    def duration(self) -> float:
        return float(sum(rest_to_rest(angle, LIMITS) for angle in self.angles))


def cones(body_axes: Any, half_angles: Any) -> Any:
    record = np.zeros((), CONES)[()]
    record["count"] = len(half_angles)
    record["body_axis"][: len(half_angles)] = body_axes
    record["half_angle"][: len(half_angles)] = half_angles
    return record


def scene(case: dict[str, Any]) -> tuple[Any, Array]:
    """Cones of a scene of the truth data, and their directions."""
    parts = case["cones"]
    half_angles = [DEGREE * part["half_angle_deg"] for part in parts]
    directions = np.array([part["direction"] for part in parts])
    return cones([part["body_axis"] for part in parts], half_angles), directions


@kernel
def sampled_angles(
    q: Quaternion, axis: Any, angle: float, limits: Any, record: Any, directions: Any, h: float
) -> Any:
    """Smallest angle [rad] to each cone's direction over a turn, at instants h [s] apart."""
    turn = profile(angle, limits.max_rate, limits.max_acceleration, limits.max_jerk)
    smallest = np.full(record.count, math.pi)
    for k in range(math.ceil(duration(turn) / h) + 1):
        psi = turned(min(k * h, duration(turn)), turn, limits.max_jerk)[0]
        attitude = product(q, about(axis, psi))
        for i in range(record.count):
            b, s = record.body_axis[i], directions[i]
            there = rotate(attitude, (b[0], b[1], b[2]))
            smallest[i] = min(smallest[i], angle_between(there, (s[0], s[1], s[2])))
    return smallest


def planned(start: Any, goal: Any, record: Any, directions: Array) -> Plan:
    return Plan(*route(quaternion(start), quaternion(goal), record, directions, LIMITS))


def assert_leads_there(plan: Plan, start: Any, goal: Any, record: Any, directions: Array) -> None:
    """The turns join start and goal and keep the cones; the first may leave those it begins in."""
    exempt = cones_around(quaternion(start), record, directions)
    q = quaternion(start)
    for k, (begin, axis, angle) in enumerate(
        zip(plan.attitudes, plan.axes, plan.angles, strict=True)
    ):
        assert abs(abs(np.dot(begin, q)) - 1.0) < 1e-12
        q = quaternion(begin)
        smallest = sampled_angles(q, tuple(axis), angle, LIMITS, record, directions, 0.01)
        for i in range(record["count"]):
            if k > 0 or not exempt >> i & 1:
                assert smallest[i] >= record["half_angle"][i] - 1e-9
        q = product(q, about(tuple(axis), angle))
    assert abs(abs(np.dot(goal, q)) - 1.0) < 1e-12


@pytest.mark.parametrize("case", SCENES, ids=lambda case: case["case"])
def test_closest_angles_of_the_direct_turn(case: dict[str, Any]) -> None:
    record, directions = scene(case)
    q = quaternion(case["start"])
    axis, angle = turn_between(q, quaternion(case["goal"]))
    assert angle == pytest.approx(DEGREE * case["direct"]["angle_deg"], abs=1e-9)
    assert rest_to_rest(angle, LIMITS) == pytest.approx(case["direct"]["duration"], abs=1e-9)
    for i, expected in enumerate(case["direct"]["closest_deg"]):
        b = rotate(q, tuple(record["body_axis"][i]))
        closest = closest_angle(b, rotate(q, axis), angle, tuple(directions[i]))
        assert closest == pytest.approx(DEGREE * expected, abs=1e-9)


@pytest.mark.parametrize("case", SCENES, ids=lambda case: case["case"])
def test_planner_on_the_truths_scenes(case: dict[str, Any]) -> None:
    record, directions = scene(case)
    plan = planned(case["start"], case["goal"], record, directions)
    if case["feasible"]:
        assert plan.outcome == FOUND
        assert plan.duration <= 1.3 * case["example"]["duration"] + 1e-9
        assert_leads_there(plan, case["start"], case["goal"], record, directions)
    elif case["reason"] == "goal inside":
        assert plan.outcome == GOAL_INSIDE
    elif case["reason"] == "enclosed" or len(case["cones"]) == 2:
        assert plan.outcome != FOUND
    else:  # The start is inside: it is led out.
        assert plan.outcome == FOUND
        assert_leads_there(plan, case["start"], case["goal"], record, directions)


def test_way_out_is_the_smallest_turn() -> None:
    record = cones([[0.0, 0.0, 1.0]], [30.0 * DEGREE])
    start = Rotation.from_euler("x", 20.0, degrees=True).as_quat()
    goal = Rotation.from_euler("x", -90.0, degrees=True).as_quat()
    plan = planned(start, goal, record, np.array([[0.0, 0.0, 1.0]]))
    # The axis is 20° from the direction and leaves to 33°: 13° is the least that any way takes.
    assert plan.angles[0] == pytest.approx(13.0 * DEGREE, abs=1e-9)


def test_half_a_turn_goes_the_way_that_is_clear() -> None:
    record = cones([[0.0, 0.0, 1.0]], [30.0 * DEGREE])
    for side in (-1.0, 1.0):
        plan = planned(
            (0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0), record, np.array([[0.0, side, 0.0]])
        )
        assert plan.axes.tolist() == [[side, 0.0, 0.0]]


def test_of_two_ways_that_are_mirrored_rounding_takes_none() -> None:
    """The last digits of sines differ between machines; the way round the cone must not."""
    record = cones([[0.0, 0.0, 1.0]], [25.0 * DEGREE])
    rng = np.random.default_rng(1)
    start, goal = np.array([0.0, 0.0, 0.0, 1.0]), Rotation.from_euler("x", 1.4).as_quat()
    middle = Rotation.from_euler("x", 0.7).apply([[0.0, 0.0, 1.0]])
    plan = planned(start, goal, record, middle)
    assert len(plan.angles) > 1
    for _ in range(20):
        near = [q + 1e-16 * rng.standard_normal(q.shape) for q in (start, goal, middle)]
        other = planned(near[0], near[1], record, near[2])
        assert other.attitudes == pytest.approx(plan.attitudes, abs=1e-12)


def test_a_narrow_corridor_is_gone_through() -> None:
    """One body axis may only move between two cones; the direct turn within would cross another."""
    x, z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    for half_width, goal_deg in ((1.0, 120.0), (1.5, 75.0), (2.4, 145.0)):
        middle, goal = (about(z, f * DEGREE * goal_deg) for f in (0.5, 1.0))
        wide = DEGREE * (90.0 - half_width)
        record = cones([x, x, x], [wide, wide, 5.0 * DEGREE])
        directions = np.array([z, (0.0, 0.0, -1.0), rotate(middle, x)])
        plan = planned(STRAIGHT, goal, record, directions)
        assert plan.outcome == FOUND
        assert_leads_there(plan, STRAIGHT, goal, record, directions)


def random_scene(seed: int) -> tuple[Array, Array, Any, Array]:
    """Start, goal, cones of one to three body axes, and their directions."""
    random = np.random.default_rng(seed)

    def units(count: int) -> Array:
        vectors = random.normal(size=(count, 3))
        return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))

    count = int(random.integers(2, 9))
    axes = units(int(random.integers(1, 4)))
    chosen = axes[random.integers(0, len(axes), count)]
    half_angles = DEGREE * random.uniform(5.0, 40.0, count)
    start, goal = Rotation.random(2, random_state=seed).as_quat()
    return start, goal, cones(chosen, half_angles), units(count)


def outcomes(seeds: range) -> dict[str, int]:
    """Count what became of random scenes; a plan that violates a cone fails."""
    counts = dict.fromkeys(("direct", "stops", "led out", "goal inside", "unsolved"), 0)
    for seed in seeds:
        start, goal, record, directions = random_scene(seed)
        plan = planned(start, goal, record, directions)
        inside = cones_around(quaternion(start), record, directions)
        if plan.outcome == FOUND:
            assert_leads_there(plan, start, goal, record, directions)
            name = "led out" if inside else "stops" if len(plan.angles) > 1 else "direct"
        elif plan.outcome == GOAL_INSIDE:
            name = "goal inside"
        else:
            name = "unsolved"
        counts[name] += 1
    print(counts)
    return counts


def test_random_scenes_are_never_violated() -> None:
    counts = outcomes(range(300))
    assert min(counts[name] for name in ("direct", "stops", "led out", "goal inside")) > 10
    assert counts["unsolved"] == 0


@pytest.mark.long
def test_ten_thousand_random_scenes_are_never_violated() -> None:
    assert outcomes(range(10_000))["unsolved"] == 0


def best_known(start: Array, goal: Array, record: Any, directions: Array, plan: Plan) -> float:
    """Duration [s] of the quickest way among the planner's and many random stops.

    Rounds of stops all over, then ever nearer those of the best way so far.
    """
    random = np.random.default_rng(0)
    best = plan.attitudes[1:]
    shortest = plan.duration
    for spread in (np.inf, 30.0, 10.0, 3.0):
        turns = random.normal(size=(max(400 // len(best), 1), len(best), 3))
        spun = Rotation.from_rotvec(np.minimum(spread, 1e3) * DEGREE * turns.reshape(-1, 3))
        tries = (spun * Rotation.from_quat(np.tile(best, (len(turns), 1)))).as_quat()
        clear = [q for q in tries if cones_around(quaternion(q), record, directions) == 0]
        nodes = np.array([start, *best, *clear, goal])
        previous = _search(nodes, 0, record, directions, LIMITS)
        way = [len(nodes) - 1]
        while way[-1] != 0:
            way.append(int(previous[way[-1]]))
        stops = nodes[way[::-1]]
        angles = [
            turn_between(quaternion(a), quaternion(b))[1] for a, b in itertools.pairwise(stops)
        ]
        duration_now = sum(rest_to_rest(angle, LIMITS) for angle in angles)
        if duration_now < shortest:
            best, shortest = stops[1:-1], float(duration_now)
    return shortest


@pytest.mark.long
def test_detours_are_near_the_best_known() -> None:
    ratios = []
    for seed in range(1500):
        start, goal, record, directions = random_scene(seed)
        plan = planned(start, goal, record, directions)
        inside = cones_around(quaternion(start), record, directions)
        if plan.outcome == FOUND and not inside and len(plan.angles) > 1:
            known = best_known(start, goal, record, directions, plan)
            ratios.append(plan.duration / known)
    print(f"{len(ratios)} detours: mean {np.mean(ratios):.3f}, largest {np.max(ratios):.3f}")
    assert max(ratios) <= 1.3
