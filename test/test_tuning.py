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

"""Gains by search: better than those it began with, judged by fresh runs, and no guarantee."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from conftest import Ask
from craft_helpers import overlay

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import Accuracy, Requirements
from ppc_attitude.campaign.declaration import Campaign, campaign, scenario_of_run
from ppc_attitude.campaign.summary import Fraction
from ppc_attitude.campaign.tuning import GAINS, Tuned, cost, tuned
from ppc_attitude.command_line import gain_search
from ppc_attitude.contract.topics import CONTROLLER, PLANT
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load, scenario

GAIN = "quaternion_feedback.natural_frequency"
CUBESAT: dict[str, dict[str, Any]] = {
    "spacecraft_plant": {
        "inertia": [0.28, 0.0, 0.0, 0.0, 0.21, 0.0, 0.0, 0.0, 0.13],
        "max_torque": 0.004,
        "min_torque": 1e-6,
        "rate": 5.0,
        "duration": 120.0,
    },
    CONTROLLER: {
        "controller": "quaternion_feedback",
        "inertia": [0.28, 0.0, 0.0, 0.0, 0.21, 0.0, 0.0, 0.0, 0.13],
        "max_torque": 0.004,
        GAIN: 0.1,
    },
    "disturbance_injector": {"environment": False},
}
REQUIRED = Requirements(settling_deadline=100.0, terminal=None)
EVERY_START = {"initial_attitude": {"distribution": "so3"}}


def cubesat(**controller: Any) -> Campaign:
    base = scenario(CUBESAT | {CONTROLLER: CUBESAT[CONTROLLER] | controller})
    return replace(campaign(EVERY_START, base, seed=0), required=REQUIRED)


def search(candidates: int, required: Requirements = REQUIRED) -> Tuned:
    of = replace(cubesat(), required=required)
    with ThreadPoolExecutor(2) as threads:
        return tuned(of, 60.0, threads, runs=3, fresh=12, candidates=candidates)


def test_a_search_settles_sooner_than_the_gains_it_began_with() -> None:
    begun, found = search(1), search(24)
    assert begun.gains[GAIN] == 0.1
    assert set(found.gains) == set(GAINS["quaternion_feedback"])
    assert found.fraction.judged == 12
    assert begun.missed["settling time"] == 12 - begun.fraction.met
    assert found.fraction.met > begun.fraction.met
    assert found.settling[0] < min(begun.settling[0], 80.0)
    assert list(found.never_met) == []


def test_what_no_gains_can_meet_is_told_from_what_some_runs_miss() -> None:
    found = search(10, replace(REQUIRED, rate=1e-3, settling_deadline=80.0))
    assert list(found.never_met) == ["angular rate (norm)"]
    assert found.missed["settling time"] < found.missed["angular rate (norm)"] == 12


def test_a_search_ends_between_two_runs_when_its_time_is_over(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A generation of long runs went on for an hour."""
    flown, clock = list[int](), count()
    monkeypatch.setattr(
        "ppc_attitude.campaign.tuning._verdict", lambda *told: flown.append(told[1])
    )
    with ThreadPoolExecutor(1) as threads:
        found = tuned(cubesat(), 10.0, threads, runs=3, fresh=1, now=lambda: next(clock))
    assert found.candidates == 3
    assert flown == [0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1, 3]


def test_runs_that_break_are_counted_among_the_misses() -> None:
    inertia = {"distribution": "choice", "values": [0.28, 9.0]}  # the latter belongs to no body
    varied = {**EVERY_START, "parameters": {"spacecraft_plant.inertia[0]": inertia}}
    of = replace(campaign(varied, scenario(CUBESAT), seed=0), required=REQUIRED)
    with ThreadPoolExecutor(2) as threads:
        found = tuned(of, 60.0, threads, runs=1, fresh=12, candidates=1)
    broken = found.missed["the run broke"]
    assert 0 < broken <= 12 - found.fraction.met


@pytest.mark.filterwarnings("ignore:overflow encountered")
def test_gains_with_which_a_run_diverges_cost_more_than_any_that_are_merely_slow() -> None:
    strong = {node: values | {"max_torque": 1e6} for node, values in CUBESAT.items()}
    strong["disturbance_injector"] = CUBESAT["disturbance_injector"]
    of = replace(
        campaign(EVERY_START, scenario(strong), seed=0), required=replace(REQUIRED, rate=None)
    )

    def costs(frequency: float) -> float:
        gains = {GAIN: frequency}
        case = scenario_of_run(of, 0).with_values(CONTROLLER, **gains)
        return cost(Verdict(simulate(case, of.duration), of.required))

    slow, diverging = costs(1e-3), costs(15.0)  # a sample lasts three times as long
    assert 10.0 < slow < diverging == cost(None)


