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

"""How far a loop is from oscillating: against closed forms, and against runs that oscillate."""

import math
from typing import Any

import numpy as np
import pytest
from conftest import Ask
from craft_helpers import case, configs

from ppc_attitude.command_line.proportions import actuator_torques
from ppc_attitude.contract.topics import ALLOCATOR, CONTROLLER, INJECTOR, PLANT, REFERENCE
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.loop_margin import LEAST, LoopMargin, loop_margin
from ppc_attitude.simulation.scenario import Scenario


def margin_of(scenario: Scenario, at: float = 60.0) -> LoopMargin:
    return loop_margin(scenario, at, actuator_torques(scenario)[1])


def swings(found: LoopMargin) -> bool:
    """Whether the loop has no margin, or swings by itself and is stable about that."""
    return found.disk < 0.01 or found.swing > 5e-4


def linear(**values: float) -> Scenario:
    """The paper's craft with quaternion feedback."""
    law = {f"quaternion_feedback.{name}": value for name, value in values.items()}
    return case(rate=10.0, min_torque=0.0).with_values(
        CONTROLLER, controller="quaternion_feedback", **law
    )


@pytest.mark.parametrize(
    ("disk", "gain", "phase"), [(0.0, 1.0, 0.0), (1.0, 3.0, 53.130102), (2.0, math.inf, 90.0)]
)
def test_gain_and_phase_are_those_of_the_published_formulas(
    disk: float, gain: float, phase: float
) -> None:
    found = LoopMargin(disk, frequency=1.0, fades=1.0, swing=0.0)
    assert (found.gain, found.phase) == pytest.approx((gain, phase))


def test_an_axis_that_the_law_leaves_alone_has_no_margin() -> None:
    """The others have come to rest when its first answer is still to come."""
    alone = np.diag([2.8, 2.8, 2.8e-9]).ravel().tolist()
    loop = linear(natural_frequency=1.0)
    assert margin_of(loop).disk > 1.0
    found = margin_of(loop.with_values(CONTROLLER, inertia=alone))
    assert (found.disk, found.fades) == (0.0, 60.0)  # for so long it was listened to


@pytest.mark.filterwarnings("ignore:overflow encountered", "ignore:invalid value encountered")
def test_a_loop_whose_torque_soon_is_no_number_has_no_margin() -> None:
    """A sample lasts three times as long as the law can bear, and nothing limits the torque."""
    loop, strong = linear(natural_frequency=3.0), {"max_torque": 1e6}
    loop = loop.with_values(PLANT, rate=1.0, **strong).with_values(CONTROLLER, **strong)
    assert margin_of(loop, 0.0) == LoopMargin(0.0, 0.0, fades=60.0, swing=math.inf)


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize(
    ("natural_frequency", "damping", "integral_time", "size"),
    [(1.0, 1.0, 10.0, 1.0), (3.0, 0.7, 5.0, 1e-3), (0.5, 0.4, 20.0, 1.0)],
)
def test_the_margin_of_a_linear_loop_is_that_of_the_closed_form(
    natural_frequency: float, damping: float, integral_time: float, size: float, late: bool
) -> None:
    """By the transfer function L(z) from the torque on the craft to the torque of the law."""
    loop = linear(
        natural_frequency=natural_frequency, damping=damping, integral_time=integral_time
    ).with_values(PLANT, late_command=late)
    for node in (PLANT, CONTROLLER):
        given = loop.parameters[node]
        inertia = np.multiply(size, given["inertia"]).tolist()
        loop = loop.with_values(node, inertia=inertia, max_torque=size * given["max_torque"])
    found = margin_of(loop, 0.0)  # from its first instant on it rests
    h = 0.1
    z = np.exp(1j * np.linspace(1e-4, math.pi, 200_001))
    rate = h / (z - 1.0)
    angle = 0.5 * h * h * (z + 1.0) / (z - 1.0) ** 2
    integral = 1.0 + h / integral_time * z / (z - 1.0)
    L = 2.0 * damping * natural_frequency * rate + natural_frequency**2 * angle * integral
    S = 1.0 / (1.0 + L / z**late)
    assert found.disk == pytest.approx(1.0 / np.abs(S - 0.5).max(), rel=2e-3)
    answers = np.abs(np.fft.irfft(S - 1.0))  # to a torque of one sample
    large = np.flatnonzero(answers[:10_000] > 0.01 * answers.max())
    assert found.fades == pytest.approx(h * (large[-1] + 1.0), abs=1.01 * h)
    assert found.swing == 0.0


