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

"""The command `check`: what a wish needs at best, what is out of proportion, and 80 columns."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Ask
from craft_helpers import case, conditions, configs, overlay

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import PAPER, Accuracy, Requirements
from ppc_attitude.command_line.commands import check
from ppc_attitude.command_line.environment_load import environment_torque
from ppc_attitude.contract.topics import CONTROLLER, ESTIMATOR, INJECTOR, PLANT, REFERENCE
from ppc_attitude.science.conditions import advisable
from ppc_attitude.science.environments.paper import ENVIRONMENT_BOUND
from ppc_attitude.science.estimators.steady_state import FLOOR
from ppc_attitude.science.kinds import ENVIRONMENTS, REFERENCES
from ppc_attitude.science.references import paper
from ppc_attitude.simulation.closed_loop import first_instant, simulate
from ppc_attitude.simulation.scenario import Scenario, load

INERTIA = [0.18, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.12]
CUBESAT: dict[str, dict[str, Any]] = {
    PLANT: {"inertia": INERTIA, "max_torque": 0.002, "min_torque": 1e-6, "duration": 120.0},
    CONTROLLER: {"inertia": INERTIA, "max_torque": 0.002, "D_m": 1e-4},
    INJECTOR: {"environment": False},
}
THIRD = (0.5, 0.5, 0.5, 0.5)  # 120° about x = y = z
TENTH = Requirements(settled=Accuracy(0.1, "deg"), settling_deadline=90.0, rate=5.0)


def warned(scenario: Scenario) -> set[str]:
    """Conditions that are violated, beside those that only promise; none of them is necessary."""
    violated = {each for each in conditions(scenario, TENTH).values() if not each.holds}
    assert not any(each.necessary for each in violated)
    return {each.name for each in violated if not each.sufficient}


def told_by_check(ask: Ask, *files: Path, code: int = 0) -> dict[str, dict[str, Any]]:
    told = ask("check", *(f"--config={file}" for file in files), "--json", code=code)
    return {each["name"]: each for each in told.json["conditions"]}


@pytest.mark.parametrize(
    "wrong",
    [{"value": None}, {"limit": "much"}, {"value": np.ones(2)}, {"unit": None}, {"relation": "<="}],
)
def test_a_condition_that_nobody_could_tell_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"name='mine', .*; allowed: numbers, >, ≥, ≤ between"):
        replace(advisable("mine", 1.0, 2.0, "", "it holds"), **wrong)


def test_json_has_no_number_that_is_infinite(ask: Ask, monkeypatch: pytest.MonkeyPatch) -> None:
    endless = advisable("mine", np.float32(0.5), math.inf, "", "it holds")  # type: ignore[arg-type]
    endless = replace(endless, necessary=np.True_)  # type: ignore[arg-type]
    monkeypatch.setattr(check, "conditions_of", lambda *_: [endless])
    told = told_by_check(ask, *configs("paper"))["mine"]
    assert (told["value"], told["limit"], told["holds"]) == (0.5, None, True)


@pytest.fixture
def cubesat() -> Scenario:
    return load([], CUBESAT)


def test_a_wish_is_told_what_it_needs_at_best_and_what_that_leaves(cubesat: Scenario) -> None:
    found = conditions(cubesat, TENTH, THIRD)
    # Up to 5°/s and down again with what 2 mN·m give on the slowest axis, 119.9° in all.
    rate, acceleration = math.radians(5.0), 0.002 / (0.2 / math.sqrt(3.0))
    # At the end it may turn on, from the one side of what is asked to the other.
    turns_on = math.sqrt(2.0 * math.radians(0.2) / acceleration)
    needs = math.radians(120.1) / rate + rate / acceleration - turns_on
    assert found["time to turn"].value == pytest.approx(needs)
    assert found["time to turn"].meaning == (
        "an error of 0.1 deg from rest at 120° needs 28.4 s or more about its eigenaxis, "
        "with at most 0.002 N·m an axis and within 5 deg/s; the requirement is 90 s, which leaves "
        "61.6 s"
    )
    assert found["time of the law"].holds
    hasty = conditions(cubesat, replace(TENTH, settling_deadline=60.0), THIRD)["time of the law"]
    assert (hasty.holds, hasty.necessary) == (False, False)
    assert "the requirement is 60 s, which is 25.4 s too few" in hasty.meaning
    weak = cubesat.with_values(CONTROLLER, k=1e-6)
    never = conditions(weak, TENTH, THIRD)["time of the law"]
    assert not never.holds
    assert "is not reached within an hour at the rates of k" in never.meaning


def test_the_rate_bound_is_that_of_the_reference_for_an_hour_if_a_run_has_no_end(
    cubesat: Scenario,
) -> None:
    desired = np.linalg.norm(simulate(cubesat, 120.0)["reference_angular_velocity"], axis=1).max()
    bound = math.sqrt(3.0) * 3.0 * 0.017
    most = math.degrees(bound + math.sqrt(3.0) * 3e-5 + desired)
    assert conditions(cubesat, TENTH)["rate bound"].value == pytest.approx(most, rel=2e-4)
    slew = conditions(cubesat.with_values(REFERENCE, mode="goal"), TENTH)["slew rate"].value
    assert slew == pytest.approx(2.0 + math.degrees(bound) * 5e-3)  # of an error in ρ_q's end
    runs = (cubesat.with_values(PLANT, duration=each) for each in (0.0, 3600.0))
    endless, hour = (conditions(each, TENTH)["rate bound"].value for each in runs)
    assert endless == hour


def test_no_run_settles_sooner_than_the_law_can_and_a_good_one_hardly_later() -> None:
    paper = case()
    record = simulate(paper, 60.0)
    error = tuple(record["attitude_error"][0])
    least = conditions(paper, PAPER, error)["time of the law"].value
    settled = record.t[abs(record["attitude_error"][:, :3]).max(axis=1) >= 5e-3][-1]
    assert 0.9 * settled < least <= settled


def test_who_has_settled_is_asked_for_nothing(cubesat: Scenario) -> None:
    for size, asked in ((5e-4, False), (8e-4, True)):
        found = conditions(cubesat, TENTH, (size, size, 0.0, 1.0))
        assert ("time to turn" in found) == ("time of the law" in found) == asked


@pytest.mark.parametrize(("environment", "low", "high"), [(False, 0.0, 0.0), (True, 0.999, 1.0)])
def test_the_configured_environment_is_looked_at(
    environment: bool, low: float, high: float
) -> None:
    case = load([], {INJECTOR: {"environment": environment}, PLANT: {"duration": 640.0}})
    part = first_instant(case)[ENVIRONMENTS.name]
    for bound in (part.component.bound, None):
        part.component = replace(part.component, bound=bound)
        found = environment_torque(case, part)
        assert low * ENVIRONMENT_BOUND <= found <= high * ENVIRONMENT_BOUND
        assert bound is None or found == high * ENVIRONMENT_BOUND


def test_an_actuator_is_measured_by_the_environment_that_there_is(tmp_path: Path, ask: Ask) -> None:
    craft = overlay(tmp_path / "weak.yaml", {PLANT: {"max_torque": 0.002}})
    calm = overlay(tmp_path / "calm.yaml", {INJECTOR: {"environment": False}})
    found = told_by_check(ask, craft)["torque authority"]
    assert found["value"] == 0.002  # whatever the law believes of the actuator
    # The largest torque of all times and attitudes may be none that this run meets.
    assert not found["holds"]
    assert not found["necessary"]
    assert told_by_check(ask, craft, calm)["torque authority"]["limit"] == 0.0


def test_a_dead_zone_out_of_proportion_is_warned_of(cubesat: Scenario) -> None:
    assert not warned(cubesat)
    coarse = cubesat.with_values(PLANT, min_torque=1e-4)  # the paper's, of an actuator 25 × weaker
    assert warned(coarse) == {"min_torque in ρ_ω"}
    coarser = cubesat.with_values(PLANT, min_torque=1e-3)
    assert warned(coarser) == {"min_torque", "min_torque in ρ_ω"}


def test_a_disturbance_beyond_the_torque_is_warned_of(cubesat: Scenario) -> None:
    """The loop of the paper's law then swings, whatever its other gains."""
    assert "D_m" in warned(cubesat.with_values(CONTROLLER, D_m=4.57e-3))


