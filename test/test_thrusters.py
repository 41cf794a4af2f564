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

"""Thrusters: which fires how long, against linear programming, and what the pulses do."""

from typing import Any

import numpy as np
import pytest
import truth_tables
from craft_helpers import case
from estimation_helpers import STEP_NS, Array, angles_between
from scipy.optimize import linprog
from synthetic import requirement

from ppc_attitude.analysis.figures import column_figure
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import PAPER as PAPER_REQUIREMENTS
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kinds import ACTUATORS, PLANTS
from ppc_attitude.science.part import Part
from ppc_attitude.science.thrusters import (
    admitted,
    certain_torque,
    least_fuel,
    open_share,
    pulses,
)
from ppc_attitude.simulation.closed_loop import simulate

THRUSTERS = ACTUATORS.components["thrusters"]
G0 = 9.80665


def values(**given: Any) -> dict[str, Any]:
    """Parameters of the actuator, at 100 Hz; without the group's name."""
    chosen = {f"thrusters.{name}": value for name, value in given.items()}
    return {**THRUSTERS.defaults, "rate": 100.0, **chosen}


def record(**given: Any) -> Any:
    return THRUSTERS.configure(values(**given))["craft"]


def pushing(torques: Array) -> dict[str, Any]:
    """Thrusters of 1 N with these torques [N·m], each at right angles to its own."""
    across = np.cross(torques, [0.3, -0.5, 0.8])
    forces = across / np.linalg.norm(across, axis=1, keepdims=True)
    positions = np.cross(forces, torques)  # r × F with r ⊥ F
    return {
        "positions": positions.ravel().tolist(),
        "directions": forces.ravel().tolist(),
        "force": [1.0],
    }


