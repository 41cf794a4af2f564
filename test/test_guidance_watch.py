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

"""What guidance warns of while it follows a goal, and what it says of orders that it refuses."""

import math
from typing import Any

import numpy as np
import pytest
from craft_helpers import dotted
from guidance_helpers import DEGREE, STRAIGHT, cones, goals, scenes, to_earth
from scipy.spatial.transform import Rotation

from ppc_attitude.science.guidance.scene import Scene, heard, scene_at, told
from ppc_attitude.science.orbit import orbit_of
from ppc_attitude.science.part import Part
from ppc_attitude.science.references.goal import COMPONENT, configure
from ppc_attitude.science.stamps import nanoseconds


def part_of(**values: Any) -> Part:
    return Part(COMPONENT, {**COMPONENT.defaults, **dotted(values)})


def said(part: Part, times: Any, attitude: Any = STRAIGHT) -> list[tuple[float, str, bool]]:
    """What is said at which time [s], and whether as a warning."""
    found = []
    for t in times:
        before = part.advices
        part.step(nanoseconds(t), attitude)
        if part.advices > before:
            found.append((float(t), part.advice.text, part.advice.warning))
    return found


def test_cone_that_comes_is_warned_of_before_it_is_there_and_called_off_after() -> None:
    axis = to_earth(300.0)
    coming = (axis, "nadir", 10.0 * DEGREE)
    part = part_of(**cones(coming, ([0.0, 1.0, 0.0], "0 0 1", 0.1)))
    (ahead, text, warning), (after, last, over) = said(part, np.arange(0.0, 600.0, 0.25))
    times = np.arange(0.0, 600.0, 0.1)
    inside = times[np.arccos(to_earth(times) @ axis) < 10.0 * DEGREE]
    entered = float(text.rpartition("= ")[2].removesuffix(" s"))
    assert warning
    assert text.startswith("the desired motion enters keep-out cone 0 at t = ")
    assert entered == pytest.approx(inside[0], abs=0.3)  # J2
    assert 59.0 <= entered - ahead <= 60.0
    assert not over
    assert last == "the cause of the last warning is over"
    assert inside[-1] - 0.3 <= after <= inside[-1] + 1.3
    assert not said(part_of(**cones(coming)), [0.0, 600.0])  # it came and went between two steps


def test_what_is_said_does_not_depend_on_the_rate_of_the_loop() -> None:
    def heard_at(h: float) -> list[tuple[float, str, bool]]:
        return said(part_of(**cones((to_earth(200.0), "nadir", 0.1))), np.arange(0.0, 320.0, h))

    assert heard_at(1.0) == heard_at(0.125)
    assert len(heard_at(1.0)) == 2


def test_attitude_that_begins_inside_a_cone_is_warned_of_at_once() -> None:
    cone, goal = ([0.0, 0.0, 1.0], "0 0 1", 0.5), (3.0, "inertial", [0.8, 0.0, 0.0, 0.6])
    first, order, *rest = said(part_of(**cones(cone), **goals(goal)), np.arange(0.0, 120.0))
    assert first == (0.0, "the desired motion is inside keep-out cone 0", True)
    assert "it begins inside keep-out cone 0 and is led out" in order[1]
    assert order[2]
    assert [(text, warning) for _, text, warning in rest] == [
        ("the cause of the last warning is over", False)
    ]


def test_refusal_does_not_hide_that_the_motion_which_goes_on_is_inside_a_cone() -> None:
    """The warning counted as told with the answer to the order, which did not contain it."""
    inside, behind = ([0.0, 0.0, 1.0], "0 0 1", 0.5), ([0.0, 0.0, 1.0], "0 0 -1", 0.5)
    goal = (0.0, "inertial", [1.0, 0.0, 0.0, 0.0])
    part = part_of(**cones(inside, behind), **goals(goal))
    ((_, text, warning),) = said(part, np.arange(0.0, 60.0))
    assert warning
    assert text.startswith("order 1 is refused: ")
    assert text.endswith("; the desired motion is inside keep-out cone 0")