def test_wheels_that_give_less_than_the_law_may_ask_for_are_warned_of() -> None:
    enough = load(configs("wheels"))
    assert not warned(enough)
    found = conditions(enough)["max_torque"]
    assert found.limit == pytest.approx(0.05 * 2.0 / math.sqrt(3.0), rel=1e-12)
    weak = enough.with_values(PLANT, **{"wheels.max_torque": [0.04]})
    assert warned(weak) == {"max_torque"}
    assert not any(name.startswith("min_torque") for name in conditions(weak))


def test_a_wheel_whose_loss_leaves_a_plane_is_warned_of(ask: Ask, tmp_path: Path) -> None:
    given = configs("paper", "wheels", "faults")
    three = told_by_check(ask, *given)["torque with faults"]
    assert three["holds"]
    assert three["value"] == pytest.approx(0.05 / math.sqrt(3.0))
    text = "/**/spacecraft_plant: {ros__parameters: {faults: [wheel/0 seized from 5 for 9, "
    text += "wheel/1 stuck 0 from 7, wheel/2 drag 2]}}"
    (tmp_path / "two.yaml").write_text(text, encoding="utf-8")
    for more in ((), configs("allocator")):
        plane = told_by_check(ask, *given, tmp_path / "two.yaml", *more)["torque with faults"]
        assert not plane["holds"]
        assert plane["value"] == 0.0
    assert "torque with faults" not in told_by_check(ask, *given[:2])


