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

"""The sudden disturbances of a run: found in its torque, and those of the schedule."""

from dataclasses import replace

import numpy as np
import pytest
from craft_helpers import pulse
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import (
    environment,
    normal_run,
    pulse_torque,
    times,
    with_columns,
    with_parameters,
)

from ppc_attitude.analysis.hits import Pulse, find_pulses, pulses_of
from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import Requirements
from ppc_attitude.contract.run_record import Change
from ppc_attitude.contract.topics import INJECTOR, PLANT

ACTUATOR = 0.05  # [N·m]
HIT, WEAK = (0.8, 0.8, 0.8), (9e-4, 0.0, 0.0)
RATES = [50.0, 100.0, 333.0, 1000.0]


def scheduled(*pulses, changes=(), duration=30.0):
    """A run of the paper's environment with pulses (start, duration, torque) on schedule."""
    _, t = times(duration)
    starts, durations, torques = zip(*pulses, strict=True)
    schedule = {
        "pulse_times": [*starts],
        "pulse_durations": [*durations],
        "pulse_torques": [number for torque in torques for number in torque],
    }
    run = with_columns(
        normal_run(duration), disturbance_torque=environment(t) + pulse_torque(t, [*pulses])
    )
    return replace(with_parameters(run, INJECTOR, schedule), changes=changes)


def test_a_scheduled_hit_counts_however_weak_it_is():
    run = scheduled((20.0, 0.1, (0.8, 0.8, 0.8)), (10.004, 2.0, WEAK))
    weak, strong = pulses_of(run, ACTUATOR)
    assert weak == Pulse(10.01, 2.0, WEAK)  # from the first instant that it acts on
    assert strong.torque == pytest.approx((0.8, 0.8, 0.8), abs=1e-6)


def test_beside_an_environment_on_record_a_weak_hit_may_begin_with_the_record():
    """Without that record it could be the environment."""
    _, t = times(30.0)
    total = environment(t) + pulse_torque(t, [(0.0, 0.1, (0.1 * ACTUATOR, 0.0, 0.0))])
    torques = {"disturbance_torque": total, "environment_torque": environment(t)}
    (hit,) = pulses_of(with_columns(normal_run(30.0), **torques), ACTUATOR)
    assert (hit.start_s, hit.duration_s) == (0.0, 0.1)


@pytest.mark.parametrize("start", [20.0, 20.1])  # on a step of the strong one
def test_a_weak_scheduled_hit_is_no_part_of_a_strong_one(start):
    planned = (20.0, 0.1, (0.8, 0.8, 0.8)), (start, 2.0, WEAK)
    found = pulses_of(scheduled(*planned), ACTUATOR)
    assert [(each.start_s, each.duration_s) for each in found] == [each[:2] for each in planned]


@pytest.mark.parametrize(
    ("planned", "found"),
    [
        ((-5.0, 10.0, WEAK), [(0.0, 5.0)]),
        ((29.0, 5.0, WEAK), [(29.0, 1.01)]),  # the last sample acts for a step
        ((30.0, 5.0, WEAK), [(30.0, 0.01)]),
        ((0.0, 40.0, WEAK), []),  # never begins nor ends
        ((31.0, 1.0, WEAK), []),
        ((5.0, 1.0, (0.0, 0.0, 0.0)), []),
        ((5.0, 1.0, (0.0, float("nan"), 0.0)), []),
        ((float("nan"), 1.0, WEAK), []),
        (("soon", 1.0, WEAK), []),
    ],
)
def test_of_a_weak_scheduled_hit_counts_what_the_record_has_of_it(planned, found):
    run = scheduled((5.0, 1.0, (0.0, 0.0, 0.0)))
    start, duration, torque = planned
    schedule = pulse(start, duration, *torque)
    run = with_parameters(run, INJECTOR, schedule)
    assert [(each.start_s, each.duration_s) for each in pulses_of(run, ACTUATOR)] == found


@pytest.mark.parametrize("torque", [(0.003, 0.002, 0.001), (-0.007, 0.0, 0.0), (0.8, 0.8, 0.8)])
def test_a_scheduled_hit_may_begin_with_the_record_whatever_the_environment_is(torque):
    """A weak one was taken for the environment, and its end for a hit that lasted to the end."""
    begun, later = pulses_of(scheduled((0.0, 1.2, torque), (20.0, 0.1, (0.8, 0.8, 0.8))), ACTUATOR)
    assert (begun.start_s, begun.duration_s) == (0.0, 1.2)
    assert begun.torque == pytest.approx(torque, abs=1e-6)
    assert (later.start_s, later.duration_s) == (20.0, 0.1)


def test_a_schedule_acts_until_it_is_changed_in_flight():
    changes = (Change(11_000_000_000, INJECTOR, "pulse_torques", [0.0, 5e-4, 0.0]),)
    run = scheduled((10.0, 2.0, WEAK), changes=changes)
    assert pulses_of(run, ACTUATOR) == (
        Pulse(10.0, 1.0, WEAK),
        Pulse(11.0, 1.0, (0.0, 5e-4, 0.0)),
    )


