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

"""Mode `goal` of the reference in the loop: from parameters to slews that the law follows."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from craft_helpers import dotted
from guidance_helpers import DESIRED, START, STRAIGHT, cones, goals, guided, same_sign, to_earth
from scipy.spatial.transform import Rotation
from synthetic import requirement, with_parameters

from ppc_attitude.analysis.flight import approaches_of
from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.contract.run_record import Change, RunRecord
from ppc_attitude.contract.topics import REFERENCE
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guidance.orders import (
    Orders,
    goal_order,
    hold_order,
    profile_order,
    schedule_of,
    scheduled_orders,
)
from ppc_attitude.science.guidance.slew import slew_torque
from ppc_attitude.science.guidance.trajectory import POINTS, points
from ppc_attitude.science.stamps import nanoseconds
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.news import goals_told
from ppc_attitude.simulation.replay import replay
from ppc_attitude.simulation.scenario import Scenario, scenario


def flight(rate: float = 20.0, **reference: Any) -> Scenario:
    values = {"mode": "goal", **dotted(reference)}
    return scenario(
        {
            "reference_generator": values,
            "spacecraft_plant": {"initial_attitude": [*START], "rate": rate, "min_torque": 0.0},
            "disturbance_injector": {"environment": False},
        }
    )


def tour(rate: float = 20.0) -> Scenario:
    first = (5.0, "inertial", DESIRED)
    return flight(rate, **goals(first, (20.0, "nadir", STRAIGHT), (130.0, "spin", STRAIGHT)))


@pytest.fixture(scope="module")
def toured() -> RunRecord:
    return simulate(tour(100.0), 220.0)


def test_law_follows_slews_from_no_error_at_all(toured: RunRecord) -> None:
    error, rate_error = toured["attitude_error"][:, :3], toured["rate_error"]
    assert np.abs(error[0]).max() < 1e-15
    assert np.abs(error).max() < 5e-3
    assert (np.abs(error) < toured["attitude_envelope"]).all()
    assert (np.abs(rate_error) < toured["rate_envelope"]).all()
    rate = np.linalg.norm(toured["reference_angular_velocity"], axis=1)
    assert math.radians(1.99) < rate.max() < 1.002 * math.radians(2.0)
    torque = np.abs(toured["unsaturated_torque"]).max()
    assert 0.005 < torque < 0.6 * 0.05, "the default limits of slews leave the law its margin"
    q = toured["reference_attitude"]
    assert (np.sum(q[1:] * q[:-1], axis=1) > 0.9).all(), "its sign does not change"


def test_motion_does_not_depend_on_the_rate_of_the_loop(toured: RunRecord) -> None:
    slow = simulate(tour(10.0), 220.0)
    for name in ("attitude", "angular_velocity", "angular_acceleration"):
        column = f"reference_{name}"
        assert np.abs(toured[column][::10] - slow[column]).max() < 1e-12


def test_what_becomes_of_the_goals_is_told() -> None:
    ordered = goals((5.0, "inertial", DESIRED), (10.0, "inertial", STRAIGHT))
    told = goals_told(flight(**ordered, **cones(([0.0, 0.0, 1.0], "0 0 2", 0.1))))
    assert [each.time for each in told] == [5.0, 10.0]
    assert (
        "inertial frame, turns by 42.71° in 1 leg, arrives at t = 33.357 s" in told[0].advice.text
    )
    assert told[1].advice.warning
    assert "order 2 is refused: the goal is inside keep-out cone 0" in told[1].advice.text
    (late,) = goals_told(flight(**goals((5.000000005, "inertial", DESIRED))))
    assert late.time == pytest.approx(5.05), "the first step from its nanosecond on"
    assert goals_told(scenario({})) == []


def test_live_orders_act_from_their_stamp() -> None:
    second = 1_000_000_000
    start = Rotation.from_quat(START)
    attitudes = [START, (start * Rotation.from_rotvec([0.0, 0.2, 0.0])).as_quat()]
    profile = points([110.0, 150.0], attitudes, [None] * 2, [None] * 2)
    orders = [
        goal_order(3 * second, "sun", STRAIGHT),
        hold_order(20 * second),
        profile_order(40 * second, 0),
    ]
    part = guided(orders, [profile])
    part.step(0, START)
    assert part.step(3 * second, START)[4:] == (0.0,) * 6
    assert np.linalg.norm(part.step(20 * second, START)[4:7]) > 0.01
    assert part.step(39 * second, START)[4:] == (0.0,) * 6
    assert "order 2 is followed" in part.advice.text
    part.step(40 * second, START)
    end = np.array(part.step(150 * second, START))
    assert np.abs(same_sign(end[:4], attitudes[1]) - attitudes[1]).max() < 1e-12
    assert not end[4:].any()


def test_orders_before_the_begin_act_at_the_begin() -> None:
    part = guided([goal_order(1_000_000_000, "inertial", DESIRED)])
    # No attitude yet: nothing begins.
    assert part.step(2_000_000_000, [0.0] * 4) == (*STRAIGHT, *[0.0] * 6)
    part.step(7_000_000_000, START)
    assert "arrives at t = 35.357 s" in part.advice.text


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"goals__times": [1.0]}, "goals.times has 1 values, goals.attitudes 0"),
        (
            {"goals__times": [2.0, 1.0], "goals__attitudes": [*STRAIGHT, *STRAIGHT]},
            r"goals.times = \[2.0, 1.0\]; allowed: none before its predecessor",
        ),
        (
            {"goals__times": [1.0], "goals__attitudes": [1.0, 1.0, 0.0, 0.0]},
            "attitude of a goal = .* has norm 1.41421",
        ),
        ({"goals__times": [1.0], "goals__attitudes": [math.nan, 0.0, 0.0, 1.0]}, "goals.attitudes"),
        ({"goals__frames": ["moon"]}, "goals.frames = 'moon'"),
        (
            {"goals__frames": ["sun", "sun", "sun"], "goals__times": [1.0]},
            "goals.frames has 3 values; allowed: 1 or 1",
        ),
        (
            {
                "goals__times": [1.0],
                "goals__attitudes": [*STRAIGHT],
                "goals__points": [0.0, 5.0, *STRAIGHT, *[0.0] * 6],
            },
            r"goals.points has points of goal 0; allowed: goals with the frame profile, .* \[\]",
        ),
        (
            {"goals__times": [1.0], "goals__attitudes": [*STRAIGHT], "goals__frames": ["profile"]},
            "a trajectory of 0 points; allowed: 2 to 40",
        ),
        ({"keep_out__half_angles": [0.1]}, "keep_out.axes has 0 values, keep_out.half_angles 1"),
        (
            {"keep_out__half_angles": [0.1], "keep_out__axes": [0.0, 0.0, 0.0]},
            "keep_out.axes has .* which is no direction",
        ),
        (
            {
                "keep_out__half_angles": [0.1],
                "keep_out__axes": [0.0, 0.0, 1.0],
                "keep_out__directions": ["mars"],
            },
            "keep_out.directions has 'mars'; allowed: sun, nadir, or three numbers",
        ),
        (
            {"keep_out__half_angles": [0.1] * 17, "keep_out__axes": [0.0, 0.0, 1.0] * 17},
            "keep_out.half_angles has 17 values; allowed: up to 16",
        ),
        ({"orbit__eccentricity": 0.5}, "perigee is"),
        ({"orbit__epoch": "soon"}, "orbit.epoch = 'soon'"),
        ({"guidance__max_jerk": 0.0}, "guidance.max_jerk"),
        ({"spin__axis": [0.0, 0.0, 0.0]}, "spin.axis has .* which is no direction"),
    ],
)
def test_bad_parameters_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        flight(**values)


def test_torque_of_a_slew_is_the_largest_of_all_axes() -> None:
    inertia = np.diag([2.8, 2.5, 1.9])
    need = slew_torque(inertia, math.radians(2.0), math.radians(0.4))
    assert need == pytest.approx(0.0201, abs=5e-5)
    axes = Rotation.random(2000, random_state=0).apply([0.0, 0.0, 1.0])
    bent = math.radians(0.4) * np.linalg.norm(axes @ inertia, axis=1)
    spun = math.radians(2.0) ** 2 * np.linalg.norm(np.cross(axes, axes @ inertia), axis=1)
    assert bent.max() + spun.max() <= need
    assert bent.max() + spun.max() == pytest.approx(need, rel=0.01)


def test_analysis_tells_how_near_the_craft_itself_came() -> None:
    axis, direction = np.array([0.0, 0.6, 0.8]), np.array([0.0, 0.0, -1.0])
    both = cones((axis, "0 0 -2", 0.3), ([1.0, 0.0, 0.0], "nadir", 0.1))
    record = simulate(flight(**goals((1.0, "inertial", DESIRED)), **both), 40.0)
    attitudes = record.columns["attitude"]
    fixed, nadir = approaches_of(record)
    pointed = Rotation.from_quat(attitudes).apply(axis)
    assert fixed.angle == pytest.approx(np.arccos(pointed @ direction).min(), abs=1e-9)
    assert (fixed.direction, fixed.half_angle) == ("0 0 -2", 0.3)
    looked = Rotation.from_quat(attitudes).apply([1.0, 0.0, 0.0])
    expected = np.arccos(np.sum(looked * to_earth(record.t), axis=1)).min()
    assert nadir.angle == pytest.approx(expected, abs=1e-3)  # J2 is not in the circle
    row = requirement(Verdict(record), "keep_out")
    inside = max(each.half_angle - each.angle for each in (fixed, nadir))
    assert row.value == pytest.approx(math.degrees(inside))
    assert row.met is (inside <= 0.0)
    # It was nearer to nadir, but only in the other cone if that is wide.
    wide = with_parameters(record, REFERENCE, {"keep_out.half_angles": [2.2, 0.1]})
    row = requirement(Verdict(wide), "keep_out")
    assert row.met is False
    assert "of 0 0 -2, allowed 126.1°" in row.note
    assert not [row for row in Verdict(simulate(tour(), 2.0)).requirements if row.key == "keep_out"]


def timed_points(number: int) -> list[float]:
    """Three points of a timed profile, which is a goal by its number; from 8.1 s on it is late."""
    still, turned = Rotation.from_quat(START), Rotation.from_rotvec([0.0, 0.2, 0.0])
    attitudes = [q.as_quat() for q in (still, still * turned, still * turned * turned)]
    profile = points([110.0, 140.0, 180.0], attitudes, [None] * 3, [None] * 3)
    rows = schedule_of(
        Orders(
            np.concatenate([hold_order(0)] * number + [profile_order(0, 0)]), np.array([profile])
        )
    )
    found: list[float] = rows["goals.points"]
    return found


def test_timed_profile_of_a_scenario_is_flown_through_its_points() -> None:
    timed = flight(**goals((2.0, "profile", STRAIGHT)), goals__points=timed_points(0))
    barred = timed.with_values(REFERENCE, **cones(([0.0, 0.0, 1.0], "0 0 2", 3.1)))
    told = goals_told(barred)[-1].advice.text
    assert told.startswith("order 1 is refused: the goal is inside keep-out cone 0, 54.06° from")
    record = simulate(timed, 185.0)
    q = record.columns["reference_attitude"]
    rates = np.linalg.norm(record.columns["reference_angular_velocity"], axis=1)
    turned = 2.0 * np.arccos(np.clip(np.abs(q @ np.array(START) / np.linalg.norm(START)), 0, 1))
    at = [round(20.0 * t) for t in (110.0, 140.0, 180.0)]
    assert turned[at] == pytest.approx([0.0, 0.2, 0.4], abs=1e-7)
    assert rates[at] == pytest.approx([0.0, 0.5 * (0.2 / 30.0 + 0.2 / 40.0), 0.0], abs=1e-9)
    assert np.abs(record.columns["attitude_error"][:, :3]).max() < 5e-3


def given_in_flight(scheduled: RunRecord, at: float) -> RunRecord:
    """The same run as if all its goals but the first had been given at a time [s]."""
    values = scheduled.parameters[REFERENCE]
    orders = scheduled_orders(values)
    first = schedule_of(Orders(orders.listed[:1], np.zeros(0, POINTS)))
    later = schedule_of(orders._replace(listed=orders.listed[1:]))
    changes = (Change(nanoseconds(at), REFERENCE, *each) for each in later.items())
    return replace(with_parameters(scheduled, REFERENCE, first), changes=tuple(changes))


def test_orders_given_in_flight_are_replayed_from_what_was_told() -> None:
    scheduled = simulate(
        flight(
            **goals(
                (1.0, "inertial", DESIRED),
                (6.0, "hold", STRAIGHT),
                (6.0, "nadir", STRAIGHT),
                (8.1, "profile", STRAIGHT),
                (12.3, "inertial", [0.6, 0.0, 0.0, 0.8]),
            ),
            goals__points=timed_points(3),
        ),
        20.0,
    )
    values = scheduled.parameters["reference_generator"]
    orders = scheduled_orders(values)
    told = schedule_of(orders)
    again = scheduled_orders({**values, **told})
    assert np.array_equal(again.listed, orders.listed)
    assert told["goals.times"] == values["goals.times"]
    assert np.array_equal(again.profiles, orders.profiles)
    assert orders.profiles["rate"][0, 1].any()  # chosen, since none is given
    flown = given_in_flight(scheduled, 5.0)
    (reference,) = (each for each in replay(flown).others if each.component == "goal")
    assert reference.steps == 401
    assert reference.largest == 0.0
    (without,) = (
        each for each in replay(replace(flown, changes=())).others if each.component == "goal"
    )
    assert without.largest > 0.01
