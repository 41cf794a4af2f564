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

"""`envelope: auto` with config/any_start.yaml: every start converges, inside, below 3°/s."""

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
import pytest
from craft_helpers import case, pulse
from record_helpers import inputs_of, outputs_of, settled_after, state_of
from scipy.spatial.transform import Rotation

from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.science.controllers import ppc
from ppc_attitude.science.envelope_plan import MAX_STRETCH, PLAN, carry_on, plan_envelopes
from ppc_attitude.science.kinds import CONTROLLERS
from ppc_attitude.simulation.closed_loop import (
    Loop,
    first_instant,
    simulate,
    stamps_of,
    timetable_of,
)
from ppc_attitude.simulation.diagram import Diagram
from ppc_attitude.simulation.scenario import Scenario

PAPER = case()
ANY_START = case("any_start")
LAW = ANY_START.parameters["ppc_controller"]
SPEED = float(str(LAW["k"])) * float(str(LAW["M_omega"]))  # bound of ‖v‖ for ρ_q ≤ 1 [rad/s]
LARGEST_DESIRED_RATE = np.deg2rad(0.7975)  # test_reference measures it
LIMIT = np.deg2rad(3.0)


def started(case: Scenario, error: Rotation, rate: np.ndarray) -> Scenario:
    """The case, starting with an attitude error and a rate [rad/s]."""
    desired = Rotation.from_quat(case.parameters["reference_generator"]["initial_attitude"])
    return case.with_values(
        "spacecraft_plant",
        initial_attitude=(desired * error).as_quat().tolist(),
        initial_angular_velocity=rate.tolist(),
    )


def advice_of(case: Scenario) -> Any:
    return first_instant(case)[CONTROLLERS.name].advice


def random_starts(runs: int) -> Iterator[tuple[Rotation, np.ndarray]]:
    """Uniform on SO(3), every tenth within 0.1° of a half turn; rates up to 1°/s."""
    rng = np.random.default_rng(20220501)
    for k in range(runs):
        axis, direction = rng.normal(size=(2, 3))
        error = Rotation.random(random_state=rng)
        if k % 10 == 0:
            angle = math.pi - np.deg2rad(0.1) * rng.uniform()
            error = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        size = np.deg2rad(1.0) * (1.0 if k % 2 else rng.uniform())
        yield error, size * direction / np.linalg.norm(direction)


def hard_starts() -> Iterator[tuple[Rotation, np.ndarray]]:
    """Exact half turns about body axes, and rates of 1°/s away from or across the target."""
    for axis in np.eye(3):
        for rate in (*np.eye(3), *-np.eye(3)):
            yield Rotation.from_rotvec(math.pi * axis), np.deg2rad(1.0) * rate
        for angle in (0.1, 45.0, 90.0, 170.0):
            yield Rotation.from_rotvec(np.deg2rad(angle) * axis), np.deg2rad(1.0) * axis


def judged(samples: Mapping[str, np.ndarray], stamps: np.ndarray) -> list[str]:
    """What a run breaks of the promise."""
    t = stamps * 1e-9
    error = np.abs(samples["attitude_error"][:, :3])
    rate = np.linalg.norm(samples["angular_velocity"], axis=1)
    z2 = np.linalg.norm(samples["rate_error"], axis=1)
    rho_q = samples["attitude_envelope"].max(axis=1)
    rho_omega = samples["rate_envelope"].max(axis=1)
    spare = LIMIT - LARGEST_DESIRED_RATE - SPEED
    complaints = {
        "leaves its attitude envelope": np.any(error > samples["attitude_envelope"]),
        "leaves its rate envelope": np.any(
            np.abs(samples["rate_error"]) > samples["rate_envelope"]
        ),
        "is too fast": rate.max() > LIMIT,
        "breaks the bound of the rate": np.any(
            rate > LARGEST_DESIRED_RATE + SPEED * rho_q + z2 + 1e-9
        ),
        "is not certain of its rate from 10 s on": np.any(
            math.sqrt(3.0) * rho_omega[t > 10.0] > spare
        ),
        "has not settled after 140 s": error[t >= 140.0].max() >= 5e-3,
        "has not converged": error[t >= 160.0].max() >= 5e-4,
    }
    return [complaint for complaint, broken in complaints.items() if broken]


@pytest.mark.parametrize(
    "starts",
    [
        hard_starts,
        pytest.param(partial(random_starts, 50), id="random_starts"),
        pytest.param(partial(random_starts, 1000), id="many_random_starts", marks=pytest.mark.long),
    ],
)
def test_every_start_converges_inside_its_envelope_below_the_limit(starts: Any) -> None:
    stamps = stamps_of(100.0, 180.0)
    loop = Loop(ANY_START, stamps, timetable_of(ANY_START, stamps))
    wrong = []
    for k, (error, rate) in enumerate(starts()):
        record = loop.run(started(ANY_START, error, rate))
        wrong += [f"start {k} {complaint}" for complaint in judged(record.columns, stamps)]
    assert not wrong, "\n".join(wrong)


