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

import gzip
import math
import runpy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from docs_helpers import EXAMPLES
from estimation_helpers import (
    MOUNTING,
    ROOT,
    STEP_NS,
    Array,
    angles_between,
    filtered,
    known_now,
    new_memory,
    suite,
)
from scipy.spatial.transform import Rotation
from truth_tables import numbers

from ppc_attitude.science.component import Advice
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.estimators.late_fixes import take_fix, take_sample
from ppc_attitude.science.estimators.mekf import filter_record
from ppc_attitude.science.part import Part

MOUNTINGS = {
    "smallsat_slew": [0.0, 0.573576436351046, 0.0, 0.819152044288992],
    "cubesat_tumble": MOUNTING,
}
REFUSED = {"smallsat_slew": 0, "cubesat_tumble": 7}  # the false fixes, and no other


def recording(case: str) -> tuple[Any, Array, Any, Any, Array]:
    """Settings, gyro samples from step 0 on, steps of validity and arrival, and fixes."""
    settings = filter_record(suite(case.partition("_")[0], star_tracker__mounting=MOUNTINGS[case]))
    rates = np.vstack([np.zeros(3), numbers(f"{case}_gyro") * 1e-7])
    star = numbers(f"{case}_star")
    valid, arrival = (star[:, i].astype(np.int64) for i in (0, 1))
    return settings, rates, valid, arrival, np.ascontiguousarray(star[:, 2:])


def run(settings: Any, rates: Array, valid: Any, arrival: Any, fixes: Array) -> tuple[Any, Array]:
    memory, rows = new_memory(), np.full((len(rates), 13), np.nan)
    filtered(memory, settings, rates, valid, arrival, fixes, rows)
    return memory, rows


@pytest.mark.parametrize("case", MOUNTINGS)
def test_recorded_data_give_what_the_reference_filter_knows(case: str, tmp_path: Path) -> None:
    """By the example of docs/estimation.md, as a user feeds them."""
    example = runpy.run_path(str(EXAMPLES / "recorded_sensors.py"))
    packed = (ROOT / "test" / "truth" / f"{case}_gyro.csv.gz").read_bytes()
    (tmp_path / "gyro.csv").write_bytes(gzip.decompress(packed))
    gyro = example["read_gyro"](tmp_path / "gyro.csv")
    values = suite(case.partition("_")[0], star_tracker__mounting=MOUNTINGS[case])
    fed = example["estimates"](values, gyro, numbers(f"{case}_star"), 100.0)
    rows = np.array(list(fed))
    oracle = numbers(f"{case}_oracle")
    rows = rows[oracle[:, 0].astype(int)]
    known = ~np.isnan(oracle[:, 1])
    assert np.array_equal(~np.isnan(rows[:, 0]), known)
    rows, oracle = rows[known], oracle[known]
    assert angles_between(rows[:, :4], oracle[:, 1:5]).max() < 1e-9
    assert np.abs(rows[:, 4:7] - oracle[:, 5:8]).max() < 5e-9
    assert np.allclose(rows[:, 7:], oracle[:, 8:], rtol=1e-6)  # the file has seven digits
    memory, inner = run(*recording(case))
    assert np.array_equal(inner[oracle[:, 0].astype(int)], rows)
    assert (memory["refused"], memory["unmatched"]) == (REFUSED[case], 0)