def test_a_rate_envelope_that_single_pulses_leave_is_warned_of() -> None:
    wide = load(configs("thrusters"))
    assert not warned(wide)
    found = conditions(wide)["least pulse in ρ_ω"]
    assert found.limit == pytest.approx(3.0 * 0.01 * 0.028190778623577255 / 1.9, rel=1e-12)
    narrow = wide.with_values(CONTROLLER, **{"rate_envelope.terminal": 3e-5})
    assert warned(narrow) == {"least pulse in ρ_ω"}
    assert not set(conditions(case())) & {found.name}
    assert "least pulse in ρ_q" not in conditions(wide)
    bending = conditions(case("flexible", "thrusters"))[found.name]
    assert bending.limit == pytest.approx(found.limit / (1.0 - 0.75**2 / 2.8), rel=1e-12)
    oblique = {"flexible.frequency": [0.5], "flexible.damping": [0.01]}
    oblique |= {"flexible.coupling": [0.6, 0.5, 0.0]}  # 1/(1 − δᵀ J⁻¹ δ)
    bending = conditions(case("flexible", "thrusters").with_values(PLANT, **oblique))[found.name]
    assert bending.limit == pytest.approx(found.limit / (1.0 - 0.36 / 2.8 - 0.25 / 2.5), rel=1e-12)
    mixed = wide.with_values(PLANT, **{"thrusters.force": [0.1, *[1.0] * 7]})  # the coarsest counts
    assert conditions(mixed)[found.name].limit == pytest.approx(10.0 * found.limit, rel=1e-12)
    slender = wide.with_values(CONTROLLER, inertia=[2.8, 0.0, 0.0, 0.0, 2.8, 0.0, 0.0, 0.0, 0.05])
    places = (slender.parameters[PLANT][f"thrusters.{x}"] for x in ("positions", "directions"))
    turns = 0.1 * np.cross(*(np.reshape(each, (-1, 3)) for each in places))
    change = 0.01 * np.abs(turns / [2.8, 2.8, 0.05]).max()
    assert conditions(slender)[found.name].limit == pytest.approx(3.0 * change, rel=1e-12)


def test_noise_out_of_proportion_is_warned_of(cubesat: Scenario) -> None:
    assert not {"attitude_envelope.terminal", "noise torque"} & set(conditions(cubesat))
    noisy = cubesat.with_values(PLANT, rate_noise=1e-5)
    assert warned(noisy) == {"rate_envelope.terminal"}
    least = conditions(noisy)["rate_envelope.terminal"].limit
    assert least == pytest.approx(FLOOR * 1e-5)  # without a filter it is the noise of the sensor
    asked = conditions(noisy)["noise torque"].value
    assert asked == pytest.approx(3.0 * 2.3 * 0.2 * 1e-5)  # 3σ of K_ω J z2, of the largest moment
    blurred = cubesat.with_values(PLANT, attitude_noise=2e-3)
    blurred = blurred.with_values(CONTROLLER, controller="log_barrier")  # which has no z2
    least = conditions(blurred)["attitude_envelope.terminal"].limit
    assert least == pytest.approx(FLOOR * 1e-3)
    noisier = cubesat.with_values(PLANT, rate_noise=2e-3, attitude_noise=2e-3)
    everything = {"attitude_envelope.terminal", "rate_envelope.terminal", "noise torque"}
    assert warned(noisier) == everything