def plan_of(angle_deg: float, t: float = 0.0, rate: float = 0.0) -> Any:
    """Plan for an error about an axis on which all components are equal, rate [rad/s] outward."""
    axis = np.ones(3) / math.sqrt(3.0)
    q_e = Rotation.from_rotvec(np.deg2rad(angle_deg) * axis).as_quat()
    plan = np.zeros((), PLAN)[()]
    plan_envelopes(plan, t, tuple(q_e.tolist()), tuple((rate * axis).tolist()), GAINS)
    return plan


GAINS = ppc.configure(LAW)


def test_where_the_table_can_be_followed_it_is_the_plan() -> None:
    plan = plan_of(20.0)
    assert (plan["hold"], plan["stretch"], plan["attitude_clock"]) == (0.0, 1.0, 0.0)
    assert plan["feasible"] == 1.0


def test_a_larger_error_never_settles_earlier() -> None:
    settled = []
    for angle in np.linspace(5.0, 179.9, 60):
        plan = plan_of(float(angle))
        assert plan["feasible"] == 1.0
        settled.append(plan["hold"] + plan["stretch"] * 60.0)
    # The fills at which the fall may begin are a grid: a second of slack.
    assert np.all(np.diff(settled) > -1.0)
    assert settled[-1] < 140.0


def test_a_turn_away_from_the_target_is_waited_for() -> None:
    assert plan_of(90.0, rate=0.03)["hold"] > plan_of(90.0)["hold"] + 1.0


def test_a_plan_in_flight_begins_down_the_table_with_room_for_the_error() -> None:
    plan = plan_of(2.0, t=300.0)
    assert 0.0 < plan["attitude_clock"] < 60.0
    (_, _), (rho, rate) = carry_on(plan, 300.0, GAINS)
    component = math.sin(math.radians(1.0)) / math.sqrt(3.0)
    assert 2.0 * component < rho < 10.0 * component
    assert rate == 0.0  # it waits


def test_a_plan_made_on_target_depends_on_the_rate_and_not_on_the_rounding_of_the_error() -> None:
    """Guidance begins where the craft is, so the law's first error is a rounded zero."""
    rate, plans = 0.03, []
    for error in (*(1e-17 * np.eye(3)), *(-1e-17 * np.eye(3)), np.zeros(3)):
        plan = np.zeros((), PLAN)[()]
        plan_envelopes(plan, 1.0, (*error.tolist(), 1.0), (0.0, rate, 0.0), GAINS)
        plans.append(plan.tolist())
    assert np.ptp(plans, axis=0).max() < 1e-9
    rho = carry_on(plan, 1.0, GAINS)[1][0]
    braking = rate * rate * 2.5 / (0.05 - LAW["D_m"])  # [rad] twice what a full brake needs
    assert 0.5 * braking < rho < 5.0 * braking


@pytest.mark.parametrize(("early", "plans"), [(0.25, 1.0), (0.0, 2.0)])
def test_a_plan_is_revised_when_its_hold_has_ended_and_not_before(
    early: float, plans: float
) -> None:
    measurement, memory = inputs_of(ppc.COMPONENT), state_of(ppc.COMPONENT)
    memory["plan"], memory["started"] = plan_of(150.0, t=300.0), 1.0
    memory["plan"]["hold"], memory["t"] = 2.5, 300.0
    measurement["t"] = 302.5 - early
    measurement["reference_attitude"] = (0.0, 0.0, 0.0, 1.0)
    measurement["attitude"] = Rotation.from_rotvec(np.deg2rad(150.0) * np.eye(3)[0]).as_quat()
    ppc.step(measurement, memory, GAINS, outputs_of(ppc.COMPONENT))
    assert memory["plan"]["count"] == plans


def test_an_envelope_that_is_switched_in_flight_is_placed_anew() -> None:
    """A plan stayed that nobody wanted any more; and there was none where one was wanted."""
    diagram = Diagram(started(ANY_START, Rotation.from_rotvec([3.0, 0, 0]), np.zeros(3)).parameters)
    part, stamps = diagram.parts[CONTROLLERS.name], stamps_of(100.0, 1.0)
    diagram.run(stamps[:50])
    plan = part.state[0]["law"]["plan"]
    holds = [plan["hold"]]
    for k, envelope in enumerate(("nominal", "auto")):
        part.configure({**LAW, "envelope": envelope})
        diagram.run(stamps[50 + k : 51 + k])
        assert plan["start"] == 0.5 + 0.01 * k
        holds.append(plan["hold"])
    assert holds[0] > 30.0
    assert holds[1] == 0.0
    assert holds[2] > 30.0


