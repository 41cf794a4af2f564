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

"""Goals in flight: the truth's slews and switches, and what must hold for any."""

from typing import Any

import numpy as np
import pytest
from guidance_helpers import (
    DEGREE,
    DESIRED,
    MOTION,
    START,
    STRAIGHT,
    assert_same,
    begun,
    guidance,
    motion,
    motion_of,
    quaternion,
    same_sign,
)
from scipy.spatial.transform import Rotation
from truth_tables import columns, table

from ppc_attitude.science.attitude import product, rotate
from ppc_attitude.science.guidance.frames import (
    FRAME_NAMES,
    GROUND,
    INERTIAL,
    NADIR,
    SPIN,
    SUN,
)
from ppc_attitude.science.guidance.goals import (
    ACCEPTED,
    CROSSES,
    INSIDE_CONE,
    adopt_plan,
    plan_stop,
    plan_to,
)
from ppc_attitude.science.guidance.rotation import about, turn_between
from ppc_attitude.science.guidance.trajectory import append_profile, points
from ppc_attitude.science.keep_out import angle_between
from ppc_attitude.science.orbit import orbit_at

OTHER = (0.5241424183609591, 0.5241424183609591, -0.5241424183609591, 0.4193139346887673)
SWITCHES = [(0.0, INERTIAL, DESIRED), (12.0, NADIR, STRAIGHT), (60.0, INERTIAL, OTHER)]
V, A = 2.0 * DEGREE, 0.4 * DEGREE
STEP = 1e-4  # [s] of difference quotients


def pursue(t: float, frame: int, attitude: Any, configuration: Any, state: Any) -> int:
    outcome = plan_to(t, frame, attitude, configuration, state)
    adopt_plan(t, outcome, state)
    return outcome


def hold(t: float, configuration: Any, state: Any) -> int:
    outcome = plan_stop(t, configuration, state)
    adopt_plan(t, outcome, state)
    return outcome


def follow(t: float, profile: Any, configuration: Any, state: Any) -> int:
    first = quaternion(profile["attitude"][0])
    assert plan_to(t, INERTIAL, first, configuration, state) == ACCEPTED
    outcome = append_profile(t, profile, configuration, state)
    adopt_plan(t, outcome, state)
    return outcome


def active(state: Any) -> Any:
    return state["plans"][state["active"]]


def assert_moves_by_its_rates(t: float, configuration: Any, state: Any) -> None:
    """ω_d and ω_d' at t [s] equal the difference quotients of q_d and ω_d."""
    before, now, after = (motion(t + s, configuration, state) for s in (-STEP, 0.0, STEP))
    axis, angle = turn_between(quaternion(before[:4]), quaternion(after[:4]))
    assert np.allclose(np.array(axis) * angle / (2.0 * STEP), now[4:7], rtol=0.0, atol=1e-9)
    assert np.allclose((after[4:7] - before[4:7]) / (2.0 * STEP), now[7:], rtol=0.0, atol=1e-6)


def switch(t: float, frame: int, attitude: Any, configuration: Any, state: Any) -> None:
    """Take a goal at t [s], at which the motion does not jump."""
    before = motion(t, configuration, state)
    assert pursue(t, frame, quaternion(attitude), configuration, state) == ACCEPTED
    assert_same(motion(t, configuration, state), before, 1e-12, 1e-12, 1e-12)


def fly(goals: list[tuple[float, int, Any]], configuration: Any, until: float) -> Any:
    """Follow goals; every change is without a jump, and the motion is always its own derivative."""
    state = begun(START)
    times = [*(goal[0] for goal in goals[1:]), until]
    for (t, frame, attitude), end in zip(goals, times, strict=True):
        switch(t, frame, attitude, configuration, state)
        plan = active(state)
        joints = [leg["begin"] for leg in plan["legs"][1 : plan["count"]]] + [plan["end"]]
        for joint in (joint for joint in joints if t < joint < end):
            left, right = (motion(joint + s, configuration, state) for s in (-1e-9, 1e-9))
            assert_same(left, right, 1e-10, 1e-10, 1e-10)
        for s in np.linspace(t + STEP, end - STEP, 41):
            assert_moves_by_its_rates(s, configuration, state)
    return state


def test_slew_from_rest_is_the_truths() -> None:
    truth = table("slew_samples")
    configuration, state = guidance(), begun(START)
    pursue(5.0, INERTIAL, DESIRED, configuration, state)
    assert active(state)["end"] == pytest.approx(5.0 + 28.357009755863345, abs=1e-9)
    still = begun(START)
    for row in columns(truth, "t", *MOTION):
        ours = motion(row[0], configuration, state if row[0] >= 5.0 else still)
        assert_same(ours, row[1:], 1e-12, 1e-12, 1e-13)


