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

"""What a certificate assumes of wheels, against single steps of drive and craft, and in flight."""

import math
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Ask, coarse_cells
from craft_helpers import FRICTIONLESS, configs, dotted, overlay
from estimation_helpers import STEP_NS, Array
from synthetic import with_columns, without_columns
from test_certificate_held import held_by

from ppc_attitude.analysis.guarantee import _momentum, nodes_around
from ppc_attitude.command_line.main import main
from ppc_attitude.contract.run_record import Change
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, PLANT, TRUE_RATE
from ppc_attitude.science.guarantee.assumptions import assumptions_of, law_of
from ppc_attitude.science.guarantee.nodes import actuation_of, are_full, momentum_of
from ppc_attitude.science.guarantee.surroundings import broken_assumptions, fastest_of
from ppc_attitude.science.kernel import matrix
from ppc_attitude.science.kinds import ACTUATORS, PLANTS
from ppc_attitude.science.part import Part
from ppc_attitude.science.plants.rigid_body import rigid_body_step
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load

pytestmark = pytest.mark.usefixtures("coarse")
FILES = configs("paper", "wheels", "orbit")
OPTIONS = [f"--config={path}" for path in FILES]
MOMENTUM, FASTEST = 0.15, 0.12  # [N·m·s], [rad/s]
NO_FRICTION = dotted(FRICTIONLESS)


def random_speeds(plant: dict[str, Any], omega: Array, random: np.random.Generator) -> Array:
    """Speeds of four wheels with which ‖H‖ is at most `MOMENTUM`, one of them near standstill."""
    axes = np.reshape(plant["wheels.axes"], (4, 3))
    axes = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    whole = random.normal(size=3)
    whole *= MOMENTUM * random.random() / np.linalg.norm(whole)
    h = whole - np.reshape(plant["inertia"], (3, 3)) @ omega
    speeds = np.linalg.pinv(axes.T) @ h / plant["wheels.inertia"][0]
    idle = np.linalg.svd(axes.T)[2][3]  # turns no body
    still = random.integers(4)
    return np.asarray(speeds - idle * (speeds[still] - random.normal(scale=0.5)) / idle[still])


@pytest.mark.parametrize(
    ("changed", "reached"),
    [
        ({}, 0.1),
        (NO_FRICTION, 0.05),
        ({"wheels.friction_knowledge": 0.5}, 0.1),
        ({**NO_FRICTION, "wheels.gyroscopic_compensation": False}, 0.5),
    ],
)
def test_the_body_moves_as_a_rigid_one_up_to_the_rest(
    changed: dict[str, Any], reached: float
) -> None:
    plant = {**load(FILES, {PLANT: changed}).parameters[PLANT]}
    told = actuation_of(plant, MOMENTUM, FASTEST, math.inf)
    drive = Part(ACTUATORS.components["wheels"], plant)
    craft = Part(PLANTS.components["gyrostat"], plant)
    start = craft.configuration[0]
    random, worst, h = np.random.default_rng(1), np.zeros(3), 1e-9 * STEP_NS
    body, inverse = matrix(told.inertia), matrix(np.linalg.inv(told.inertia))
    for _ in range(300):
        omega = random.normal(size=3)
        omega *= FASTEST / np.linalg.norm(omega)
        speeds = random_speeds(plant, omega, random)
        if are_full(plant, speeds[None])[0]:
            continue
        command = told.torque * random.choice([-1.0, 1.0], 3)
        external = 0.5 * told.torque * random.choice([-1.0, 1.0], 3)
        craft.forget()  # it begins anew, and is not configured anew, which takes most of the time
        start["body"]["initial_rate"], start["wheels"]["initial_speed"][:4] = omega, speeds
        q, _, wheels = np.split(np.array(craft.step(0, [0.0] * 11)), [4, 7])
        given = np.array(drive.step(0, [*command, *omega, *wheels]))
        if not changed:
            assert np.abs(given[:3] - command).max() <= 1e-15  # all of it can be had
        moved = np.array(craft.step(STEP_NS, [*given[3:], *external]))[4:7]
        torque = tuple(command + external)
        _, rigid = rigid_body_step(tuple(q), tuple(omega), torque, body, inverse, h)
        rest = np.abs(told.inertia @ (moved - np.array(rigid))) / h
        worst = np.maximum(worst, rest)
    assert reached < worst.max() / told.rest < 1.0