def test_a_start_outside_the_top_of_the_table_is_planned_for_once() -> None:
    narrow = ANY_START.with_values("ppc_controller", **{"attitude_envelope.initial": 0.5})
    diagram = Diagram(started(narrow, Rotation.from_rotvec([2.0, 0, 0]), np.zeros(3)).parameters)
    diagram.run(stamps_of(100.0, 5.0))
    assert diagram.parts[CONTROLLERS.name].advices == 1


def test_the_envelope_falls_continuously_after_the_hold() -> None:
    plan = plan_of(150.0)
    end = plan["hold"] + 60.0 * plan["stretch"]
    times = np.linspace(0.0, end + 5.0, 20_001)
    values, rates = np.array([carry_on(plan, t, GAINS)[1] for t in times]).T
    assert np.all(values[times < plan["hold"]] == pytest.approx(1.0))
    assert values[times >= end] == pytest.approx(5e-3)
    assert np.all(np.diff(values) <= 0.0)
    # Trapezoids of its rate add up to its fall: value and rate agree; the corner costs a step.
    fall = np.sum(0.5 * (rates[1:] + rates[:-1]) * np.diff(times))
    assert fall == pytest.approx(values[-1] - values[0], abs=2e-3)


def test_a_law_too_slow_for_any_stretch_says_so() -> None:
    slow = ANY_START.with_values("ppc_controller", M_omega=1e-4)
    error = Rotation.from_rotvec([2.0, 0.0, 0.0])
    advice = advice_of(started(slow, error, np.zeros(3)))
    assert advice.warning
    assert f"stretch {MAX_STRETCH:.3f}" in advice.text
    assert "raise k, M_omega or beta" in advice.text


def follows_the_table(case: Scenario, error: Rotation) -> tuple[bool, bool]:
    """Whether the law says that the start can follow the table, and whether it does."""
    case = started(case, error, np.zeros(3))
    advice = advice_of(case)
    record = simulate(case, 75.0)
    magnitude = np.abs(record["attitude_error"][:, :3])
    inside = bool(np.all(magnitude < record["attitude_envelope"]))
    return not advice.warning, inside and magnitude[record.t >= 60.0].max() < 5e-3


@pytest.mark.parametrize("starts", [40, pytest.param(80, marks=pytest.mark.long)])
@pytest.mark.parametrize("form", ["componentwise", "norm"])
def test_the_warning_of_the_nominal_envelope_can_be_trusted(form: str, starts: int) -> None:
    case = PAPER.with_values("ppc_controller", virtual_control=form)
    rng = np.random.default_rng(11)
    verdicts = []
    for _ in range(starts):
        axis = rng.normal(size=3)
        angle = np.deg2rad(rng.uniform(5.0, 110.0))
        error = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        verdicts.append(follows_the_table(case, error))
    promised, kept = np.array(verdicts).T
    assert np.all(kept[promised])  # no promise is broken
    assert np.mean(promised[kept]) > 0.85  # and few are withheld
    assert not promised.all()
    assert promised.any()


def test_a_start_beyond_the_table_gets_a_warning_that_names_the_remedy() -> None:
    error = Rotation.from_rotvec([2.0 * math.asin(0.5), 0.0, 0.0])
    advice = advice_of(started(PAPER, error, np.zeros(3)))
    assert advice.warning
    assert "envelope: auto" in advice.text
    assert not advice_of(started(ANY_START, error, np.zeros(3))).warning


def hit(case: Scenario, duration: float) -> RunRecord:
    """0.8 N·m on every axis at 80 s; 240 s more."""
    struck = pulse(80.0, duration, 0.8, 0.8, 0.8)
    return simulate(case.with_values("disturbance_injector", **struck), 320.0)


def outside(record: RunRecord) -> float:
    """Seconds that the attitude error is outside its envelope after the hit."""
    beyond = np.abs(record["attitude_error"][:, :3]) > record["attitude_envelope"]
    return 0.01 * np.count_nonzero(beyond.any(axis=1) & (record.t >= 80.0))


@pytest.mark.parametrize(("lasts", "most", "least"), [(0.5, 75.0, 239.0), (1.0, 80.0, 134.0)])
def test_a_hit_is_recovered_by_a_new_plan_as_by_no_table(
    lasts: float, most: float, least: float
) -> None:
    """That of half a second not at all by the table, and that of a second in twice the time."""
    planned, tabulated = hit(ANY_START, lasts), hit(PAPER, lasts)
    assert settled_after(planned, 80.0) < most
    assert settled_after(tabulated, 80.0) > least
    assert outside(planned) == 0.0
    assert outside(tabulated) > 60.0
