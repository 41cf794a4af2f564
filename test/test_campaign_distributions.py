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

"""What a campaign draws: the right distributions, reproducible alone, and clear refusals."""

import math
from typing import Any

import numpy as np
import pytest
import yaml
from campaign_helpers import run_one
from craft_helpers import ROOT, configs, pulse
from docs_helpers import blocks
from scipy import linalg, stats

from ppc_attitude.campaign.declaration import (
    Campaign,
    campaign,
    draw,
    scenario_of_run,
    stream,
)
from ppc_attitude.campaign.distributions import direction, number, on_sphere
from ppc_attitude.campaign.rows import rerun
from ppc_attitude.campaign.summary import Summary
from ppc_attitude.campaign.variables import DRAWN, perturbed_inertia
from ppc_attitude.contract.declared import components_of
from ppc_attitude.contract.topics import CONTROLLER, ESTIMATOR, INJECTOR, PLANT, REFERENCE, SOURCES
from ppc_attitude.science.attitude import attitude_error, rotation_angle
from ppc_attitude.science.inertia import inertia_matrix
from ppc_attitude.science.parameter import Parameter
from ppc_attitude.simulation.scenario import Scenario, load, scenario

ANY = Parameter("any", 0.0, "any number")
DRAWS = 3000
# A right distribution fails one test in 10⁴; the seed is fixed, so it is right or wrong for good.
UNLIKELY = 1e-4

EVERYTHING: dict[str, Any] = {
    "initial_attitude": {"distribution": "so3"},
    "initial_rate": {"magnitude": {"distribution": "uniform", "low": 0.0, "high": 0.01}},
    "inertia_error": {"distribution": "uniform", "low": 0.0, "high": 0.3},
    "disturbance": {
        "time": {"distribution": "uniform", "low": 1.0, "high": 5.0},
        "duration": 0.2,
        "torque": {"distribution": "choice", "values": [0.1, 0.5]},
    },
    "actuator_strength": {
        "distribution": "normal",
        "mean": 1,
        "deviation": 0.1,
        "low": 0.5,
        "high": 2.0,
    },
    "attitude_noise": {"distribution": "log_uniform", "low": 1e-7, "high": 1e-5},
    "rate_noise": 1e-7,
}


def base(**plant: Any) -> Scenario:
    return scenario({PLANT: {"duration": 10.0, **plant}})


def numbers(given: Any, count: int = DRAWS) -> np.ndarray:
    distribution = number("x", given, ANY)
    own = np.random.default_rng(5)
    return np.array([distribution.draw(own) for _ in range(count)])


def test_a_number_alone_is_fixed() -> None:
    assert set(numbers(3, 5)) == {3.0}
    assert set(numbers({"distribution": "fixed", "value": 2.5}, 5)) == {2.5}
    assert direction("x", [0.0, 3.0, 4.0])(np.random.default_rng(5)) == (0.0, 0.6, 0.8)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"distribution": "uniform", "low": -2, "high": 3}, stats.uniform(-2, 5)),
        ({"distribution": "log_uniform", "low": 1e-6, "high": 1e-2}, stats.loguniform(1e-6, 1e-2)),
        (
            {"distribution": "normal", "mean": 1, "deviation": 0.5, "low": -9, "high": 9},
            stats.norm(1, 0.5),
        ),
        (
            {"distribution": "normal", "mean": 1, "deviation": 2, "low": 0, "high": 2},
            stats.truncnorm(-0.5, 0.5, 1, 2),
        ),
    ],
)
def test_numbers_follow_their_distribution(given: Any, expected: Any) -> None:
    assert stats.kstest(numbers(given), expected.cdf).pvalue > UNLIKELY


def test_a_normal_distribution_is_cut_off_at_what_is_allowed() -> None:
    given = {"distribution": "normal", "mean": 1.0, "deviation": 2.0}
    assert stats.kstest(numbers(given), stats.norm(1, 2).cdf).pvalue > UNLIKELY
    distribution = number("x", given, Parameter("x", 1.0, "a size", above=0.0))
    own = np.random.default_rng(5)
    drawn = [distribution.draw(own) for _ in range(DRAWS)]
    assert stats.kstest(drawn, stats.truncnorm(-0.5, np.inf, 1, 2).cdf).pvalue > UNLIKELY


def test_choices_are_equally_likely() -> None:
    drawn = numbers({"distribution": "choice", "values": [1, 2, 7]})
    values, counts = np.unique(drawn, return_counts=True)
    assert values.tolist() == [1.0, 2.0, 7.0]
    assert stats.chisquare(counts).pvalue > UNLIKELY