def test_cone_that_is_widened_in_flight_is_looked_for_anew() -> None:
    goal = goals((1.0, "inertial", [0.6, 0.0, 0.0, 0.8]))  # 73.7° about x
    narrow, wide = (
        cones(([0.0, 0.0, 1.0], "0 0 -1", angle))  # from 180° off the direction
        for angle in (0.4, 3.0)
    )
    part = part_of(**narrow, **goal)
    assert len(said(part, np.arange(0.0, 6.0))) == 1
    record, *_kept = configure({**COMPONENT.defaults, **wide, **goal})
    part.hold(record)
    ((when, text, warning),) = said(part, np.arange(6.0, 60.0, 0.25))
    assert (when, warning) == (6.0, True)
    entered = float(text.rpartition("= ")[2].removesuffix(" s"))
    # After 7 s it has turned by 7° and goes on with V = 2°/s.
    passed = math.degrees(math.pi - 3.0)
    assert entered == pytest.approx(1.0 + 7.0 + (passed - 7.0) / 2.0, abs=0.1)


def test_hold_that_brakes_into_a_cone_is_followed_with_a_warning() -> None:
    cone = ([1.0, 0.0, 0.0], "-0.5 0.8 0", 4.0 * DEGREE)  # x is there after 122° of a spin at 1°/s
    given = goals((1.0, "spin", STRAIGHT), (118.0, "hold", STRAIGHT))
    part = part_of(**cones(cone), **given)
    *_, (when, text, warning) = said(part, np.arange(0.0, 200.0, 0.25))
    assert (when, warning) == (118.0, True)
    assert "order 2 is followed" in text
    assert "; the desired motion enters keep-out cone 0 at t = 119" in text


def test_frame_whose_two_directions_have_become_parallel_is_warned_of() -> None:
    orbit = {"orbit.inclination": 0.5 * math.pi, "orbit.raan": 0.5 * math.pi}  # its normal is x
    values = {**goals((0.0, "sun", STRAIGHT)), **orbit, "orbit.epoch": "2024-12-20"}
    part = part_of(**values)
    ((_, _, warning),) = said(part, [0.0])
    assert not warning
    # Three months later the Sun is along x.
    part.configure({**COMPONENT.defaults, **values, "orbit.epoch": "2025-03-20T09:00:00"})
    ((_, text, warning),) = said(part, [1.0])
    assert warning
    assert text.endswith("is in a frame whose two directions are parallel within 6°")


def test_ground_point_below_the_horizon_is_followed_with_a_warning() -> None:
    # Greenwich is 100.9° east of the ascending node at the epoch, so the point is behind Earth.
    goal = goals((10.0, "ground", STRAIGHT))
    part = part_of(**goal, target__longitude=math.radians(79.1))
    ((when, text, warning),) = said(part, np.arange(0.0, 60.0))
    assert (when, warning) == (10.0, True)
    assert "order 1 is followed: ground frame" in text
    assert text.endswith("the desired motion looks at a ground point below the horizon")
    near = part_of(**goal, target__longitude=math.radians(-100.9))
    (first, *later) = said(near, np.arange(0.0, 900.0))
    assert not first[2]  # straight below, and out of sight once the craft has gone on
    assert [warning for *_, warning in later] == [True]


def ring() -> tuple[Any, dict[str, Any]]:
    """Attitude at the begin, and parameters of a goal that cones close off."""
    (case,) = (case for case in scenes() if case["case"].startswith("closed ring"))
    closed = [
        (cone["body_axis"], " ".join(map(str, cone["direction"])), DEGREE * cone["half_angle_deg"])
        for cone in case["cones"]
    ]
    return case["start"], {**goals((0.0, "inertial", case["goal"])), **cones(*closed)}


def profile(*points: list[float]) -> dict[str, Any]:
    """Parameters of a timed profile: time [s] and attitude of each point, without rates."""
    rows = [[0.0, *point, *[0.0] * 6] for point in points]
    return {**goals((0.0, "profile", STRAIGHT)), "goals.points": [x for row in rows for x in row]}