@pytest.mark.parametrize("rate", [10.0, 1000.0])
def test_the_margin_is_that_of_the_loop_where_rounding_would_hide_small_answers(
    rate: float,
) -> None:
    """So little torque for so much inertia that 1e-7 of it turns the craft by less than 1e-16."""
    heavy, light = (np.multiply(size, np.eye(3)).ravel().tolist() for size in (2e4, 2.0))
    loop = linear(natural_frequency=0.3).with_values(PLANT, rate=rate)
    large, small = (
        loop.with_values(PLANT, inertia=each).with_values(CONTROLLER, inertia=each)
        for each in (heavy, light)
    )
    assert margin_of(large).disk == pytest.approx(margin_of(small).disk, rel=0.01)


def test_a_filter_at_a_high_rate_does_not_take_the_margin_away() -> None:
    slow, fast = (case("sensors_flagship").with_values(PLANT, rate=x) for x in (100.0, 1000.0))
    assert margin_of(fast).disk == pytest.approx(margin_of(slow).disk, rel=0.02)


@pytest.mark.parametrize("rate", [10.0, 100.0])
def test_a_slow_loop_has_the_margin_of_a_fast_one(rate: float) -> None:
    """One that needs a half an hour to come to rest."""
    fast, slow = (
        linear(natural_frequency=w, integral_time=6.0 / w).with_values(PLANT, rate=rate)
        for w in (0.1, 0.01)
    )
    assert margin_of(slow).disk == pytest.approx(margin_of(fast).disk, rel=0.03)
    assert margin_of(slow).fades > 500.0


@pytest.mark.parametrize(("damping", "told"), [(0.01, False), (0.0012, True)])
def test_a_mode_that_grows_slowly_is_heard(damping: float, told: bool) -> None:
    """Its part of the first answer is below 1 %, and grows by a sixth in 80 s."""
    bending = {
        "plant": "flexible",
        "flexible.frequency": [0.13, 0.69],
        "flexible.damping": [damping, damping],
        "flexible.coupling": [-0.46, -0.118, -0.115, 0.088, -0.314, 0.124],
    }
    law = {"rate_observer": 1.6, "disturbance_feedforward": True, "max_disturbance": 0.02}
    loop = linear(natural_frequency=2.75, damping=0.86, integral_time=5.3)
    loop = loop.with_values(CONTROLLER, **law).with_values(PLANT, rate=200.0, **bending)
    assert (margin_of(loop).disk == 0.0) == told


@pytest.mark.parametrize(("share", "stable"), [(0.99, True), (1.01, False)])
def test_the_gain_that_is_told_is_where_the_loop_begins_to_swing(
    share: float, stable: bool
) -> None:
    """The paper's loop is worst at half the rate of its samples, where the bound is exact."""
    paper = case()
    told = margin_of(paper)
    assert told.frequency == pytest.approx(50.0, rel=0.01)
    lighter = np.multiply(paper.parameters[PLANT]["inertia"], 1.0 / (share * told.gain)).tolist()
    found = margin_of(paper.with_values(PLANT, inertia=lighter))
    assert (found.disk > 0.0) == stable


@pytest.mark.parametrize(
    ("frequency", "damping", "time", "told"),
    [
        (0.95, 1.0, 10.0, False),
        (1.05, 1.0, 10.0, True),
        (0.52, 2.0, 10.0, True),
        (0.42, 0.1, 10.0, True),
        (1.05, 0.3, 1.0, True),
        (0.35, 0.1, 2.0, True),
        (0.05, 1.0, 1.2, False),
        (0.05, 1.0, 0.9, True),
    ],
)
def test_a_linear_loop_that_swings_has_no_margin(
    frequency: float, damping: float, time: float, told: bool
) -> None:
    loop = {"natural_frequency": 10.0 * frequency, "damping": damping, "integral_time": time}
    law = {f"quaternion_feedback.{name}": value for name, value in loop.items()}
    fast = case(rate=10.0).with_values(CONTROLLER, controller="quaternion_feedback", **law)
    assert swings(margin_of(fast)) == told
    run = simulate(fast, 200.0)
    torque = np.abs(run["torque_command"][run.t > 150.0])
    assert bool(torque.max() > 0.02) == told  # the environment has up to 4.4 mN·m