def test_switches_in_flight_are_the_truths() -> None:
    configuration, state, left = guidance(), begun(START), list(SWITCHES)
    lengths = []
    for row in columns(table("goal_switch"), "t", *MOTION):
        while left and left[0][0] <= row[0]:
            t, frame, attitude = left.pop(0)
            assert pursue(t, frame, attitude, configuration, state) == ACCEPTED
            plan = active(state)
            lengths.append((plan["end"] - t, plan["legs"][0]["duration"]))
        assert_same(motion(row[0], configuration, state), row[1:], 1e-12, 1e-12, 1e-9)
    assert lengths[1] == pytest.approx((94.33848142218557, 8.319633775351878), abs=1e-9)
    assert lengths[2] == pytest.approx((87.27504155948724, 8.00066191671642), abs=1e-9)


@pytest.mark.parametrize("frame", [INERTIAL, NADIR])
def test_goal_just_beyond_the_cone_that_it_begins_in_is_turned_to_directly(frame: int) -> None:
    x, z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    configuration = guidance((z, "nadir", 28.6 * DEGREE))
    start = motion_of(NADIR, 0.0, configuration["sky"])[0]
    goal = about(x, 31.0 * DEGREE)
    state = begun(start)
    goal = product(start, goal) if frame == INERTIAL else goal
    assert pursue(0.0, frame, goal, configuration, state) == ACCEPTED
    assert active(state)["end"] < 26.0


@pytest.mark.parametrize("frame", range(len(FRAME_NAMES)), ids=FRAME_NAMES)
def test_every_frame_is_reached_from_rest_and_left_in_motion(frame: int) -> None:
    state = fly(
        [(3.0, frame, OTHER), (150.0, INERTIAL, DESIRED), (330.0, frame, START)], guidance(), 480.0
    )
    assert active(state)["end"] < 480.0


def test_goal_during_a_brake() -> None:
    goals = [(0.0, INERTIAL, DESIRED), (12.0, NADIR, STRAIGHT), (15.0, SUN, OTHER)]
    fly([*goals, (18.5, INERTIAL, START), (19.0, SPIN, STRAIGHT)], guidance(), 200.0)


def test_brake_with_little_jerk_keeps_the_rate() -> None:
    configuration, state = guidance(), begun(STRAIGHT)
    configuration["limits"]["max_jerk"] = 0.01 * DEGREE
    goals = [(0.0, (0.0, 0.0, 1.0, 0.0)), (30.0, STRAIGHT), (34.0, STRAIGHT)]
    for (t, goal), until in zip(goals, (30.0, 34.0, 200.0), strict=True):
        assert pursue(t, INERTIAL, goal, configuration, state) == ACCEPTED
        samples = [motion(s, configuration, state) for s in np.linspace(t, until, 400)]
        assert np.linalg.norm(np.array(samples)[:, 4:7], axis=1).max() < 1.01 * V


def test_random_switches_amid_accelerations_keep_the_limits() -> None:
    configuration, random = guidance(), np.random.default_rng(11)
    for attitudes in Rotation.random(200, random_state=4).as_quat().reshape(50, 4, 4):
        t = float(random.uniform(5640.0, 5720.0))  # at 5710 s it passes the ground point
        state = begun(quaternion(attitudes[0]), t)
        for attitude in attitudes[1:]:
            frame = int(random.integers(0, len(FRAME_NAMES)))
            switch(t, frame, attitude, configuration, state)
            plan = active(state)
            later = plan["legs"][plan["count"] - 1]["begin"] + random.uniform(4.0, 8.0)
            samples = np.array([motion(s, configuration, state) for s in np.linspace(t, later, 50)])
            # The rate of the frame itself, up to 0.017 rad/s, adds to that of the brake.
            most = {SPIN: 1.06, GROUND: 1.03}.get(frame, 1.002)
            assert np.linalg.norm(samples[:, 4:7], axis=1).max() < most * V
            t = float(later)


def test_goal_where_it_is_already_takes_no_time() -> None:
    state = begun(START)
    assert pursue(1.0, INERTIAL, quaternion(-np.array(START)), guidance(), state) == ACCEPTED
    assert active(state)["end"] == 1.0


