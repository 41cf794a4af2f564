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

"""The judgement of records that lack something: the rest is judged, and what lacks is named."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import (
    hit_run,
    normal_run,
    part_of,
    requirement,
    turned,
    with_columns,
    with_error,
    with_parameters,
    with_rows,
    without_columns,
)
from test_metrics import constant_error

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import DEGREES, PAPER, Accuracy
from ppc_attitude.analysis.series import AnalysisError
from ppc_attitude.command_line.verdict_view import verdict_table
from ppc_attitude.contract.topics import PLANT


@pytest.mark.parametrize("column", ["attitude_error", "angular_velocity", "applied_torque"])
def test_missing_samples_are_skipped_and_counted(column):
    verdict = Verdict(with_rows(normal_run(), column, np.r_[1, 0:12001:7], np.nan))
    json.dumps(verdict.to_json(), allow_nan=False)
    assert requirement(verdict, "lost_messages").value == 1 + 1715
    assert [each.key for each in verdict.requirements if not each.met] == ["lost_messages"]


@pytest.mark.parametrize("column", ["reference_attitude", "attitude"])
def test_an_attitude_of_zeros_is_as_good_as_none(column):
    verdict = Verdict(with_rows(normal_run(), column, slice(-2000, None), 0.0))
    assert requirement(verdict, "lost_messages").value == 2000


def test_an_envelope_that_is_not_on_record_is_left_out_of_the_time_outside_it():
    run = with_rows(normal_run(), "attitude_envelope", slice(8000, 9000), np.nan)
    row = requirement(Verdict(run), "outside_attitude_envelope")
    assert [each for each in row.without if each[1] - each[0] > 1.0] == [(79.99, 90.0)]


def test_the_three_errors_say_what_is_not_on_record():
    run = with_rows(normal_run(), "attitude", slice(10_500, 11_500), np.nan)
    assert "RMS, from 100 to 120, without 104.99 to 115 s" in verdict_table(Verdict(run))


def test_a_reference_that_ends_before_the_craft_has_settled_is_no_disturbance():
    run = with_rows(normal_run(), "reference_attitude", slice(1001, None), np.nan)
    row = requirement(Verdict(run), "settling_time")
    assert row.met is None
    assert row.reason == "no attitude error is known after 10 s, before the deadline of 60 s"


@pytest.mark.parametrize("end", [50, 80, 82])  # [s]: before the second hit, at it, and after it
def test_a_recovery_that_nobody_saw_is_not_judged(end):
    since = slice(100 * end + 1, None)
    verdict = Verdict(with_rows(hit_run(), "reference_attitude", since, np.nan))
    row = requirement(verdict, "recovery")
    reason = f"no attitude error is known after {end} s, before the 10 s after the sudden"
    assert (row.met, row.reason.startswith(reason)) == (None, True)
    assert "not recovered" not in verdict_table(verdict)


def test_what_was_told_of_the_rate_is_no_truth_where_the_truth_is_recorded():
    run = normal_run()
    rate = requirement(Verdict(with_columns(run, truth_attitude=run["attitude"])), "rate")
    assert (rate.met, rate.reason) == (None, "no topic truth/angular_velocity in the bag")


def test_what_comes_with_some_instants_only_lacks_nothing_at_the_others():
    run = normal_run()
    fixes = np.full((12001, 3), np.nan)
    fixes[::10] = 1.0
    assert Verdict(with_columns(run, innovation=fixes)).all_met
    fixes[10, 1] = np.nan  # a fix of which a part is missing
    row = requirement(Verdict(with_columns(run, innovation=fixes)), "lost_messages")
    assert row.value == 1


@pytest.mark.filterwarnings("error")
def test_missing_messages_count_once_and_what_is_no_number_of_a_craft_counts():
    run = with_rows(normal_run(), "angular_velocity", [3, 4], np.nan)
    run = with_rows(run, "angular_velocity", ([9, 10, 11], 1), [np.inf, 1e31, -1e300])
    verdict = Verdict(replace(run, missing={"angular_velocity": 2}))
    assert requirement(verdict, "lost_messages").value == 5
    assert verdict.metrics.max_rate_deg_s < 3


def test_no_sample_at_all():
    with pytest.raises(AnalysisError, match="no sample at all"):
        Verdict(part_of(normal_run(1.0), slice(0)))


LACKING = {
    "disturbance_torque": [],
    "angular_velocity": ["rate"],
    "applied_torque": ["applied_torque"],
    "attitude": ["settling_time", "error_after_deadline", "terminal_error"],
}


@pytest.mark.parametrize("column", LACKING)
def test_what_the_record_lacks_is_named_and_the_rest_is_judged(column):
    run = normal_run()
    for lacking in (with_rows(run, column, slice(None), np.nan), without_columns(run, column)):
        verdict = Verdict(lacking)
        open_rows = [each for each in verdict.requirements if each.met is None]
        assert [each.key for each in open_rows] == LACKING[column]
        assert all(each.reason == f"no topic {column} in the bag" for each in open_rows)
        json.dumps(verdict.to_json(), allow_nan=False)
    assert verdict.all_met


def test_without_our_plant_the_torque_is_judged_by_what_the_controller_was_told():
    run = normal_run()
    for parameters, limit in (
        ({"spacecraft_plant": {"max_torque": 0.2}, "ppc_controller": {"max_torque": 0.1}}, 0.2),
        ({"ppc_controller": {"max_torque": 0.005}}, 0.005),
        ({}, 0.05),
    ):
        verdict = Verdict(replace(run, parameters=parameters))
        assert requirement(verdict, "applied_torque").limit == limit


@pytest.mark.parametrize(
    ("axes", "each", "limit"),
    [
        ([1.0, 1.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0, -1.0, 1.0], [0.3], 4 * 0.3 / 3**0.5),
        ([2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0], [0.1, 0.2, 0.3], 0.3),
        ([1.0] * 7, [0.3], 0.05),  # what nobody can read is not believed
        ([0.0] * 9, [0.3], 0.05),
        ("none", [0.3], 0.05),
        ([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], [0.1, 0.2], 0.05),
    ],
)
def test_with_wheels_the_torque_is_judged_by_what_they_give_together(axes, each, limit):
    plant = {"max_torque": 0.05, "wheels.axes": axes, "wheels.max_torque": each}
    for actuator, expected in (("wheels", limit), ("ideal", 0.05)):
        parameters = {"spacecraft_plant": {**plant, "actuator": actuator}}
        verdict = Verdict(replace(normal_run(), parameters=parameters))
        judged = requirement(verdict, "applied_torque")
        assert judged.limit == pytest.approx(expected, rel=1e-12)


def test_the_torque_of_an_actuator_that_is_not_installed_is_not_judged():
    """Whatever limit another actuator of the plant's parameters would have."""
    craft = {"actuator": "gimbals", "gimbals.thrust": 0.2, "max_torque": 0.05}
    run = replace(normal_run(), parameters={"spacecraft_plant": craft})
    row = requirement(Verdict(run), "applied_torque")
    assert row.met is None
    assert row.reason == "actuator = gimbals is not installed here"


