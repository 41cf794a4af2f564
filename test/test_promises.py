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

"""What is promised of a craft: by which proof, by how much, and when nothing is."""

import math
from dataclasses import replace
from functools import cache
from itertools import product as pairs
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Ask
from craft_helpers import case, configs, guaranteed, overlay, pulse
from test_guarantee import broken, complete, values_of

from ppc_attitude.analysis.guarantee import nodes_around
from ppc_attitude.analysis.truth import pointing_errors
from ppc_attitude.command_line import guarantee_view
from ppc_attitude.command_line.guarantee_view import (
    Judgement,
    promise_lines,
    time_text,
)
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, PLANT, REFERENCE
from ppc_attitude.science.attitude import product, unit_quaternion
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guarantee import design
from ppc_attitude.science.guarantee.arithmetic import FLOATS
from ppc_attitude.science.guarantee.assumptions import (
    Assumptions,
    Law,
    assumptions_of,
    law_of,
    parameters_of,
)
from ppc_attitude.science.guarantee.bounds import Bounds
from ppc_attitude.science.guarantee.cells import COARSE, Speed, cells
from ppc_attitude.science.guarantee.certificate import Certificate, Promise, certify
from ppc_attitude.science.guarantee.design import Wishes, designed
from ppc_attitude.science.guarantee.envelope import Envelope
from ppc_attitude.science.guarantee.fixed_point import InfeasibleError, tuned
from ppc_attitude.science.guarantee.surroundings import assumptions_from, suspensions
from ppc_attitude.science.guidance.rotation import about
from ppc_attitude.science.kinds import ENVIRONMENTS, REFERENCES, Kind
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load


def test_full_inertia_and_every_error_are_designed_and_proved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(design, "FINE", (80, 2, 2))  # searched on these, and proved on fine ones
    assumed, _ = guaranteed()
    full = (2.8, 0.1, -0.05, 0.1, 2.5, 0.08, -0.05, 0.08, 1.9)
    poor = replace(assumed, inertia=full, eta=0.8, e_S=0.05, e_A=1e-4, e_W=1e-5)
    found = designed(poor, Wishes(), 0.01, (0.6, 20.0, 0.5))
    certificate = certify(complete(poor, found.law), rates=(1.0,))
    assert certificate.holds
    assert certificate.promises[0].time < 130.0


def test_late_commands_are_refused_with_the_momentum_observer() -> None:
    """The proof leaves them out, yet given gains were certified, and a search could find some."""
    assumed = replace(guaranteed()[0], late=1.0)
    tuned(assumed, 0.01, (0.6, 20.0, 1.0), COARSE)
    with pytest.raises(InfeasibleError, match="C5 ℓ fails"):
        tuned(assumed, 0.01, (0.6, 20.0, 0.5), COARSE)


def test_errors_of_what_a_ramp_adds_are_part_of_those_of_F() -> None:
    """With r' = k the law errs in r' f n besides, by k times the change of v with the attitude."""
    assumed, law = noisy()
    bounds = Bounds(assumed, law, FLOATS, COARSE)
    number = (law.k, bounds.a, bounds.a_most, law.Omega_e, assumed.W, assumed.W1, assumed.W2)
    speed = Speed(*number, law.z_bar, assumed.e_A, bounds.e_w, FLOATS)
    for each in cells(speed, law.Omega_e - assumed.W - 2.0 * law.h * law.V_rate, COARSE):
        error = each.error + law.k * each.lipschitz * assumed.e_A
        for row, noise in zip(bounds.body.row, bounds.torque_noise, strict=True):
            assert row * error <= noise


@pytest.mark.parametrize("eta", [0.4, 0.6])
def test_what_a_weak_actuator_makes_of_errors_of_y_is_in_the_tube(eta: float) -> None:
    """By 1 / (1 - 2 (1 - η) x): below η = 1/2 that is more than what the rest of D is spread by."""
    exact, law = guaranteed()
    law = replace(law, kappa=8.0)
    x = law.kappa * law.h * (1.0 - law.ell) / law.ell
    weak = 1.0 - 2.0 * (1.0 - eta) * x
    without, told = (
        Bounds(replace(exact, eta=eta, e_W=e_W), law, FLOATS, COARSE) for e_W in (0.0, 1e-4)
    )
    for Y, more, N, N_F in zip(without.Y, told.Y, told.noise, told.torque_noise, strict=True):
        assert more - Y >= N / weak + N_F * (1.0 + x / weak) / law.kappa