def test_hold_brakes_and_stays() -> None:
    configuration, state = guidance(), begun(START)
    pursue(0.0, NADIR, STRAIGHT, configuration, state)
    before = motion(20.0, configuration, state)
    assert hold(20.0, configuration, state) == ACCEPTED
    assert_same(motion(20.0, configuration, state), before, 1e-12, 1e-12, 1e-12)
    end = active(state)["end"]
    for s in np.linspace(20.0 + STEP, end + 1.0, 31):
        assert_moves_by_its_rates(s, configuration, state)
    stand = motion(end, configuration, state)
    assert not stand[4:].any()
    assert hold(end + 5.0, configuration, state) == ACCEPTED
    assert_same(motion(end + 50.0, configuration, state), stand, 1e-15, 0.0, 0.0)


def test_hold_is_followed_where_the_acceleration_was_limited_amid_a_slew() -> None:
    """A brake that kept a tenth of A was so long that the present acceleration led far beyond V."""
    configuration, state = guidance(), begun(STRAIGHT)
    pursue(0.0, INERTIAL, START, configuration, state)
    A = configuration["limits"]["max_acceleration"]
    configuration["limits"]["max_acceleration"] = 0.1 * A
    for t in np.arange(0.5, 10.0, 0.5):
        held = state.copy()
        assert hold(t, configuration, held) == ACCEPTED
        samples = [motion(s, configuration, held) for s in np.linspace(t, active(held)["end"], 100)]
        rates, accelerations = (
            np.linalg.norm(np.array(samples)[:, i : i + 3], axis=1) for i in (4, 7)
        )
        assert rates.max() < 1.2 * V
        assert accelerations.max() < 1.002 * A
        assert not samples[-1][4:].any()


def test_spin_turns_at_its_rate_about_its_axis() -> None:
    configuration, state = guidance(), begun(START)
    pursue(0.0, SPIN, OTHER, configuration, state)
    end = float(active(state)["end"])
    turn = Rotation.from_rotvec(DEGREE * (end + 7.0) * configuration["spin_axis"])
    expected = (Rotation.from_quat(OTHER) * turn).as_quat()
    now = motion(end + 7.0, configuration, state)
    assert np.abs(same_sign(now[:4], expected) - expected).max() < 1e-12
    assert now[4:7] == pytest.approx(DEGREE * configuration["spin_axis"], abs=1e-16)


@pytest.mark.parametrize("share", [0.9, -0.9, 0.87])
def test_the_fastest_spins_that_are_allowed_are_caught_up_with(share: float) -> None:
    configuration, state = guidance(), begun(START)
    configuration["spin_rate"] = share * V
    assert pursue(0.0, SPIN, START, configuration, state) == ACCEPTED
    times = np.linspace(0.0, float(active(state)["end"]), 500)
    rates = [np.linalg.norm(motion(t, configuration, state)[4:7]) for t in times]
    assert max(rates) < 1.001 * V


@pytest.mark.parametrize("frame", [INERTIAL, NADIR, SUN])
def test_craft_keeps_away_from_earth_on_the_whole_way(frame: int) -> None:
    x = (1.0, 0.0, 0.0)
    random = np.random.default_rng(2)
    configuration = guidance((x, "nadir", 40.0 * DEGREE))
    outcomes, stops = [], 0
    for first, second in Rotation.random(80, random_state=9).as_quat().reshape(40, 2, 4):
        state = begun(quaternion(first))
        t = float(random.uniform(0.0, 3000.0))
        outcome = pursue(t, frame, quaternion(second), configuration, state)
        outcomes.append(outcome)
        assert outcome in (ACCEPTED, INSIDE_CONE)
        plan = active(state)
        cursor = np.zeros(1, state["look"]["now"].dtype)[0]
        inside = True  # until it has come out for the first time
        for s in np.arange(t, plan["end"], 0.2) if outcome == ACCEPTED else []:
            r = np.array(orbit_at(s, configuration["sky"]["orbit"], cursor)[0])
            b = rotate(quaternion(motion(s, configuration, state)[:4]), x)
            clear = angle_between(b, tuple(-r / np.linalg.norm(r))) >= 40.0 * DEGREE - 1e-9
            assert clear or inside
            inside = inside and not clear
        stops += outcome == ACCEPTED and plan["count"] > 2
    assert outcomes.count(ACCEPTED) > 15
    assert stops > 0