@pytest.mark.parametrize(
    ("law", "warned_of"),
    [("quaternion_feedback", set()), ("log_barrier", {"attitude_envelope.terminal"})],
)
def test_noise_is_compared_with_the_envelopes_that_the_law_has(
    law: str, warned_of: set[str], cubesat: Scenario
) -> None:
    noisy = cubesat.with_values(PLANT, rate_noise=2e-3, attitude_noise=2e-3)
    assert warned(noisy.with_values(CONTROLLER, controller=law)) == warned_of


def test_a_reference_without_known_bounds_is_compared_with_nothing(
    cubesat: Scenario, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = cubesat.with_values(CONTROLLER, controller="log_barrier")
    assert "rate of the law" in conditions(scenario)
    unbounded = replace(paper.COMPONENT, motion_bounds=None)
    monkeypatch.setitem(REFERENCES.components, "paper", unbounded)
    assert "rate of the law" not in conditions(scenario)


def test_a_pulse_out_of_proportion_is_warned_of(cubesat: Scenario) -> None:
    hit = cubesat.with_values(
        INJECTOR,
        pulse_times=[20.0, 40.0],
        pulse_durations=[0.1, 0.1],
        pulse_torques=[0.1, 0.0, 0.0, 0.0, -0.3, 0.0],
    )
    names = ["pulse at 20 s", "pulse at 40 s"]
    assert [conditions(hit)[name].value for name in names] == pytest.approx([5.0, 15.0])
    assert warned(hit) == {"pulse at 40 s"}
    derated = hit.with_values(CONTROLLER, max_torque=1e-3)  # the law asks for half of the actuator
    assert [conditions(derated)[name].value for name in names] == pytest.approx([10.0, 30.0])
    # It acts from the first state in it to the first after it, at 100 Hz.
    for start, duration, steps in ((20.0, 1e-3, 1), (20.0095, 1e-3, 1), (20.001, 0.05, 5)):
        given = {"pulse_times": [start, 40.0], "pulse_durations": [duration, 0.1]}
        felt = conditions(hit.with_values(INJECTOR, **given))[f"pulse at {start:g} s"].value
        assert felt == pytest.approx(0.1 * 0.01 * steps / 0.002)


def test_a_law_of_another_craft_and_rates_that_no_tracker_follows_are_warned_of(
    cubesat: Scenario,
) -> None:
    assert not warned(cubesat)
    forgotten = cubesat.with_values(CONTROLLER, inertia=[2.8, 0, 0, 0, 2.5, 0, 0, 0, 1.9])
    assert warned(forgotten) == {"inertia"}
    double = cubesat.with_values(CONTROLLER, inertia=[0.36, 0, 0, 0, 0.4, 0, 0, 0, 0.24])
    assert conditions(double)["inertia"].value == pytest.approx(0.5)  # of what the law believes
    values = {"star_tracker.max_rate": 0.03, "initial_angular_velocity": [0.02, 0.02, 0.02]}
    fast = case("sensors_smallsat").with_values(PLANT, **values)
    assert warned(fast) == {"rate at the start"}
    slews = fast.with_values(REFERENCE, mode="goal")
    assert warned(slews) == {"rate at the start", "rate of the reference"}
    slow = slews.with_values(PLANT, **{"star_tracker.max_rate": 0.04})
    assert not warned(slow)


def test_a_filter_that_takes_its_sensors_for_others_is_warned_of() -> None:
    good = case("sensors_smallsat", "sensors_uncalibrated")  # it believes in more than there is
    assert warned(good) == {"rate_envelope.terminal"}
    wrong = {"star_tracker.mounting": [0.0, 0.7071, 0.0, 0.7071], "gyro.rate_random_walk": 0.0}
    found = conditions(good.with_values(ESTIMATOR, **wrong))
    assert found["star_tracker.mounting"].value == pytest.approx(math.pi / 2.0)
    assert found["gyro.rate_random_walk"].value == math.inf
    for name in wrong:
        assert not found[name].holds
    told = "mounting = [0, 0, 0, 1] of the sensors, [0, 0.7071, 0, 0.7071] of the filter"
    assert told in found["star_tracker.mounting"].meaning


@pytest.mark.parametrize(("scale", "follows"), [(1e-3, True), (1e-2, False)])
def test_errors_of_a_gyro_that_the_filter_cannot_follow_are_warned_of(
    scale: float, follows: bool
) -> None:
    """And then the fixes are off their predictions by more than the filter says."""
    craft = case("sensors_smallsat", "mission", **{"gyro.scale_factor": [scale] * 3})
    assert conditions(craft)["gyro scale and axes"].holds == follows
    rows = {each.key: each for each in Verdict(simulate(craft, 150.0)).requirements}
    assert rows["nis"].met == follows
    told_more = {"gyro.rate_random_walk": 1e-3}
    assert conditions(craft.with_values(ESTIMATOR, **told_more))["gyro scale and axes"].holds
    assert "gyro scale and axes" not in conditions(case("sensors_smallsat"))


@pytest.mark.parametrize(("asked", "limits"), [("1.5", {1.5}), ("null", set())])
def test_rates_are_compared_with_the_required_one(
    asked: str, limits: set[float], tmp_path: Path, ask: Ask
) -> None:
    """The law's rate bound and the rate of slews; without a required rate there is no condition."""
    config = overlay(tmp_path / "goal.yaml", {REFERENCE: {"mode": "goal"}})
    required = tmp_path / "required.yaml"
    required.write_text(f"rate: {asked}\n")
    told = ask("check", "--config", config, "--requirements", required, "--json").json
    compared = [each for each in told["conditions"] if each["name"] in ("rate bound", "slew rate")]
    assert {each["limit"] for each in compared} == limits
    assert len(compared) == 2 * len(limits)


@pytest.mark.parametrize("name", ["sensors_smallsat", "guaranteed"])
def test_the_page_fits_a_terminal_and_holds_no_rounding_of_zero(name: str, ask: Ask) -> None:
    page = ask("check", *(f"--config={file}" for file in configs("paper", name))).out
    assert max(map(len, page.splitlines())) <= 80
    assert "e-3" not in page.replace("1e-3", "")  # such as 4.94e-324


def test_a_goal_that_will_be_refused_is_no_good_configuration(tmp_path: Path, ask: Ask) -> None:
    """The run will miss the requirement that every order is followed."""
    goals = {"times": [1.0, 5.0], "attitudes": 2 * [0, 0, 0, 1], "frames": ["inertial", "spin"]}
    reference = {"mode": "goal", "goals": goals, "spin.rate": 0.05}
    file = overlay(tmp_path / "goals.yaml", {REFERENCE: reference})
    assert "refused goals  1 ≤ 0  VIOLATED" in ask("check", "--config", file, code=1).out


def test_a_run_that_ends_before_its_last_goal_is_reached_is_warned_of(
    tmp_path: Path, ask: Ask
) -> None:
    goals = {"times": [1.0, 20.0], "attitudes": [0, 0, 0, 1, 1, 0, 0, 0]}
    file = overlay(tmp_path / "goals.yaml", {REFERENCE: {"mode": "goal", "goals": goals}})
    for duration, enough in ((110.0, False), (120.0, True)):
        run = overlay(tmp_path / f"{duration}.yaml", {PLANT: {"duration": duration}})
        reached = told_by_check(ask, *configs("paper"), file, run)["last arrival"]
        assert reached["value"] == pytest.approx(119.4, abs=0.1)
        assert reached["holds"] == enough
        assert reached["meaning"].endswith("if the attitude is known from the start on")


def test_a_start_without_a_fix_is_checked_by_the_truth(tmp_path: Path, ask: Ask) -> None:
    late = overlay(tmp_path / "late.yaml", {"/**": {"initial_fix": False}})
    files = [*configs("paper", "sensors_smallsat"), late]
    page = ask("check", *(f"--config={file}" for file in files)).out
    assert "attitude error x y z w: -0.22952, 0.25933, -0.11266, -0.93133" in page
    assert "attitude error 42.71°" in page


def test_what_a_file_sets_and_nothing_selected_has_is_told(tmp_path: Path, ask: Ask) -> None:
    given = {"wheels.max_speed": [400.0], "max_torque": 0.04, "wheels.null_gain": 0.02}
    file = overlay(tmp_path / "idle.yaml", {PLANT: given})  # of the last the default
    page = ask("check", "--config", file).out
    assert "warning: no selected component has wheels.max_speed, so a file sets it" in page
    files = [*configs("paper", "wheels"), file]
    told = ask("check", *(f"--config={each}" for each in files), "--json").json
    assert told["idle_parameters"] == ["spacecraft_plant.max_torque"]  # the law's is in use