def test_of_a_hit_that_may_not_be_seen_no_time_is_promised() -> None:
    """The proof begins at an event: a weaker torque leads out of the tube, and makes none."""
    assumed, law = guaranteed()
    envelope = Envelope(Bounds(assumed, law, FLOATS, COARSE))
    assert envelope.recovery(0.16, 0.1, 5e-3) < 5.0
    with pytest.raises(ValueError, match=r"is promised only of hits above 0\.153 N·m"):
        envelope.recovery(0.15, 0.1, 5e-3)
    # Of a tube that is narrow for its sample a torque leads out that the own actuator explains. The
    # law then takes that for weak, and counts on less of it, which makes the recovery longer.
    quiet = replace(assumed, d=2e-4, W=1e-3, W1=1e-5, W2=1e-7)
    narrow = tuned(quiet, 0.05, (0.1, 4.0, 1.0), COARSE)
    assert max(narrow.Y) / 0.05 + 4.0 * max(narrow.Y) + 3.0 * 2e-4 < 0.007
    with pytest.raises(ValueError, match=r"is promised only of hits above 0\.051\d N·m"):
        Envelope(Bounds(quiet, narrow, FLOATS, COARSE)).recovery(0.05, 0.1, 5e-3)


def test_scheduled_pulses_beyond_the_assumed_disturbance_are_told() -> None:
    """A time was promised for a start amid which the craft is hit, without a word of that."""

    def told(duration: float, **injector: Any) -> list[str]:
        base = load(configs("paper", "guaranteed", "sudden_disturbance"), {INJECTOR: injector})
        return [*suspensions(guaranteed()[0], nodes_around(base.parameters), duration)]

    assert len(told(120.0)) == 1
    assert "reach 0.5044 N·m from 20 s on, by a scheduled pulse" in told(120.0)[0]
    assert told(20.0) == []  # when it begins, the run is over
    overlapping = {"pulse_times": [5.0, 4.0], "pulse_durations": [1.0, 2.0]}
    weak = {"environment": "none", "pulse_torques": [0.003, 0.0, 0.0, 0.0, 0.004, 0.0]}
    assert told(120.0, **overlapping, **weak) == []
    weak["pulse_torques"] = [0.003, 0.0, 0.0, 0.002, 0.0, 0.0]
    assert "reach 0.005 N·m from 5 s on" in told(120.0, **overlapping, **weak)[0]


def test_of_a_hit_that_may_make_the_craft_tumble_no_time_is_promised() -> None:
    envelope = Envelope(Bounds(*guaranteed(), FLOATS, COARSE))
    with pytest.raises(ValueError, match="may make the craft tumble: it may gain"):
        envelope.recovery(1.0, 1.0, 5e-3)


def test_a_settled_craft_recovers_from_hits_within_the_promised_time() -> None:
    """It gains no more, and turns no further, than the promise allows for."""
    envelope, chance = Envelope(Bounds(*guaranteed(), FLOATS)), np.random.default_rng(1)
    most = 0.0
    for torque, duration in pairs((0.2, 0.5, 0.8), (0.025, 0.1)):
        time = envelope.recovery(torque, duration, 5e-3)
        turn, rate, _ = envelope.after_hit(torque, duration)
        for _ in range(4):
            begin = float(chance.uniform(60.0, 70.0))
            hit = pulse(begin, duration, *(torque * chance.choice([-1.0, 1.0], 3)).tolist())
            record = simulate(load(configs("paper", "guaranteed"), {INJECTOR: hit}), 85.0)
            after = record.t >= begin
            error = np.linalg.norm(record["attitude_error"][after, :3], axis=1)
            assert np.abs(record["attitude_error"][record.t > begin + time, :3]).max() < 5e-3
            struck = record.t[after] <= begin + duration + 0.01
            assert 2.0 * np.arcsin(error[struck].max()) <= turn
            gained = np.linalg.norm(record["rate_error"][after][struck], axis=1).max()
            assert gained <= rate
            most = max(most, float(gained / rate))
    assert most > 0.8


