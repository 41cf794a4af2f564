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

import itertools
import math
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from estimation_helpers import STEP_NS, Array, suite
from record_helpers import configured, new_record, records_of
from scipy.integrate import trapezoid
from scipy.spatial.transform import Rotation

from ppc_attitude.science.controllers import momentum_tube, ppc, quaternion_feedback
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import ZERO, kernel, matrix, quaternion, store_quaternion
from ppc_attitude.science.kinds import CONTROLLERS
from ppc_attitude.science.part import Part
from ppc_attitude.science.plants.rigid_body import angular_acceleration
from ppc_attitude.science.rate_observer import (
    MEMORY,
    PARAMETERS,
    compensate,
    disturbance_sigma,
    observe,
    observer_record,
    rate_sigma,
    with_front,
)
from ppc_attitude.science.stamps import stamp_of

INERTIA = np.array([[2.8, 0.15, -0.1], [0.15, 2.5, 0.2], [-0.1, 0.2, 1.9]])
INVERSE = np.linalg.inv(INERTIA)
WHITE = 1.70872639588e-4  # the cubesat's σ_v,eff [rad/√s]
H = 1e-9 * STEP_NS


def observer(
    frequency: float, inertia: Array = INERTIA, suite_name: str = "cubesat", **given: Any
) -> Any:
    values = {parameter.name: parameter.default for parameter in PARAMETERS}
    values |= {k: v for k, v in suite(suite_name).items() if k in values}
    values |= {"rate_observer": frequency, "disturbance_feedforward": True, "max_torque": 0.05}
    return observer_record({**values, "inertia": inertia.ravel().tolist(), **given})


@kernel
def observed(settings: Any, memory: Any, measured: Any, torques: Any, rows: Any) -> None:
    """ω̂ and d̂ at every step, the law's torques given."""
    for k in range(measured.shape[0]):
        rate = observe(
            settings, memory, k * STEP_NS, (measured[k, 0], measured[k, 1], measured[k, 2])
        )
        compensate(settings, memory, (torques[k, 0], torques[k, 1], torques[k, 2]))
        for i in range(3):
            rows[k, i] = rate[i]
            rows[k, 3 + i] = memory.disturbance[i]


def run(settings: Any, measured: Array, torques: Array | None = None) -> Array:
    rows = np.empty((len(measured), 6))
    zero = np.zeros_like(measured)
    observed(settings, new_record(MEMORY), measured, zero if torques is None else torques, rows)
    return rows


def motion(torques: Array, disturbance: Array, substeps: int = 20) -> tuple[Array, Array]:
    """Rates at the steps, and mean rates of the intervals before them, under held torques."""
    j, inverse = matrix(INERTIA), matrix(INVERSE)
    omega = np.array([0.01, -0.02, 0.015])
    rates, means = [omega], [omega]
    h = H / substeps
    for torque in torques[:-1]:
        start = omega
        total = tuple(torque + disturbance)
        path = [omega]
        for _ in range(substeps):
            middle = omega + 0.5 * h * np.array(
                angular_acceleration(tuple(omega), total, j, inverse)
            )
            omega = omega + h * np.array(angular_acceleration(tuple(middle), total, j, inverse))
            path.append(omega)
        rates.append(omega)
        means.append(trapezoid(path, dx=1.0 / substeps, axis=0))
        assert np.abs(omega - start).max() < 1e-2
    return np.array(rates), np.array(means)


def test_noise_behind_the_observer_is_that_of_its_transfer() -> None:
    noise = WHITE / math.sqrt(H) * np.random.default_rng(1).normal(size=(200_000, 3))
    frequency = 2.0
    inertia = np.diag([2.8, 2.5, 1.9])
    rows = run(observer(frequency, inertia, disturbance_feedforward=False), noise)[2000:]
    assert rows[:, :3].std(axis=0) == pytest.approx([rate_sigma(frequency, WHITE)] * 3, rel=0.05)
    expected = [disturbance_sigma(frequency, WHITE, moment) for moment in np.diag(inertia)]
    assert rows[:, 3:].std(axis=0) == pytest.approx(expected, rel=0.05)
    crossings = np.count_nonzero((rows[1:, :3] > 0) & (rows[:-1, :3] <= 0)) / (3 * H * len(rows))
    assert crossings == pytest.approx(
        math.sqrt(3.2 * frequency * 100.0) / (2.0 * math.pi), rel=0.05
    )


