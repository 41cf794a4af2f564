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

"""Fixes that do not fit: which are refused, and what refused ones say of the filter."""

import numpy as np
import pytest
from estimation_helpers import (
    SLOTS,
    STEP_NS,
    angles_between,
    begun,
    known_now,
    new_memory,
    noisy,
    run,
    suite,
    turning,
    write_knowledge,
)
from scipy.spatial.transform import Rotation

from ppc_attitude.science.estimators.late_fixes import take_fix, take_sample


@pytest.mark.parametrize("name", SLOTS)
def test_false_fixes_are_refused_and_good_ones_are_not(name: str) -> None:
    for seed in range(100, 120):  # by chance the gate refuses one good fix in 65 000
        settings, rates, _, valid, arrival, fixes = noisy(name, 20.0, seed)
        rng = np.random.default_rng(1000 + seed)
        false = rng.random(valid.size) < 0.05
        false[:6] = False  # a first fix that is false is another test's
        axis = rng.normal(size=(valid.size, 3))
        size = rng.uniform(3e-3, 0.1, valid.size) * false
        turns = axis * (size / np.linalg.norm(axis, axis=1))[:, None]
        fixes = (Rotation.from_quat(fixes) * Rotation.from_rotvec(turns)).as_quat()
        memory, _ = run(settings, rates, valid, arrival, fixes)
        arrived = arrival < len(rates)
        assert memory["fixes"] == arrived.sum()
        assert memory["refused"] == (false & arrived).sum()
        assert memory["begun_anew"] == 0


TURN = Rotation.from_rotvec([0.2, -0.25, 0.18])  # 21°


@pytest.mark.parametrize(("name", "right_at"), [("smallsat", 30), ("cubesat", 60)])
def test_a_false_first_fix_is_soon_forgotten(name: str, right_at: int) -> None:
    settings, rates, truth, valid, arrival, fixes = noisy(name, 2.0, 7)
    fixes[0] = (TURN * Rotation.from_quat(fixes[0])).as_quat()
    memory, rows = run(settings, rates, valid, arrival, fixes)
    error = angles_between(rows[:, :4], truth)
    assert error[right_at - 1] > 0.3
    assert error[right_at:].max() < 0.01
    assert memory["begun_anew"] == 1
    assert memory["refused"] == 1  # the one that the filter begins anew from is used


@pytest.mark.parametrize(("name", "followed_after"), [("smallsat", 100), ("cubesat", 200)])
def test_a_turn_of_all_fixes_in_inertial_axes_is_followed(name: str, followed_after: int) -> None:
    settings, rates, _, valid, arrival, fixes = noisy(name, 14.0, 7)
    turned = valid >= 1000
    fixes[turned] = (TURN * Rotation.from_quat(fixes[turned])).as_quat()
    memory, rows = run(settings, rates, valid, arrival, fixes)
    at = 1000 + followed_after
    error = angles_between(rows[valid, :4], fixes)
    assert memory["begun_anew"] == 1
    assert error[(valid > 1000) & (valid < at)].min() > 0.3
    assert error[valid >= at].max() < 0.01


def test_fixes_that_disagree_are_never_believed() -> None:
    settings, rates, truth, valid, arrival, fixes = noisy("smallsat", 14.0, 3)
    count = (valid >= 500).sum()
    random = Rotation.random(count, random_state=3)
    fixes[valid >= 500] = random.as_quat()
    memory, rows = run(settings, rates, valid, arrival, fixes)
    assert memory["refused"] == (arrival[valid >= 500] < len(rates)).sum() > 80
    assert memory["begun_anew"] == 0
    assert angles_between(rows[-1, :4], truth[-1]) < 1e-3


@pytest.mark.parametrize("size", [2e-3, 1e-2, 0.1, 0.5])
@pytest.mark.parametrize(("name", "right"), [("smallsat", 3e-4), ("cubesat", 3e-3)])
def test_a_bias_that_jumps_is_found(name: str, right: float, size: float) -> None:
    jump = size * np.array([0.6, -0.64, 0.48])
    beside = []
    for seed in range(30, 34):
        settings, rates, truth, valid, arrival, fixes = noisy(name, 20.0, seed)
        _, calm = run(settings, rates, valid, arrival, fixes)
        rates[1000:] += jump
        memory, rows = run(settings, rates, valid, arrival, fixes)
        assert memory["begun_anew"] in (1, 2)
        assert memory["refused"] <= 9 * memory["begun_anew"] + 2
        late = slice(1000 + 22 * SLOTS[name], None)  # after ten slots, where need be twice
        assert angles_between(rows[late, :4], truth[late]).max() < right
        beside.append((rows[-1, 4:7] - jump - calm[-1, 4:7]) / rows[-1, 10:13])
    assert np.mean(np.square(beside)) < 1.5  # as well as it says


