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

"""Sudden disturbances found in torques whose pulses are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic import environment, pulse_torque, times

from ppc_attitude.analysis.hits import find_pulses

RATES = [50.0, 100.0, 333.0, 1000.0]
HIT = (0.8, 0.8, 0.8)
ACTUATOR = 0.05  # [N·m]


def found_in(pulses, duration=30.0, rate=100.0, background=environment):
    _, t = times(duration, rate)
    return find_pulses(t, background(t) + pulse_torque(t, pulses), ACTUATOR)


def still(t):
    return np.zeros((t.size, 3))


def same(found, true, within=1e-9, torques_within=2e-5):
    """Pulses found are those true, in order, within a time [s] and a torque [N·m]."""
    assert len(found) == len(true)
    for pulse, (start, duration, torque) in zip(found, sorted(true), strict=True):
        assert pulse.start_s == pytest.approx(start, abs=within)
        assert pulse.duration_s == pytest.approx(duration, abs=within)
        assert pulse.torque == pytest.approx(torque, abs=torques_within)


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