def test_however_many_hits_are_scheduled_each_counts():
    """From the 501st on none did: their steps passed for the noise of a rough signal."""
    planned = [(round(5.0 + 0.1 * k, 9), 0.05, (0.8, 0.8, 0.8)) for k in range(501)]
    found = pulses_of(scheduled(*planned, duration=60.0), ACTUATOR)
    assert [(each.start_s, each.duration_s) for each in found] == [each[:2] for each in planned]


@pytest.mark.parametrize("limit", [float("nan"), float("inf"), 0.0, -0.05, 10**400, "much"])
def test_an_actuator_that_means_nothing_hides_no_hit(limit):
    run = scheduled((20.0, 0.1, (0.8, 0.8, 0.8)))
    verdict = Verdict(with_parameters(run, PLANT, {"max_torque": limit}))
    assert len(verdict.hits) == 1
    assert verdict.torque_limit == ACTUATOR


def test_hits_of_a_craft_that_tells_nothing_are_found_by_its_required_torque():
    _, t = times(30.0)
    torque = pulse_torque(t, [(20.0, 0.1, (5e-4, 0.0, 0.0))])
    run = replace(with_columns(normal_run(30.0), disturbance_torque=torque), parameters={})
    assert Verdict(run).hits == ()
    (hit,) = Verdict(run, Requirements(torque=1e-4)).hits
    assert (hit.start_s, hit.duration_s) == (20.0, 0.1)


def found_in(pulses, duration=30.0, rate=100.0, background=environment):
    _, t = times(duration, rate)
    return find_pulses(t, background(t) + pulse_torque(t, pulses), ACTUATOR)


def still(t):
    return np.zeros((t.size, 3))


def same(found, true, within=1e-9, torques_within=2e-5):
    """Pulses found are those true, in order, within a time [s] and a torque [N·m]."""
    assert len(found) == len(true)
    for each, (start, duration, torque) in zip(found, sorted(true), strict=True):
        assert each.start_s == pytest.approx(start, abs=within)
        assert each.duration_s == pytest.approx(duration, abs=within)
        assert each.torque == pytest.approx(torque, abs=torques_within)


@pytest.mark.parametrize("rate", [10.0, *RATES])
def test_the_environment_has_none(rate):
    assert found_in([], 1000.0, rate) == ()


@pytest.mark.parametrize(
    "true",
    [
        [(29.5, 0.51, HIT)],  # to the last sample
        [(30.0, 0.01, HIT)],  # the last sample alone
        [(0.0, 1.0, HIT), (29.5, 0.51, (0.1, 0.0, 0.0))],
        [(5.0, 25.01, (0.002, 0.002, 0.002))],  # so weak and so long as a leak
        [(5.0, 0.2, HIT), (5.1, 0.3, (0.0, -0.3, 0.1))],  # overlapping
        [(5.0, 0.2, HIT), (5.1, 0.2, HIT)],  # overlapping and equal
        [(5.0, 1.0, HIT), (5.2, 0.1, (0.3, 0.0, 0.0))],  # one within the other
        [(5.0, 0.1, HIT), (5.1, 0.1, (0.3, -0.3, 0.0))],  # touching
        [(5.0, 0.1, HIT), (5.1, 0.1, (-0.8, -0.8, -0.8))],  # touching and opposite
        [(5.0, 0.1, HIT), (5.1, 0.1, (0.1, 0.0, 0.0)), (5.2, 0.1, (0.0, 0.4, 0.0))],
        [(5.0, 0.1, HIT), (5.1, 0.1, (0.3, 0.0, 0.0)), (9.0, 0.1, HIT)],  # then the first again
        [(0.0, 25.0, (0.02, 0.02, 0.02))],  # most of the run
        [(0.0, 0.05, HIT), (20.0, 0.1, (-0.8, -0.8, -0.8)), (25.0, 0.1, HIT)],
    ],
)
@pytest.mark.parametrize("background", [environment, still])
def test_known_pulses(true, background):
    same(found_in(true, background=background), true)


def test_equal_pulses_that_touch_or_coincide_are_one():
    same(found_in([(5.0, 0.1, HIT), (5.1, 0.1, HIT)]), [(5.0, 0.2, HIT)])
    same(found_in([(5.0, 0.1, (0.2, 0, 0))] * 2), [(5.0, 0.1, (0.4, 0, 0))])


def test_a_pulse_that_fills_a_record_of_pulses_only():
    """No rest to compare with: what is there is the extra torque."""
    same(
        found_in([(0.0, 1.0, HIT), (1.0, 1.01, (0.1, 0.0, 0.0))], 2.0, background=still),
        [(0.0, 1.0, HIT), (1.0, 1.01, (0.1, 0.0, 0.0))],
    )


