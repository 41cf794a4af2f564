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

"""Magnetorquers that stop a tumbling craft by the B-dot law, and what the craft does then."""

import math
from typing import Any

import numpy as np
import pytest
from craft_helpers import FRICTIONLESS, case, conditions, part_of
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import Requirements
from ppc_attitude.contract.topics import ALLOCATOR, PLANT
from ppc_attitude.science.kinds import ACTUATORS, PLANTS
from ppc_attitude.science.magnetorquers import rate_across
from ppc_attitude.simulation.closed_loop import simulate

CRAFT = ("wheels", "orbit", "unloading", "sensors_smallsat", "any_start", "detumble")
STEP = 0.1  # [s]
FIELD = np.array([1.2e-5, -2.5e-5, 3.1e-5])  # [T]


@pytest.mark.parametrize("rate", [[0.0, 0.0, 0.3], [0.01, -0.02, 0.005], [-1.2, 0.4, 0.1]])
def test_a_field_that_turns_tells_the_rate_across_it(rate: list[float]) -> None:
    """Across the axis of turning, it tells sin(ω T)/T of ω; along the field, it tells nothing."""
    turn = Rotation.from_rotvec(rate)  # in 1 s, body against field
    axis = np.divide(rate, np.linalg.norm(rate))
    across = np.cross(axis, FIELD)
    found = rate_across(tuple(turn.inv().apply(across)), tuple(across), 1.0)
    assert found == pytest.approx(axis * np.sin(np.linalg.norm(rate)), rel=1e-12)
    assert rate_across(tuple(axis), tuple(turn.apply(axis)), 1.0) == pytest.approx([0.0] * 3)
    b, slow = FIELD / np.linalg.norm(FIELD), 1e-4 * np.array(rate)
    before, now = FIELD, Rotation.from_rotvec(2.0 * slow).inv().apply(FIELD)
    expected = slow - b * (slow @ b)
    found = rate_across(tuple(now), tuple(before), 2.0)
    assert found == pytest.approx(expected, abs=np.linalg.norm(slow) ** 2)


def test_a_tumbling_craft_is_slowed_as_an_independent_integration_says() -> None:
    """Law, free wheels, and body by DOP853, with the torque held as the plant holds it."""
    idle = {"wheels__null_gain": 0.0, "wheels__gyroscopic_compensation": False, **FRICTIONLESS}
    idle["wheels__initial_speed"] = [400.0, -100.0, 300.0, 50.0]  # [rad/s]
    start = {"initial_angular_velocity": [0.2, -0.15, 0.1], "rate": 1.0 / STEP, **idle}
    plant = part_of(PLANTS, "gyrostat_rods", **start)
    law = {"magnetorquers__law": "b_dot", "magnetorquers__gain": 0.02}
    law |= {"magnetorquers__max_dipole": 200.0, "magnetorquers__craft_inertia": 2.2}
    rods = part_of(ACTUATORS, "wheels_rods", **law, rate=1.0 / STEP, **idle)
    axes = np.reshape(plant.component.defaults["wheels.axes"], (4, 3))
    inertia, spin = np.diag([2.8, 2.5, 1.9]), 8e-4
    locked = np.linalg.inv(inertia - spin * axes.T @ axes)

    def motion(_: float, x: np.ndarray, torque: np.ndarray) -> np.ndarray:
        omega = x[4:7]
        momentum = inertia @ omega + spin * axes.T @ x[7:]
        acceleration = locked @ (torque - np.cross(omega, momentum))
        q_rate = 0.5 * np.append(x[3] * omega + np.cross(x[:3], omega), -x[:3] @ omega)
        return np.concatenate([q_rate, acceleration, -axes @ acceleration])

    x, dipole, before, speeds = np.zeros(11), np.zeros(3), None, np.zeros(8)
    x[:7] = [*plant.component.defaults["initial_attitude"], *start["initial_angular_velocity"]]
    x[:4] /= np.linalg.norm(x[:4])
    x[7:] = idle["wheels__initial_speed"]
    given, energies = np.zeros(3), []
    for k in range(600):
        told = np.array(plant.step(round(k * STEP * 1e9), [*np.zeros(8), 0.0, 0.0, 0.0, *given]))
        assert told[:4] * np.sign(told[3] * x[3]) == pytest.approx(x[:4], abs=1e-8)
        assert told[4:7] == pytest.approx(x[4:7], abs=1e-8)
        b, speeds = told[15:18], told[7:15]
        rods.step(round(k * STEP * 1e9), [0.0, 0.0, 0.0, *told[4:7], *speeds, *b])
        given = np.array(rods.output("magnetorquer_dipole"))
        assert not any(rods.output("wheel_torque"))
        if k % 10 == 0:
            rate = np.zeros(3) if before is None else -np.cross(b, b - before) / (b @ b)
            before, dipole = b, 0.02 / (b @ b) * np.cross(2.2 * rate, b)
            dipole *= min(1.0, 200.0 / np.abs(dipole).max(initial=1.0))
            energies.append(0.5 * x[4:7] @ np.linalg.inv(locked) @ x[4:7])  # that wheels leave
        assert given == pytest.approx(dipole, rel=1e-6)
        x = solve_ivp(
            motion, (0.0, STEP), x, "DOP853", args=(np.cross(dipole, b),), rtol=1e-11, atol=1e-13
        ).y[:, -1]
    assert np.all(np.diff(energies) < 0.0)
    assert energies[-1] < 0.7 * energies[0]


