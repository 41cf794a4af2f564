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
    begun,
    known_now,
    noisy,
    run,
    suite,
    turning,
)
from truth_tables import numbers

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.estimators.late_fixes import take_fix
from ppc_attitude.science.estimators.mekf import filter_record
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.part import Part

MOUNTINGS = {
    "smallsat_slew": [0.0, 0.573576436351046, 0.0, 0.819152044288992],
    "cubesat_tumble": MOUNTING,
}
# Of a gyro that does not turn and tells no variance, and of a tracker that sees it so.
STILL, FIX, NO_FIX = (0.0,) * 4, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0), (0.0,) * 8
REFUSED = {"smallsat_slew": 0, "cubesat_tumble": 7}  # the false fixes, and no other


def recording(case: str) -> tuple[Any, Array, Any, Any, Array]:
    """Settings, gyro samples from step 0 on, steps of validity and arrival, and fixes."""
    settings = filter_record(suite(case.partition("_")[0], star_tracker__mounting=MOUNTINGS[case]))
    rates = np.vstack([np.zeros(3), numbers(f"{case}_gyro") * 1e-7])
    star = numbers(f"{case}_star")
    valid, arrival = (star[:, i].astype(np.int64) for i in (0, 1))
    return settings, rates, valid, arrival, np.ascontiguousarray(star[:, 2:])


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


def test_without_noise_one_fix_is_enough() -> None:
    rates, truth = turning(100.0)
    settings = filter_record(suite("flagship"))
    steps = np.zeros(1, np.int64)
    _, rows = run(settings, rates, steps, steps, truth[:1])
    assert angles_between(rows[:, :4], truth).max() <= 1e-12
    assert np.array_equal(rows[:, 4:7], np.zeros_like(rates))


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


def test_the_rate_has_the_variance_of_a_sample_by_the_filters_own_numbers() -> None:
    values = suite("smallsat")
    part = Part(mekf.COMPONENT, values)
    for k in range(3):
        part.step(k * STEP_NS, (*STILL, *(FIX if k == 0 else NO_FIX)))
    h, estimate = 0.01, np.array(part.output("estimate"))
    white = values["gyro.angular_random_walk"] ** 2 / h + values["gyro.resolution"] ** 2 / 12.0
    rest = estimate[[13, 16, 18]] - np.square(part.output("gyro_bias_sigma"))
    assert rest == pytest.approx(white, rel=1e-6)


@pytest.mark.parametrize("name", ["star_tracker.cross_noise", "star_tracker.boresight_noise"])
def test_a_tracker_without_noise_is_refused(name: str) -> None:
    for value in (0.0, 1e-170):
        with pytest.raises(ConfigurationError, match=rf"{name} = {value} rad; allowed: ≥ 1e-15"):
            filter_record({**suite("smallsat"), name: value})


def test_variances_that_rounding_would_mix_are_refused() -> None:
    given = {"star_tracker.cross_noise": 1e-8, "star_tracker.boresight_noise": 1e-2}
    with pytest.raises(ConfigurationError, match=r"boresight_noise are 1e\+06 times apart"):
        filter_record({**suite("smallsat"), **given})


@pytest.mark.parametrize("walk", [0.0, 1e-9, 1e-6])
@pytest.mark.parametrize("noise", [1e-12, 1e-9, 1e-5])
@pytest.mark.parametrize("missed", [0, 1, 100, 300])
def test_no_variance_becomes_negative_with_the_least_known_bias_that_is_allowed(
    noise: float, walk: float, missed: int
) -> None:
    given = {
        "star_tracker.cross_noise": noise,
        "star_tracker.boresight_noise": 7.0 * noise,
        "gyro.angular_random_walk": walk,
        "gyro.rate_random_walk": 0.0,
        "gyro.resolution": 0.0,
        "star_tracker.latency": 0.0,
    }
    most = math.sqrt((noise**2 + 10.0 * walk**2) / 1e-12) / 10.0
    if most <= 1.0:
        refused = suite("smallsat") | given | {"gyro.initial_bias_sigma": 1.001 * most}
        with pytest.raises(ConfigurationError, match=r"initial_bias_sigma = .* allowed: up to"):
            filter_record(refused)
    part = Part(
        mekf.COMPONENT,
        suite("smallsat") | given | {"gyro.initial_bias_sigma": 0.999 * min(most, 1.0)},
    )
    for k in range(10 * missed + 200):
        came = k == 0 or (k % 10 == 0 and k > 10 * missed)
        part.step(k * STEP_NS, (*STILL, *(FIX if came else NO_FIX)))
        estimate = np.array(part.output("estimate"))
        variances = estimate[[4, 7, 9, 13, 16, 18]]
        assert np.isfinite(estimate).all()
        assert (variances >= 0.0).all() or (variances[3:] == -1.0).any(), (k, variances)