def test_a_recording_of_one_fix_and_one_sample_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    gyro, star = tmp_path / "gyro.csv", tmp_path / "star.csv"
    gyro.write_text("wx,wy,wz [1e-07 rad/s]\n100,-200,300\n")
    star.write_text("valid,arrival,qx,qy,qz,qw\n0,1,0.6,0,0,0.8\n")
    given = [gyro, star, "--config", ROOT / "config" / "sensors_smallsat.yaml"]
    monkeypatch.setattr("sys.argv", ["recorded_sensors.py", *map(str, given)])
    runpy.run_path(str(EXAMPLES / "recorded_sensors.py"), run_name="__main__")
    before, after = (line.split(",") for line in capsys.readouterr().out.splitlines()[1:])
    assert before[1] == "nan"
    assert np.allclose(np.array(after[1:5], float), [0.6, 0.0, 0.0, 0.8], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("case", MOUNTINGS)
def test_a_late_filter_is_a_prompt_one_without_the_later_fixes(case: str) -> None:
    settings, rates, valid, arrival, fixes = recording(case)
    # From a first estimate, over a false fix, and between two arrivals.
    for last in (25, 647, 1999):
        late_memory, late = run(settings, rates[: last + 1], valid, arrival, fixes)
        arrived = arrival <= last
        assert arrived.any()
        prompt_memory, prompt = run(
            settings, rates[: last + 1], valid[arrived], valid[arrived], fixes[arrived]
        )
        assert np.array_equal(late[-1], prompt[-1])
        assert known_now(late_memory) == known_now(prompt_memory)


@cache
def turning(seconds: float) -> tuple[Array, Array]:
    """Rates [rad/s] held over each step of 0.01 s (row k ends at step k) and exact attitudes."""
    t = 0.01 * np.arange(round(100 * seconds) + 1)
    rates = 0.02 * np.stack([np.cos(t / 3), np.sin(t / 2), -np.cos(t / 4)], axis=1)
    q = [Rotation.from_quat([0.1554, 0.4271, 0.4792, 0.7509])]
    for turn in Rotation.from_rotvec(0.01 * rates[1:]):
        q.append(q[-1] * turn)
    return rates, Rotation.concatenate(q).as_quat()


def test_without_noise_one_fix_is_enough() -> None:
    rates, truth = turning(100.0)
    settings = filter_record(suite("flagship"))
    steps = np.zeros(1, np.int64)
    _, rows = run(settings, rates, steps, steps, truth[:1])
    assert angles_between(rows[:, :4], truth).max() <= 1e-12
    assert np.array_equal(rows[:, 4:7], np.zeros_like(rates))


SLOTS = {"smallsat": 10, "cubesat": 20}


def noisy(name: str, seconds: float, seed: int) -> tuple[Any, Array, Array, Any, Any, Array]:
    """`turning` as the sensors of a suite see it; noise of NumPy's generator, bias as drawn."""
    values, rng = suite(name), np.random.default_rng(seed)
    every = SLOTS.get(name, 10)
    rates, truth = turning(seconds)
    n, h = len(rates), 0.01
    white = np.hypot(
        values["gyro.angular_random_walk"], values["gyro.resolution"] * np.sqrt(h / 12.0)
    )
    walk = values["gyro.rate_random_walk"] * np.sqrt(h) * rng.normal(size=(n, 3))
    bias = values["gyro.initial_bias_sigma"] * rng.normal(size=3) + walk.cumsum(axis=0)
    measured = rates + bias + white / np.sqrt(h) * rng.normal(size=(n, 3))
    valid = np.arange(0, n, every)
    sigma = [values["star_tracker.cross_noise"]] * 2 + [values["star_tracker.boresight_noise"]]
    noise = Rotation.from_rotvec(rng.normal(size=(valid.size, 3)) * sigma)
    fixes = (Rotation.from_quat(truth[valid]) * noise).as_quat()
    return filter_record(values), measured, truth, valid, valid + every, fixes


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
    assert memory["distrust"] == 4.0 ** (memory["begun_anew"] - 1)
    late = slice(4000, None)
    assert angles_between(rows[late, :4], truth[late]).max() < 2e-5
    assert np.abs(rows[late, 4:7] - jump).max() < 3e-6


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


def begun(steps: int, at: int = 0, valid: int = 0) -> tuple[Any, Array, Any]:
    """Settings, truth and memory after so many steps, at one of which the first fix came."""
    settings, rates, truth, *_ = noisy("smallsat", 12.0, 3)
    memory = new_memory()
    for k, rate in enumerate(rates[:steps].tolist()):
        take_sample(memory, settings, k * STEP_NS, tuple(rate))
        if k == at:
            take_fix(memory, settings, valid * STEP_NS, tuple(truth[valid]))
    return settings, truth, memory


@pytest.mark.parametrize(
    ("steps", "at", "valid", "stamps"),
    [
        # Of no step that is remembered: forgotten, between two, to come.
        (1201, 0, 0, (0, 1199 * STEP_NS + STEP_NS // 2, 1201 * STEP_NS)),
        # Of steps before the first that the filter knows of, and the first fix once more.
        (100, 90, 80, (0, 79 * STEP_NS, 80 * STEP_NS)),
    ],
)
def test_a_fix_of_no_step_that_waits_for_one_is_counted_and_changes_nothing(
    steps: int, at: int, valid: int, stamps: tuple[int, ...]
) -> None:
    settings, truth, memory = begun(steps, at, valid)
    before = known_now(memory)
    for stamp in stamps:
        _, told = take_fix(memory, settings, stamp, tuple(truth[stamp // STEP_NS % 1201]))
        assert not told
    assert (memory["unmatched"], memory["accepted"]) == (3, 1)
    assert known_now(memory) == before


@pytest.mark.parametrize(("off", "accepted"), [(-1, 2), (1, 2), (-600, 2), (1000, 1)])
def test_a_fix_is_of_its_step_whatever_its_stamp_was_rounded_to(off: int, accepted: int) -> None:
    settings, truth, memory = begun(100)
    for _ in range(2):  # the second time it is known
        take_fix(memory, settings, 50 * STEP_NS + off, tuple(truth[50]))
    assert memory["accepted"] == accepted
    assert memory["unmatched"] == 3 - accepted


def test_a_refused_fix_that_comes_again_does_not_agree_with_itself() -> None:
    settings, truth, memory = begun(100)
    before = known_now(memory)
    false = Rotation.from_quat(truth[50]) * Rotation.from_rotvec([1.0, 0.0, 0.0])
    for _ in range(12):
        take_fix(memory, settings, 50 * STEP_NS, tuple(false.as_quat()))
    assert (memory["refused"], memory["unmatched"], memory["begun_anew"]) == (1, 11, 0)
    assert known_now(memory) == before


def test_the_rate_has_the_variance_of_a_sample_by_the_filters_own_numbers() -> None:
    values = suite("smallsat")
    part = Part(mekf.COMPONENT, values)
    fix = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(3):  # a gyro that tells no variance
        part.step(k * STEP_NS, (0.0, 0.0, 0.0, 0.0, *(fix if k == 0 else (0.0,) * 8)))
    h, estimate = 0.01, part.output("estimate")
    white = values["gyro.angular_random_walk"] ** 2 / h + values["gyro.resolution"] ** 2 / 12.0
    assert estimate[13] - part.output("gyro_bias_sigma")[0] ** 2 == pytest.approx(white, rel=1e-6)


@pytest.mark.parametrize("name", ["star_tracker.cross_noise", "star_tracker.boresight_noise"])
def test_a_tracker_without_noise_is_refused(name: str) -> None:
    for value in (0.0, 1e-170):
        with pytest.raises(ConfigurationError, match=rf"{name} = {value} rad; allowed: ≥ 1e-15"):
            filter_record({**suite("smallsat"), name: value})


def test_variances_that_rounding_would_mix_are_refused() -> None:
    given = {"star_tracker.cross_noise": 1e-8, "star_tracker.boresight_noise": 1e-2}
    with pytest.raises(ConfigurationError, match=r"boresight_noise are 1e\+06 times apart"):
        filter_record({**suite("smallsat"), **given})


@pytest.mark.parametrize("latency", [0.1, 0.6, 5.0])
def test_a_fix_is_missed_from_its_arrival_on_however_late_that_is(latency: float) -> None:
    part = Part(mekf.COMPONENT, suite("smallsat", star_tracker__latency=latency))
    delay, last = round(100 * latency), 3000  # steps

    def is_warning_at(k: int) -> bool:
        valid = k - delay
        fix = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, latency)
        came = valid % 10 == 0 and 0 <= valid <= last
        part.step(k * STEP_NS, (0.0, 0.0, 0.0, 0.0, *(fix if came else (0.0,) * 8)))
        return bool(part.advice.warning)

    warned = [k for k in range(last + delay + 60) if is_warning_at(k)]
    assert warned[0] - last - delay in (50, 51)  # five slots, to rounding


def test_a_filter_in_the_dark_warns_after_five_slots() -> None:
    part = Part(mekf.COMPONENT, suite("smallsat", star_tracker__latency=0.0))
    begin = 12_345 * STEP_NS
    for k in range(52):
        part.step(begin + k * STEP_NS, (0.0,) * 12)
        late = k > 50
        text = "no fix for 0.51 s, so no estimate" if late else "no fix yet"
        assert part.advice[:3] == (text, late, False)


def test_the_filter_says_what_it_thinks_of_itself() -> None:
    values = suite("smallsat", star_tracker__latency=0.0)
    part = Part(mekf.COMPONENT, values)
    no_fix, good = (0.0,) * 8, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    false = (0.0, 0.0, math.sin(0.1), math.cos(0.1), 0.0, 0.0, 0.0, 0.0)

    def after(*fixes: tuple[float, ...]) -> Advice:
        for fix in fixes:
            stamp = int(part.state[0]["count"]) * STEP_NS
            part.step(stamp, (*(0.0, 0.0, 0.0, 0.0), *fix))
        return part.advice

    assert after(no_fix)[:3] == ("no fix yet", False, False)
    assert after(good).text.startswith("tracking, 3σ = 30″")  # 3 · 10″, about the boresight
    assert after(*[no_fix] * 50).text.startswith("tracking")  # five slots
    stale = after(no_fix)
    assert stale.text.startswith("no fix for 0.51 s, 3σ = ")
    assert (stale.warning, stale.failed) == (True, False)
    assert after(good).text.startswith("tracking")
    refused = after(false)
    assert refused.text.startswith("the last fix was refused, 3σ = ")
    assert (refused.warning, refused.failed) == (True, False)
    assert (refused.numbers["fixes"], refused.numbers["fixes refused"]) == (3, 1)
    lost = after(*[no_fix] * 6000)  # it hardly knows the bias yet
    assert lost.text.startswith("lost: no fix for 60 s, 3σ = ")
    assert (lost.warning, lost.failed) == (True, True)
    assert after(good).text.startswith("tracking")
    assert part.advices == 8  # every change of mind, once