def test_the_published_sigma() -> None:
    # 6σ of the observed rate: smallsat 2 rad/s, cubesat 1 rad/s.
    assert 6.0 * rate_sigma(2.0, 4.36332421363e-5) == pytest.approx(4.14e-4, rel=1e-3)
    assert 6.0 * rate_sigma(1.0, WHITE) == pytest.approx(1.15e-3, rel=5e-3)


def test_a_slew_does_not_disturb_the_estimate() -> None:
    """A gyro's mean rate is half a sample old; the observer compares it at that instant."""
    torques = 0.05 * np.ones((400, 3)) * np.array([1.0, -1.0, 0.5])
    rates, means = motion(torques, np.zeros(3))
    rows = run(observer(4.0, suite_name="flagship"), means, torques)
    lag = np.abs(means - rates)[1:].max()  # what a law would be told without the observer
    assert lag > 5e-5
    assert np.abs(rows[:, :3] - rates).max() < lag / 138.0


def test_a_disturbance_is_learnt_and_taken_off_the_command() -> None:
    disturbance = np.array([0.002, -0.003, 0.004])
    torques = np.zeros((1000, 3))
    _, means = motion(torques, disturbance)
    settings = observer(2.0, disturbance_feedforward=False)
    rows = run(settings, means)
    assert np.abs(rows[-1, 3:] - disturbance).max() < 1e-5
    memory = new_record(MEMORY)
    memory["disturbance"] = disturbance
    forward = observer(2.0)
    assert compensate(forward, memory, (0.01, 0.01, -0.049)) == pytest.approx((0.008, 0.013, -0.05))
    assert memory["torque"] == pytest.approx([0.008, 0.013, -0.05])
    assert compensate(settings, memory, (0.01, 0.0, 0.0)) == (0.01, 0.0, 0.0)


@pytest.mark.parametrize("turn", [[0.0, 0.0, 0.0], [0.6, 0.8, -0.5]])
def test_whatever_the_body_axes_a_disturbance_is_learnt_as_the_transfer_says(
    turn: list[float],
) -> None:
    """With J_ii for J, an oblong craft with slanted axes had a loop that did not settle."""
    axes = Rotation.from_rotvec(turn).as_matrix()
    inertia = axes @ np.diag([2.8, 2.5, 0.35]) @ axes.T
    disturbance = 1e-8 * axes @ np.array([1.0, -2.0, 1.5])  # too small to turn the craft
    frequency, slow = 5.0, 10  # steps of 0.1 s
    times = slow * H * np.arange(60)
    rates = np.outer(times, np.linalg.solve(inertia, disturbance))
    means = np.vstack([rates[:1], 0.5 * (rates[1:] + rates[:-1])])
    settings = observer(frequency, inertia, max_disturbance=0.05)
    memory = new_record(MEMORY)
    learnt = []
    for k, mean in enumerate(means.tolist()):
        observe(settings, memory, slow * k * STEP_NS, (mean[0], mean[1], mean[2]))
        learnt.append(memory["disturbance"] @ axes)
    p = math.exp(-frequency * slow * H)
    unlearnt = 1.0 - np.array(learnt) / (disturbance @ axes)
    assert np.abs(unlearnt - unlearnt[:, :1]).max() < 1e-4  # every principal axis alike
    assert np.abs(unlearnt[30:]).max() < 30.0 * p**30 + 1e-4


