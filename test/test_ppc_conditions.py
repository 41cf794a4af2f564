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

"""The conditions of the law `ppc` against the numbers that the paper's tables give by hand."""

import math
from pathlib import Path

import numpy as np
import pytest
from conftest import Ask
from craft_helpers import CONFIG, overlay
from scipy.spatial.transform import Rotation

from ppc_attitude.contract.topics import CONTROLLER, REFERENCE
from ppc_attitude.science.conditions import Condition, Task
from ppc_attitude.science.controllers import ppc
from ppc_attitude.science.controllers.common import ATTITUDE_TABLE, RATE_TABLE
from ppc_attitude.science.controllers.ppc_conditions import (
    largest_start,
    steepest_fall,
    virtual_control_bound,
)
from ppc_attitude.science.performance import EnvelopeTable, nominal, solve_envelope
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import scenario

TASK = Task(
    craft={},
    error=(0.364, 0.0, 0.0, -0.93133),
    duration=120.0,
    desired_rate=math.radians(0.5) * math.sqrt(3),
    slews_from=None,
    actuator_torque=0.05,
    torque=0.05,
    environment=0.0,
    attitude_sigma=0.0,
    rate_sigma=0.0,
    rate_limit=3.0,
    settled=(5e-3, 1.0),
    deadline=60.0,
    wish="it",
)


def by_name(values: dict[str, object]) -> dict[str, Condition]:
    return {each.name: each for each in ppc.COMPONENT.conditions(values, TASK)}


@pytest.fixture
def values() -> dict[str, object]:
    return dict(scenario({}).parameters[CONTROLLER])


@pytest.mark.parametrize(
    "table",
    [
        ATTITUDE_TABLE,
        RATE_TABLE,
        EnvelopeTable(1.0, 1e-4, 0.2, 20.0, 1e-2),
        EnvelopeTable(0.7, 5e-3, 0.12, 60.0, 5e-3),
        EnvelopeTable(1.0, 5e-3, 1.0, 800.0, 5e-3),  # whose parabola is flat
    ],
)
def test_the_steepest_fall_is_the_largest_of_a_fine_grid(table: EnvelopeTable) -> None:
    shape = solve_envelope("table", table)
    grid = np.linspace(0.0, table.settling_time, 20_001)
    falls = [-rate / rho for rho, rate in (nominal(t, shape) for t in grid)]
    assert steepest_fall(shape) == pytest.approx(max(falls), rel=1e-6)


@pytest.mark.parametrize(
    ("name", "fall", "digits"), [("S1", 0.213, 2e-3), ("S1 of the paper", 0.05, 1e-9)]
)
def test_the_papers_numbers_violate_s1_and_that_is_said_not_to_be_necessary(
    values: dict[str, object], name: str, fall: float, digits: float
) -> None:
    """By the steepest fall of the envelope, which the audited page states, and by the paper's."""
    s1 = by_name(values)[name]
    assert s1.value == pytest.approx(0.93133 * 0.017 - 4.0 * fall, abs=digits)
    assert not s1.holds
    assert (s1.necessary, s1.sufficient) == (False, True)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("S2", {"K_omega": 1.0, "K_u": 0.1}),
        ("S3", {"K_a": 0.5}),
        ("S4", {"C_q": 0.004, "C_tau": 0.01}),
        ("S5", {"K_b": 0.9}),
    ],
)
def test_a_necessary_condition_fails_where_it_should(
    values: dict[str, object], name: str, changes: dict[str, float]
) -> None:
    condition = by_name({**values, **changes})[name]
    assert condition.necessary
    assert not condition.holds


@pytest.mark.parametrize(("C_omega", "s4"), [(0.6, 1.1), (0.9, 1.5)])  # the lesser of two
def test_the_conditions_of_the_proof_have_the_published_values(
    values: dict[str, object], C_omega: float, s4: float
) -> None:
    gains = {"K_omega": 5.0, "K_u": 0.5, "K_a": 4.0, "k2": 0.4, "K_b": 3.0}
    gains |= {"C_q": 1.0, "C_tau": 0.5, "C_omega": C_omega, "B_tau": 0.1}
    found = by_name({**values, **gains})
    expected = {"S2": 7.0, "S3": 6.8, "S4": s4, "S5": 4.0}
    assert {each: found[each].value for each in expected} == pytest.approx(expected)