def test_the_sphere_has_no_preferred_direction() -> None:
    own = np.random.default_rng(5)
    points = np.array([on_sphere(own) for _ in range(DRAWS)])
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, rtol=1e-12)
    turned = points @ stats.ortho_group.rvs(3, random_state=1)
    for component in (*points.T, *turned.T):  # Archimedes: each is uniform
        assert stats.kstest(component, stats.uniform(-1, 2).cdf).pvalue > UNLIKELY


# A draw of a run takes a millisecond. With a thousand of them a distribution fails that is off by
# 0.07 somewhere (2.2/√n at this probability). Uniform angles would be off by 0.3 on SO(3), and the
# angles of a uniform cap would be off by 0.25 in the cone.
@pytest.mark.parametrize("draws", [1000, pytest.param(DRAWS, marks=pytest.mark.long)])
def test_so3_is_uniform(draws: int) -> None:
    of = campaign({"initial_attitude": {"distribution": "so3"}}, base(), 3)
    q = np.array([attitude(of, k) for k in range(draws)])
    angles = 2.0 * np.arccos(np.minimum(np.abs(q[:, 3]), 1.0))
    assert stats.kstest(angles, lambda a: (a - np.sin(a)) / np.pi).pvalue > UNLIKELY
    axes = q[:, :3] / np.linalg.norm(q[:, :3], axis=1, keepdims=True)
    for component in axes.T:
        assert stats.kstest(component, stats.uniform(-1, 2).cdf).pvalue > UNLIKELY


@pytest.mark.parametrize("draws", [1000, pytest.param(DRAWS, marks=pytest.mark.long)])
def test_cone_turns_about_the_configured_attitude(draws: int) -> None:
    of = campaign({"initial_attitude": {"distribution": "cone", "angle": 0.4}}, base(), 3)
    start = of.scenario.parameters[PLANT]["initial_attitude"]
    start = tuple(np.array(start) / np.linalg.norm(start))
    turns = [attitude_error(tuple(attitude(of, k)), start) for k in range(draws)]
    angles = [rotation_angle(turn) for turn in turns]
    assert stats.kstest(angles, stats.uniform(0, 0.4).cdf).pvalue > UNLIKELY


def attitude(of: Campaign, index: int) -> list[float]:
    drawn: dict[str, Any] = draw(of, index)
    return [float(drawn[f"initial_attitude_{axis}"]) for axis in "xyzw"]


def moments(inertia: Any) -> Any:
    """Second moments of a body [kg·m²], shape (3, 3)."""
    return 0.5 * np.trace(inertia) * np.eye(3) - inertia


@pytest.mark.parametrize("error", [0.0, 0.1, 0.9])
def test_inertia_differs_by_no_more_than_said_and_is_that_of_a_body(error: float) -> None:
    body = inertia_matrix("J", [2.8, 0.1, -0.2, 0.1, 2.5, 0.05, -0.2, 0.05, 1.9])
    own = np.random.default_rng(5)
    largest = []
    for _ in range(300):
        drawn = perturbed_inertia(body, error, own)
        inertia_matrix("drawn", drawn.ravel())  # raises if no body has it
        shares = linalg.eigvalsh(drawn - body, body)  # relative difference about the worst axes
        largest.append(np.abs(shares).max())
    assert max(largest) <= error + 1e-12
    assert max(largest) >= 0.9 * error  # and it is reached
    # The second moments differ by as much in every draw.
    changes = linalg.eigvalsh(moments(drawn) - moments(body), moments(body))
    assert np.abs(changes).max() == pytest.approx(error, abs=1e-12)


def test_a_plate_stays_a_body() -> None:
    plate = np.diag([1.0, 2.0, 3.0])  # on the edge of the triangle inequality
    own = np.random.default_rng(5)
    for _ in range(100):
        inertia_matrix("drawn", perturbed_inertia(plate, 0.5, own).ravel())


def test_every_run_is_drawn_alone_and_differs_from_others() -> None:
    of = campaign(EVERYTHING, base(), 11)
    assert set(draw(of, 0)) == set(DRAWN)
    backwards = {k: draw(of, k) for k in reversed(range(20))}
    assert [draw(of, k) for k in range(20)] == [backwards[k] for k in range(20)]
    assert len({row["noise_seed"] for row in backwards.values()}) == 20
    assert draw(campaign(EVERYTHING, base(), 12), 0) != backwards[0]


def test_a_variable_left_out_moves_no_other() -> None:
    whole = draw(campaign(EVERYTHING, base(), 11), 4)
    without = {k: v for k, v in EVERYTHING.items() if k not in ("inertia_error", "disturbance")}
    part = draw(campaign(without, base(), 11), 4)
    same = [name for name in DRAWN if not name.startswith(("inertia", "pulse"))]
    assert {n: whole[n] for n in same} == {n: part[n] for n in same}
    assert part["pulse_torque"] is None
    assert part["inertia_error"] == 0.0