@pytest.mark.parametrize("axes", list(itertools.product((-1.0, 1.0), repeat=3)))
def test_whatever_the_body_axes_a_disturbance_within_its_limit_is_no_hit(
    axes: tuple[float, float, float],
) -> None:
    """With 1/J_ii for J⁻¹, an oblong craft with slanted axes took half of the limit for a hit."""
    turn = Rotation.from_rotvec([0.6, 0.8, -0.5]).as_matrix()
    inertia = turn @ np.diag([2.8, 2.5, 0.35]) @ turn.T
    settings, memory = observer(2.0, inertia, suite_name="flagship"), new_record(MEMORY)
    gain = H * 6e-3 * np.linalg.solve(inertia, axes)  # [rad/s] in a step, with the limit
    x, y, z = (0.5 * gain).tolist()  # its mean in the first step
    observe(settings, memory, 0, ZERO)
    observe(settings, memory, STEP_NS, (x, y, z))
    assert memory["surprised"] == 0.0


def test_the_disturbance_estimate_has_a_limit() -> None:
    _, means = motion(np.zeros((1000, 3)), np.array([0.02, 0.0, -0.02]))
    rows = run(observer(2.0), means)
    assert np.abs(rows[:, 3:]).max() == 6e-3


def test_a_hit_is_believed_at_its_second_sample() -> None:
    rates = np.zeros((300, 3))
    rates[100:] = [0.05, 0.0, 0.0]
    rows = run(observer(1.0, suite_name="flagship"), rates)
    assert np.abs(rows[100, 0]) < 0.01
    assert np.abs(rows[101:, :3] - rates[101:]).max() < 1e-3
    assert np.abs(rows[101, 3:] - rows[100, 3:]).max() == 0.0
    # One odd sample is no hit.
    rates[101:] = 0.0
    rows = run(observer(1.0, suite_name="flagship"), rates)
    assert np.abs(rows[:, 0]).max() < 0.01


@pytest.mark.parametrize(("counts", "believed"), [(1.0, False), (2.0, True)])
def test_a_count_of_a_coarse_gyro_is_no_hit(counts: float, believed: bool) -> None:
    """Five σ of its rounding are 1.44 counts."""
    rates = np.zeros((102, 3))
    rates[100:, 0] = counts * 0.01
    coarse = observer(1.0, **{"gyro.resolution": 0.01, "gyro.angular_random_walk": 0.0})
    assert (run(coarse, rates)[101, 0] > 0.5 * rates[101, 0]) == believed


def test_a_gyro_that_was_saturated_does_not_lead_the_estimate_away_for_ever() -> None:
    """With steps of half a second it grew beyond all numbers, also once the gyro was well again."""
    settings, memory = observer(1.0), new_record(MEMORY)
    for k in range(100):
        measured = (20.0, 10.0, -20.0) if 20 <= k < 30 else ZERO
        rate = observe(settings, memory, stamp_of(k, 2.0), measured)
    assert np.abs(rate).max() < 1e-3


def test_the_last_torque_is_not_taken_to_act_over_a_gap() -> None:
    """An actuator that hears nothing for half a second gives none; so the rate was far off."""
    rates = np.zeros((200, 3))
    torques = np.tile([0.05, 0.0, 0.0], (200, 1))  # that the craft does not get, as after the gap
    settings = observer(0.5, suite_name="flagship", disturbance_feedforward=False)
    for pause, is_gap in ((5.0, True), (0.4, False)):
        memory = new_record(MEMORY)
        rows = np.empty((200, 6))
        observed(settings, memory, rates, torques, rows)
        stamp = 200 * STEP_NS + round(pause * 1e9)
        learnt = memory["disturbance"].copy()
        rate = observe(settings, memory, stamp, ZERO)
        assert (rate == ZERO) is is_gap
        assert np.array_equal(memory["disturbance"], learnt)  # of a hit, too
        assert observe(settings, memory, stamp + STEP_NS, ZERO) != ZERO  # it goes on from there


@pytest.mark.parametrize("rate", [1.0, 1.5])
def test_slow_steps_are_no_gaps(rate: float) -> None:
    settings, memory = observer(0.3, suite_name="flagship"), new_record(MEMORY)
    for k in range(10):
        observe(settings, memory, stamp_of(k, rate), (1e-4 * k, 0.0, 0.0))
        assert memory["step"] == pytest.approx(min(k, 1) / rate)