def test_a_hit_gains_more_rate_where_the_inertia_is_smaller_than_the_law_knows() -> None:
    """By up to ε√3 in the proof; without that the craft was faster than the promise allowed for."""
    assumed = replace(guaranteed()[0], e_S=0.1, d=2e-4, W=2e-3, W1=1e-5, W2=1e-7)
    law = designed(assumed, Wishes(), 0.01, (1.0, 20.0, 1.0), COARSE).law
    envelope = Envelope(Bounds(assumed, law, FLOATS, COARSE))
    lighter = (0.9 * np.array(assumed.inertia)).tolist()
    given = {
        PLANT: {"inertia": lighter, "initial_attitude": [0.2, -0.5, -0.5, -0.6782]},
        REFERENCE: {"amplitude": [0.0, 0.0, 0.0]},
        INJECTOR: {"environment": "none", **pulse(1.0, 0.01, 8.0, 8.0, 8.0)},
        CONTROLLER: parameters_of(assumed, law),
    }
    record = simulate(load(configs("paper", "guaranteed"), given), 1.02)
    gained = np.linalg.norm(record["rate_error"], axis=1).max()
    assert 0.8 * envelope.after_hit(8.0, 0.01)[1] < gained < envelope.after_hit(8.0, 0.01)[1]
    blind = replace(assumed, e_S=0.5)  # its law is another one, but so is a hit seen by it
    with pytest.raises(ValueError, match=r"e_S = 0\.5, so no recovery time is promised"):
        Envelope(Bounds(blind, law, FLOATS, COARSE)).recovery(8.0, 0.01, 5e-3)


def test_a_hit_counts_as_long_as_it_acts_which_is_from_sample_to_sample() -> None:
    """Of 2.5 N·m for 10.1 ms, which act for 20, 1.23 s were promised, and it took 1.87 s."""
    judgement = Judgement(load(configs("paper", "guaranteed")), configs("paper", "guaranteed"))
    longer, whole = (judgement.of_hit(2.5, duration) for duration in (0.0101, 0.02))
    assert longer.replace("for 0.0101 s", "for 0.02 s") == whole


def test_a_craft_that_has_just_settled_is_promised_no_recovery() -> None:
    """It still moves: of 2.5 N·m for 10 ms it recovered after 1.29 s, and 1.18 s were promised."""
    base = load(configs("paper", "guaranteed"))
    promised = Judgement(base, configs("paper", "guaranteed")).of_hit(2.5, 0.01)
    assert "again 1.18 s after" in promised
    assert "follows its brake (phase 3) within its final bound, ‖q_ev‖ ≤ 0.00043" in promised
    x = -4.99e-3
    desired = unit_quaternion("q", base.parameters[REFERENCE]["initial_attitude"])
    near = product(desired, (x, x, x, math.sqrt(1.0 - 3.0 * x * x)))
    hit = {"environment": "none", **pulse(0.0, 0.01, -2.5, -2.5, -2.5)}
    given = {PLANT: {"initial_attitude": list(near)}, INJECTOR: hit}
    record = simulate(load(configs("paper", "guaranteed"), given), 10.0)
    error = pointing_errors(record).sizes
    assert error[0] < 5e-3
    assert record.t[error >= 5e-3][-1] > 1.18


def test_who_begins_within_the_accuracy_is_not_promised_to_stay_there_at_once() -> None:
    """While the brake sets in nothing holds φ back: just below it took less than just above."""
    envelope = Envelope(Bounds(*guaranteed(), FLOATS))
    drift, stop = envelope.stop(0.01)
    begin = envelope.settled(5e-3) - drift
    below, above = (envelope.near_time(begin + each, 0.01, 5e-3) for each in (-1e-9, 1e-9))
    assert below == above > stop + 0.1


@pytest.mark.parametrize("share", [0.2, 0.27, 0.4])
def test_a_refusal_shows_numbers_that_fail(share: float) -> None:
    """An infinite bound had no room to compare: any refusal could be told for the nearest."""
    assumed, law = guaranteed()
    slow = replace(assumed, Omega=share * assumed.Omega)
    with pytest.raises(InfeasibleError) as refusal:
        tuned(slow, law.h, (law.k, law.kappa, law.ell), COARSE)
    assert refusal.value.failing.room < 0.0