def test_missing_samples_are_no_steps():
    _, t = times(30.0)
    torque = environment(t) + pulse_torque(t, [(5.0, 0.1, HIT)])
    torque[100:200] = np.nan
    torque[501] = np.nan
    torque[-3:] = np.nan
    same(find_pulses(t, torque, ACTUATOR), [(5.0, 0.1, HIT)])


def test_a_large_environment_is_no_pulse_of_a_weak_actuator():
    _, t = times(30.0)
    torque = environment(t) + pulse_torque(t, [(5.0, 0.1, HIT)])
    same(find_pulses(t, torque, 0.01, 4.4e-3), [(5.0, 0.1, HIT)])


def test_where_there_is_no_environment_rest_is_zero_even_if_pulses_touch_from_the_start() -> None:
    """As those of the worst case that `falsify` writes: one of them was taken for rest."""
    _, t = times(30.0)
    levels = [HIT, (0.005, -0.004, 0.003), (-0.3, 0.2, -0.1)]
    pieces = [(10.0 * k, 10.0, level) for k, level in enumerate(levels)]
    same(find_pulses(t, pulse_torque(t, pieces), ACTUATOR, 0.0), pieces)


def test_a_constant_torque_is_not_sudden():
    _, t = times(10.0)
    assert find_pulses(t, np.full((t.size, 3), 0.3), ACTUATOR) == ()


def test_a_rough_torque_has_no_pulses():
    _, t = times(30.0)
    rough = np.random.default_rng(1).normal(0.0, 0.1, (t.size, 3))
    assert find_pulses(t, rough, ACTUATOR) == ()


@pytest.mark.parametrize("rough", [slice(100, 1300), slice(None)])
@pytest.mark.parametrize("second", [HIT, (0.5, 0.5, 0.5)])
def test_a_hit_stands_out_of_a_rough_torque(rough: slice, second: tuple[float, ...]) -> None:
    """Noise of 2 mN·m for 12 s hid every hit of the record."""
    true = [(20.0, 0.1, HIT), (25.0, 0.1, second)]
    _, t = times(30.0)
    for seed in range(10):
        torque = environment(t) + pulse_torque(t, true)
        torque[rough] += np.random.default_rng(seed).normal(0.0, 2e-3, torque[rough].shape)
        same(find_pulses(t, torque, ACTUATOR), true, torques_within=0.02)


@pytest.mark.parametrize("samples", [0, 1, 2])
def test_hardly_any_sample(samples):
    t = np.arange(samples) * 0.01
    for torque in (0.0, np.nan):
        assert find_pulses(t, np.full((samples, 3), torque), ACTUATOR) == ()


AXIS = st.floats(0.02, 2.0).flatmap(lambda size: st.sampled_from([size, -size]))
TORQUE = st.tuples(AXIS, AXIS, AXIS).flatmap(
    lambda torque: st.sampled_from(
        [torque, (torque[0], 0.0, 0.0), (0.0, torque[1], 0.0), (0.0, 0.0, torque[2])]
    )
)


@settings(max_examples=150, deadline=None)
@given(
    rate=st.sampled_from(RATES),
    data=st.lists(st.tuples(st.integers(1, 40), st.integers(1, 60), TORQUE), max_size=6),
    start=st.integers(0, 1),
    environment_on=st.booleans(),
)
def test_pulses_apart(rate, data, start, environment_on):
    """Any pulses with a sample of rest between, from the first sample on: found as they are."""
    true, sample = [], start
    for length, rest, torque in data:
        true.append((sample / rate, length / rate, torque))
        sample += length + rest
    background = environment if environment_on else still
    same(found_in(true, (sample + 400) / rate, rate, background), true, within=2e-9)


@settings(max_examples=150, deadline=None)
@given(pulses=st.lists(st.tuples(st.integers(5, 200), st.integers(1, 50), TORQUE), max_size=5))
def test_what_is_found_adds_up(pulses):
    """However pulses overlap, those found explain the torque: what they leave is smooth."""
    _, t = times(10.0)
    torque = environment(t) + pulse_torque(t, [(a / 100, b / 100, c) for a, b, c in pulses])
    found = find_pulses(t, torque, ACTUATOR)
    rest = torque - pulse_torque(t, [(p.start_s, p.duration_s, p.torque) for p in found])
    assert np.abs(rest - environment(t)).max() < 1.1e-3


@pytest.mark.parametrize("gap", [(20.2, 77.8), (28.8, 70.1)])  # [s]
def test_what_the_environment_changes_while_nothing_is_on_record_is_no_hit(gap):
    true = [(10.0, 0.1, HIT), (90.0, 0.1, HIT)]
    _, t = times(120.0)
    torque = environment(t) + pulse_torque(t, true)
    on_record = (t < gap[0]) | (t > gap[1])
    same(find_pulses(t[on_record], torque[on_record], ACTUATOR), true)


def test_a_torque_that_is_too_weak_alone_is_too_weak_beside_a_hit():
    true = [(10.0, 0.1, HIT)]
    same(found_in([*true, (10.1, 2.0, (9e-4, 0.0, 0.0))]), true)
