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

"""The judgement of synthetic runs with sudden disturbances."""

from dataclasses import replace

import numpy as np
import pytest
from craft_helpers import case
from synthetic import (
    environment,
    hit_run,
    normal_run,
    pulse_torque,
    requirement,
    with_columns,
    with_parameters,
    with_rows,
)
from test_metrics import constant_error

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import PAPER
from ppc_attitude.analysis.verdict import torque_text
from ppc_attitude.command_line.verdict_view import verdict_table
from ppc_attitude.contract.run_record import Change
from ppc_attitude.contract.topics import PLANT, REFERENCE
from ppc_attitude.simulation.closed_loop import simulate


def test_recovered_hits_are_judged_by_recovery_and_not_by_the_settled_error():
    verdict = Verdict(hit_run())
    early, late = verdict.metrics.disturbances
    assert (early.start_s, late.start_s) == (20.0, 80.0)
    assert late.torque == pytest.approx((0.8, 0.8, 0.8), abs=1e-6)
    # 0.02 exp(−0.4 s) − 0.23 exp(−0.09 (80 + s)) + 2e-5 sin(80 + s) = 5e-3 at s = 3.41…
    t = np.arange(0, 10, 0.01) + 80
    error = 0.02 * np.exp(-0.4 * (t - 80)) - 0.23 * np.exp(-0.09 * t) + 2e-5 * np.sin(t)
    assert late.recovery_time_s == pytest.approx(
        t[np.flatnonzero(np.abs(error) >= 5e-3)[-1]] - 80, abs=1e-6
    )
    # The hit at 20 s leaves no settling to judge, and that at 80 s no terminal accuracy.
    assert requirement(verdict, "settling_time").met is None
    assert requirement(verdict, "terminal_error").met is None
    assert requirement(verdict, "error_after_deadline").without == ((80.0, 90.0),)
    assert (early.judged_by, late.judged_by) == ("the envelope", "recovery")
    before = requirement(verdict, "outside_rate_envelope")
    after = requirement(verdict, "outside_rate_envelope_after_hit")
    assert (after.value, after.span) == (0.16, (20.0, 120.0))
    assert (before.value, before.span) == (0.0, (0.0, 20.0))
    assert verdict.metrics.time_outside_rate_envelope_s == 0.32
    assert verdict.metrics.spans["time_outside_rate_envelope_s"] == (0.0, 120.0)
    assert verdict.metrics.error_after_settling_deadline < 5e-3
    assert verdict.all_met


@pytest.mark.parametrize("size", [2.0**-26, 2.0**14])
def test_hits_of_a_tiny_and_of_a_huge_craft_are_judged_as_those_of_any_other(size):
    run = hit_run(hits=(80.0,))
    torques = {name: size * run[name] for name in ("applied_torque", "disturbance_torque")}
    scaled = with_parameters(with_columns(run, **torques), PLANT, {"max_torque": size * 0.05})
    verdict, expected = Verdict(scaled), Verdict(run)
    assert [each.met for each in verdict.requirements] == [
        each.met for each in expected.requirements
    ]
    (hit,) = verdict.metrics.disturbances
    assert hit.torque == pytest.approx((0.8 * size,) * 3, rel=1e-6)
    assert torque_text(hit) == ", ".join([f"{0.8 * size:.4g}"] * 3)
    assert hit.recovery_time_s == expected.metrics.disturbances[0].recovery_time_s


def test_rate_and_settling_count_before_the_first_hit_only():
    run = hit_run(hits=(80.0,))
    verdict = Verdict(with_rows(run, "angular_velocity", slice(8001, None), 1.0))
    row = requirement(verdict, "rate")
    assert (row.met, row.span) == (True, (0.0, 80.0))
    assert verdict.metrics.spans["max_rate_deg_s"] == (0.0, 80.0)
    whole = np.rad2deg(np.sqrt(3.0))
    assert verdict.metrics.max_rate_whole_run_deg_s == pytest.approx(whole, rel=1e-12)
    assert verdict.metrics.settling_time_s < 60
    assert requirement(verdict, "settling_time").met


def hit_with_error(last_bad, start=80.0, end=120.0, extra=()):
    """A run hit at `start` whose error is 0.01 from then to `last_bad`."""
    run = normal_run(end)
    t = run.stamps_ns / 1e9
    bad = (t > start - 1e-9) & (t < last_bad + 1e-9)
    hits = [(start, 0.1, (0.8, 0.0, 0.0)), *extra]
    return with_columns(
        constant_error(run, np.where(bad | (t < 50), 0.01, 1e-5)),
        disturbance_torque=environment(t) + pulse_torque(t, hits),
    )


LOST = "not recovered from the sudden disturbance at 80 s"
NEXT = (0.1, (0.0, 0.5, 0.0))  # duration and torque of another hit
ENDS = "the run ends at {} s, before the 10 s after the sudden disturbance at {} s are over"