def test_two_runs_of_which_one_meets_all_are_better_than_two_that_each_miss_little() -> None:
    """The search found gains of which few runs met all, as long as none missed anything by far."""
    case = scenario_of_run(cubesat(), 0)
    record = simulate(case.with_values(CONTROLLER, **{GAIN: 0.3}), 120.0)

    def costs(**limits: Any) -> float:
        verdict = Verdict(record, replace(REQUIRED, **limits))
        assert verdict.all_met is not bool(limits)
        return cost(verdict)

    reached = Verdict(record, REQUIRED).metrics.max_rate_deg_s
    by_little = costs(rate=0.99 * reached)
    by_far = costs(rate=0.1, settling_deadline=10.0, terminal=Accuracy(1e-12))
    assert costs() + by_far < 2.0 * by_little


def test_a_law_whose_gains_are_not_searched_is_named() -> None:
    with (
        ThreadPoolExecutor(1) as threads,
        pytest.raises(ConfigurationError, match="controller = log_barrier; allowed for a search"),
    ):
        tuned(cubesat(controller="log_barrier"), 1.0, threads)


@pytest.mark.parametrize(
    ("gain", "varies", "told"),
    [
        (0.0, {}, "K_omega = 0; allowed: > 0"),
        (2.3, {"parameters": {f"{CONTROLLER}.K_omega": 2.0}}, "the campaign varies K_omega"),
    ],
)
def test_a_gain_that_no_search_would_change_or_keep_is_refused(
    gain: float, varies: dict[str, Any], told: str
) -> None:
    """A zero has no logarithm, and what is drawn of a gain would be overwritten."""
    given = {CONTROLLER: {"K_omega": gain}, "spacecraft_plant": {"duration": 60.0}}
    of = campaign(varies, scenario(given), seed=0)
    with ThreadPoolExecutor(1) as threads, pytest.raises(ConfigurationError, match=told):
        tuned(of, 1.0, threads)


def test_design_writes_gains_and_says_that_they_are_no_guarantee(
    tmp_path: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A fast machine would try others than the configured gains within the time.
    monkeypatch.setattr(gain_search, "tuned", partial(tuned, fresh=20, candidates=1))
    craft, gains = overlay(tmp_path / "craft.yaml", CUBESAT), tmp_path / "gains.yaml"
    law = ["--controller", "quaternion_feedback", "--seconds", 0.01, "--rate", 0.5]
    told = ask("design", "--config", craft, *law, "--output", gains, code=1).out
    assert "sets of gains: quaternion_feedback.natural_frequency = 0.1, " in told
    assert "of 20 fresh runs meet every requirement that they are judged by: " in told
    assert "no guarantee" in told
    values = load([craft, gains]).parameters[CONTROLLER]
    assert values[GAIN] == 0.1
    assert math.isfinite(values["quaternion_feedback.damping"])
    assert "check warns" not in told
    declared = tmp_path / "varies.yaml"
    declared.write_text(f"campaign: {{parameters: {{{CONTROLLER}.{GAIN}: 0.2}}}}\n")
    varies = ["--config", craft, *law[:4], "--campaign", declared]
    assert f"the campaign varies {GAIN}" in ask("design", *varies, code=2).err
    hard = tmp_path / "hard.yaml"
    hard.write_text("rate: 1.0e-3\n")  # [deg/s]
    told = ask("design", "--config", craft, *law, "--requirements", hard, code=1).out
    assert "no gains met, in any run of the search: angular rate (norm)" in told
    law[1] = "ppc"  # with the D_m of another craft
    told = ask("design", "--config", craft, *law, code=1).out
    assert "warning: check warns of these gains: loop margin, torque at rest" in told


@pytest.mark.parametrize(("met", "code", "settled"), [(20, 0, "60.0 s"), (19, 1, "not always")])
def test_gains_are_sought_for_the_starts_and_the_requirements_that_are_asked_for(
    tmp_path: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch, met: int, code: int, settled: str
) -> None:
    asked = list[Campaign]()

    def judged(of: Campaign, *_: object, **__: object) -> Tuned:
        asked.append(of)
        longest = math.inf if code else 60.0
        return Tuned({GAIN: 0.1}, 1, Fraction(met, 20), (50.0, longest), {})

    monkeypatch.setattr(gain_search, "tuned", judged)
    craft, limits = overlay(tmp_path / "craft.yaml", CUBESAT), tmp_path / "limits.yaml"
    words = ["--config", craft, "--controller", "quaternion_feedback", "--requirements", limits]
    limits.write_text("settling_deadline: 120.0\n")  # as long as a run
    told = ask("design", *words, "--rate", 2.0, "--output", tmp_path / "gains.yaml", code=code).out
    assert settled in told
    assert told.endswith(f"\n{tmp_path / 'gains.yaml'}\n")
    assert asked[0].required.settling_deadline == 120.0
    starts = (scenario_of_run(asked[0], index).parameters[PLANT] for index in range(50))
    rates = [math.dist(start["initial_angular_velocity"], (0.0, 0.0, 0.0)) for start in starts]
    assert 0.9 < max(rates) / math.radians(2.0) <= 1.0
    limits.write_text("settling_deadline: 120.5\n")
    assert "shorter runs cannot be judged" in ask("design", *words, code=2).err