def test_one_sample_is_a_run():
    """It has no duration: outside an envelope it was so for 0 s, and met that requirement."""
    verdict = Verdict(with_error(normal_run(0.0), np.array([[0.0, 1.0, 0.0, 0.0]])))
    assert (verdict.t.size, verdict.duration_s) == (1, 0.0)
    json.dumps(verdict.to_json(), allow_nan=False)
    for error in ("attitude", "rate"):
        row = requirement(verdict, f"outside_{error}_envelope")
        assert (row.met, row.reason) == (None, "the record has one instant, which has no duration")
        assert verdict.to_json()["metrics"][f"time_outside_{error}_envelope_s"] is None
    assert verdict.metrics.time_pointing_outside_attitude_envelope_s is None


LIMITS = "limits (wheels.max_speed"
TANK = "tank (thrusters.fuel"


@pytest.mark.parametrize(
    ("key", "what", "plant"),
    [
        ("wheel_speed", LIMITS, {}),
        *(("wheel_speed", LIMITS, {"wheels.max_speed": x}) for x in ([], "fast", [628.3] * 9)),
        ("fuel", TANK, {}),
        *(("fuel", TANK, {"thrusters.fuel": x}) for x in ("full", math.nan)),
        ("momentum", "parameters of the wheels (wheels.inertia", {}),
    ],
)
def test_what_nobody_can_read_of_the_plant_is_not_judged(key, what, plant):
    rows = np.full((12001, 4), 600.0)
    run = with_columns(normal_run(), wheel_speed=rows, fuel_used=rows[:, :1])
    run, required = replace(run, parameters={"spacecraft_plant": plant}), replace(PAPER, momentum=1)
    judged = requirement(Verdict(run, required), key)
    assert (judged.met, judged.reason) == (None, f"no {what} of spacecraft_plant) on record")


def test_verdict_says_when_the_wheels_momentum_ran_out():
    t = normal_run().t
    speeds = np.outer(t, [0.0, -6.0, 5.0, 0.0])
    run = with_columns(normal_run(), wheel_speed=speeds)
    plant = {"spacecraft_plant": {"wheels.max_speed": [600.0]}}
    judged = requirement(Verdict(replace(run, parameters=plant)), "wheel_speed")
    full = t[6.0 * t > 0.99 * 600.0][0]
    assert not judged.met
    assert judged.note == f"wheel 1 is above the limit from {full:g} s on, so momentum runs out"