@pytest.mark.parametrize(
    ("run", "value", "met", "reason", "told"),
    [
        ((90.0,), 10.0, True, "", [10.0]),
        ((90.01,), 10.01, False, "", [10.01]),
        ((120.0,), None, False, LOST, [None]),
        # One whose time to recover ends with the record, and before, while it may still recover.
        ((0.0, 80.0, 90.0), 0.0, True, "", [0.0]),
        ((83.0, 80.0, 90.0), 3.0, True, "", [3.0]),
        ((95.0, 80.0, 90.0), None, None, ENDS.format(90, 80), [None]),
        ((95.0, 80.0, 90.01), None, False, LOST, [None]),
        ((85.0, 80.0, 84.0), None, None, ENDS.format(84, 80), [None]),
        ((83.0, 80.0, 84.0), None, None, ENDS.format(84, 80), [3.0]),
        # The error of one just before the end has not yet grown.
        ((0.0, 99.9, 100.0), None, None, ENDS.format(100, 99.9), [None]),
        # One that the next interrupts is judged with it, unless it had its time before.
        ((88.0, 80.0, 120.0, [(83.0, *NEXT)]), 5.0, True, "", [None, 5.0]),
        ((97.0, 80.0, 120.0, [(95.0, *NEXT)]), None, False, LOST, [None, 2.0]),
    ],
)
def test_recovery_within_ten_seconds(run, value, met, reason, told):
    """Given are the last instant with a large error, the hit, the end of the run, further hits."""
    verdict = Verdict(hit_with_error(*run))
    row = requirement(verdict, "recovery")
    assert (row.value, row.met, row.reason) == (value, met, reason)
    assert row.reason in verdict_table(verdict)
    assert [hit.recovery_time_s for hit in verdict.metrics.disturbances] == told


@pytest.mark.parametrize(("last_bad", "start"), [(90.0, 80.0), (62.0, 55.0)])
def test_what_comes_in_the_time_to_recover_is_no_error_after_the_deadline(last_bad, start):
    """The last instant of that time is in it, and it may begin before the deadline."""
    row = requirement(Verdict(hit_with_error(last_bad, start)), "error_after_deadline")
    assert (row.met, row.without) == (True, ((start, start + 10.0),))


def test_where_every_instant_is_in_the_time_to_recover_no_error_is_judged():
    verdict = Verdict(hit_run(), replace(PAPER, recovery=150.0))
    row = requirement(verdict, "error_after_deadline")
    told = "every instant from 60 to 120 s is within 150 s of a sudden disturbance"
    assert (row.met, row.reason) == (None, told)


@pytest.mark.parametrize("start", [30.0, 60.0])  # before the deadline, and at it
def test_a_run_that_is_not_settled_when_it_is_hit_has_no_settling_time(start):
    run = hit_with_error(84.0, start=start)
    run = constant_error(run, np.where(run.t < 84.0, 0.01, 1e-5))
    verdict = Verdict(run)
    assert verdict.metrics.settling_time_s == start - 0.01  # as the contract defines it
    assert verdict.metrics.settled is False
    row = requirement(verdict, "settling_time")
    assert (row.value, row.met) == (None, None)
    assert ("still not settled" in row.reason) == (start == 60.0)


@pytest.mark.parametrize(("end", "judged"), [(159.99, False), (160.0, True)])
def test_the_terminal_error_is_judged_sixty_seconds_after_a_hit(end, judged):
    verdict = Verdict(hit_with_error(84.0, end=end))
    row = requirement(verdict, "terminal_error")
    assert (row.met is True) is judged
    assert verdict.metrics.terminal_error == pytest.approx(1e-5, rel=1e-9)
    assert verdict.all_met


def test_an_early_hit_is_judged_by_the_envelope():
    run = hit_run(hits=(20.0,))
    verdict = Verdict(with_rows(run, "attitude_envelope", slice(2050, 2150), 1e-3))
    assert "recovery" not in [each.key for each in verdict.requirements]
    assert not requirement(verdict, "outside_attitude_envelope").met


def test_the_rate_error_may_be_outside_half_a_second_a_hit():
    verdict = Verdict(with_rows(hit_run(), "rate_error", slice(8000, 8051), 1.0))
    row = requirement(verdict, "outside_rate_envelope_after_hit")
    assert (row.value, row.met) == (0.51, False)


def test_a_hit_from_the_first_sample_leaves_no_undisturbed_rate():
    run = normal_run()
    t = run.stamps_ns / 1e9
    torque = environment(t) + pulse_torque(t, [(0.0, 0.1, (0.5, 0.0, 0.0))])
    verdict = Verdict(with_columns(run, disturbance_torque=torque))
    assert verdict.metrics.max_rate_deg_s is None
    assert verdict.metrics.settling_time_s is None
    row = requirement(verdict, "rate")
    assert (row.met, row.reason) == (None, "a sudden disturbance acts from the first instant on")


@pytest.mark.parametrize(
    ("key", "overlays", "parameter", "value"),
    [
        ("applied_torque", [], "max_torque", 0.2),
        ("wheel_speed", ["wheels"], "wheels.max_speed", [900.0]),
        ("fuel", ["thrusters"], "thrusters.fuel", 1.0),
        ("keep_out", ["mission"], "keep_out.half_angles", [1.0, 1.2]),
    ],
)
def test_a_limit_that_was_changed_in_flight_is_not_judged(key, overlays, parameter, value):
    run = simulate(case(*overlays), 1.0)
    assert requirement(Verdict(run), key).met is not None
    node = REFERENCE if parameter.startswith("keep_out") else PLANT
    changed = replace(run, changes=(Change(500_000_000, node, parameter, value),))
    row = requirement(Verdict(changed), key)
    assert (row.met, row.reason) == (None, f"{parameter} was changed in flight")
