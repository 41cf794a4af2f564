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

"""The desired motion stays within the bounds that its limits promise, whatever is ordered when."""

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Ask
from craft_helpers import configs, overlay
from guidance_helpers import START, Array, guidance
from scipy.spatial.transform import Rotation
from synthetic import requirement

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.contract.topics import REFERENCE
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guidance.frames import (
    FRAME_NAMES,
    INERTIAL,
    SPINNING,
    frame_at,
    frame_bounds,
)
from ppc_attitude.science.guidance.orders import ORDER, OrderBook, goal_order, hold_order
from ppc_attitude.science.guidance.plan import LOOK
from ppc_attitude.science.guidance.slew import slew_bounds
from ppc_attitude.science.kernel import Vector
from ppc_attitude.science.parameter import resolved
from ppc_attitude.science.part import Part, signals_of
from ppc_attitude.science.references.goal import COMPONENT
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.diagram import play
from ppc_attitude.simulation.scenario import load

POOLS = (("inertial",), ("inertial", "nadir"), ("inertial", "spin"), FRAME_NAMES)


def ordered(random: np.random.Generator, pool: tuple[str, ...]) -> dict[str, Any]:
    """Parameters of goals at random times, most of them amid a slew, with random limits."""
    count = int(random.integers(2, 14))
    rate = 10.0 ** random.uniform(-2.5, -1.0)  # [rad/s]
    acceleration = rate * 10.0 ** random.uniform(-1.5, 1.5)  # [rad/s²]
    chosen = {
        "guidance.max_rate": rate,
        "guidance.max_acceleration": acceleration,
        "guidance.max_jerk": acceleration * 10.0 ** random.uniform(-1.5, 1.5),
        "spin.rate": rate * random.uniform(-0.85, 0.85),
        "spin.axis": random.normal(size=3).tolist(),
        "orbit.altitude": random.uniform(3e5, 2e6),
        "orbit.inclination": random.uniform(0.0, math.pi),
        "orbit.mean_anomaly": random.uniform(0.0, 6.0),
        "target.latitude": random.uniform(-1.0, 1.0),
        "target.longitude": random.uniform(-3.0, 3.0),
        "goals.times": np.sort(random.uniform(1.0, 200.0, count)).tolist(),
        "goals.frames": [str(each) for each in random.choice(pool, count)],
        "goals.attitudes": Rotation.random(count, random).as_quat().ravel().tolist(),
    }
    return dict(resolved(COMPONENT.parameters, chosen, "goals"))


def shares_of(values: dict[str, Any], until: float, step: float) -> Array:
    """Largest ‖ω_d‖, ‖ω_d'‖ and ‖ω_d''‖ until a time [s], each as a share of its bound."""
    stamps_ns = np.arange(round(until / step) + 1) * round(step * 1e9)
    attitude = np.tile([[0.0], [0.0], [0.0], [1.0]], (1, stamps_ns.size))
    part = Part(COMPONENT, values, np.zeros(signals_of(COMPONENT)))
    motion = play(part, stamps_ns, attitude, COMPONENT.outputs)
    rates, accelerations = motion[4:7], motion[7:10]
    moved = rates, accelerations, np.diff(accelerations, axis=1) / step
    assert COMPONENT.motion_bounds is not None
    most = [np.linalg.norm(each, axis=0).max() for each in moved]
    return np.asarray(np.divide(most, COMPONENT.motion_bounds(values, until)))


@pytest.mark.parametrize("pool", POOLS)
def test_no_order_lets_the_desired_motion_pass_its_bounds(pool: tuple[str, ...]) -> None:
    random = np.random.default_rng(3)
    most = np.max([shares_of(ordered(random, pool), 300.0, 0.02) for _ in range(40)], axis=0)
    assert (most <= (1.0, 1.0, 1.0 + 1e-9)).all()  # a difference of numbers is rounded
    assert most[0] > 0.8, "the bound of the rate is no wider than it has to be"
    assert most[1] > 0.9


@pytest.mark.parametrize(
    ("limits", "frames", "bounds"),
    [
        ((0.5, 2.0, 1e3), (0.1, 0.2, 0.3), (0.6 + 2.75 * 4.0 / 27.0, 2.75, 1002.175)),
        ((0.5, 2.0, 0.01), (0.1, 0.2, 0.3), (0.6 + 0.85 * 4.0 / 27.0, 2.75, 21.175)),
        ((0.5, 0.01, 0.01), (0.0, 0.0, 0.0), (0.6, 0.01, 0.08)),
    ],
)
def test_bounds_of_a_slew_are_those_of_the_derivation(
    limits: Vector, frames: Vector, bounds: Vector
) -> None:
    """The frames give each of its terms 0.25 rad/s² and 0.725 rad/s³."""
    assert slew_bounds(limits, frames) == pytest.approx(bounds, rel=1e-8)