@pytest.mark.parametrize(
    ("changed", "kappa", "told"),
    [
        ({"d": 0.06}, 15.4, "C2: the torque exceeds the disturbance"),
        ({"late": 1.0}, 60.0, "C1: the tube is finite"),
        ({"W1": 0.02}, 15.4, "C3: feedforward and tube leave torque to brake with"),
    ],
)
def test_a_refusal_tells_what_is_too_much(
    changed: dict[str, float], kappa: float, told: str
) -> None:
    assumed, law = guaranteed()
    with pytest.raises(InfeasibleError) as refusal:
        tuned(replace(assumed, **changed), law.h, (law.k, kappa, law.ell), COARSE)
    failing = refusal.value.failing
    assert f"{failing.name}: {failing.meaning}" == told


def test_of_a_start_that_is_too_fast_or_a_law_that_is_wrong_nothing_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(guarantee_view, "balls", lambda: FLOATS)
    monkeypatch.setattr(guarantee_view, "RATES", ())
    judged = Judgement(load(configs("paper", "guaranteed")), [])
    assert len(judged.of_start(1.0, 0.01)) == 1
    assert judged.of_start(1.0, 0.2) == []
    wrong = {CONTROLLER: {"momentum_tube.Y": [1e-5, 1e-5, 1e-5]}}
    lines = Judgement(load(configs("paper", "guaranteed"), wrong), []).lines()
    assert any(line.startswith("  not proved: C1 x, C1 y, C1 z") for line in lines)


def test_an_accuracy_within_the_tube_is_never_promised() -> None:
    with pytest.raises(ValueError, match=r"\|q_ev,i\| < 1e-09 is never guaranteed: the tube leads"):
        certify(values_of(), 1e-9, (0.0,), FLOATS)


OMEGA_D = math.radians(0.7072)  # ‖ω_d(0)‖ of the paper's reference, for a craft at rest


@cache
def noisy() -> tuple[Assumptions, Law]:
    """A law for the paper's craft, whose rate is measured to 5e-4 rad/s."""
    assumed = replace(guaranteed()[0], e_A=1e-4, e_W=5e-4)
    return assumed, tuned(assumed, 0.01, (0.56, 28.0, 0.4), COARSE)


def test_no_time_is_promised_of_a_start_that_may_be_told_to_tumble() -> None:
    assumed, law = noisy()
    e_w = Bounds(assumed, law, FLOATS, COARSE).e_w
    fastest = math.degrees(law.omega0 - assumed.W)
    rates = [fastest - math.degrees(each * e_w) for each in (1.1, 0.9)]
    promised = [each.rate for each in certify(complete(assumed, law), rates=rates).promises]
    assert promised == rates[:1]


def test_a_stop_lasts_no_longer_than_what_the_law_is_told_allows() -> None:
    """The rate of the start alone was counted, though the law takes away what it is told."""
    assumed, law = noisy()
    nodes = {
        PLANT: {"faults": ["sensor/rate bias 5e-4 0 0"]},
        REFERENCE: {"amplitude": [0.0] * 3},
        CONTROLLER: parameters_of(assumed, law),
    }
    given = load(configs("paper", "guaranteed"), nodes)
    record = simulate(given, 1.0)
    lasted = float(record.t[record["phase"][:, 0] == 1.0][-1])
    bounds = Bounds(assumed, law, FLOATS, COARSE)
    envelope = Envelope(bounds)
    assert envelope.stop(0.0)[1] < lasted <= envelope.stop(envelope.told(0.0))[1]
    exact = Bounds(replace(assumed, e_A=0.0, e_W=0.0), law, FLOATS, COARSE)
    noise = [x / row for x, row in zip(bounds.torque_noise, bounds.body.row, strict=True)]
    assert min(noise) <= exact.reserve - bounds.reserve <= max(noise)


@cache
def envelope_of(name: str) -> Envelope:
    values = load(configs("paper", name)).parameters[CONTROLLER]
    return Envelope(Bounds(assumptions_of(values), law_of(values), FLOATS))


@pytest.mark.parametrize(
    ("name", "time"),
    [("guaranteed_sharp", 23.2), ("guaranteed", 23.8), ("guaranteed_quiet", 25.7)],
)
def test_the_papers_start_settles_when_an_independent_prototype_promised(
    name: str, time: float
) -> None:
    promised = envelope_of(name).settling(OMEGA_D, 5e-3, math.radians(42.714))
    assert promised == pytest.approx(time, abs=0.2)


