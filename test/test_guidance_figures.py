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

"""Figures of guidance: what the run did, from the record alone."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from craft_helpers import configs
from guidance_helpers import DESIRED, STRAIGHT, cones, goals
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation
from synthetic import part_of, requirement, with_columns, with_parameters, with_rows
from test_goal_reference import START, flight, given_in_flight

from ppc_attitude.analysis.drawing import BLUE, ORANGE, RED
from ppc_attitude.analysis.figures import figures_of
from ppc_attitude.analysis.flight import approaches_of, flight_of, pointed
from ppc_attitude.analysis.guidance_figures import guidance_drawings
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.page import plotted
from ppc_attitude.analysis.requirements import Requirements
from ppc_attitude.analysis.series import AnalysisError
from ppc_attitude.contract.run_record import Change, RunRecord
from ppc_attitude.contract.topics import ENABLED, ESTIMATOR, PLANT, REFERENCE
from ppc_attitude.science.part import Part
from ppc_attitude.science.references import goal
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.replay import replay
from ppc_attitude.simulation.scenario import load, scenario

OWN = {"slews", "sky_map", "cone_angles"}
SLEW, INSIDE = (5.0, "inertial", DESIRED), (60.0, "inertial", STRAIGHT)
STANDS = ([0.0, 0.0, 1.0], "0 0 1", 0.9)


@pytest.fixture(scope="module")
def record() -> RunRecord:
    """A slew, a brake into nadir in mid-slew, and a goal inside a cone, which is refused."""
    return simulate(
        flight(
            **goals(SLEW, (20.0, "nadir", STRAIGHT), INSIDE),
            **cones(STANDS, ([0.0, 1.0, 0.0], "nadir", 0.1)),
        ),
        240.0,
    )


@pytest.fixture(scope="module")
def drawn(record: RunRecord) -> dict[str, tuple[str, Figure]]:
    return figures_of(Measured(record))


def guidance_drawn(record: RunRecord) -> dict[str, Figure]:
    found = {}
    for name, _, draw in guidance_drawings(record):
        with suppress(AnalysisError):  # it has no such figure
            found[name] = draw(Measured(record))
    return found


def test_flight_is_what_the_reference_did(record: RunRecord) -> None:
    found = flight_of(record)
    assert found is not None
    assert [word.time for word in found.words] == pytest.approx([5.0, 20.0, 60.0])
    assert [word.warning for word in found.words] == [False, False, True]
    assert "is inside keep-out cone 0" in found.words[2].text
    assert [leg.turns for leg in found.words[0].legs] == [True]
    brake, *_ = found.words[1].legs
    assert (brake.begin, brake.turns) == (20.0, False)
    assert found.words[2].legs == ()
    # Where the reference ends is the goal.
    q = record.columns["reference_attitude"][found.picked[-1]]
    assert abs(np.dot(q, found.goals[-1])) == pytest.approx(1.0, abs=1e-12)
    first = int(np.searchsorted(found.picked, 100))  # t = 5 s at 20 Hz
    assert abs(np.dot(found.goals[first], DESIRED)) == pytest.approx(1.0, abs=1e-9)


def test_goals_given_in_flight_are_found_too(record: RunRecord) -> None:
    here, there = flight_of(record), flight_of(given_in_flight(record, 20.0))
    assert here is not None
    assert there is not None
    assert there.words == here.words
    assert np.array_equal(there.goals, here.goals)


def test_goals_that_were_told_at_an_instant_that_is_not_on_record_are_found(
    record: RunRecord,
) -> None:
    """The next change tells only what is yet to come."""
    told = given_in_flight(record, 20.0)
    next_told = (Change(20_020_000_000, REFERENCE, *each) for each in goals(INSIDE).items())
    told = replace(told, changes=(*told.changes, *next_told))
    left = np.flatnonzero((record.t != 20.0) & (record.t < 61.0))
    here, there = (flight_of(part_of(run, left)) for run in (record, told))
    assert here is not None
    assert there is not None
    assert there.words == here.words


def test_a_reference_that_is_started_again_is_flown_and_replayed_anew(record: RunRecord) -> None:
    again = 40_000_000_000  # [ns] in mid-slew: it begins at rest, with the orders that had come
    first = int(np.searchsorted(record.stamps_ns, again))
    values = record.parameters["reference_generator"]
    part, columns = Part(goal.COMPONENT, values), dict(record.columns)
    for column in goal.COMPONENT.outputs:
        columns[column.name] = columns[column.name].copy()
    for k in range(first, record.stamps_ns.size):
        part.step(int(record.stamps_ns[k]), record["attitude"][k])
        for column in goal.COMPONENT.outputs:
            columns[column.name][k] = part.outputs[0][column.name]
    started = replace(
        record, columns=columns, changes=(Change(again, "reference_generator", ENABLED, True),)
    )
    assert {each.component: each.largest for each in replay(started).others}["goal"] == 0.0
    found = flight_of(started)
    assert found is not None
    assert [word.time for word in found.words] == pytest.approx([5.0, 20.0, 40.0, 60.0])
    assert "order 2 is followed" in found.words[2].text
    row = requirement(Verdict(started), "refused_orders")
    assert row.value == 1.0


def test_a_refused_order_is_no_run_that_meets_all(record: RunRecord) -> None:
    row = requirement(Verdict(record), "refused_orders")
    assert (row.value, row.met) == (1.0, False)
    assert row.reason.startswith("order 3 is refused: the goal is inside keep-out cone 0")
    # The next order of its instant is followed, and tells nothing of it.
    both = goals((1.0, "spin", STRAIGHT), (1.0, "inertial", STRAIGHT))
    twice = flight(**both, spin__rate=0.05)
    row = requirement(Verdict(simulate(twice, 2.0)), "refused_orders")
    assert (row.value, row.met, row.reason) == (1.0, False, "")
    obeyed = simulate(flight(**goals((1.0, "inertial", STRAIGHT))), 2.0)
    row = requirement(Verdict(obeyed), "refused_orders")
    assert (row.value, row.met) == (0.0, True)
    resting = Verdict(simulate(flight(), 2.0))
    assert "refused_orders" not in {row.key for row in resting.requirements}


def test_the_time_to_a_goal_is_judged_if_it_has_a_limit() -> None:
    """90° within V, A and K take θ/V + V/A + A/K; the law keeps the error small on the way."""
    there = (Rotation.from_quat(START) * Rotation.from_euler("z", 90.0, degrees=True)).as_quat()
    orders = (5.0, "inertial", there), (80.0, "inertial", START), (100.0, "inertial", there)
    flown, takes = simulate(flight(**goals(*orders)), 130.0), 90.0 / 2.0 + 2.0 / 0.4 + 0.4 / 0.2
    assert "goal_time" not in {row.key for row in Verdict(flown).requirements}
    # The second order gives way after 20 s, and the run ends 30 s after the third.
    for limit in (takes - 1.0, takes + 1.0):
        row = requirement(Verdict(flown, Requirements(goal=limit)), "goal_time")
        assert row.value == pytest.approx(takes, abs=0.051)
        assert (row.met, row.reason) == (limit > takes, "that of the order at 5 s")
    on_its_way = part_of(flown, flown.t <= 45.0)
    row = requirement(Verdict(on_its_way, Requirements(goal=40.0)), "goal_time")
    assert (row.value, row.met) == (pytest.approx(40.0), False)
    assert row.reason == "that of the order at 5 s, and was not reached"
    late = with_rows(flown, "attitude", slice(0, 101), 0.0)  # as from a filter without a fix
    row = requirement(Verdict(late, Requirements(goal=60.0)), "goal_time")
    assert row.value == pytest.approx(takes, abs=0.11)
    assert row.reason == "that of the order at 5.05 s"
    row = requirement(Verdict(on_its_way, Requirements(goal=41.0)), "goal_time")
    shows_none = (None, "no order held for 41 s, or until its goal was reached")
    assert (row.met, row.reason) == shows_none
    begun_late = part_of(flown, (flown.t >= 40.0) & (flown.t <= 110.0))  # amid the first turn
    row = requirement(Verdict(begun_late, Requirements(goal=41.0)), "goal_time")
    assert (row.met, row.reason) == shows_none


def test_figures_show_ways_sky_and_angles(
    record: RunRecord, drawn: dict[str, tuple[str, Figure]]
) -> None:
    assert set(drawn) >= OWN
    ways = drawn["slews"][1].axes
    assert [axes.get_ylabel() for axes in ways] == [
        "angle to the goal [deg]",
        "desired rate [deg/s]",
        "desired accel. [deg/s²]",
    ]
    spans = [to_rgba(patch.get_facecolor())[:3] for patch in ways[0].patches]
    flown = flight_of(record)
    assert flown is not None
    legs = [leg.turns for word in flown.words for leg in word.legs]
    assert 0 < legs.count(True) == spans.count(to_rgba(BLUE)[:3])
    assert 0 < legs.count(False) == spans.count(to_rgba(ORANGE)[:3])
    marks = [line for line in ways[0].get_lines() if line.get_linestyle() == ":"]
    assert [line.get_xdata()[0] for line in marks] == pytest.approx([5.0, 20.0, 60.0])
    assert [line.get_color() == RED for line in marks] == [False, False, True]
    craft = np.asarray(ways[0].get_lines()[0].get_ydata())
    assert craft[-1] < 0.5  # [deg] it has come to its goal

    (angles,) = drawn["cone_angles"][1].axes
    lines = {str(line.get_label()): line for line in angles.get_lines()}
    for i, each in enumerate(approaches_of(record)):
        shown = np.asarray(lines[f"{i}: {each.direction}"].get_ydata(), float)
        assert np.nanmin(shown) == pytest.approx(np.rad2deg(each.angle), abs=1e-6)

    (sky,) = drawn["sky_map"][1].axes
    paths = [each for each in sky.collections if isinstance(each, LineCollection)]
    # Two axes, craft and desired; a cone that stands, one that moves, and its way.
    assert len(paths) == 4 + 1 + 3
    rim = np.concatenate(paths[4].get_segments())  # about the pole
    assert rim[:, 1] == pytest.approx(90.0 - np.rad2deg(0.9))
    path = np.concatenate(paths[0].get_segments())
    z = Rotation.from_quat(record.columns["attitude"][-1]).apply([0.0, 0.0, 1.0])
    assert np.deg2rad(path[-1, 1]) == pytest.approx(np.arcsin(z[2]))
    assert plotted(drawn["sky_map"][1]) == ""  # a map has nothing over time to zoom
    assert plotted(drawn["slews"][1]) != ""


def test_a_turn_that_is_cut_short_after_a_refusal_is_drawn_until_then() -> None:
    ordered = goals(SLEW, (10.0, "spin", STRAIGHT), (20.0, "hold", STRAIGHT))
    cut = simulate(flight(**ordered, spin__rate=0.05), 40.0)
    ways = guidance_drawn(cut)["slews"].axes
    spans = [(patch.get_extents().x0, patch.get_extents().x1) for patch in ways[0].patches]
    (turn, brake) = sorted(spans)
    assert turn[1] == pytest.approx(brake[0])


def test_every_line_of_the_way_can_be_read_off_by_name(
    drawn: dict[str, tuple[str, Figure]],
) -> None:
    """A line without a name has no value in the chart of the page."""
    slews = drawn["slews"][1]
    names = [{each.get_label() for each in axes.get_lines()} for axes in slews.axes]
    assert names[0] >= {"craft", "desired"}
    assert all("desired, norm" in each for each in names[1:])
    shown = slews.axes[1].get_legend().get_texts()
    assert [each.get_text() for each in shown] == ["desired, norm", "limit of a slew"]


def test_limits_of_a_slew_that_were_changed_in_flight_are_all_drawn(record: RunRecord) -> None:
    limit = record.parameters[REFERENCE]["guidance.max_rate"]
    changes = (Change(10**10, REFERENCE, "guidance.max_rate", 2.0 * limit),)
    rate = guidance_drawn(replace(record, changes=changes))["slews"].axes[1]
    lines = (np.asarray(each.get_ydata()) for each in rate.get_lines())
    levels = sorted({float(line[0]) for line in lines if line.size == 2 and line[0] == line[1]})
    assert levels == pytest.approx(np.rad2deg([limit, 2.0 * limit]).tolist())


def test_cones_that_come_or_go_in_flight_are_drawn_and_not_judged(record: RunRecord) -> None:
    values = record.parameters[REFERENCE]
    all_of_them = {name: values[name] for name in values if name.startswith("keep_out.")}
    none = {"keep_out.axes": [], "keep_out.directions": ["sun"], "keep_out.half_angles": []}
    for before, after in ((none, all_of_them), (all_of_them, cones(STANDS))):
        changes = (Change(10**10, REFERENCE, name, value) for name, value in after.items())
        run = replace(with_parameters(record, REFERENCE, before), changes=tuple(changes))
        drawn = guidance_drawn(run)
        told = {text.get_text() for text in drawn["sky_map"].axes[0].texts}
        assert told == {"0: 0 0 1", "1: nadir"}
        assert ("cone_angles" in drawn) is (before is not none)
        row = requirement(Verdict(run), "keep_out")
        assert (row.met, row.reason) == (None, "keep_out.axes was changed in flight")


def test_a_run_without_any_order_has_no_legs_to_shade() -> None:
    resting = simulate(load(configs("paper"), {REFERENCE: {"mode": "goal"}}), 2.0)
    flown = flight_of(resting)
    assert flown is not None
    assert flown.words == ()
    assert {"slews", "sky_map"} <= figures_of(Measured(resting)).keys()


@pytest.mark.filterwarnings("error")
def test_a_craft_that_never_knew_its_attitude_flew_nothing() -> None:
    blind = {
        "initial_fix": False,
        "star_tracker.blinding_times": [0.0],
        "star_tracker.blinding_durations": [1e3],
    }
    files = configs("paper", "mission", "sensors_smallsat")
    record = simulate(load(files, {PLANT: blind, ESTIMATOR: {"initial_fix": False}}), 2.0)
    assert flight_of(record) is None
    assert {"gyro_bias", "transformed_errors"} <= figures_of(Measured(record)).keys()


def test_an_attitude_that_is_not_known_is_in_no_cone_and_nowhere_on_the_sky(
    record: RunRecord,
) -> None:
    attitude = record["attitude"].copy()
    attitude[:100] = 0.0
    lacking = with_columns(record, attitude=attitude)
    assert approaches_of(lacking) == approaches_of(part_of(record, slice(100, None)))
    attitude[:] = 0.0
    assert approaches_of(lacking) == []
    assert np.isnan(pointed(np.zeros((1, 4)), (0.0, 0.0, 1.0))).all()


def test_cones_are_not_judged_where_the_attitude_is_long_not_on_record(record: RunRecord) -> None:
    row = requirement(Verdict(record), "keep_out")
    assert row.met is not None
    most = slice(100, record.stamps_ns.size // 2)
    row = requirement(Verdict(with_rows(record, "attitude", most, np.nan)), "keep_out")
    assert row.met is None
    assert row.reason.startswith("nothing is on record from ")


def test_a_run_without_goals_has_none_of_them() -> None:
    record = simulate(scenario({"spacecraft_plant": {"rate": 20.0}}), 1.0)
    assert flight_of(record) is None
    assert not OWN & set(figures_of(Measured(record)))


def test_guidance_that_nobody_could_fly_is_told_beside_the_rest_of_a_verdict(
    record: RunRecord,
) -> None:
    lacking = with_parameters(record, REFERENCE, {"goals.times": [1.0]})
    rows = {row.key: row for row in Verdict(lacking).requirements}
    for key in ("refused_orders", "keep_out"):
        assert rows[key].met is None
        assert rows[key].reason.startswith("goals.frames has 3 values; allowed: 1")
    assert rows["lost_messages"].met
    assert not OWN & set(figures_of(Measured(lacking)))
    told = replay(lacking)
    assert any(each.startswith("goal: goals.frames has 3 values") for each in told.left_out)
    assert told.law is not None