@pytest.mark.parametrize(
    ("size", "width", "told"),
    [(0.0083, 5e-3, False), (0.0077, 5e-3, True), (1.0, 6.6e-4, False), (1.0, 5.5e-4, True)],
)
def test_a_barrier_that_swings_has_no_margin(size: float, width: float, told: bool) -> None:
    """K2 is in no proportion to the inertia, so a small craft swings with the defaults."""
    inertia = (size * np.diag([2.8, 2.5, 1.9])).ravel().tolist()
    law = {"controller": "log_barrier", "inertia": inertia, "attitude_envelope.terminal": width}
    craft = case(inertia=inertia, min_torque=0.0).with_values(CONTROLLER, **law)
    craft = craft.with_values(INJECTOR, environment="none")
    assert swings(margin_of(craft)) == told
    rates = np.abs(simulate(craft, 120.0)["rate_error"][-1000:])
    assert bool(rates.max() > 1e-6) == told


@pytest.mark.parametrize(("share", "told"), [(0.6, False), (0.98, True), (1.2, True)])
def test_a_disturbance_estimate_that_swings_is_seen(share: float, told: bool) -> None:
    """The rate error then swings by D_m h / 2J from sample to sample, whatever the gains."""
    D_m = share * 2.0 * 3e-5 * 1.9 * 100.0  # of g∞, the least inertia and the rate
    law = case(min_torque=0.0).with_values(CONTROLLER, D_m=D_m)
    law = law.with_values(INJECTOR, environment="none")
    found = margin_of(law)
    assert swings(found) == told
    run = simulate(law, 100.0)
    late = run.t > 60.0
    change = np.abs(np.diff(run["torque_command"][late], axis=0)).max()
    assert bool(change > D_m) == told
    assert not (told and found.disk)  # a swing may be stable, which is no margin


@pytest.mark.parametrize("changed", [{"rate": 50.0}, {"late_command": True}])
def test_a_loop_at_rest_that_would_swing_once_it_is_touched_is_seen(
    changed: dict[str, Any],
) -> None:
    """At rest to the last bit nothing begins to swing; a run with the paper's start does."""
    loop = case(min_torque=0.0, **changed).with_values(REFERENCE, amplitude=[0.0] * 3)
    torque = simulate(loop.with_values(INJECTOR, environment="none"), 160.0)["applied_torque"]
    amplitude = 0.5 * np.ptp(torque[-500:], axis=0).max()
    assert amplitude > 2e-3
    found = margin_of(loop)
    assert found.disk == 0.0
    assert 0.6 * amplitude < found.swing < 1.1 * amplitude


@pytest.mark.parametrize(("D_m", "told"), [(1e-4, False), (1.14e-3, True)])
def test_a_torque_that_swings_over_several_samples_is_seen(D_m: float, told: bool) -> None:
    """With modes and a late command it does so with a period of eight samples."""
    bending = {
        "plant": "flexible",
        "flexible.frequency": [0.173, 0.219],
        "flexible.damping": [0.0026, 0.0026],
        "flexible.coupling": [-0.155, -0.414, 0.585, 0.039, -0.345, 0.247],
    }
    loop = case(rate=10.0, min_torque=0.0, late_command=True, **bending)
    law = {"attitude_envelope.terminal": 0.016, "attitude_envelope.exponential_terminal": 3.2e-4}
    loop = loop.with_values(CONTROLLER, D_m=D_m, **law)
    loop = loop.with_values(REFERENCE, amplitude=[0.0] * 3)
    torque = simulate(loop.with_values(INJECTOR, environment="none"), 300.0)["torque_command"]
    amplitude = 0.5 * np.ptp(torque[-1000:], axis=0).max()
    assert bool(amplitude > 1e-3) == told
    assert margin_of(loop).swing == pytest.approx(amplitude, rel=0.3, abs=1e-4)