@pytest.mark.parametrize("seed", range(6))
def test_no_other_on_times_cost_less(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = 6 + 2 * seed
    torques = random.normal(size=(count // 2, 3))
    torques = np.vstack([torques, -torques * random.uniform(0.2, 2.0, (count // 2, 1))])
    each = random.uniform(0.5, 2.0, count)
    chosen = {**pushing(torques), "force": each.tolist()}
    craft, on_time = record(**chosen), np.zeros(16)
    assert np.allclose(craft["torque"][:count], torques * each[:, None], rtol=0.0, atol=1e-14)
    for wanted in random.normal(size=(20, 3)):
        least_fuel(tuple(wanted), craft, on_time)
        least = linprog(each, A_eq=(torques * each[:, None]).T, b_eq=wanted)
        assert craft["force"] @ on_time == pytest.approx(least.fun, rel=1e-9)
        assert np.allclose(craft["torque"].T @ on_time, wanted, rtol=0.0, atol=1e-11)


def test_of_equally_good_threes_the_first_fires() -> None:
    """Every thruster twice: the second of a kind never fires."""
    twice = np.vstack([np.eye(3), np.eye(3), -np.eye(3), -np.eye(3)])
    on_time = np.zeros(16)
    least_fuel((0.1, -0.2, 0.3), record(**pushing(twice)), on_time)
    assert on_time == pytest.approx([0.1, 0.0, 0.3, 0, 0, 0, 0, 0.2, *[0.0] * 8], abs=1e-15)


def test_705_pulses_turn_the_craft_as_two_integrators_say() -> None:
    truth, craft = truth_tables.table("thrusters"), record()
    attitudes = truth_tables.columns(truth, "qx", "qy", "qz", "qw")
    rates = truth_tables.columns(truth, "wx", "wy", "wz")
    wanted = truth_tables.columns(truth, *(f"on{j}" for j in range(8)))
    start = {"initial_attitude": attitudes[0], "initial_angular_velocity": rates[0]}
    plant = PLANTS.components["rigid_body"]
    body = Part(plant, {**plant.defaults, "rate": 100.0, **start})
    torque, used, fired, worst = (0.0, 0.0, 0.0), 0.0, 0, np.zeros(3)
    for row, on in enumerate(wanted):
        for k in range(10):
            motion = body.step((10 * row + k) * STEP_NS, (*torque, 0.0, 0.0, 0.0))
            if k == 0:
                off = np.abs(np.subtract(motion[4:7], rates[row])).max()
                turned = angles_between(np.array(motion[:4]), attitudes[row])
                worst = np.maximum(worst, [turned, off, abs(used - truth["fuel_kg"][row])])
                on_time = np.array([*(admitted(t, craft) for t in on), *[0.0] * 8])
                fired += np.count_nonzero(on_time)
            shares = [open_share(t, k, craft) for t in on_time]
            torque = tuple(craft["torque"].T @ shares)
            used += 0.01 * craft["flow"] @ shares
    assert fired == 705
    assert np.all(worst < (1e-5, 1e-7, 1e-12)), worst


def flown(part: Part, commands: Array) -> tuple[Array, Array]:
    """Applied torque [N·m] and on-times [s] of each step."""
    told = [part.step(k * STEP_NS, command) for k, command in enumerate(commands)]
    return np.array(told)[:, :3], np.array(told)[:, 3:-1]


@pytest.mark.parametrize(
    ("fault", "share"),
    [
        ("effectiveness 0.3", lambda asked: 0.3 * asked),
        ("stuck_closed", lambda asked: 0.0 * asked),
        ("stuck_open 0.4", lambda asked: 0.0 * asked + 0.4),
    ],
)
def test_a_thruster_that_fails_gives_another_share_of_its_force(fault: str, share: Any) -> None:
    texts = [f"thruster/3 {fault} from 0.2 for 0.5", "thruster/6 stuck_closed"]
    part = Part(THRUSTERS, {**values(), "faults": texts})
    craft, used = record(), 0.0
    commands = np.tile(0.3 * craft["torque"][3] + 0.2 * craft["torque"][6], (100, 1))
    applied, on_times = flown(part, commands)
    assert (on_times[10:, [3, 6]] > 0.0).all()
    for k in range(100):
        shares = np.array([open_share(t, k % 10, craft) for t in on_times[k]])
        shares[6] = 0.0
        if 20 <= k < 70:
            shares[3] = share(shares[3])
        torque, flow = craft["torque"].T @ shares, craft["flow"] @ shares
        assert applied[k] == pytest.approx(torque, abs=1e-17)
        used += 0.01 * flow
    assert part.output("fuel_used")[0] == pytest.approx(used, rel=1e-12)


def test_impulse_is_neither_made_nor_lost() -> None:
    """Commands that change, mostly of less than the shortest pulse."""
    part, t = Part(THRUSTERS, values()), np.arange(3000) / 100.0
    commands = 2e-3 * np.sin(np.outer(t, [0.3, 0.7, 1.1])) + np.array([1e-3, 0.0, -5e-4])
    applied, on_times = flown(part, commands)
    b = record()["torque"]
    kept = np.array(part.state[0]["impulse"])
    assert np.abs(0.01 * (commands - applied).sum(axis=0) - kept).max() < 1e-15
    assert np.linalg.norm(kept) < 3 * 0.01 * 0.033  # less than three of the shortest pulses
    periods = on_times[::10]
    assert np.array_equal(np.repeat(periods, 10, axis=0), on_times)
    assert np.allclose(0.01 * applied.reshape(300, 10, 3).sum(axis=1), periods @ b, atol=1e-17)
    assert periods[periods > 0.0].min() >= 0.01
    assert np.count_nonzero(periods, axis=1).max() == 3
    spent = 0.1 * periods.sum() / (G0 * 65.0)
    assert part.output("fuel_used")[0] == pytest.approx(spent, rel=1e-12)


def test_a_short_pulse_that_is_not_carried_is_rounded() -> None:
    pair = 2.0 * record()["torque"][0, 0]  # N·m about x, of the two that turn about it
    for share, fired in ((0.49, 0.0), (0.51, 0.01), (1.5, 0.015)):
        part = Part(THRUSTERS, values(carry=False))
        commands = np.outer(np.ones(101), [share * 0.01 * pair / 0.1, 0.0, 0.0])
        _, on_times = flown(part, commands)
        assert on_times[100][[0, 5]] == pytest.approx([fired, fired], abs=1e-15)
        assert not part.state[0]["impulse"].any()
    assert admitted(0.005, record(carry=False)) == 0.01  # half of it is enough
    assert admitted(0.005, record()) == 0.0
    assert admitted(0.01, record()) == 0.01


def test_too_much_torque_is_scaled_and_does_not_pile_up() -> None:
    part = Part(THRUSTERS, values())
    commands = np.zeros((300, 3))
    commands[:100] = [0.5, -0.3, 0.2]
    applied, on_times = flown(part, commands)
    assert on_times[50].max() == pytest.approx(0.1, rel=1e-12)
    mean = applied[50:60].mean(axis=0)
    assert np.linalg.norm(np.cross(mean, commands[0])) < 1e-12
    assert not applied[110:].any()


def test_a_period_of_one_step_without_a_shortest_pulse_is_an_ideal_actuator() -> None:
    part = Part(THRUSTERS, {**values(period=0.02, min_on_time=0.0), "rate": 50.0})
    commands = 0.01 * np.random.default_rng(3).uniform(-1.0, 1.0, (100, 3))
    told = [part.step(2 * k * STEP_NS, command)[:3] for k, command in enumerate(commands)]
    assert np.abs(told - commands).max() < 1e-16


def test_of_what_asks_for_too_much_something_fires_even_if_no_pulse_is_shorter_than_a_period() -> (
    None
):
    """A whole period that lacked its last bit was shorter than the shortest: one in fourteen."""
    craft, on_time = record(min_on_time=0.1), np.zeros(16)
    for impulse in np.random.default_rng(0).normal(size=(200, 3)):
        pulses(tuple(impulse), craft, on_time)
        assert on_time.max() == pytest.approx(0.1)


def test_thrusters_without_fuel_give_nothing_and_say_so_once() -> None:
    part = Part(THRUSTERS, values(fuel=1e-3))
    applied, _ = flown(part, np.outer(np.ones(1000), [0.01, 0.0, 0.0]))
    last = int(np.flatnonzero(applied.any(axis=1))[-1])
    # Two thrusters turn about x, so the whole impulse follows from the fuel.
    b = record()["torque"]
    impulse = 1e-3 * G0 * 65.0 / 0.1 * b[0, 0]
    assert 0.01 * applied[:, 0].sum() == pytest.approx(impulse, rel=1e-9)
    assert 100 < last < 999
    assert (part.advices, part.advice.failed) == (1, True)
    assert part.advice.text == "the fuel is used up: the thrusters give no torque"
    assert part.advice.numbers["fuel used [kg]"] == pytest.approx(1e-3, rel=1e-12)


def test_less_fuel_than_was_used_gives_nothing_and_more_gives_torque_again() -> None:
    part, command = Part(THRUSTERS, values()), np.outer(np.ones(50), [0.01, 0.0, 0.0])
    flown(part, command)
    spent = part.advice.numbers["fuel used [kg]"]
    part.configure(values(fuel=0.5 * spent))
    applied, _ = flown(part, command)
    assert not applied.any()
    assert (part.advice.failed, part.advice.numbers["fuel used [kg]"]) == (True, spent)
    part.configure(values(fuel=1.0))
    applied, _ = flown(part, command)
    assert applied.any()
    assert (part.advices, part.advice.text, part.advice.failed) == (2, "there is fuel again", False)


@pytest.mark.parametrize("seed", [0, 1, 21])  # of 21 the worst torque lies on an edge of the box
def test_what_thrusters_give_on_every_axis(seed: int) -> None:
    """No torque of the box needs longer than a period, and some torque needs all of it."""
    random = np.random.default_rng(seed)
    torques = random.normal(size=(4, 3))
    given = pushing(np.vstack([torques, -torques])) if seed else {}
    craft, on_time = record(**given), np.zeros(16)
    certain, longest = certain_torque(craft), 0.0
    for torque in random.uniform(-1.0, 1.0, (3000, 3)):
        least_fuel(tuple(0.1 * certain * torque / np.abs(torque).max()), craft, on_time)
        longest = max(longest, float(on_time.max()))
    assert 0.09 < longest < 0.1 * (1.0 + 1e-9)
    axes = pushing(np.vstack([np.eye(3), -2.0 * np.eye(3)]))
    assert THRUSTERS.torques(values(**axes)) == pytest.approx((1.0, 2.0), rel=1e-12)
    assert certain_torque(record(**axes)) == pytest.approx(1.0, rel=1e-12)


def test_where_threes_cost_the_same_the_slower_one_counts() -> None:
    """Beside a torque that two threes give for one cost, it may be the other that is the first."""
    torques = [[2, -2, 0], [0, 1, -2], [-2, 0, -1], [-1, -2, 0], [-2, 1, -1], [1, 0, 2], [0, 1, 1]]
    craft, on_time = record(**pushing(np.array(torques, np.float64))), np.zeros(16)
    certain, longest = certain_torque(craft), 0.0
    for way in np.random.default_rng(0).uniform(-1.0, 1.0, (20_000, 3)):
        least_fuel(tuple(certain * way / np.abs(way).max()), craft, on_time)
        longest = max(longest, float(on_time.max()))
    assert 0.97 < longest < 1.0 + 1e-9


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        (pushing(np.vstack([np.eye(3), -np.eye(3)[:2]])), r"about \[.*-1.0\]"),
        (pushing(np.vstack([np.eye(3)[:2], -np.eye(3)[:2]])), r"about \[.*1.0\]"),
        ({"positions": [], "directions": []}, "no thruster gives torque about"),
        ({"force": [0.1, 0.2]}, "has 8 thrusters, .* 2; allowed: as many"),
        ({"directions": [0.0, 0.0, 1.0]}, "thrusters.directions 1,"),
        ({"positions": [1.0] * 51, "directions": [1.0] * 51}, "at most 16"),
        ({"directions": [0.0] * 24}, "each longer than 1e-6"),
        ({"period": 0.025}, r"thrusters.period = 0.025 s is 2.5 steps at rate = 100.0 Hz"),
        ({"period": 0.0999999}, r"9.99999 steps at rate .* the nearest is 0.1 s"),
        ({"min_on_time": 0.2}, r"thrusters.min_on_time = 0.2 s; allowed: at most"),
    ],
)
def test_impossible_thrusters_are_refused(given: dict[str, Any], reason: str) -> None:
    with pytest.raises(ConfigurationError, match=reason):
        record(**given)


@pytest.mark.parametrize(  # of the first ten, five are refused
    "seed", [*range(10), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(10, 30))]
)
def test_thrusters_are_refused_if_some_torque_cannot_be_had(seed: int) -> None:
    """Few thrusters, some of them weak: linear programming says whether they reach a torque."""
    random = np.random.default_rng(seed)
    count = int(random.integers(4, 8))
    torques = random.normal(size=(count, 3)) * 10.0 ** random.uniform(-4.0, 0.0, (count, 1))

    def can_be_had(way: Array) -> bool:
        columns = torques / np.linalg.norm(torques, axis=1, keepdims=True)
        return bool(linprog(np.ones(count), A_eq=columns.T, b_eq=way).status == 0)

    try:
        record(**pushing(torques))
    except ConfigurationError as error:
        named = str(error).split("about [")[1].split("]")[0]
        assert not can_be_had(np.array(named.split(","), np.float64))
    else:
        assert all(can_be_had(way) for way in random.normal(size=(50, 3)))


@pytest.mark.parametrize(("tank", "met"), [(0.5, True), (0.001, False)])
def test_a_craft_whose_fuel_is_used_up_does_not_pass(tank: float, met: bool) -> None:
    flight = simulate(case("paper", "thrusters", thrusters__fuel=tank), 20.0)
    row = requirement(Verdict(flight), "fuel")
    assert (row.met, row.limit, row.unit) == (met, tank, "kg")
    periods = flight["thruster_on_time"][:2000:10]
    spent = 0.1 * periods.sum() / (G0 * 65.0)
    if met:
        assert flight["fuel_used"][1999, 0] == pytest.approx(spent, rel=1e-12)
    else:
        assert row.value == tank


def test_fuel_is_drawn_as_a_number_without_an_axis() -> None:
    flight = simulate(case("paper", "thrusters"), 2.0)
    (axes,) = column_figure(Measured(flight, PAPER_REQUIREMENTS), "fuel_used").axes
    (line,) = axes.get_lines()
    assert np.array_equal(line.get_ydata(), flight["fuel_used"][:, 0])
    assert axes.get_legend() is None