def test_streams_of_variables_and_runs_are_independent() -> None:
    of = campaign({}, base(), 11)
    first = [
        stream(of, index, name).random()
        for index in range(DRAWS // 3)
        for name in ("initial_rate", "inertia_error", "disturbance")
    ]
    assert stats.kstest(first, stats.uniform().cdf).pvalue > UNLIKELY
    table = np.array(first).reshape(-1, 3)
    correlation = np.corrcoef(table, rowvar=False)[np.triu_indices(3, 1)]
    assert np.abs(correlation).max() < 4.0 / math.sqrt(len(table))


def test_the_scenario_holds_what_was_drawn_and_the_controller_does_not_know() -> None:
    given = base().with_values(INJECTOR, **pulse(8.0, 0.1, 0.1, 0.0, 0.0))
    of = campaign(EVERYTHING, given, 11)
    drawn: dict[str, Any] = draw(of, 2)
    made: Any = scenario_of_run(of, 2)
    plant, injector = made.parameters[PLANT], made.parameters[INJECTOR]
    assert plant["initial_attitude"] == [drawn[f"initial_attitude_{a}"] for a in "xyzw"]
    assert plant["max_torque"] == 0.05 * drawn["actuator_strength"]
    assert plant["inertia"][0] == drawn["inertia_xx"]
    assert plant["seed"] == drawn["noise_seed"]
    assert plant["rate_noise"] == 1e-7
    assert injector["pulse_times"] == [8.0, drawn["pulse_time"]]
    assert injector["pulse_torques"][3:] == [drawn[f"pulse_torque_{a}"] for a in "xyz"]
    assert made.parameters[CONTROLLER] == given.parameters[CONTROLLER]


CRAFT = load(
    configs("sensors_smallsat"),
    {
        PLANT: {"duration": 1.0, "rate": 50.0},
        REFERENCE: {"mode": "goal", "goals.times": [0.0], "goals.attitudes": [0.0, 0.0, 0.0, 1.0]},
    },
)
WHEELED = load(configs("paper", "wheels"))
UNIFORM = {"distribution": "uniform", "low": 0.01, "high": 0.02}


def test_every_number_of_what_runs_can_be_a_variable() -> None:
    given: dict[str, Any] = {}
    for node in SOURCES:
        for component in components_of(node, CRAFT.parameters[node]):
            for each in component.parameters:
                value: Any = CRAFT.parameters[node][each.name]
                if abs(each.length) == 4:
                    continue  # quaternions vary as a whole
                if each.is_real and isinstance(value, list):
                    given |= {f"{node}.{each.name}[{k}]": x for k, x in enumerate(value)}
                elif each.is_real:
                    given[f"{node}.{each.name}"] = value
    for mirrored in (3, 6, 7):  # the same number of the craft as one above the diagonal
        del given[f"{PLANT}.inertia[{mirrored}]"]
    assert {f"{PLANT}.gyro.initial_bias[2]", f"{REFERENCE}.goals.times[0]"} <= set(given)
    assert f"{ESTIMATOR}.star_tracker.cross_noise" in given
    of, none = campaign({"parameters": given}, CRAFT, 3), campaign({}, CRAFT, 3)
    assert scenario_of_run(of, 1) == scenario_of_run(none, 1)


def test_a_product_of_inertia_acts_whichever_of_its_two_places_is_named() -> None:
    above, below = (
        run_one(campaign({"parameters": {f"{PLANT}.inertia[{k}]": UNIFORM}}, CRAFT, 3), 1).row
        for k in (2, 6)
    )
    assert above["inertia_xz"] == above[f"{PLANT}.inertia[2]"] != 0.0
    assert below["inertia_xz"] == below[f"{PLANT}.inertia[6]"] != 0.0
    beside = {"inertia_error": 0.0, "parameters": {f"{PLANT}.inertia[2]": UNIFORM}}
    drawn: dict[str, Any] = draw(campaign(beside, CRAFT, 3), 1)
    assert drawn["inertia_xz"] == pytest.approx(above["inertia_xz"], rel=1e-9)


def test_sensor_numbers_and_a_goal_that_vary_are_in_run_and_row() -> None:
    bias, goal = f"{PLANT}.gyro.initial_bias[1]", f"{REFERENCE}.goals.attitudes"
    cone = {"distribution": "cone", "angle": 0.5}
    of = campaign({"parameters": {bias: UNIFORM, goal: cone}}, CRAFT, 3)
    row = run_one(of, 1).row
    assert row["error"] is None
    assert run_one(of, 2).row[bias] != row[bias]
    turned = [row[f"{goal}[{k}]"] for k in range(4)]
    assert 0.0 < rotation_angle((turned[0], turned[1], turned[2], turned[3])) < 0.5
    record = rerun(of, 1).record
    still = rerun(campaign({}, CRAFT, 3), 1).record
    assert record.parameters[REFERENCE]["goals.attitudes"] == turned
    change = (record["gyro"] - still["gyro"])[0, :3]
    np.testing.assert_allclose(change, [0.0, row[bias], 0.0], atol=2e-5)  # its resolution


def test_the_examples_of_the_guide_can_be_drawn() -> None:
    guide = (b for b in blocks(ROOT / "docs/how-to.md", "yaml") if b.startswith("campaign:"))
    sensors, losses = (yaml.safe_load(block)["campaign"] for block in guide)
    drawn = draw(campaign(sensors, CRAFT, 0), 0)
    assert drawn[f"{ESTIMATOR}.star_tracker.cross_noise"] == 2e-5
    assert draw(campaign(losses, WHEELED, 0), 0)["fault_duration"] == 30.0


@pytest.mark.parametrize("lasting", [{}, {"duration": UNIFORM}], ids=["for ever", "for a time"])
def test_a_fault_that_is_drawn_acts_from_its_time_behind_those_of_the_scenario(
    lasting: dict[str, Any],
) -> None:
    own = WHEELED.with_values(PLANT, faults=["wheel/2 drag 2"], duration=3.0)
    losses = ["wheel/0 seized", "wheel/1 effectiveness 0.5"]
    time = {"distribution": "uniform", "low": 1.0, "high": 2.0}
    varied = {"initial_rate": {"magnitude": UNIFORM, "direction": "sphere"}}
    of = campaign({**varied, "fault": {"what": losses, "time": time, **lasting}}, own, 3)
    without = campaign(varied, own, 3)
    rows = [run_one(of, index).row for index in range(6)]
    assert {row["fault"] for row in rows} == set(losses)
    for index, row in enumerate(rows):
        assert row["error"] is None
        assert row["initial_rate"] == run_one(without, index).row["initial_rate"]
        text = f"{row['fault']} from {row['fault_time']!r}"
        if lasting:
            text += f" for {row['fault_duration']!r}"
        assert scenario_of_run(of, index).parameters[PLANT]["faults"] == ["wheel/2 drag 2", text]
    record = rerun(of, 1).record
    other = rerun(without, 1).record
    same = (record["attitude"] == other["attitude"]).all(axis=1)
    assert record.t[same][-1] == pytest.approx(rows[1]["fault_time"], abs=0.02)


def test_the_shares_of_each_fault_add_up() -> None:
    one = {"fault": {"what": ["wheel/0 seized", "wheel/1 bias 0"], "time": 1.0}}
    of = campaign(one, WHEELED.with_values(PLANT, duration=2.0), 3)
    summary = Summary(of.required, of.variables)
    for index in range(8):
        summary.add(run_one(of, index).row)
    (_, together), *each = summary.shares()
    assert [name.rpartition(", ")[2] for name, _ in each] == sorted(one["fault"]["what"])
    assert sum(share.judged for _, share in each) == together.judged == 8
    assert sum(share.met for _, share in each) == together.met
    assert list(summary.to_json()["faults"]) == sorted(one["fault"]["what"])


def test_a_reference_that_varies_is_no_part_of_what_runs_have_in_common() -> None:
    given = {"parameters": {f"{REFERENCE}.amplitude[0]": UNIFORM}}
    of = campaign(given, base(duration=2.0), 3)
    verdict = rerun(of, 1)
    record = verdict.record
    assert run_one(of, 1).row["max_rate_deg_s"] == verdict.metrics.max_rate_deg_s
    other = rerun(of, 2).record
    assert (record["reference_attitude"] != other["reference_attitude"]).any()


def test_without_variables_the_run_is_the_scenario_but_for_the_seed_of_its_noise() -> None:
    made = scenario_of_run(campaign({}, base(), 1), 0)
    seed = made.parameters[PLANT]["seed"]
    np.testing.assert_allclose(
        made.parameters[PLANT]["initial_attitude"],  # normalised
        base().parameters[PLANT]["initial_attitude"],
        atol=1e-4,
    )
    attitude_drawn = made.parameters[PLANT]["initial_attitude"]
    expected = base(seed=seed, initial_attitude=attitude_drawn)
    assert made.parameters == expected.parameters