def with_gap(run, start, end):
    """The run without what is between two times [s]."""
    between = slice(round(100 * start) + 1, round(100 * end))
    for column in ("attitude", "angular_velocity"):
        run = with_rows(run, column, between, np.nan)
    return run


NOTHING = "nothing is on record from {} to {} s".format


@pytest.mark.parametrize(  # the run settles at 43.89 s
    ("start", "end", "key", "met", "told"),
    [
        (40.0, 50.0, "settling_time", True, f"at most: {NOTHING(40, 50)}"),
        (40.0, 65.0, "settling_time", None, NOTHING(40, 65)),
        (45.0, 60.0, "settling_time", None, NOTHING(45, 60)),
        (10.0, 20.0, "settling_time", True, ""),
        (101.0, 119.0, "terminal_error", None, NOTHING(101, 119)),
        (101.0, 102.0, "terminal_error", True, "without 101 to 102"),
        (2.0, 8.0, "rate", True, "without 2 to 8"),
        (2.0, 20.0, "rate", None, NOTHING(2, 20)),
        (70.0, 70.1, "error_after_deadline", True, ""),  # ten steps are no time
        (70.0, 70.11, "error_after_deadline", True, "without 70 to 70.11"),
        (101.0, 120.01, "terminal_error", None, NOTHING(101, 120)),
    ],
)
def test_nobody_knows_what_is_not_on_record(start, end, key, met, told):
    row = requirement(Verdict(with_gap(normal_run(), start, end)), key)
    assert (row.met, row.note) == (met, told)
    if told.startswith("at most"):
        assert row.value == end


@pytest.mark.parametrize(
    ("gap", "value", "met", "told"),
    [
        ((82.0, 88.0), 8.0, True, f"at most: {NOTHING(82, 88)}"),
        ((82.0, 95.0), None, None, NOTHING(82, 95)),
        ((80.05, 85.0), 5.0, True, f"at most: {NOTHING(80.05, 85)}"),  # the hit may not be over
        ((85.0, 95.0), 3.41, True, ""),
        ((78.0, 88.0), 8.0, True, f"at most: {NOTHING(78, 88)}"),
        ((78.0, 95.0), None, None, NOTHING(78, 95)),
    ],
)
def test_nobody_knows_when_in_a_gap_the_craft_has_recovered(gap, value, met, told):
    row = requirement(Verdict(with_gap(hit_run(), *gap)), "recovery")
    assert (row.value, row.met, row.note) == (value, met, told)


@pytest.mark.parametrize(
    ("gap", "error"), [((82, 101), 1.0), ((79, 101), 1.0), ((80.05, 101), 1e-5)]
)
def test_nobody_knows_whether_the_craft_recovered_before_the_next_hit(gap, error):
    run = hit_run(hits=(80.0, 100.0))
    if error < 1.0:  # as small as it still is amid a short hit
        run = constant_error(run, np.full(run.t.size, error))
    row = requirement(Verdict(with_gap(run, *gap)), "recovery")
    assert (row.met, row.reason) == (None, NOTHING(*gap))


def test_what_is_not_on_record_of_one_hit_hides_nothing_of_another():
    run = hit_run(hits=(70.0, 95.0))
    late = slice(9500, 11000)  # the second one recovers after 15 s
    run = with_rows(run, "attitude", late, run["attitude"][9503])
    assert requirement(Verdict(run), "recovery").met is False
    for gap in ((72.0, 85.0), (72.0, 75.0), (100.0, 109.0)):
        row = requirement(Verdict(with_gap(run, *gap)), "recovery")
        assert (row.met, "at most" in row.note) == (False, False)


def test_what_is_left_out_of_a_record_or_lacks_at_its_end_is_not_judged():
    run = normal_run()
    few = np.r_[0:200, 11000:12001]
    for lacking in (part_of(run, few), with_gap(run, 101.0, 120.01)):
        for key in ("terminal_error", "rate"):
            if lacking.stamps_ns.size > 2000 or key == "rate":
                assert requirement(Verdict(lacking), key).met is None, key


def test_an_envelope_is_judged_by_the_laws_own_error():
    run = with_rows(normal_run(), "reference_attitude", slice(5000, 9000), np.nan)
    assert requirement(Verdict(run), "outside_attitude_envelope").met is True
    run = with_rows(normal_run(), "attitude_error", slice(1000, 11000), np.nan)
    assert requirement(Verdict(run), "outside_attitude_envelope").met is None