@pytest.mark.parametrize("size", [2e-3, 1e-2, 0.1])
def test_a_first_bias_far_beyond_what_was_expected_is_found(size: float) -> None:
    settings, rates, truth, valid, arrival, fixes = noisy("smallsat", 10.0, 5)
    memory, rows = run(settings, rates + size * np.array([0.6, -0.64, 0.48]), valid, arrival, fixes)
    assert memory["refused"] + memory["begun_anew"] <= 13
    assert angles_between(rows[400:, :4], truth[400:]).max() < 3e-4


@pytest.mark.parametrize("size", [2e-5, 1e-4])
def test_a_jump_that_ten_fixes_do_not_tell_from_noise_is_found_after_some_tries(
    size: float,
) -> None:
    jump = size * np.array([0.6, -0.64, 0.48])
    settings, rates, truth, valid, arrival, fixes = noisy("flagship", 60.0, 8)
    memory, rows = run(settings, rates + jump, valid, arrival, fixes)
    assert 1 < memory["begun_anew"] < 10
    first = suite("flagship")["gyro.initial_bias_sigma"] ** 2
    assert memory["bias_variance"] == first * 4.0 ** (memory["begun_anew"] - 1)
    late = slice(4000, None)
    assert angles_between(rows[late, :4], truth[late]).max() < 2e-5
    assert np.abs(rows[late, 4:7] - jump).max() < 3e-6


@pytest.mark.parametrize("size", [2e-5, 2.5e-5])
def test_a_small_jump_about_the_boresight_is_learnt_too(size: float) -> None:
    """It lets hundreds of fixes pass between two restarts, which went on for ever."""
    settings, rates, truth, valid, arrival, fixes = noisy("flagship", 250.0, 8)
    rates[10_000:] += np.array([0.0, 0.0, size])
    memory, rows = run(settings, rates, valid, arrival, fixes)
    assert 1 < memory["begun_anew"] < 4
    assert np.abs(rows[-3000:, 4:7] - [0.0, 0.0, size]).max() < 1e-6
    assert angles_between(rows[-3000:, :4], truth[-3000:]).max() < 2e-5


def test_a_tracker_that_turns_in_its_mounting_is_not_believed() -> None:
    """In a steady slew its inertial error grows at one rate, as it does after a bias has jumped."""
    settings, rates, truth, valid, arrival, fixes = noisy("smallsat", 14.0, 7)
    steady = np.broadcast_to([0.04, 0.03, 0.0], rates.shape)
    attitudes = Rotation.from_quat(truth[0]) * Rotation.from_rotvec(
        0.01 * np.arange(len(rates))[:, None] * steady[0]
    )
    noise = Rotation.from_quat(truth[valid]).inv() * Rotation.from_quat(fixes)
    fixes = (attitudes[valid] * noise).as_quat()
    rates = rates - turning(14.0)[0] + steady
    turned = valid >= 700
    fixes[turned] = (Rotation.from_quat(fixes[turned]) * TURN).as_quat()
    memory, rows = run(settings, rates, valid, arrival, fixes)
    assert memory["refused"] == (turned & (arrival < len(rates))).sum() > 30
    assert memory["begun_anew"] == 0
    assert angles_between(rows[-1, :4], attitudes[-1].as_quat()) < 0.02


def test_a_tracker_that_is_wrong_anew_for_hours_leaves_finite_numbers() -> None:
    """Whenever the filter has believed it, it turns on by 21°."""
    settings, *_ = noisy("smallsat", 2.0, 4)
    memory, row, turns = new_memory(), np.zeros(13), 0
    for k in range(30_000):
        take_sample(memory, settings, k * STEP_NS, (0.0, 0.0, 0.0))
        if k % SLOTS["smallsat"] == 0:
            turns = int(memory["begun_anew"]) + 1 if memory["accepted"] > 6 else turns
            turned = Rotation.from_rotvec(turns * TURN.as_rotvec()).as_quat()
            take_fix(memory, settings, k * STEP_NS, tuple(turned.tolist()))
    assert memory["begun_anew"] > 200
    write_knowledge(memory, row)
    assert np.isfinite(row).all()
    assert row[10:].max() < 0.2  # [rad/s] σ of the bias


def test_refused_fixes_make_a_row_in_their_order_only() -> None:
    rate = [0.05, 0.0, 0.0]  # [rad/s] at which their error grows
    for order, believed in ((1, 1), (-1, 0)):
        settings, truth, memory = begun(400)
        for valid in range(250, 400, 10)[::order]:
            turn = Rotation.from_rotvec(0.01 * valid * np.array(rate))
            fix = Rotation.from_quat(truth[valid]) * turn
            take_fix(memory, settings, valid * STEP_NS, tuple(fix.as_quat().tolist()))
        assert memory["begun_anew"] == believed


def test_a_refused_fix_that_comes_again_does_not_agree_with_itself() -> None:
    settings, truth, memory = begun(100)
    before = known_now(memory)
    false = Rotation.from_quat(truth[50]) * Rotation.from_rotvec([1.0, 0.0, 0.0])
    for _ in range(12):
        take_fix(memory, settings, 50 * STEP_NS, tuple(false.as_quat()))
    assert (memory["refused"], memory["unmatched"], memory["begun_anew"]) == (1, 11, 0)
    assert known_now(memory) == before