def test_orders_amid_brakes_that_last_for_turns_of_a_spin_do_not_add_up() -> None:
    """The acceleration is so small beside the spin that a brake turns by several radians."""
    random = np.random.default_rng(5)
    for _ in range(40):
        values = ordered(random, ("inertial", "spin"))
        count = len(values["goals.times"])
        values |= {
            "guidance.max_rate": 0.2,
            "guidance.max_acceleration": 3e-3,
            "guidance.max_jerk": 3e-3,
            "spin.rate": 0.17,
            "goals.times": np.sort(random.uniform(1.0, 800.0, count)).tolist(),
        }
        assert shares_of(values, 1500.0, 0.5)[0] <= 1.0


@pytest.mark.parametrize("frame", range(len(FRAME_NAMES)))
def test_no_frame_turns_faster_than_its_bounds(frame: int) -> None:
    sky, spinning = guidance()["sky"], np.zeros((), SPINNING)[()]
    spinning["axis"], spinning["rate"] = (0.0, 0.6, 0.8), -0.01
    bounds = frame_bounds(frame, -0.01, sky, 1800.0)
    cursor, times = np.zeros((), LOOK)[()]["now"], np.arange(0.0, 1800.0, 0.25)
    moved = [frame_at(float(t), frame, spinning, sky, cursor)[0][1:] for t in times]
    omega, alpha = (np.array(each) for each in zip(*moved, strict=True))
    for bound, samples in zip(bounds, (omega, alpha, np.diff(alpha, axis=0) / 0.25), strict=True):
        most = np.linalg.norm(samples, axis=1).max()
        assert most <= bound * (1.0 + 1e-3)
        assert bound <= 1.1 * most + 1e-12 or frame == INERTIAL


@pytest.fixture
def goals(tmp_path: Path) -> Path:
    reference = {
        "mode": "goal",
        "guidance": {"max_rate": 0.0145, "max_acceleration": 0.0035, "max_jerk": 0.0035},
        "goals.times": [10.0, 40.0, 45.0],
        "goals.frames": ["inertial", "nadir", "inertial"],
        "goals.attitudes": [0.6, 0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0, 0.0, 0.8, 0.0, -0.6],
    }
    return overlay(tmp_path / "goals.yaml", {REFERENCE: reference})


@pytest.mark.usefixtures("coarse")
def test_a_flight_to_goals_is_promised_and_the_promise_kept(
    goals: Path, tmp_path: Path, ask: Ask
) -> None:
    gains = tmp_path / "gains.yaml"
    given = ["--config", goals, "--gains", 0.92, 78.4, 1, "--output", gains]
    ask("design", "--config", *configs("paper"), *given)
    scenario = load([*configs("paper"), goals, gains])
    held = requirement(Verdict(simulate(scenario, 120.0)), "certificate")
    assert (held.met, held.note) == (True, "")


def test_a_law_that_looks_ahead_is_not_designed_for_goals(goals: Path, ask: Ask) -> None:
    refused = ask("design", f"--config={goals}", "--controller", "momentum_tube_ahead", code=2)
    assert "controller = momentum_tube_ahead with mode = goal" in refused.err


def test_a_timed_profile_has_no_bound_of_its_jerk(tmp_path: Path, ask: Ask) -> None:
    still = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    schedule = {"times": [1.0], "frames": ["profile"], "attitudes": still[:4]}
    points = [0.0, 20.0, *still, 0.0, 30.0, *still]
    timed = {REFERENCE: {"mode": "goal", "goals": {**schedule, "points": points}}}
    file = overlay(tmp_path / "goals.yaml", timed)
    refused = ask("design", "--config", file, code=2)
    assert "mode = goal tells no bound W2: give it with" in refused.err


def test_what_waits_for_a_state_is_forgotten_when_time_begins_again() -> None:
    book = OrderBook(np.zeros(0, ORDER))
    book.at(0)
    book.accept(hold_order, 0)
    book.begin_again()
    assert np.size(book.at(0)) == 0


def test_only_orders_that_wait_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stream of goals goes on for ever, and a reference that begins anew finds the latest."""
    monkeypatch.setattr("ppc_attitude.science.guidance.orders._MOST", 100)
    book = OrderBook(np.zeros(0, ORDER))
    book.accept(partial(goal_order, frame="inertial", attitude=START), 1)
    for stamp in range(2, 200):
        book.accept(hold_order, 0)
        listed = book.at(stamp)
    assert listed is not None
    assert (len(listed), listed["stamp_ns"][-1]) == (100, 199)
    for stamp in range(200, 300):
        book.accept(hold_order, stamp)
    with pytest.raises(ConfigurationError, match="100 orders wait; allowed: no more at a time"):
        book.accept(hold_order, 0)
