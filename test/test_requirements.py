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

"""What a run is judged by: the user's own requirements, over the paper's."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from craft_helpers import configs
from synthetic import (
    hit_run,
    normal_run,
    requirement,
    turned,
    with_columns,
    with_error,
    without_columns,
)

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import (
    PAPER,
    Accuracy,
    Requirements,
    load_requirements,
    names_of,
)
from ppc_attitude.contract.run_record import Change
from ppc_attitude.science.errors import ConfigurationError


def written(folder: Path, text: str, name: str = "own.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def cubesat_run():
    """A run whose rotation is off by 3 degrees until it settles at 80 s, and by 0.05 then."""
    run = normal_run()
    t = run.stamps_ns / 1e9
    half = np.deg2rad(np.where(t <= 80.0, 3.0, 0.05)) / 2.0
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    rows = np.column_stack([np.sin(half)[:, None] * axis, np.cos(half)])
    return with_columns(with_error(run, rows), attitude_envelope=np.ones((t.size, 3)))


CUBESAT = "settled: 0.1 deg\nsettling_deadline: 90\nterminal: 0.06 deg\nrate: 5\n"


def test_the_shipped_file_is_the_paper() -> None:
    assert load_requirements(configs("requirements")) == PAPER == load_requirements([])
    assert set(names_of(PAPER)) >= {"settling_time", "rate", "knowledge"}


def test_a_cubesat_meets_its_own_requirements_and_not_the_papers(tmp_path: Path) -> None:
    own = load_requirements([written(tmp_path, CUBESAT)])
    verdict = Verdict(cubesat_run(), own)
    assert verdict.all_met
    row = requirement(verdict, "error_after_deadline")
    assert row.value == pytest.approx(0.05, rel=1e-9)
    assert (row.limit, row.unit, row.span) == (0.1, "deg", (90.0, 120.0))
    assert requirement(verdict, "settling_time").value == 80.0
    assert verdict.to_json()["required"]["settled"] == "0.1 deg"
    assert not Verdict(cubesat_run()).all_met


def test_later_files_win_and_keep_what_they_do_not_name(tmp_path: Path) -> None:
    first = written(tmp_path, CUBESAT + "limits: {wheel_torque: 0.02}\n")
    second = written(
        tmp_path, "rate: null\nterminal: 5e-4\nlimits: {torque_command: 1}\n", "second.yaml"
    )
    own = load_requirements([first, second])
    assert own == Requirements(
        settled=Accuracy(0.1, "deg"),
        settling_deadline=90.0,
        terminal=Accuracy(5e-4),
        rate=None,
        limits={"wheel_torque": 0.02, "torque_command": 1.0},
    )
    assert "rate" not in [each.key for each in Verdict(cubesat_run(), own).requirements]


def test_a_limit_on_any_column_and_on_the_torque(tmp_path: Path) -> None:
    own = load_requirements([written(tmp_path, "limits: {wheel_torque: 0.02}\ntorque: 0.01\n")])
    verdict = Verdict(normal_run(), own)
    assert requirement(verdict, "applied_torque").met is False
    row = requirement(verdict, "limit_wheel_torque")
    assert (row.met, row.reason) == (None, "no topic wheels/torque in the bag")
    wheels = np.full((12001, 3), -0.03)
    row = requirement(Verdict(with_columns(normal_run(), wheel_torque=wheels), own), row.key)
    assert (row.met, row.value) == (False, 0.03)


def test_a_limit_on_a_quaternion_is_one_on_its_vector(tmp_path: Path) -> None:
    own = load_requirements([written(tmp_path, "limits: {attitude_error: 0.5}")])
    turned = np.tile([0.1, -0.4, 0.0, np.sqrt(0.83)], (12001, 1))
    verdict = Verdict(with_columns(normal_run(), attitude_error=turned), own)
    row = requirement(verdict, "limit_attitude_error")
    assert (row.met, row.value, row.limit_text) == (True, 0.4, "≤ 0.5")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("setled: 1", "no requirement setled; did you mean settled"),
        ("settled: -1", "settled = -1; allowed: a number > 0, ≤ 1, or an angle such as"),
        ("settled: 200 deg", "settled = '200'; allowed: a number > 0, ≤ 180 deg"),
        ("torque: ideal", "torque = 'ideal'; allowed: a number > 0 or 'actuator'; null"),
        ("settled: fast", "settled = 'fast'"),
        ("settled: null", "settled = None"),
        ("rate: true", "rate = True; allowed: a number > 0; null for no such requirement"),
        ("rate: .nan", "rate = nan"),
        ("recovery: []", r"recovery = \[\]"),
        ("terminal_window: 1.0e+300", r"allowed: a number > 0, ≤ 1e\+08 s"),
        ("limits: 3", "limits = 3; allowed: a mapping"),
        ("limits: {wheel_torque: no}", "limits: wheel_torque = False"),
        ("limits: {attitude_eror: 0.1}", "no column attitude_eror; did you mean attitude_error"),
        ("limits: {foo: 1.0}", "there is no column foo; allowed: attitude, "),
        ("[1, 2]", "must be `name: value` lines"),
        ("a: [", "cannot be read as YAML"),
        (f"rate: {900 * '9'}", "number of 900 characters, allowed are 250"),
    ],
)
def test_bad_files_are_refused_by_name_and_value(tmp_path: Path, text: str, told: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ConfigurationError, match=told) as caught:
        load_requirements([path])
    assert str(path) in str(caught.value)


def told_with_noise(noise=1e-4, said=1e-4):
    """A good run whose controller is told the truth with noise [rad], as the plant says or not."""
    run = normal_run()
    random = np.random.default_rng(1)
    turns = np.column_stack([0.5 * noise * random.normal(size=(12001, 3)), np.ones(12001)])
    told = turned(run["attitude"], turns)
    reported = turned(run["reference_attitude"] * [-1.0, -1.0, -1.0, 1.0], told)
    run = with_columns(
        run,
        truth_attitude=run["attitude"],
        truth_angular_velocity=run["angular_velocity"],
        attitude=told,
        attitude_error=reported,
        angular_velocity=run["angular_velocity"] + 1.0,
    )
    run.parameters["spacecraft_plant"].update(attitude_noise=said)
    return run


def test_the_truth_is_judged_and_three_errors_are_kept_apart() -> None:
    verdict = Verdict(told_with_noise())
    exact = Verdict(normal_run())
    assert verdict.truth.standing == "recorded"
    for name in ("terminal_error", "settling_time_s", "max_rate_deg_s"):
        assert getattr(verdict.metrics, name) == getattr(exact.metrics, name)
    assert verdict.all_met
    pointing, control, knowledge = verdict.errors
    assert pointing == exact.errors[0]
    # Three axes of 1e-4 rad each: the RMS of the angle is √3 times as much.
    assert knowledge.rms_deg == pytest.approx(np.rad2deg(np.sqrt(3.0) * 1e-4), rel=0.02)
    assert control.max_deg > pointing.max_deg


def test_who_is_told_the_truth_makes_no_knowledge_error() -> None:
    """Where sensing is exact and the truth is on record too, no rounding is an error."""
    run = normal_run()
    run = with_columns(run, truth_attitude=run["attitude"])
    assert Verdict(run).errors[-1].name == "knowledge"
    assert Verdict(run).errors[-1].max_deg == 0.0


def test_zeros_on_both_sides_are_no_perfect_knowledge() -> None:
    run = told_with_noise()
    for column in ("truth_attitude", "attitude"):
        run[column][-1000:] = 0.0
    (*_, knowledge) = Verdict(run).errors
    assert knowledge.rms_deg == pytest.approx(np.rad2deg(np.sqrt(3.0) * 1e-4), rel=0.02)


def test_a_told_attitude_that_the_noise_does_not_explain_fails() -> None:
    row = requirement(Verdict(told_with_noise(1e-4, 1e-5)), "knowledge")
    assert (row.met, row.unit) == (False, "deg")
    assert row.limit == pytest.approx(np.rad2deg(8e-5), rel=1e-12)


def test_noise_that_was_changed_in_flight_explains_no_one_knowledge_error(tmp_path: Path) -> None:
    louder = Change(60 * 10**9, "spacecraft_plant", "attitude_noise", 1e-4)
    run = replace(told_with_noise(1e-4, 1e-5), changes=(louder,))
    row = requirement(Verdict(run), "knowledge")
    assert (row.met, row.reason) == (None, "attitude_noise was changed in flight")
    own = load_requirements([written(tmp_path, "knowledge: 0.1 deg\n")])
    assert requirement(Verdict(run, own), row.key).met


def test_torque_that_alternates_is_judged_by_its_amplitude_once_settled() -> None:
    """±a has the amplitude a, and a sine A sin 2πft the RMS A sin²(πfh)/√2 of its curvature."""
    run, required = hit_run(hits=(80.0,)), Requirements(chatter=5e-4)
    assert "chatter" not in {row.key for row in Verdict(run).requirements}
    sign, torque = np.where(np.arange(run.t.size) % 2, -1.0, 1.0), np.zeros((run.t.size, 3))
    torque[:, 0] = 0.02 * np.sin(2.0 * np.pi * 5.0 * run.t)
    early, recovering = run.t < 60.0, (run.t >= 80.0) & (run.t <= 90.0)
    torque[:, 1] = 0.05 * sign * (early | recovering)
    torque[:, 2] = 0.03
    row = requirement(Verdict(with_columns(run, applied_torque=torque), required), "chatter")
    sine = 0.02 * np.sin(np.pi * 5.0 * 0.01) ** 2 / np.sqrt(2.0)
    assert row.value == pytest.approx(sine, rel=1e-3)
    assert (row.met, row.unit, row.span, row.without) == (
        True,
        "N·m",
        (60.0, 120.0),
        ((80.0, 90.0),),
    )
    torque[:, 1] += 1e-3 * sign
    row = requirement(Verdict(with_columns(run, applied_torque=torque), required), "chatter")
    assert (row.value, row.met) == (pytest.approx(1e-3, rel=1e-9), False)
    row = requirement(Verdict(without_columns(run, "applied_torque"), required), "chatter")
    assert (row.met, row.reason) == (None, "no topic applied_torque in the bag")


def test_required_knowledge(tmp_path: Path) -> None:
    own = load_requirements([written(tmp_path, "knowledge: 0.01 deg\n")])
    assert requirement(Verdict(told_with_noise(), own), "knowledge").met is False
    assert requirement(Verdict(normal_run(), own), "knowledge").value == 0.0  # sensing is exact
    verdict = Verdict(replace(normal_run(), parameters={}), own)
    assert verdict.truth.standing == "unknown"
    row = requirement(verdict, "knowledge")
    assert (row.met, row.reason) == (None, "no topic truth/attitude in the bag")