@pytest.mark.parametrize("latency", [0.1, 0.6, 5.0])
def test_a_fix_is_missed_from_its_arrival_on_however_late_that_is(latency: float) -> None:
    part = Part(mekf.COMPONENT, suite("smallsat", star_tracker__latency=latency))
    delay, last = round(100 * latency), 3000  # steps

    def is_warning_at(k: int) -> bool:
        valid = k - delay
        came = valid % 10 == 0 and 0 <= valid <= last
        part.step(k * STEP_NS, (*STILL, *((*FIX[:7], latency) if came else NO_FIX)))
        return bool(part.advice.warning)

    warned = [k for k in range(last + delay + 60) if is_warning_at(k)]
    assert warned[0] - last - delay in (50, 51)  # five slots, to rounding


def test_a_filter_in_the_dark_warns_after_five_slots() -> None:
    part = Part(mekf.COMPONENT, suite("smallsat", star_tracker__latency=0.0))
    begin = 12_345 * STEP_NS
    for k in range(52):
        part.step(begin + k * STEP_NS, (*STILL, *NO_FIX))
        late = k > 50
        text = "no fix for 0.51 s, so no estimate" if late else "no fix yet"
        assert part.advice[:3] == (text, late, False)
    for k in range(52, 92):  # of instants between two samples
        came = k % 10 == 0
        part.step(begin + k * STEP_NS, (*STILL, *((*FIX[:7], 0.005) if came else NO_FIX)))
    assert part.advice.text.endswith(", 4 fixes have the stamp of no gyro sample, so no estimate")


def test_the_filter_says_what_it_thinks_of_itself() -> None:
    values = suite("smallsat", star_tracker__latency=0.0)
    part = Part(mekf.COMPONENT, values)
    false = (0.0, 0.0, math.sin(0.1), math.cos(0.1), 0.0, 0.0, 0.0, 0.0)

    def after(*fixes: tuple[float, ...]) -> Advice:
        for fix in fixes:
            stamp = int(part.state[0]["count"]) * STEP_NS
            part.step(stamp, (*STILL, *fix))
        return part.advice

    assert after(NO_FIX)[:3] == ("no fix yet", False, False)
    assert after(FIX).text.startswith("tracking, 3σ = 30″")  # 3 · 10″, about the boresight
    assert after(*[NO_FIX] * 50).text.startswith("tracking")  # five slots
    stale = after(NO_FIX)
    assert stale.text.startswith("no fix for 0.51 s, 3σ = ")
    assert (stale.warning, stale.failed) == (True, False)
    assert after(FIX).text.startswith("tracking")
    refused = after(false)
    assert refused.text.startswith("the last fix was refused, 3σ = ")
    assert (refused.warning, refused.failed) == (True, False)
    assert (refused.numbers["fixes"], refused.numbers["fixes refused"]) == (3, 1)
    lost = after(*[NO_FIX] * 6000)  # it hardly knows the bias yet
    assert lost.text.startswith("lost: no fix used for 60 s, the last one was refused, 3σ = ")
    assert (lost.warning, lost.failed) == (True, True)
    assert after(FIX).text.startswith("tracking")
    assert part.advices == 8  # every change of mind, once
    for share, told in ((1.001, "tracking"), (0.999, "lost")):
        limit = share * math.radians(30.0 / 3600.0)
        other = Part(mekf.COMPONENT, {**values, "lost_sigma": limit})
        other.step(0, (*STILL, *FIX))
        assert other.advice.text.startswith(told)
    part.step(10**12, (*(0.0, 0.0, 0.0, -1.0), *NO_FIX))
    assert part.advice[:3] == ("lost: the gyro gives no rate", True, True)
    estimate = np.zeros(19)
    estimate[[4, 13]] = -1.0  # not known
    assert part.output("estimate") == pytest.approx(estimate, abs=0.0)
    assert part.output("gyro_bias") == part.output("gyro_bias_sigma") == (0.0, 0.0, 0.0)
    assert after(FIX).text.startswith("tracking")


@pytest.mark.parametrize("jump", [0.0, 1e-5])  # of the bias [rad/s], hidden in the fixes' noise
def test_the_filter_says_that_its_own_covariance_is_wrong(jump: float) -> None:
    _, rates, truth, valid, arrival, fixes = noisy("flagship", 45.0, 3)
    rates[2000:, 0] += jump
    part, come = Part(mekf.COMPONENT, suite("flagship")), dict(zip(arrival, valid, strict=True))
    outside, told = [], []
    for k, rate in enumerate(rates):
        fix = NO_FIX
        if k in come:
            fix = (*fixes[come[k] // 10], 0.0, 0.0, 0.0, 0.01 * (k - come[k]))
        part.step(k * STEP_NS, (*rate, 0.0, *fix))
        error = angles_between(np.array(part.output("attitude")), truth[k])
        outside.append(error > 6.0 * part.state[0]["sigma"])
        told.append("have a mean NIS of" in part.advice.text or part.advice.warning)
    assert any(outside[2500:]) == any(told[2500:]) == (jump > 0.0)
    assert sum(told[2500:]) >= 0.9 * sum(outside[2500:])
