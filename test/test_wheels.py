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

"""The drive of the wheels, and the laws with it."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bag_helpers import assert_flown
from conftest import StartProcess
from craft_helpers import FRICTIONLESS, case, configs, part_of
from estimation_helpers import STEP_NS, Array
from peer import peer
from process_helpers import PAPER, Run
from scipy.linalg import null_space
from synthetic import requirement, with_columns

from ppc_attitude.analysis.figures import column_figure
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import PAPER as PAPER_REQUIREMENTS
from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.environment_load import environment_torque, wheel_conditions
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import INJECTOR, PLANT, REFERENCE
from ppc_attitude.science import wheels
from ppc_attitude.science.component import MAX_WHEELS
from ppc_attitude.science.conditions import Condition
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kinds import ACTUATORS, ENVIRONMENTS
from ppc_attitude.simulation.closed_loop import first_instant, simulate
from ppc_attitude.simulation.scenario import Scenario, check_components, load, weakened

drive = partial(part_of, ACTUATORS, "wheels")


def test_the_drive_takes_friction_and_gyroscopic_torque_away() -> None:
    speeds, omega = wheel_speeds(100.0, -50.0, 0.03, 300.0), [0.02, -0.05, 0.03]
    command = [0.03, -0.02, 0.01]
    exact = drive()
    given = np.array(exact.step(0, [*command, *omega, *speeds]))
    assert given[:3] == pytest.approx(command, abs=1e-16)
    # Without compensation the command lacks what friction and the wheels' momentum take.
    plain = drive(wheels__friction_knowledge=0.0, wheels__gyroscopic_compensation=False)
    axes = np.reshape(wheels.AXES.default, (4, 3))
    momentum = 8e-4 * axes.T @ speeds[:4]
    lost = axes.T @ frictions(speeds) - np.cross(omega, momentum)
    given = np.array(plain.step(0, [*command, *omega, *speeds]))
    assert given[:3] - command == pytest.approx(lost, abs=1e-15)


def wheel_speeds(*speeds: float) -> Array:
    return np.array(speeds + (0.0,) * (MAX_WHEELS - len(speeds)))


def frictions(speeds: Array) -> Array:
    """Friction of each of four wheels [N·m], written once more from the specification."""
    coulomb, static, viscous, at = 5e-4, 8e-4, 3e-6, speeds[:4]
    dry = coulomb + (static - coulomb) * np.exp(-((at / 2.0) ** 2))
    return np.asarray(dry * np.tanh(at / 0.1) + viscous * at)


@pytest.mark.parametrize("overload", ["scale", "clip"])
def test_too_much_torque_is_scaled_or_clipped(overload: str) -> None:
    part = drive(wheels__overload=overload, wheels__null_gain=0.0)
    command = np.array([0.2, 0.01, -0.05])
    given = np.array(part.step(0, [*command, 0.0, 0.0, 0.0, *[0.0] * 8]))
    assert np.abs(given[3:]).max() == pytest.approx(0.05, rel=1e-12)
    turned = np.linalg.norm(np.cross(given[:3], command)) / np.linalg.norm(command) ** 2
    assert (turned < 1e-15) == (overload == "scale")


def test_a_wheel_stops_at_its_largest_speed_and_the_drive_says_so() -> None:
    part = drive(wheels__axes=np.eye(3).ravel().tolist())
    assert not part.advice.warning
    part.step(0, [0.03, 0.0, 0.0, 0.0, 0.0, 0.0, *wheel_speeds(-628.2999)])
    assert part.advice.warning
    assert "wheel 0 has reached its largest speed" in part.advice.text
    torque = part.output("applied_torque")
    assert 0.0 <= torque[0] < 1e-5
    # The other way there is all of it.
    part.step(STEP_NS, [-0.03, 0.0, 0.0, 0.0, 0.0, 0.0, *wheel_speeds(-628.2999)])
    assert part.output("applied_torque")[0] == pytest.approx(-0.03, rel=1e-12)


def test_what_is_clipped_leaves_the_other_axes_alone() -> None:
    part = drive(wheels__axes=np.eye(3).ravel().tolist(), wheels__overload="clip")
    full = wheel_speeds(-628.3)
    given = np.array(part.step(0, [0.03, 0.02, -0.01, 0.0, 0.0, 0.0, *full]))
    assert given[:3] == pytest.approx([0.0, 0.02, -0.01], abs=1e-9)


@pytest.mark.parametrize("knowledge", [1.05, 1.5, 2.0])
def test_a_drive_that_believes_in_too_much_friction_keeps_the_limits(knowledge: float) -> None:
    given: dict[str, Any] = {"wheels__friction_knowledge": knowledge, "wheels__max_torque": [0.003]}
    part, speeds = drive(wheels__axes=np.eye(3).ravel().tolist(), **given), np.zeros(8)
    speeds[0] = 620.0
    for k in range(3000):
        motors = np.array(part.step(k * STEP_NS, [-0.05] + [0.0] * 5 + [*speeds]))[3:]
        assert np.abs(motors).max() <= 0.003 * (1.0 + 1e-8)
        speeds[:4] += 0.01 / 8e-4 * (motors[:4] - frictions(speeds))
    assert 628.0 < speeds[0] < 628.3 * (1.0 + 1e-5)


@pytest.mark.parametrize("overload", ["scale", "clip"])
@pytest.mark.parametrize("seed", range(8))
def test_torques_that_cancel_take_what_is_left_of_the_limits(seed: int, overload: str) -> None:
    """Some share of −k N Nᵀ h, up to all of it: the largest with which no wheel gives too much."""
    random, axes = np.random.default_rng(seed), np.reshape(wheels.AXES.default, (4, 3))
    given = {"wheels__null_speed": 0.0, "wheels__overload": overload, **FRICTIONLESS}
    command, speeds = random.uniform(-0.04, 0.04, 3), wheel_speeds(*random.uniform(-200, 200, 4))
    row = [*command, 0.0, 0.0, 0.0, *speeds]
    shared, spread = (
        np.array(drive(wheels__null_gain=gain, **given).step(0, row))[3:7] for gain in (0.0, 1.0)
    )
    free = null_space(axes.T)
    wish = -free @ free.T @ (8e-4 * speeds[:4])
    left = np.where(wish > 0.0, 0.05 - shared, -0.05 - shared) / wish
    assert spread == pytest.approx(shared + min(1.0, left.min()) * wish, abs=1e-15)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("knowledge", [0.0, 0.5, 1.0, 1.5])
def test_a_wheel_is_driven_to_its_largest_speed_in_a_step_and_not_beyond(
    knowledge: float, sign: float
) -> None:
    """Whatever the drive takes away of the friction, all of the speed can be used, and no more."""
    axes = np.eye(3).ravel().tolist()
    part, short = drive(wheels__axes=axes, wheels__friction_knowledge=knowledge), 0.2  # [rad/s]
    speeds = wheel_speeds(sign * (628.3 - short))
    motor = part.step(0, [-sign * 0.05, 0.0, 0.0, 0.0, 0.0, 0.0, *speeds])[3]
    assert 0.01 / 8e-4 * (motor - frictions(speeds)[0]) * sign == pytest.approx(short, abs=1e-6)


def test_what_is_required_of_a_column_is_drawn() -> None:
    record = flown(duration=2.0)
    required = replace(PAPER_REQUIREMENTS, limits={"wheel_torque": 0.02})
    (axes,) = column_figure(Measured(record, required), "wheel_torque").axes
    drawn = [line.get_ydata()[0] for line in axes.get_lines() if len(line.get_ydata()) == 2]
    assert drawn == [0.02, -0.02]
    assert "required" in [line.get_label() for line in axes.get_lines()]


@pytest.mark.parametrize(
    ("axes", "inertia", "slowest"),
    [
        (wheels.AXES.default, [8e-4, 8e-4, 8e-4, 1e-4], 12.5),
        ([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] * 2, [8e-4], 100.0),
        ([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] * 2, [*[8e-4] * 3, *[4e-4] * 3], 50.0),
        ([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0], [8e-4], 0.0),
    ],
)
def test_fastest_wheel_of_any_array_goes_to_the_null_speed_and_none_stands_that_need_not(
    axes: list[float], inertia: list[float], slowest: float
) -> None:
    array = {"wheels__axes": axes, "wheels__inertia": inertia}
    part, count = drive(wheels__null_gain=1.0, **FRICTIONLESS, **array), len(axes) // 3
    speeds, spin = np.zeros(8), np.broadcast_to(inertia, count)
    for k in range(3000):
        given = np.array(part.step(k * STEP_NS, [0.0] * 6 + [*speeds]))
        assert np.abs(given[:3]).max() < 1e-15
        speeds[:count] += 0.01 / spin * given[3 : 3 + count]
    assert np.abs(speeds[:count]).max() == pytest.approx(100.0)
    assert np.abs(speeds[:count]).min() == pytest.approx(slowest, abs=1e-9)


def test_null_speed_beyond_a_wheels_largest_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="null_speed = 700 rad/s brings wheel"):
        drive(wheels__null_speed=700.0)
    drive(wheels__null_speed=700.0, wheels__axes=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])


@pytest.mark.ros
def test_nodes_with_wheels_modes_sensors_and_faults_give_the_bits_of_the_loop(
    tmp_path: Path, start_process: StartProcess
) -> None:
    """Six processes in lock-step; one wheel fails by schedule, and another one in flight."""
    schedule = [
        "wheel/1 effectiveness 0 from 0.1",
        "gyro bias 1e-4 0 0",
        "star_tracker blind from 0.5",
        "gyro dead from 1 for 0.3",
    ]
    given = {
        "real_time_factor": 0.25,  # for a busy machine changes the faults late
        "faults": schedule,
        "wheels.initial_speed": [627.0, 0.0, 0.0, 0.0],
        "wheels.detection_delay": 0.3,
    }
    overlays = [
        *configs("flexible", "wheels", "sensors_smallsat"),
        tmp_path / "failing.yaml",
    ]
    overlays[-1].write_text(yaml.safe_dump({f"/**/{PLANT}": {"ros__parameters": given}}))
    options = [f"--config={path}" for path in overlays]
    run = Run(start_process, tmp_path / "bag", "--duration", "2.5", *options)
    with peer() as stack:
        run.reaches(0.1)
        changed = [*schedule, "wheel/3 stuck 0.01"]
        assert stack.set_parameter(PLANT, "faults", changed).successful
        stack.hears(PLANT, "wheels 1, 3 lost: the others give torque in one plane only")
        assert stack.health[PLANT]["level"] == "2"
        assert "wheel/1 effectiveness 0; gyro bias 1e-4 0 0" in stack.health[PLANT]["faults"]
        assert run.ends() == 1, run.err
    assert "wheel 0 has reached its largest speed" in run.err
    record = read_run(run.bag)
    ((since, *change),) = record.changes
    assert change == [PLANT, "faults", changed]
    at_once = [*schedule, f"wheel/3 stuck 0.01 from {since / 1e9!r}"]
    craft = load([PAPER, *overlays]).with_values(PLANT, faults=at_once)
    assert_flown(record, simulate(craft, 2.5))
    assert set(Verdict(record).faults) == {
        "gyro bias 1e-4 0 0, 0 to 2.5 s",
        "wheel/1 effectiveness 0, 0.1 to 2.5 s",
        "star_tracker blind, 0.5 to 2.5 s",
        "gyro dead, 1 to 1.3 s",
        f"wheel/3 stuck 0.01, {since / 1e9:g} to 2.5 s",
    }


def flown(**plant: Any) -> RunRecord:
    craft = case("wheels", **plant)
    return simulate(craft, craft.number(PLANT, "duration"))


def test_the_papers_case_with_wheels_is_as_with_an_ideal_actuator() -> None:
    verdict = Verdict(flown())
    assert all(each.met for each in verdict.requirements)
    assert requirement(verdict, "settling_time").value == pytest.approx(48.9)
    assert 0.5 < requirement(verdict, "wheel_speed").value < 0.75


def test_what_friction_does_to_a_drive_that_does_not_know_it() -> None:
    """An independent study found 7.4 s outside ρ_ω and a terminal error of 1.7e-4."""
    verdict = Verdict(
        flown(wheels__friction_knowledge=0.0, wheels__null_speed=0.0, wheels__null_gain=0.0)
    )
    assert requirement(verdict, "outside_rate_envelope").value == pytest.approx(7.4, abs=2.0)
    assert requirement(verdict, "terminal_error").value == pytest.approx(1.7e-4, abs=0.3e-4)


def test_the_momentum_of_the_wheels_is_judged_by_the_users_limit() -> None:
    """‖Σ J_s Ω a‖, written once more; without wheels it is not judged, and that fails nothing."""
    record = flown(duration=2.0, wheels__initial_speed=[200.0, -100.0, 50.0, 0.0])
    axes = np.reshape(wheels.AXES.default, (4, 3))
    held = np.linalg.norm(8e-4 * record["wheel_speed"][:, :4] @ axes, axis=1).max()
    for limit, met in ((0.9 * held, False), (1.1 * held, True)):
        verdict = Verdict(record, replace(PAPER_REQUIREMENTS, momentum=limit))
        row = requirement(verdict, "momentum")
        assert (row.value, row.met, row.unit) == (pytest.approx(held, rel=1e-12), met, "N·m·s")
    verdict = Verdict(simulate(case(), 2.0), replace(PAPER_REQUIREMENTS, momentum=0.1))
    row = requirement(verdict, "momentum")
    assert (row.met, row.note) == (None, "no topic wheels/speed in the bag")


def test_each_wheel_that_turned_is_drawn() -> None:
    record = flown(duration=2.0)
    for column, label in (("wheel_speed", "[rad/s]"), ("wheel_torque", "[N·m]")):
        (axes,) = column_figure(Measured(record, PAPER_REQUIREMENTS), column).axes
        drawn = {line.get_label(): line.get_ydata() for line in axes.get_lines()}
        assert axes.get_ylabel().endswith(label)
        for k in range(4):
            assert np.array_equal(drawn[f"wheel {k}"], record[column][:, k])
        assert "wheel 4" not in drawn
    still = with_columns(record, wheel_speed=np.zeros((201, 8)))
    (axes,) = column_figure(Measured(still, PAPER_REQUIREMENTS), "wheel_speed").axes
    assert [line.get_label() for line in axes.get_lines()] == ["wheel 0"]


@pytest.mark.parametrize(
    ("chosen", "reason"),
    [
        ({"plant": "gyrostat"}, "gyrostat reads wheel_torque, which no selected component gives"),
        ({"actuator": "wheels"}, "wheels reads wheel_speed, which no selected component gives"),
    ],
)
def test_wheels_without_a_drive_and_a_drive_without_wheels_are_refused(
    chosen: dict[str, Any], reason: str
) -> None:
    """Also by the node alone, which would listen to a topic of its own."""
    plant = {**case().parameters[PLANT], **chosen}
    with pytest.raises(ConfigurationError, match=reason):
        check_components(PLANT, plant)


def test_a_weaker_actuator_has_smaller_limits_whatever_it_is() -> None:
    assert weakened({"actuator": "ideal", "max_torque": 0.05}, 0.5) == {"max_torque": 0.025}
    assert weakened({"actuator": "wheels", "wheels.max_torque": [0.04]}, 0.5) == {
        "wheels.max_torque": [0.02]
    }


def speed_of_a_wheel(scenario: Scenario) -> list[Condition]:
    parts = first_instant(scenario)
    return [*wheel_conditions(scenario, parts["references"], parts["environments"])]


def test_the_wheel_that_is_full_first_is_warned_of() -> None:
    record = simulate(case("wheels"), 250.0)
    shares = np.abs(record["wheel_speed"]).max(axis=1) / 628.3
    (short,) = speed_of_a_wheel(case("wheels"))
    assert short.holds
    assert short.value == pytest.approx(shares[record.t <= 120.0].max(), rel=0.05)
    (long,) = speed_of_a_wheel(case("wheels", duration=400.0))
    assert not long.holds
    full = float(long.meaning.rpartition("limit from ")[2].removesuffix(" s on"))
    assert full == pytest.approx(record.t[shares > 0.99][0], rel=0.01)
    spun = {"wheels.initial_speed": [0.0, 300.0, 0.0, 0.0]}
    (sooner,) = speed_of_a_wheel(case("wheels").with_values(PLANT, **spun))
    assert sooner.value > short.value
    endless = case("wheels", duration=0.0)
    for fine in (case(), endless):
        assert not speed_of_a_wheel(fine)
    hasty = {"wheels.null_gain": 1.0, "duration": 2e4}  # a step of the sum is of 10 s
    (idle,) = speed_of_a_wheel(case("wheels", "orbit").with_values(PLANT, **hasty))
    assert idle.value < 0.3


def test_a_slew_brings_the_wheels_to_the_speed_that_check_tells() -> None:
    """It begins where the craft is, which says about which axis it turns."""
    goal = {"mode": "goal", "goals.times": [10.0], "goals.attitudes": [0.0, 0.0, 0.6, 0.8]}
    slew = case("wheels", initial_attitude=[0.0, 0.0, 0.0, 1.0]).with_values(REFERENCE, **goal)
    (held,) = speed_of_a_wheel(slew)
    shares = np.abs(simulate(slew, 120.0)["wheel_speed"]).max() / 628.3
    assert held.value == pytest.approx(shares, rel=0.01)


def test_a_pulse_that_fills_the_wheels_is_warned_of() -> None:
    hit = {"pulse_times": [50.0], "pulse_durations": [0.1], "pulse_torques": [15.0, 0.0, 0.0]}
    hit_once = case("wheels", "orbit").with_values(INJECTOR, **hit)
    (full,) = speed_of_a_wheel(hit_once)
    assert not full.holds
    when = float(full.meaning.rpartition("limit from ")[2].removesuffix(" s on"))
    assert 50.0 < when < 65.0
    for torque in (2.0, -2.0):  # one takes off what the environment has added, one adds to it
        hit["pulse_torques"] = [torque, 0.0, 0.0]
        hit_once = case("wheels").with_values(INJECTOR, **hit)
        (held,) = speed_of_a_wheel(hit_once)
        shares = np.abs(simulate(hit_once, 120.0)["wheel_speed"]).max() / 628.3
        assert held.value == pytest.approx(shares, rel=0.01)


def test_magnetorquers_take_up_what_the_environment_adds_and_no_tumble() -> None:
    unloaded = case("wheels", "orbit", "unloading", duration=1e5)
    (fine,) = speed_of_a_wheel(unloaded)
    (lone,) = speed_of_a_wheel(unloaded.with_values(PLANT, **{"magnetorquers.law": "off"}))
    assert fine.value < 0.3 < lone.value
    fast = unloaded.with_values(PLANT, initial_angular_velocity=[0.3, 0.2, 0.0])
    (full,) = speed_of_a_wheel(fast)
    assert not full.holds
    assert full.meaning.endswith(
        "s, if the craft follows its reference and magnetorquers take up the environment's torque; "
        "a wheel exceeds the limit from 0 s on"
    )
    speeds = simulate(fast, 60.0)["wheel_speed"]
    assert np.abs(speeds).max() > 0.99 * 628.3


def test_of_an_environment_that_reads_the_state_the_first_torque_is_looked_at() -> None:
    orbit = case("orbit")
    first = simulate(orbit, 0.0)["disturbance_torque"][0]
    part = first_instant(orbit)[ENVIRONMENTS.name]
    part.component = replace(part.component, bound=None)
    found = environment_torque(orbit, part)
    assert found == pytest.approx(np.linalg.norm(first))