STANDING = goals((0.0, "inertial", STRAIGHT))
# The Sun along the orbit's normal leaves the frame `sun` no second direction.
PARALLEL = {
    **goals((0.0, "sun", STRAIGHT)),
    "orbit.epoch": "2025-03-20T09:00:00",
    "orbit.inclination": 0.5 * math.pi,
    "orbit.raan": 0.5 * math.pi,
}
QUICK = {**goals((0.0, "nadir", STRAIGHT)), "guidance.max_rate": 1e-3}
LONG = profile([5.0, *STRAIGHT], [86401.0, *STRAIGHT]) | cones(([0.0, 0.0, 1.0], "nadir", 0.1))
# A cone that stands still, and points that lead through it.
THROUGH = profile([5.0, *STRAIGHT], [90.0, 0.6, 0.0, 0.0, 0.8])
THROUGH |= cones(([0.0, 0.0, 1.0], "0 -1 1", 0.1))
REFUSED: dict[str, tuple[Any, dict[str, Any], str]] = {
    "goal in a cone": (
        [1.0, 0.0, 0.0, 0.0],
        STANDING | cones(([0.0, 0.6, 0.8], "0 0 1", 1.0)),
        "goal is inside keep-out cone 0, 36.87° from its direction; allowed: at least 57.30°",
    ),
    "closed": (
        *ring(),  # z turns about x, over the cone that stands at −y
        "no path to the goal is found that avoids all keep-out cones; the direct one crosses "
        "keep-out cone 6",
    ),
    "spin": (
        STRAIGHT,
        {**goals((0.0, "spin", STRAIGHT)), "spin.rate": -0.2},
        "spin.rate = -0.2 rad/s; allowed: -0.0314159 to 0.0314159, which is 0.9 guidance.max_rate",
    ),
    "late": (
        STRAIGHT,
        profile([5.0, 1.0, 0.0, 0.0, 0.0], [500.0, *STRAIGHT]),
        "the slew to the first point ends at t = 97.000 s, after that point's 5.000 s",
    ),
    "far": (
        STRAIGHT,
        LONG,
        "the last point is at t = 86401.000 s; allowed with keep-out cones: up to 86400.000 s",
    ),
    "fast": (
        STRAIGHT,
        profile([5.0, *STRAIGHT], [9.0, 0.6, 0.0, 0.0, 0.8]),
        "the path on from the point at t = 5.000 s needs",
    ),
    "frame": (STRAIGHT, PARALLEL, "from being parallel; allowed: at least 5.74°; try another time"),
    "fast frame": (
        STRAIGHT,
        QUICK,
        "that keeps guidance.max_rate = 0.001 rad/s while the goal's frame turns too; raise",
    ),
    "through": (
        STRAIGHT,
        THROUGH,
        "crosses keep-out cone 0 at t = 49.0 s; try another time or another path",
    ),
}


@pytest.mark.parametrize(("start", "values", "reason"), REFUSED.values(), ids=REFUSED)
def test_refusal_names_value_and_range_and_the_present_motion_goes_on(
    start: list[float], values: dict[str, Any], reason: str
) -> None:
    part = part_of(**values)
    ((_, text, warning),) = said(part, [0.0], start)
    assert warning
    assert text.startswith("order 1 is refused: ")
    assert reason in text
    moved = part.step(nanoseconds(20.0), start)
    assert np.abs(np.dot(moved[:4], start)) == pytest.approx(1.0, abs=1e-12)
    assert not any(moved[4:])


def test_scene_is_told_and_heard_without_loss() -> None:
    tilted = ([0.0, 0.6, 0.8], "sun", 0.1), ([1.0, 0.0, 0.0], "nadir", 0.2)
    part = part_of(**goals((0.0, "nadir", [0.6, 0.0, 0.0, 0.8])), **cones(*tilted))
    part.step(nanoseconds(0.0), STRAIGHT)
    part.step(nanoseconds(700.0), STRAIGHT)
    scene = scene_at(700.0, part.configuration[0], part.state[0])
    assert heard(told(scene)) == scene
    assert heard({"order": "1"}) is None
    assert isinstance(scene, Scene)
    assert scene.cones[1].direction == pytest.approx(to_earth(700.0), abs=3e-3)  # J2
    # The frame's z axis looks at Earth's centre; the goal is turned about x by 73.74°.
    back = Rotation.from_quat([-0.6, 0.0, 0.0, 0.8])
    z = (Rotation.from_quat(scene.goal) * back).apply([0.0, 0.0, 1.0])
    assert z == pytest.approx(scene.cones[1].direction, abs=1e-12)
    assert scene.cones[0].half_angle == 0.1
    for name, text in (
        ("keep-out cone 0", "1 2 3"),
        ("keep-out cone 0", "1 0 0 0 0 1 inf"),  # which no marker can show
        ("goal in inertial axes", "0 0 nan 1"),
    ):
        with pytest.raises(ValueError, match=f"{name} = '{text}'; allowed: . finite numbers"):
            heard({**told(scene), name: text})