@pytest.mark.parametrize(("share", "told"), [(0.53, False), (0.56, True)])
def test_a_loop_that_swings_because_modes_follow_later_has_no_margin(
    share: float, told: bool
) -> None:
    """With δ² of J a torque moves J − δ² at first, so ω_n h = 0.45 exceeds 1 − δ²/J at 0.55."""
    bending = {
        "plant": "flexible",
        "flexible.frequency": [0.2],
        "flexible.damping": [0.01],
        "flexible.coupling": [0.0, 0.0, math.sqrt(share * 1.9)],
    }
    loop = linear(natural_frequency=4.5).with_values(PLANT, **bending)
    assert swings(margin_of(loop)) == told
    torque = np.abs(simulate(loop, 120.0)["torque_command"][-500:])
    assert bool(torque.max() > 0.02) == told  # the environment has up to 4.4 mN·m


@pytest.mark.parametrize(("period", "told"), [(0.9, False), (1.1, True)])
def test_a_loop_that_swings_because_thrusters_answer_once_a_period_has_no_margin(
    period: float, told: bool
) -> None:
    law = {"controller": "quaternion_feedback", "quaternion_feedback.natural_frequency": 1.0}
    slow = {"thrusters.period": period, "thrusters.min_on_time": 1e-4}
    loop = case("thrusters").with_values(PLANT, **slow).with_values(CONTROLLER, **law)
    loop = loop.with_values(INJECTOR, environment="none").with_values(
        REFERENCE, amplitude=[0.0] * 3
    )
    assert swings(margin_of(loop)) == told
    commanded = np.abs(simulate(loop, 150.0)["torque_command"][-500:])
    assert bool(commanded.max() > 1e-4) == told


@pytest.mark.parametrize("knowledge", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("overlays", [("wheels",), ("wheels", "allocator")])
def test_wheels_that_stand_have_the_margin_of_those_that_run(
    knowledge: float, overlays: tuple[str, ...]
) -> None:
    """Of three wheels none runs by itself; with dry friction they would hardly answer at rest."""
    loop = case(*overlays).with_values(CONTROLLER, controller="quaternion_feedback")
    drive, axes = (ALLOCATOR if len(overlays) > 1 else PLANT), np.eye(3).ravel().tolist()
    for node in (PLANT, drive):
        loop = loop.with_values(node, **{"wheels.axes": axes})
    loop = loop.with_values(drive, **{"wheels.friction_knowledge": knowledge})
    runs = loop.with_values(PLANT, **{"wheels.initial_speed": [60.0]})
    assert margin_of(loop).disk == pytest.approx(margin_of(runs).disk, rel=0.01)


@pytest.mark.parametrize(
    ("overlays", "disturbed"),
    [
        (
            ("sensors_smallsat", "sudden_disturbance"),
            {"seed": 5, "min_torque": 0.01, "faults": ["actuator/x stuck 0.01 from 10"]},
        ),
        (
            ("sensors_smallsat",),
            {
                "star_tracker.dropout_probability": 0.3,
                "star_tracker.outlier_probability": 0.2,
                "star_tracker.outlier_size": 1e-3,
                "gyro.resolution": 1e-3,
                "star_tracker.blinding_times": [80.2],
                "star_tracker.blinding_durations": [1e3],
            },
        ),
        ((), {"attitude_noise": 1e-4, "rate_noise": 1e-4}),
        (("thrusters",), {"thrusters.min_on_time": 0.02}),
    ],
)
def test_noise_rounding_dead_zone_faults_and_hits_do_not_count(
    overlays: tuple[str, ...], disturbed: dict[str, Any]
) -> None:
    quiet = case(*overlays)
    assert margin_of(quiet.with_values(PLANT, **disturbed), 80.0) == margin_of(quiet, 80.0)


def test_goals_to_which_a_craft_turns_do_not_count() -> None:
    mission = case("mission")
    none: dict[str, list[Any]] = {"goals.times": [], "goals.frames": [], "goals.attitudes": []}
    assert margin_of(mission, 15.0) == margin_of(mission.with_values(REFERENCE, **none), 15.0)


def test_check_tells_what_the_loop_bears(ask: Ask) -> None:
    told = ask("check", *(f"--config={file}" for file in configs("paper", "flexible")), "--json")
    found: dict[str, dict[str, Any]] = {each["name"]: each for each in told.json["conditions"]}
    margin, known = found["loop margin"], margin_of(case("flexible"))
    assert margin["value"] == pytest.approx(known.disk, rel=1e-9)
    assert margin["value"] > margin["limit"] == LEAST
    bears = "changes by up to 1.39 times, or its phase by up to 18.6°; least at 50 Hz"
    assert bears in margin["meaning"]
    assert found["torque at rest"]["holds"]
