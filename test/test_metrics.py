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

"""The judgement of synthetic runs, whose truth is known."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import (
    hit_run,
    normal_run,
    part_of,
    requirement,
    with_columns,
    with_error,
    with_rows,
    without_columns,
)

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.command_line.verdict_view import verdict_table


def constant_error(run, values):
    """The run with max_i |q_ev,i| as given, on the y axis, with alternating sign of q_e."""
    sign = np.where(np.arange(values.size) % 2, 1.0, -1.0)
    rows = np.zeros((values.size, 4))
    rows[:, 1], rows[:, 3] = sign * values, sign * np.sqrt(1 - values**2)
    return with_error(run, rows)


def test_a_good_run_meets_every_requirement():
    verdict = Verdict(normal_run())
    assert verdict.all_met
    assert [each.name for each in verdict.requirements] == [
        "settling time",
        "attitude error from 60 s on",
        "attitude error in the last 20 s",
        "angular rate (norm)",
        "applied torque on an axis",
        "attitude error outside its envelope",
        "rate error outside its envelope",
        "difference in the reported attitude error",
        "messages missing or not finite",
    ]
    assert verdict.t.size == 12001
    assert verdict.duration_s == 120.0


def test_the_json_has_of_each_requirement_and_hit_what_the_reference_says():
    run = replace(hit_run(), warnings=("recording was cut",))
    told = json.loads(json.dumps(Verdict(run).to_json(), allow_nan=False))
    for each in told["requirements"]:
        assert list(each)[:6] == ["name", "value", "limit", "unit", "pass", "span"]
        told_more = each["pass"] is None or "over the whole run" in each.get("reason", "")
        assert ("reason" in each) is told_more
    assert list(told["metrics"]["disturbances"][0]) == [
        "start_s",
        "duration_s",
        "torque",
        "recovery_time_s",
        "judged_by",
    ]
    assert told["bag"] == "simulate"
    assert told["warnings"] == ["recording was cut"]


def test_rates_and_torques_are_the_largest():
    run = with_rows(normal_run(1.0), "angular_velocity", 10, np.deg2rad([1.0, -3.0, 3.0]))
    metrics = Verdict(with_rows(run, "applied_torque", 50, [0.0, 0.0, -0.06])).metrics
    assert metrics.max_rate_deg_s == pytest.approx(np.sqrt(19.0), rel=1e-14)
    assert metrics.max_rate_axis_deg_s == pytest.approx(3.0, rel=1e-14)
    assert metrics.max_applied_torque == 0.06


def test_time_counts_from_the_first_instant():
    run = normal_run()
    later = replace(run, stamps_ns=run.stamps_ns + 1_700_000_000_000_000_000)
    assert Verdict(later).to_json() == Verdict(run).to_json()


def test_in_a_rhythm_that_changes_a_sample_lasts_until_the_next():
    """At 10 Hz, and then at 20 Hz: of 20 s outside 10 s were told."""
    run = part_of(normal_run(), np.r_[0:6000:10, 6000:12000:5])
    run = with_rows(run, "rate_error", run.t < 20.0, 1.0)
    assert Verdict(run).metrics.time_outside_rate_envelope_s == 20.0


def begun_late(run, start):
    """Record of a recorder that came at a time [s]."""
    return part_of(run, run.t >= start)


def test_a_recorder_that_came_late_changes_no_time_of_our_plant():
    run = hit_run()
    late = begun_late(run, 10.0)
    expected, found = Verdict(run), Verdict(late)
    for name in ("settling_time_s", "error_after_settling_deadline", "terminal_error"):
        assert getattr(found.metrics, name) == getattr(expected.metrics, name)
    assert found.metrics.disturbances == expected.metrics.disturbances
    assert found.duration_s == expected.duration_s - 10.0
    assert min(row.span[0] for row in found.requirements if row.span) == 10.0
    # Of somebody else's clock the record is all that is known.
    other = Verdict(replace(late, parameters={}))
    assert other.metrics.disturbances[0].start_s == expected.metrics.disturbances[0].start_s - 10.0


@pytest.mark.parametrize(("start", "value"), [(55.0, 55.0), (70.0, None)])
def test_who_is_settled_when_the_record_begins_settled_by_then(start, value):
    verdict = Verdict(begun_late(normal_run(), start))
    row = requirement(verdict, "settling_time")
    assert (row.value, row.met) == (value, None if value is None else True)
    assert "the record of the error begins" in row.reason
    assert verdict.metrics.settling_time_s is None


def test_the_end_of_a_record_that_is_shorter_than_it_is_not_judged():
    row = requirement(Verdict(begun_late(normal_run(), 105.0)), "terminal_error")
    assert (row.met, row.reason) == (
        None,
        "the record of the error begins at 105 s, within the last 20 s",
    )


def test_the_sign_of_the_quaternion_changes_nothing():
    run = hit_run()
    other = with_columns(run, attitude_error=-run["attitude_error"], attitude=-run["attitude"])
    assert Verdict(other).to_json() == Verdict(run).to_json()


RUN = normal_run()
SPOILT = {
    "settling_time": constant_error(RUN, np.full(RUN.t.size, 6e-3)),
    "error_after_deadline": constant_error(RUN, np.where(RUN.t < 60.005, 5.0000001e-3, 1e-5)),
    "terminal_error": constant_error(RUN, np.full(RUN.t.size, 5.0000001e-4)),
    "rate": with_rows(RUN, "angular_velocity", 100, 0.0303),
    "applied_torque": with_rows(RUN, "applied_torque", 100, -0.0500001),
    "outside_attitude_envelope": with_rows(RUN, "attitude_envelope", 100, 0.2),
    "outside_rate_envelope": with_columns(RUN, rate_error=1.01 * RUN["rate_envelope"]),
    "reported_error": with_columns(RUN, attitude_error=0.999 * RUN["attitude_error"]),
    "lost_messages": replace(RUN, missing={"torque_command": 1}),
}


@pytest.mark.parametrize("key", SPOILT)
def test_every_requirement_can_fail(key):
    verdict = Verdict(SPOILT[key])
    assert requirement(verdict, key).met is False
    assert not verdict.all_met


def test_a_controller_without_envelopes_skips_their_rows():
    run = without_columns(
        normal_run(), "attitude_envelope", "rate_envelope", "rate_error", "auxiliary_state"
    )
    verdict = Verdict(run)
    assert not [each.key for each in verdict.requirements if "envelope" in each.key]
    assert verdict.metrics.time_outside_rate_envelope_s is None
    assert verdict.all_met


def test_the_error_is_that_of_the_attitudes_whatever_the_controller_says():
    run = constant_error(normal_run(), np.full(12001, 3e-3))
    told = with_rows(run, "attitude_error", slice(None), [0.0, 0.0, 0.0, 1.0])
    for each in (told, without_columns(run, "attitude_error")):
        verdict = Verdict(each)
        assert verdict.metrics.error_after_settling_deadline == pytest.approx(3e-3, rel=1e-12)
        assert requirement(verdict, "terminal_error").met is False


def test_a_law_whose_envelope_holds_for_what_it_says_alone_has_the_true_time_beside_it():
    run = normal_run()
    small = np.tile([1e-6, 0.0, 0.0, 1.0], (12001, 1))
    verdict = Verdict(
        with_columns(run, attitude_error=small, attitude_envelope=np.full((12001, 3), 1e-4))
    )
    assert requirement(verdict, "outside_attitude_envelope").met
    outside = int((np.abs(run["attitude_error"][:, :3]).max(axis=1) > 1e-4).sum())
    measured = verdict.metrics.time_pointing_outside_attitude_envelope_s
    assert measured == pytest.approx(outside / 100.0, abs=1e-9)


NOT_YET = {
    "settling time": "the run ends at {:g} s, before the deadline of 60 s",
    "attitude error from 60 s on": "the run ends at {:g} s, before the deadline of 60 s",
    "attitude error in the last 20 s": (
        "the run ends at {:g} s, before 20 s that begin 60 s after the start are over"
    ),
}


@pytest.mark.parametrize(
    ("duration", "reasons"),
    [(10.0, NOT_YET), (59.99, NOT_YET), (79.99, dict(list(NOT_YET.items())[2:])), (80.0, {})],
)
def test_a_short_run_is_not_judged_by_what_comes_later_and_fails_nothing(duration, reasons):
    verdict = Verdict(normal_run(duration))
    open_rows = {each.name: each.reason for each in verdict.requirements if each.met is None}
    assert open_rows == {name: why.format(duration) for name, why in reasons.items()}
    assert all(each.span is None for each in verdict.requirements if each.met is None)
    assert verdict.all_met == bool(reasons)  # at 60 s the error is 1.2e-3: too much for the end


def test_the_envelopes_of_any_law_are_judged_by_their_declarations():
    run = normal_run()
    tube, turn = np.full((run.t.size, 3), 0.02), np.full((run.t.size, 1), 0.3)
    columns = {"momentum_error": 0.5 * tube, "momentum_tube": tube}
    run = with_columns(run, **columns, turn=0.1 * turn, turn_envelope=turn)
    verdict = Verdict(with_rows(run, "momentum_error", run.t < 0.995, 0.03))
    row = requirement(verdict, "outside_momentum_tube")
    assert (row.value, row.met) == (1.0, False)
    assert requirement(verdict, "outside_turn_envelope").met
    assert verdict.to_json()["metrics"]["time_outside_momentum_tube_s"] == 1.0


def test_the_table_tells_every_requirement():
    verdict = Verdict(hit_run())
    table = verdict_table(verdict)
    for row in verdict.requirements:
        (line,) = [line for line in table.splitlines() if line.startswith(row.name + "  ")]
        assert line.endswith(f"  {row.outcome}")
        assert row.limit_text in line
        assert row.span_text in line
    assert "settling time: a sudden disturbance at 20 s comes before the deadline" in table
    assert "at 80 s, (0.8, 0.8, 0.8) N·m for 0.1 s: recovered after 3." in table
    assert table.splitlines()[1].startswith("judged by `attitude`, which is the truth")


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), holes=st.floats(0, 0.3), rate=st.sampled_from([10.0, 50.0]))
def test_the_metrics_of_arbitrary_errors(seed, holes, rate):
    """Settling, deadline, terminal error and envelope against a plain loop over the samples.

    With more holes there would be gaps of ten samples, behind which a craft may have settled.
    """
    random = np.random.default_rng(seed)
    run = normal_run(90.0, rate)
    t = run.stamps_ns / 1e9
    values = 10.0 ** random.uniform(-5, -2, t.size) * np.where(t < 40, 10, 1)
    run = constant_error(run, values)
    known = random.random(t.size) >= holes
    known[[0, -1]] = True
    holey = {
        name: np.where(known[:, None], run[name], np.nan) for name in ("attitude", "attitude_error")
    }
    metrics = Verdict(with_columns(run, **holey)).metrics
    settling, late, end, outside = 0.0, 0.0, 0.0, 0
    for instant, error, rho, seen in zip(t, values, run["attitude_envelope"], known, strict=True):
        if not seen:
            continue
        settling = instant if error >= 5e-3 else settling
        late = max(late, error) if instant >= 60 else late
        end = max(end, error) if instant >= 70 else end
        outside += bool(error > rho[1])
    assert metrics.settling_time_s == settling
    assert metrics.error_after_settling_deadline == pytest.approx(late, rel=1e-12)
    assert metrics.terminal_error == pytest.approx(end, rel=1e-12)
    assert metrics.time_outside_attitude_envelope_s == pytest.approx(outside / rate, abs=1e-9)


def test_instants_of_a_long_flight_are_told_to_a_tenth_of_a_second():
    """Six digits told a fault of 5 s after three months as 8.00005e+06 to 8.00006e+06 s."""
    run, begin = hit_run(), 8_000_000
    plant = {
        **run.parameters["spacecraft_plant"],
        "faults": [f"star_tracker blind from {begin + 50.5} for 5"],
    }
    verdict = Verdict(
        replace(
            run,
            stamps_ns=run.stamps_ns + begin * 10**9,
            parameters={**run.parameters, "spacecraft_plant": plant},
        )
    )
    assert verdict.faults == ("star_tracker blind, 8000050.5 to 8000055.5 s",)
    table = verdict_table(verdict)
    assert "8000100 to 8000120" in table
    assert "the sudden disturbance at 8000080 s are over" in table
    assert "e+06 to" not in table