@pytest.mark.parametrize(
    ("begin", "goal", "about_what"), [(-115, 43, "nadir"), (-30, 43, "nadir"), (39, 0, "start")]
)
def test_goal_is_judged_by_where_it_and_the_cones_are_at_arrival(
    begin: float, goal: float, about_what: str
) -> None:
    """Until then Earth moves by some degrees in inertial axes; two starts are inside the cone."""
    y, z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    nadir = motion_of(NADIR, 0.0, guidance()["sky"])[0]
    start = product(nadir, about(y, begin * DEGREE))
    where = " ".join(map(str, rotate(start, z))) if about_what == "start" else about_what
    configuration = guidance((z, where, 40.0 * DEGREE))
    attitude = about(y, goal * DEGREE)
    assert pursue(0.0, NADIR, attitude, configuration, begun(start)) == ACCEPTED


def test_timed_profile_goes_through_its_points() -> None:
    configuration, state = guidance(), begun(START)
    attitudes = [
        (Rotation.from_quat(START) * Rotation.from_rotvec(v)).as_quat()
        for v in ([0.1, 0.0, 0.0], [0.2, 0.1, 0.0], [0.3, 0.1, 0.1], [0.3, 0.2, 0.0])
    ]
    times = [60.0, 85.0, 110.0, 140.0]
    rate = [0.004, 0.001, -0.002]
    profile = points(times, attitudes, [None, rate, None, None], [None, [1e-4, 0, 0], None, None])
    assert follow(2.0, profile, configuration, state) == ACCEPTED
    for time, attitude in zip(times, attitudes, strict=True):
        now = motion(time, configuration, state)
        assert np.abs(same_sign(now[:4], attitude) - attitude).max() < 1e-12
        left, right = (motion(time + s, configuration, state) for s in (-1e-9, 1e-9))
        assert_same(left, right, 1e-10, 1e-10, 1e-10)
    now = motion(85.0, configuration, state)
    assert now[4:] == pytest.approx([*rate, 1e-4, 0.0, 0.0], abs=1e-14)
    assert not motion(150.0, configuration, state)[4:].any()
    for s in np.linspace(2.1, 145.0, 101):
        assert_moves_by_its_rates(s, configuration, state)


def test_wait_for_a_timed_profile_keeps_clear_of_cones_that_move() -> None:
    cursor = np.zeros(1, begun(STRAIGHT)["look"]["now"].dtype)[0]
    r = np.array(orbit_at(700.0, guidance()["sky"]["orbit"], cursor)[0])
    axis = tuple(-r / np.linalg.norm(r))  # looks at Earth at 700 s
    configuration = guidance((axis, "nadir", 0.35))
    for first, expected in ((200.0, ACCEPTED), (1400.0, CROSSES)):
        state = begun(STRAIGHT)
        profile = points([first, first + 9.0], [STRAIGHT, STRAIGHT], [None] * 2, [None] * 2)
        assert follow(10.0, profile, configuration, state) == expected
    assert 300.0 < state["measured"] < 450.0  # [s] of the crossing


@pytest.mark.parametrize(
    ("times", "attitudes", "rates", "message"),
    [
        ([1.0], [START], [None], "a trajectory of 1 points; allowed: 2 to 40"),
        ([1.0, 1.0], [START, OTHER], [None, None], "allowed: finite and increasing"),
        ([1.0, np.nan], [START, OTHER], [None, None], "allowed: finite and increasing"),
        ([1.0, 1.7e9], [START, OTHER], [None, None], r"allowed: .* s, up to 2e\+08 s"),
        ([0.0, 1e-70], [START, START], [None, None], "increasing by more than 1e-12 s"),
        (
            [1.0, 2.0],
            [START, (1.0, 1.0, 0.0, 0.0)],
            [None, None],
            "of point 1 = .* norm 1.41",
        ),
        ([1.0, 2.0], [(np.nan,) * 4, START], [None, None], "of point 0 = .* norm nan"),
        ([1.0, 2.0], [START, OTHER], [(0.1, 0.0, 0.0), None], "point 0 is in motion"),
        ([1.0, 2.0, 3.0], [START, OTHER, START], [None, (np.inf, 0, 0), None], "not finite"),
    ],
)
def test_bad_timed_profile_is_refused(times: Any, attitudes: Any, rates: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        points(times, attitudes, rates, [None] * len(times))


def test_attitudes_of_a_timed_profile_that_are_nearly_unit_are_made_unit() -> None:
    record = points([1.0, 2.0], [START, np.multiply(1.0009, OTHER)], [None] * 2, [None] * 2)
    assert record["attitude"][1] == pytest.approx(OTHER, rel=1e-12)