def test_the_norm_form_has_the_smaller_bound(values: dict[str, object]) -> None:
    assert virtual_control_bound(values) == pytest.approx(math.sqrt(3) * 0.051)
    norm = {**values, "virtual_control": "norm"}
    assert virtual_control_bound(norm) == pytest.approx(0.051)
    slow = by_name({**norm, "M_omega": 0.0125})["rate bound"]
    assert slow.value == pytest.approx(math.degrees(0.0375) + math.sqrt(3) * 0.5, abs=0.01)


@pytest.mark.parametrize(
    ("law", "envelope"),
    [("quaternion_feedback", "attitude_envelope"), ("log_barrier", "rate_envelope")],
)
def test_an_impossible_envelope_stops_only_a_law_that_has_it(
    law: str, envelope: str, tmp_path: Path, ask: Ask
) -> None:
    impossible = {"controller": law, envelope: {"settling_time": 1.0, "decay": 0.001}}
    file = overlay(tmp_path / "law.yaml", {CONTROLLER: impossible})
    told = ask("check", "--config", file)
    assert "r of ρ_ω" not in told.out
    assert "\nS1" not in told.out
    assert ("r of ρ_q" in told.out) == (law == "log_barrier")
    refused = ask("check", "--config", file, "--controller", "ppc", code=2)
    assert f"{envelope} is infeasible" in refused.err


def test_check_prints_every_condition_and_fails_only_for_necessary_ones(ask: Ask) -> None:
    printed = ask("check").out
    for name in ("r of ρ_q", "r of ρ_ω", "S1", "S2", "S3", "S4", "S5", "rate bound"):
        assert name in printed
    assert "20.5476279 s" in printed
    # This flight meets every requirement, and six such warnings made the seventh unseen.
    assert "warning" not in printed
    assert printed.count("not promised") == 5
    hasty = ask("check", "--config", CONFIG / "paper.yaml", "--config", CONFIG / "mission.yaml").out
    assert "slew rate  5.06997 ≤ 3 deg/s  not promised" in hasty


@pytest.mark.parametrize(("k", "kept"), [(2.5, True), (4.2, False)])
def test_a_law_that_is_faster_than_allowed_is_warned_of_and_flies_so(k: float, kept: bool) -> None:
    """A turn by 100° about one axis, to a reference at rest."""
    case = scenario({CONTROLLER: {"k": k, "envelope": "auto"}, REFERENCE: {"amplitude": [0.0] * 3}})
    told = by_name(dict(case.parameters[CONTROLLER]))["rate of the law"]
    assert (told.holds, told.necessary, told.sufficient) == (kept, False, False)
    desired = Rotation.from_quat(case.parameters[REFERENCE]["initial_attitude"])
    start = (desired * Rotation.from_euler("x", 100.0, degrees=True)).as_quat().tolist()
    run = simulate(case.with_values("spacecraft_plant", initial_attitude=start), 60.0)
    fastest = np.degrees(np.linalg.norm(run["angular_velocity"], axis=1).max())
    assert told.value == pytest.approx(math.degrees(k * 0.017))
    assert fastest == pytest.approx(told.value, rel=0.1)
    assert (fastest <= told.limit) == kept


def test_what_shrinks_faster_than_the_envelope_falls(values: dict[str, object]) -> None:
    speed = 0.5 * 0.93133 * 3.0 * 0.017
    conditions = by_name(values)
    assert conditions["small error follows"].value == pytest.approx(speed * 3.6)
    assert conditions["edge follows"].value == pytest.approx(speed * math.tanh(3.6))
    assert not conditions["edge follows"].holds
    gentle = {**values, "attitude_envelope.exponential_terminal": 0.3}
    gentle |= {"attitude_envelope.terminal": 0.3, "attitude_envelope.decay": 0.05}
    gentle |= {"k": 10.0, "attitude_envelope.settling_time": 300.0}
    assert all(by_name(gentle)[name].holds for name in ("small error follows", "edge follows"))


def stays_inside(component: float, axis: int) -> bool:
    case = scenario({})
    desired = Rotation.from_quat(case.parameters["reference_generator"]["initial_attitude"])
    turn = np.zeros(3)
    turn[axis] = 2.0 * math.asin(component)
    start = (desired * Rotation.from_rotvec(turn)).as_quat().tolist()
    run = simulate(case.with_values("spacecraft_plant", initial_attitude=start), 70.0)
    return bool(np.all(np.abs(run["attitude_error"][:, :3]) < run["attitude_envelope"]))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_largest_start_can_be_simulated_and_its_reserve_is_small(
    values: dict[str, object], axis: int
) -> None:
    largest = largest_start(ppc.configure(values))
    assert stays_inside(0.98 * largest, axis)
    assert not stays_inside(1.2 * largest, axis)