def test_of_steps_that_vary_nobody_knows_what_is_missing():
    run = normal_run()
    some = np.random.default_rng(0).random(run.stamps_ns.size) < 0.6
    row = requirement(Verdict(part_of(run, some)), "lost_messages")
    assert (row.met, row.reason.startswith("the steps of the record vary")) == (None, True)


@pytest.mark.parametrize("column", ["attitude", "reference_attitude", "attitude_error"])
def test_an_attitude_with_a_number_beyond_any_crafts_is_skipped(column):
    verdict = Verdict(with_rows(normal_run(), column, [11_000, 11_500], (1e40, 0.0, 0.0, 0.0)))
    unharmed = Verdict(normal_run())
    assert verdict.metrics.terminal_error == unharmed.metrics.terminal_error
    assert [each.max_deg for each in verdict.errors] == [each.max_deg for each in unharmed.errors]
    assert [each.key for each in verdict.requirements if not each.met] == ["lost_messages"]


def test_a_torque_with_a_number_beyond_any_crafts_is_skipped():
    verdict = Verdict(with_rows(normal_run(), "applied_torque", 5000, (0.0, 1e40, 0.0)))
    largest = Verdict(normal_run()).metrics.max_applied_torque
    assert verdict.metrics.max_applied_torque == largest


def test_a_number_that_says_that_there_is_no_rate_is_no_largest_rate():
    run = normal_run()
    gyro = np.tile([0.01, 0.0, 0.0, 1e-8], (run.stamps_ns.size, 1))
    gyro[500:600] = 0.0, 0.0, 0.0, -1.0
    limits = replace(PAPER, limits={"gyro": 0.1})
    row = requirement(Verdict(with_columns(run, gyro=gyro), limits), "limit_gyro")
    assert (row.value, row.met) == (0.01, True)


def test_the_speed_of_wheels_that_is_long_not_on_record_is_not_judged():
    run = normal_run()
    speeds = np.tile(np.full(8, 10.0), (run.stamps_ns.size, 1))
    run = with_parameters(
        with_columns(run, wheel_speed=speeds), PLANT, {"wheels.max_speed": [600.0]}
    )
    short = requirement(
        Verdict(with_rows(run, "wheel_speed", slice(100, 200), np.nan)), "wheel_speed"
    )
    assert short.met
    assert short.without == ((0.99, 2.0),)
    long = requirement(
        Verdict(with_rows(run, "wheel_speed", slice(100, 2000), np.nan)), "wheel_speed"
    )
    assert long.met is None
    assert long.reason == "nothing is on record from 0.99 to 20 s"


@pytest.mark.parametrize(("instants", "met"), [(slice(100, 9000), True), (slice(9000, None), None)])
def test_fuel_is_known_from_any_later_sample(instants, met):
    run = normal_run()
    fuel = np.linspace(0.0, 0.1, run.stamps_ns.size)[:, None]
    run = with_parameters(with_columns(run, fuel_used=fuel), PLANT, {"thrusters.fuel": 0.5})
    row = requirement(Verdict(with_rows(run, "fuel_used", instants, np.nan)), "fuel")
    assert row.met is met


def test_a_reported_error_and_knowledge_that_are_long_not_on_record_are_not_judged():
    run = with_rows(normal_run(), "attitude_error", slice(100, 2000), np.nan)
    assert requirement(Verdict(run), "reported_error").met is None
    run = with_columns(normal_run(), truth_attitude=normal_run()["attitude"])
    run = with_rows(run, "truth_attitude", slice(7000, 9000), np.nan)
    required = replace(PAPER, knowledge=Accuracy(1e-3))
    assert requirement(Verdict(run, required), "knowledge").met is None


def test_a_filter_has_until_the_settling_deadline_to_know_the_attitude():
    run = normal_run()
    turns = np.tile([1.0, 0.0, 0.0], (run.stamps_ns.size, 1))
    turns[:6000] *= 0.1  # [rad] until the deadline of 60 s
    turns[6000:] *= 1e-4
    told = turned(run["attitude"], Rotation.from_rotvec(turns).as_quat())
    run = with_columns(run, truth_attitude=run["attitude"], attitude=told)
    for accuracy, met in ((1.1e-4, True), (9e-5, False)):
        angle = Accuracy(np.rad2deg(accuracy), DEGREES)
        row = requirement(Verdict(run, replace(PAPER, knowledge=angle)), "knowledge")
        assert (row.met, row.span) == (met, (60.0, 120.0))
        assert row.value == pytest.approx(np.rad2deg(1e-4))
    short = part_of(run, slice(5000))
    row = requirement(Verdict(short, replace(PAPER, knowledge=Accuracy(1e-3))), "knowledge")
    assert (row.met, row.reason) == (None, "the run ends at 49.99 s, before the settling deadline")