@pytest.mark.parametrize("slower", [0.95, 0.7])
def test_a_slower_craft_has_more_torque_and_no_more_rest(slower: float) -> None:
    plant = load(FILES, {PLANT: NO_FRICTION}).parameters[PLANT]
    told = actuation_of(plant, 0.35, FASTEST, math.inf)
    less = actuation_of(plant, 0.35, slower * FASTEST, told.torque)
    assert less.torque > told.torque
    assert less.rest < told.rest


def test_rods_are_part_of_the_rest() -> None:
    told = [
        actuation_of(load([*FILES, *more]).parameters[PLANT], MOMENTUM, FASTEST, math.inf)
        for more in ([], configs("unloading"))
    ]
    # Two rods of 10 A·m² are across the strongest field, 7e-5 T.
    assert told[1].rest - told[0].rest == pytest.approx(2**0.5 * 10.0 * 7e-5, rel=1e-12)
    assert (told[1].torque, told[1].told) == (told[0].torque, told[0].told)


CHOSEN = ("--gains", "0.8", "78.4", "1")


@pytest.fixture(scope="module")
def gains(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Numbers of the law, proved for a craft with wheels that hold the assumed momentum."""
    path = tmp_path_factory.mktemp("design") / "gains.yaml"
    with coarse_cells(), redirect_stdout(StringIO()) as told:
        assert main(["design", *OPTIONS, *CHOSEN, f"--output={path}"]) == 0
    assert "the wheels hold no more" not in told.getvalue()
    return path


def test_the_rate_at_the_start_is_told_and_not_that_at_the_end_of_the_run(
    gains: Path, ask: Ask
) -> None:
    check = ["check", *OPTIONS, f"--config={gains}", "--json", "--duration"]
    (short,), (long,) = (ask(*check, duration).json["own_start"] for duration in (80, 100))
    assert short == long
    assert short.endswith("42.71° from the reference, turning at 0.707 deg/s relative to it")


def test_a_craft_may_turn_with_its_rate_limit_however_low_omega0_is(gains: Path) -> None:
    values = load([*FILES, gains]).parameters[CONTROLLER]
    assumed, law = assumptions_of(values), law_of(values)
    low = replace(law, omega0=0.5 * assumed.Omega)
    assert fastest_of(assumed, low) == assumed.Omega < fastest_of(assumed, law)


@pytest.mark.parametrize(
    "given",
    [
        # A wide tube: the craft may be faster than the design first took it to be.
        ["--gains", "0.3", "1.8", "1", "--accuracy=0.02"],
        # Much momentum: torque falls with the rate.
        ["--gains", "0.8", "78.4", "1", "--assume=momentum=0.2"],
    ],
)
def test_a_scenario_keeps_what_its_own_design_assumed(given: list[str], tmp_path: Path) -> None:
    path = tmp_path / "gains.yaml"
    assert main(["design", *OPTIONS, *given, f"--output={path}"]) == 0
    parameters = load([*FILES, path]).parameters
    assumed, law = assumptions_of(parameters[CONTROLLER]), law_of(parameters[CONTROLLER])
    assert not [*broken_assumptions(assumed, law, nodes_around(parameters))]


def test_a_certificate_with_wheels_holds_in_flight(gains: Path) -> None:
    record = simulate(load([*FILES, gains]), 30.0)
    held = held_by(record)
    assert (held.reason, held.note, held.outside.any()) == ("", "", False)
    silent = without_columns(record, "wheel_speed")
    assert "no speed of the wheels on record" in held_by(silent).reason


def test_wheels_that_change_in_flight_are_judged_by_what_they_became(gains: Path) -> None:
    """Friction and largest speed were those of the start: less torque was left to disturb."""
    given = load([*FILES, gains])
    became = {each: given.parameters[PLANT][each] for each in NO_FRICTION}
    record = simulate(load([*FILES, gains], {PLANT: NO_FRICTION}), 2.0)
    torque = np.full((record.t.size, 3), 1e-3)  # within d beside wheels without friction
    record = with_columns(record, disturbance_torque=torque)
    assert held_by(record).note == ""
    changes = tuple(Change(10**9, PLANT, *each) for each in became.items())
    told = "suspended: a disturbance beyond the assumed one at 101 instants"
    assert held_by(replace(record, changes=changes)).note == told
    slow = (Change(10**9, PLANT, "wheels.max_speed", [1e-3]),)
    told = "suspended: a wheel at its largest speed at 101 instants"
    assert held_by(replace(record, changes=slow)).note == told


def test_the_momentum_of_a_craft_that_changes_in_flight_is_that_of_what_it_became(
    gains: Path,
) -> None:
    given = load([*FILES, gains]).parameters[PLANT]
    record = simulate(load([*FILES, gains]), 2.0)
    heavy = {**given, "inertia": [1.2 * each for each in given["inertia"]]}
    changed = replace(record, changes=(Change(10**9, PLANT, "inertia", heavy["inertia"]),))
    samples = record[TRUE_RATE.column], record["wheel_speed"]
    was, became = (momentum_of(plant, *samples) for plant in (given, heavy))
    most = float(was.max())
    found = _momentum(changed, most)["more momentum than assumed"]
    np.testing.assert_array_equal(found, (became > most) & (record.t >= 1.0))
    assert found.any()


@pytest.mark.parametrize(
    ("plant", "told"),
    [
        ({"wheels.max_torque": [0.04]}, "guaranteed torque of the wheels = 0.0"),
        ({"wheels.static": [3e-3]}, "N·m and the wheels' residual 0.0"),
        ({"wheels.inertia": [8e-3]}, "relative error of the inertia = 0.00"),
        (
            {
                "flexible.frequency": [0.35],
                "flexible.damping": [0.005],
                "flexible.coupling": [0.5, 0, 0],
            },
            "flexible.frequency = [0.35]: whether it keeps the assumed bounds is not known",
        ),
    ],
)
def test_wheels_that_are_not_as_assumed_void_the_promise(
    gains: Path, plant: dict[str, Any], told: str
) -> None:
    assert told in held_by(simulate(load([*FILES, gains], {PLANT: plant}), 1.0)).reason


def test_a_run_whose_promise_is_suspended_all_along_is_not_judged(
    gains: Path, tmp_path: Path, ask: Ask
) -> None:
    spun = {PLANT: {"wheels.initial_speed": [200.0]}}  # together 0.37 N·m·s about z
    held = held_by(simulate(load([*FILES, gains], spun), 1.0))
    assert held.reason == "suspended: more momentum than assumed at 101 instants"
    assert not held.outside.any()
    fast = overlay(tmp_path / "spun.yaml", spun)
    told = ask("check", *OPTIONS, f"--config={gains}", f"--config={fast}").page
    assert "craft and wheels is at most 0.1532 N·m·s" in told
    assert "the wheels hold no more" not in told
    assert (
        "warning: the promise holds while the momentum is at most 0.1532 N·m·s: it is 0.369" in told
    )


def test_wheels_that_cannot_hold_the_assumed_momentum_are_warned_of(
    gains: Path, tmp_path: Path, ask: Ask
) -> None:
    # J_s 110 rad/s √(8/3), less what a sample may add, of four wheels in a pyramid
    warning = "warning: in some direction the wheels hold no more than 0.1429 N·m·s"
    file = overlay(tmp_path / "slow.yaml", {PLANT: {"wheels.max_speed": [110.0]}})
    slow, known = f"--config={file}", f"--config={gains}"
    for name, rest in (
        ("check", [known, slow]),
        ("design", [slow, *CHOSEN]),  # that others are not warned of, `gains` sees
    ):
        told = ask(name, *OPTIONS, *rest).page
        assert warning in told, told
        assert "a hit or magnetorquers may add to it" in told


TENTH: dict[str, dict[str, Any]] = {
    "/**": {"inertia": [0.28, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 0.19], "max_torque": 0.005},
    PLANT: {"min_torque": 1e-5},
    INJECTOR: {"environment": "none"},
    CONTROLLER: {"controller": "momentum_tube_ahead"},
}


@pytest.mark.parametrize(
    ("option", "law"),
    [((), "momentum_tube_ahead"), (("--controller", "momentum_tube"), "momentum_tube")],
)
def test_gains_are_designed_for_a_craft_that_those_before_do_not_fit(
    option: tuple[str, ...], law: str, tmp_path: Path, ask: Ask
) -> None:
    craft, gains = overlay(tmp_path / "craft.yaml", TENTH), tmp_path / "gains.yaml"
    given = ["--config", craft, *option]
    assert "momentum_tube.brake" in ask("simulate", *given, code=2).err
    ask("design", *given, "--gains", 1, 15.4, 0.2, "--output", gains)
    assert load([craft, gains]).controller.name == law


def test_the_papers_environment_fills_the_wheels_and_is_refused(ask: Ask) -> None:
    told = "error: with a momentum of 0.6715 N·m·s at up to 0.1218 rad/s the wheels give no torque "
    assert told in ask("design", *OPTIONS[:2], code=2).err