LINES = (
    "1 25544U 98067A   24087.49722222  .00016717  00000-0  10270-3 0  9005\n"
    "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.49815380 30001"
)
DATE = "2024-03-28"


def with_checksums(lines: str) -> str:
    """The lines, each with its last digit put right."""
    found = []
    for line in lines.splitlines():
        total = sum(int(c) if c.isdigit() else c == "-" for c in line[:68]) % 10
        found.append(f"{line[:68]}{total}")
    return "\n".join(found)


def test_two_line_elements_give_the_orbit_of_sgp4() -> None:
    api = pytest.importorskip("sgp4.api")
    text = with_checksums(LINES)
    satellite = api.Satrec.twoline2rv(*text.splitlines())
    epoch = "2024-03-28T18:00:00"  # 8853.25 days from J2000
    record = orbit_of({"orbit.tle": f"ISS (ZARYA)\n{text}\n", "orbit.epoch": epoch})
    error, position, velocity = satellite.sgp4(2451545.0 + 8853.0, 0.25)
    assert error == 0
    assert record["position"] == pytest.approx(np.multiply(1e3, position))
    assert record["velocity"] == pytest.approx(np.multiply(1e3, velocity))
    assert 400e3 < np.linalg.norm(record["position"]) - 6378137.0 < 440e3
    part = part_of(orbit__tle=text, orbit__epoch=epoch)
    assert np.array_equal(part.configuration["sky"]["orbit"][0]["position"], record["position"])


BOTH = with_checksums(LINES)
BAD_ELEMENTS = {
    "old": (BOTH, "2025-01-01", "is 279.5 days after the epoch of orbit.tle"),
    "checksum": (BOTH.replace("51.6416", "51.6417"), DATE, "allowed: its checksum"),
    "one line": (LINES.splitlines()[0], DATE, r"orbit\.tle has 1 lines; allowed: 2"),
    "two sets": (f"{BOTH}\n{BOTH}", DATE, r"orbit\.tle has 4 lines; allowed: 2, or 3"),
    "no element set": (BOTH.replace("\n2 ", "\n3 "), DATE, "allowed: 69 characters"),
    "no ASCII": (BOTH.replace(".00016717", ".0001671²"), DATE, "allowed: 69 characters"),
    **{
        name: (with_checksums(LINES.replace(*changed)), DATE, reason)
        for name, changed, reason in (
            ("no number", ("51.6416", "  .    "), "not convert string to float"),
            ("no motion", ("15.49815380", " 0.00000000"), "gives no orbit"),
            ("two craft", ("2 25544", "2 25545"), "do not match"),
            ("far", ("15.49815380", " 0.00010000"), r"gives a height of .* m; allowed: ≤ 1e\+09"),
            ("decayed", ("15.49815380", "17.99815380"), "gives no orbit: mrt is less than 1.0"),
            ("below ground", ("0006703", "0706703"), "perigee is -.* m above"),
        )
    },
}


@pytest.mark.parametrize(("lines", "epoch", "reason"), BAD_ELEMENTS.values(), ids=BAD_ELEMENTS)
def test_bad_two_line_elements_are_refused(lines: str, epoch: str, reason: str) -> None:
    pytest.importorskip("sgp4.api")
    with pytest.raises(ValueError, match=reason):
        orbit_of({"orbit.tle": lines, "orbit.epoch": epoch})