def test_a_law_with_its_own_observer_gets_no_second_one() -> None:
    values = {each.name: each.default for each in (*PARAMETERS, *ppc.COMPONENT.parameters)}
    for observes, frequency in ((False, 2.0), (True, 0.0)):
        law = with_front(replace(ppc.COMPONENT, observes=observes))
        record, *_ = law.configure({**values, "rate_observer": 2.0})
        assert record["observer"]["frequency"] == frequency
    assert momentum_tube.COMPONENT.observes


def test_an_observer_that_is_switched_on_again_in_flight_begins_from_what_is_measured() -> None:
    """It had predicted the rate over the whole time for which it was off."""
    law = CONTROLLERS.components["quaternion_feedback"]
    inputs, state, outputs = records_of(law)
    inputs["attitude"], inputs["reference_attitude"] = (0.6, 0.0, 0.0, 0.8), (0.0, 0.0, 0.0, 1.0)
    measured = (0.01, -0.02, 0.005)
    for stamp_ns, frequency in ((0, 2.0), (STEP_NS, 2.0), (2 * STEP_NS, 0.0), (10**11, 2.0)):
        inputs["stamp_ns"], inputs["angular_velocity"] = stamp_ns, measured
        settings, *_ = configured(law, {"rate_observer": frequency})
        law.step(inputs, state, settings, outputs)
    assert tuple(state["observer"]["rate"]) == measured


@pytest.mark.parametrize("frequency", [0.0, 2.0])
@pytest.mark.parametrize("name", list(CONTROLLERS.components))
def test_a_law_begins_anew_after_a_gap_without_an_attitude(name: str, frequency: float) -> None:
    """What it remembers is of before the gap: a plan, and a torque that has not acted since."""
    law = CONTROLLERS.components[name]
    values = {**law.defaults, "rate_observer": frequency, "disturbance_feedforward": True}
    flown, fresh = Part(law, values), Part(law, values)
    known = {"attitude": (0.1, -0.2, 0.05, 0.9733), "reference_attitude": (0.0, 0.0, 0.0, 1.0)}
    zeros = {column.name: (0.0,) * column.width for column in law.inputs}
    for k in range(300):
        told = {**zeros, **({} if 100 <= k < 200 else known), "angular_velocity": (0.01, 0, -0.01)}
        row = [number for values in told.values() for number in values]
        answer = flown.step(k * STEP_NS, row)
        if k < 100:
            before = flown.advices
        elif k < 200:
            assert not any(answer), "what is not known is not told"
            assert flown.advices == before
        else:
            assert answer == fresh.step(k * STEP_NS, row)
    assert flown.advice == fresh.advice
    assert (flown.advices > before) == bool(fresh.advices)


@kernel
def of_another_package(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    store_quaternion(outputs.attitude_error, quaternion(inputs.attitude))


def test_a_law_of_another_package_may_be_told_no_attitude_too() -> None:
    ours = replace(quaternion_feedback.COMPONENT, name="theirs", step=of_another_package)
    law = with_front(ours)
    part = Part(law, law.defaults)
    zeros = [0.0] * sum(column.width for column in law.inputs)
    assert not any(part.step(0, zeros))


def test_a_limit_within_the_estimates_own_noise_is_refused() -> None:
    ten = np.diag([10.0, 9.0, 8.0])
    assert disturbance_sigma(4.0, WHITE, 10.0) == pytest.approx(6.9e-3, rel=0.02)
    with pytest.raises(ConfigurationError, match=r"rate_observer = 4.0 rad/s .* 0.002 N·m"):
        observer(4.0, ten)
    observer(1.0, ten, max_disturbance=1e-2)


@pytest.mark.parametrize(("share", "refused"), [(0.99, True), (1.01, False)])
def test_the_noise_of_the_worst_axis_counts(share: float, refused: bool) -> None:
    """That of the largest row of J, (2.8, 0.15, -0.1): three σ of it leave no room."""
    row = math.sqrt(2.8**2 + 0.15**2 + 0.1**2)
    limit = share * 3.0 * 0.5 * row * 2.0**1.5 * WHITE
    given = {"max_disturbance": limit, "gyro.angular_random_walk": WHITE}
    with pytest.raises(ConfigurationError) if refused else nullcontext():
        observer(2.0, **given)