def test_a_rate_needs_the_field_of_the_period_before() -> None:
    """Not at the start, nor after steps that are missing: then only the wheels' momentum counts."""
    law = {"magnetorquers__law": "b_dot", "magnetorquers__period": 0.1}
    rods = part_of(ACTUATORS, "wheels_rods", **law)
    unloading = part_of(ACTUATORS, "wheels_rods", magnetorquers__period=0.1)
    seen = {}
    for k in (0, 10, 20, 45, 50, 60):
        b = Rotation.from_rotvec([0.0, 0.01 * k, 0.0]).apply(FIELD)
        row = [1e-3, *[0.0] * 5, 50.0, -20.0, 10.0, 0.0, *[0.0] * 4, *b]
        both, wheels_alone = (np.array(p.step(k * 10_000_000, row)[-3:]) for p in (rods, unloading))
        seen[k] = bool(np.linalg.norm(both - wheels_alone) > 1.0)
    assert seen == {0: False, 10: True, 20: True, 45: False, 50: True, 60: True}
    for k in (70, 80):  # no field, as of a magnetometer that has not begun
        assert not any(rods.step(k * 10_000_000, [*row[:-3], 0.0, 0.0, 0.0])[-3:])


def test_a_craft_without_an_attitude_is_slowed_until_it_has_one_and_then_points() -> None:
    """It tumbles faster than its star tracker can follow, and the law waits for the first fix."""
    slower = {"initial_angular_velocity": [0.05, -0.03, 0.02], "star_tracker__max_rate": 0.05}
    record = simulate(case(*CRAFT, **slower), 600.0)
    rates = np.linalg.norm(record["truth_angular_velocity"], axis=1)
    known = int(np.argmax(np.any(record["attitude"] != 0.0, axis=1)))
    assert 3000 < known < 50000
    assert rates[known - 30] == pytest.approx(0.05, rel=0.01)
    assert not np.any(record["torque_command"][:known])
    verdict = Verdict(record, Requirements(settling_deadline=550.0, rate=None))
    assert verdict.all_met, verdict.summary
    off = case(*CRAFT, **slower, magnetorquers__law="cross_product")
    lost = simulate(off, 600.0)
    assert not np.any(lost["attitude"])


@pytest.mark.long
@pytest.mark.parametrize(
    ("first", "given"),
    [
        (1155.0, {}),
        (1488.0, {"faults": ["magnetorquer/x effectiveness 0"]}),
        (1521.0, {"faults": ["magnetorquer/z stuck 3"]}),
        (2553.0, {"magnetorquers__gain": 1e-3}),
    ],
)
def test_the_first_fix_comes_when_the_page_says(first: float, given: dict[str, Any]) -> None:
    """`docs/actuators.md` has these times, of the craft as it is shipped and of changed ones."""
    record = simulate(case(*CRAFT, **given), first + 100.0)
    known = np.any(record["attitude"] != 0.0, axis=1)
    assert record.t[np.argmax(known)] == pytest.approx(first, abs=1.0)
    assert np.abs(record["attitude_error"][-100:, :3]).max() < 5e-4
    if not given:
        verdict = Verdict(record, Requirements(settling_deadline=first, rate=None, terminal=None))
        assert verdict.metrics.settling_time_s == pytest.approx(1216.0, abs=1.0)


@pytest.mark.parametrize("node", [PLANT, ALLOCATOR])
def test_check_knows_what_stops_a_tumbling_craft(node: str) -> None:
    board = case(*CRAFT)
    craft = board if node == PLANT else case(*CRAFT, "allocator_unloading")
    found = conditions(craft)
    assert "rate at the start" not in found
    assert found["turn in a period"].value == pytest.approx(math.sqrt(0.0308))
    # (‖J ω‖ − J_max 3°/s)/(√3 m B), and ln(ωᵀ J ω/(J_max (3°/s)²))/(2 k J/J_min)
    for gain, low, high in ((4e-3, 240.0, 240.1), (1e-4, 9083.0, 9084.0), (0.0, 1e9, math.inf)):
        given = craft.with_values(node, **{"magnetorquers.gain": gain})
        for duration, deadline in ((3600.0, 4000.0), (0.0, 3600.0)):
            flown = given.with_values(PLANT, duration=duration)
            required = Requirements(settling_deadline=deadline)
            time = conditions(flown, required)["time to detumble"]
            assert low < time.value < high
            assert (time.limit, time.holds) == (3600.0, low < 3600.0)
    slow = craft.with_values(node, **{"magnetorquers.period": 9.0})
    assert not conditions(slow)["turn in a period"].holds
    for deadband, holds in ((0.12, True), (0.13, False)):  # 2.4 kg·m² at 3°/s have 0.126 N·m·s
        resting = craft.with_values(node, **{"magnetorquers.deadband": deadband})
        assert conditions(resting)["unloading deadband"].holds is holds
    unloading = conditions(craft.with_values(node, **{"magnetorquers.law": "cross_product"}))
    assert not unloading["rate at the start"].holds
    assert "turn in a period" not in unloading