def test_a_smaller_turn_takes_no_longer_and_half_a_turn_what_every_attitude_does() -> None:
    for name in ("guaranteed", "guaranteed_ahead"):  # the second may go the other way round
        envelope = envelope_of(name)
        turns = np.radians([0.0, 1.0, 20.0, 60.0, 120.0, 140.0, 150.0, 170.0, 180.0])
        times = [envelope.settling(OMEGA_D, 5e-3, turn) for turn in turns]
        assert times == sorted(times)
        assert times[0] < 10.0
        assert times[-1] == envelope.settling(OMEGA_D, 5e-3)


@pytest.mark.parametrize("turn", [3.0, 30.0, 80.0, 130.0, 179.0])
def test_a_start_settles_as_soon_as_is_promised_for_its_turn(turn: float) -> None:
    """Judged by the motion: about five axes each, with the paper's environment and reference."""
    scenario = load(configs("paper", "guaranteed"))
    q_d = scenario.parameters[REFERENCE]["initial_attitude"]
    promised = envelope_of("guaranteed").settling(OMEGA_D, 5e-3, math.radians(turn))
    for axis in np.random.default_rng(5).normal(size=(5, 3)):
        q_s = product(tuple(q_d), about(tuple(axis / np.linalg.norm(axis)), math.radians(turn)))
        record = simulate(scenario.with_values(PLANT, initial_attitude=[*q_s]), 100.0)
        assert record.t[pointing_errors(record).sizes >= 5e-3][-1] < promised


def test_what_is_promised_is_told_as_no_more_than_is_proved() -> None:
    promises = (Promise(5.0, 109.454), Promise(1.0, 91.75))
    certificate = Certificate("", 0.005, (), promises, 1.241e-3)
    late, exact, end = promise_lines(certificate, assumptions_of(values_of()))[:3]
    assert "from t = 109.46 s on" in late
    assert "from t = 91.75 s on" in exact
    assert end.endswith("≤ 0.0013 in the end")
    assert time_text(71.1701) == "71.18"


SLOW = {"mode": "goal", "guidance.max_rate": 1e-3}
SLOW |= {"guidance.max_acceleration": 1e-6, "guidance.max_jerk": 1e-7}


@pytest.mark.parametrize(
    ("kind", "hook", "told", "bound"),
    [
        (REFERENCES, "motion_bounds", "mode = paper", "W2"),
        (ENVIRONMENTS, "bound", "environment = paper", "d"),
    ],
)
def test_of_what_has_no_known_bounds_nothing_is_promised(
    kind: Kind, hook: str, told: str, bound: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    unbounded = replace(kind.components["paper"], **{hook: None})
    monkeypatch.setitem(kind.components, "paper", unbounded)
    scenario = case("guaranteed")
    assert broken(scenario) == [f"{told}: whether it keeps the assumed bounds is not known"]
    nodes, law = nodes_around(scenario.parameters), scenario.parameters[CONTROLLER]
    with pytest.raises(ConfigurationError, match=f"{told} tells no bound {bound}: give it with"):
        assumptions_from(nodes, law, {"W": 0.01, "W1": 0.01})


def test_a_reference_at_rest_and_a_given_error_are_assumed_as_they_are() -> None:
    scenario = load(configs("paper", "guaranteed"), {REFERENCE: {"amplitude": [0.0, 0.0, 0.0]}})
    nodes, law = nodes_around(scenario.parameters), scenario.parameters[CONTROLLER]
    assumed = assumptions_from(nodes, law, {"e_W": 1e-3})
    assert (assumed.W, assumed.W1, assumed.W2, assumed.e_W) == (0.0, 0.0, 0.0, 1e-3)


@pytest.mark.parametrize(
    ("node", "values", "option", "told"),
    [
        (REFERENCE, SLOW, ("--known-reference",), "mode = goal; allowed with --known-reference: p"),
        (PLANT, {"rate": 50.0}, ("--known-reference",), "so no time is guaranteed"),
        (PLANT, {"rate": 50.0}, ("--hit", "0.5", "0.1"), "so no recovery is guaranteed"),
    ],
)
def test_what_is_asked_where_nothing_can_be_told_is_refused(
    node: str, values: dict[str, Any], option: tuple[str, ...], told: str, tmp_path: Path, ask: Ask
) -> None:
    files = [*configs("paper", "guaranteed"), overlay(tmp_path / "own.yaml", {node: values})]
    assert told in ask("check", *(f"--config={file}" for file in files), *option, code=2).err
