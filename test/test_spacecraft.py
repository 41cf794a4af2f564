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

import math
from typing import Any

import numpy as np
import pytest
from craft_helpers import part_of
from estimation_helpers import STEP_NS, Array, angles_between
from scipy import stats
from scipy.spatial.transform import Rotation
from truth_tables import numbers

from ppc_attitude.science.actuators import ideal
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.inertia import inertia_matrix
from ppc_attitude.science.kernel import Vector, matrix
from ppc_attitude.science.kinds import PLANTS
from ppc_attitude.science.part import Part
from ppc_attitude.science.plants import rigid_body
from ppc_attitude.science.plants.rigid_body import rigid_body_step
from ppc_attitude.science.sensors.direct import measured

DIAGONAL = np.diag([2.8, 2.5, 1.9])
FULL = np.array([[2.8, 0.15, -0.1], [0.15, 2.5, 0.2], [-0.1, 0.2, 1.9]])


def trajectory(inertia: Array, q: Array, omega: Array, torques: Array, h: float) -> Array:
    """States after each step, rows of q (x y z w) and ω; the torque of a row is held over it."""
    j, j_inverse = matrix(inertia), matrix(np.linalg.inv(inertia))
    state = tuple(map(float, q)), tuple(map(float, omega))
    rows = [(*state[0], *state[1])]
    for torque in torques.tolist():
        state = rigid_body_step(*state, tuple(torque), j, j_inverse, h)
        rows.append((*state[0], *state[1]))
    return np.array(rows)


@pytest.mark.parametrize(
    ("case", "inertia"), [("sin_diag", DIAGONAL), ("sin_full", FULL), ("tumble_diag", DIAGONAL)]
)
def test_hundred_hertz_follow_the_binary128_truth(case: str, inertia: Array) -> None:
    truth = numbers(f"quad_{case}")
    steps = round(truth[-1, 0] / 0.01)
    torques = np.zeros((steps, 3))
    if case.startswith("sin"):
        torques = numbers(f"torque100Hz_{case}")[:, 1:]
    rows = trajectory(inertia, truth[0, 1:5], truth[0, 5:8], torques[:steps], 0.01)
    samples = rows[np.round(truth[:, 0] / 0.01).astype(int)]
    assert angles_between(samples[:, :4], truth[:, 1:5]).max() < 1e-11
    assert np.abs(samples[:, 4:] - truth[:, 5:8]).max() < 1e-12


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_spin_about_a_principal_axis_is_a_plain_rotation(axis: int) -> None:
    omega = np.zeros(3)
    omega[axis] = 0.3
    start = Rotation.from_rotvec([1.0, 2.0, -0.5])
    rows = trajectory(DIAGONAL, start.as_quat(), omega, np.zeros((5000, 3)), 0.01)
    expected = (start * Rotation.from_rotvec(omega * 50.0)).as_quat()
    assert angles_between(rows[-1:, :4], expected[None])[0] < 1e-10
    assert np.array_equal(rows[-1, 4:], omega)


@pytest.mark.parametrize("plant", ["rigid_body", "flexible"])
def test_fast_body_nutates_by_its_closed_form(plant: str) -> None:
    """R = exp(H/J_x t) exp(s t e_z) of an axisymmetric body that turns by 0.028 rad in a step."""
    transverse, axial, omega = 2.0, 1.2, np.array([1.5, 0.0, 2.4])
    moments = np.array([transverse, transverse, axial])
    precession = moments * omega / transverse  # [rad/s] inertial axes: those of the start
    spin = np.array([0.0, 0.0, omega[2] * (1.0 - axial / transverse)])
    part = part_of(
        PLANTS,
        plant,
        inertia=np.diag(moments).ravel().tolist(),
        initial_attitude=[0.0, 0.0, 0.0, 1.0],
        initial_angular_velocity=omega.tolist(),
    )
    rows = np.array([part.step(k * STEP_NS, [0.0] * 6) for k in range(6001)])
    t = np.arange(6001)[:, None] / 100.0
    turned, back = (Rotation.from_rotvec(t * rate) for rate in (precession, -spin))
    expected = (turned * back.inv()).as_quat()
    assert angles_between(rows[:, :4], expected).max() < 1e-9
    assert np.abs(rows[:, 4:7] - back.apply(omega)).max() < 1e-10


def test_constant_torque_about_a_principal_axis() -> None:
    torques = np.tile([0.0, 0.02, 0.0], (1000, 1))
    rows = trajectory(DIAGONAL, np.array([0.0, 0, 0, 1]), np.zeros(3), torques, 0.01)
    expected = Rotation.from_rotvec([0.0, 0.5 * 0.02 / 2.5 * 10.0**2, 0.0]).as_quat()
    assert angles_between(rows[-1:, :4], expected[None])[0] < 1e-12
    assert rows[-1, 5] == pytest.approx(0.02 / 2.5 * 10.0, rel=1e-12)


def test_fourth_order_in_the_step() -> None:
    q, omega = np.array([0.0, 0, 0, 1]), np.array([0.5, -0.9, 0.7])
    torque = np.array([0.3, -0.2, 0.1])
    fine, *coarse = (
        trajectory(FULL, q, omega, np.tile(torque, (n, 1)), 2.0 / n)[-1] for n in (6400, 20, 40)
    )
    errors = [np.abs(rows - fine).max() for rows in coarse]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.15)


def test_actuator_saturates_and_has_a_dead_band() -> None:
    actuator = Part(ideal.COMPONENT, ideal.COMPONENT.defaults)
    assert actuator.step(0, (0.06, -7.0, 0.05)) == (0.05, -0.05, 0.05)
    assert actuator.step(0, (0.99e-4, -0.99e-4, 0.0)) == (0.0, 0.0, 0.0)
    assert actuator.step(0, (1e-4, -1e-4, 0.03)) == (1e-4, -1e-4, 0.03)


def test_a_plant_holds_both_torques_from_stamp_to_stamp() -> None:
    body = Part(
        rigid_body.COMPONENT,
        {
            "inertia": FULL.ravel().tolist(),
            "initial_attitude": [0.0, 0.0, 0.0, 1.0],
            "initial_angular_velocity": [0.01, 0.02, 0.03],
        },
    )
    q, omega = (0.0, 0.0, 0.0, 1.0), (0.01, 0.02, 0.03)
    applied, disturbance = (0.01, 0.0, -0.02), (0.003, 0.002, 0.001)
    total = tuple(a + d for a, d in zip(applied, disturbance, strict=True))
    expected = rigid_body_step(q, omega, total, matrix(FULL), matrix(np.linalg.inv(FULL)), 0.01)
    assert body.step(0, (*applied, *disturbance)) == (*q, *omega)  # nothing was held before
    after = (*expected[0], *expected[1])
    assert body.step(10_000_000, (*applied, *disturbance)) == after
    assert body.step(10_000_000, (9.0,) * 6) == after  # no time has passed
    body.forget()
    assert body.step(10_000_000, (*applied, *disturbance)) == (*q, *omega)


def test_a_late_command_acts_with_the_next_sample() -> None:
    part = Part(ideal.COMPONENT, {"max_torque": 0.05, "min_torque": 1e-4, "late_command": True})
    assert part.step(0, (1.0, 5e-5, -0.02)) == (0.0, 0.0, 0.0)
    assert part.step(10_000_000, (0.01, 0.02, 0.03)) == (0.05, 0.0, -0.02)
    assert part.step(20_000_000, (0.0, 0.0, 0.0)) == (0.01, 0.02, 0.03)
    prompt = {"max_torque": 0.05, "min_torque": 1e-4, "late_command": False}
    part.configure(prompt)
    assert part.step(30_000_000, (0.02, 0.0, 0.0)) == (0.02, 0.0, 0.0)
    part.configure({**prompt, "late_command": True})
    assert part.step(40_000_000, (0.0, 0.0, 0.0)) == (0.02, 0.0, 0.0)


TRUE_ATTITUDE = tuple(map(float, Rotation.from_rotvec([1.0, -0.4, 0.2]).as_quat()))
TRUE_RATE = (0.01, -0.02, 0.03)


def noise(sizes: tuple[float, float], seed: int, steps: int) -> tuple[Array, Array]:
    """Small rotation from true to measured, body axes [rad], and rate noise [rad/s]."""
    draws = [measured(TRUE_ATTITUDE, TRUE_RATE, *sizes, seed, k) for k in range(steps)]
    turned = Rotation.from_quat([q for q, _ in draws])
    rotation = (Rotation.from_quat(TRUE_ATTITUDE).inv() * turned).as_rotvec()
    return rotation, np.array([omega for _, omega in draws]) - np.array(TRUE_RATE)


def test_noise_is_white_normal_and_independent() -> None:
    n = 20_000
    rotation, rate = noise((1e-3, 2e-4), 5, n)
    channels = np.hstack([rotation / 1e-3, rate / 2e-4])
    for channel in channels.T:
        assert stats.kstest(channel, "norm").pvalue > 1e-4
        assert abs(np.corrcoef(channel[1:], channel[:-1])[0, 1]) < 5.0 / math.sqrt(n)
    correlation = np.corrcoef(channels.T) - np.eye(6)
    assert np.abs(correlation).max() < 5.0 / math.sqrt(n)


def test_noise_is_a_function_of_seed_and_step() -> None:
    def draw(seed: int, step: int) -> tuple[tuple[float, ...], Vector]:
        drawn: tuple[tuple[float, ...], Vector]
        drawn = measured(TRUE_ATTITUDE, TRUE_RATE, 1e-3, 1e-3, seed, step)
        return drawn

    assert draw(1, 1234) == draw(1, 1234)
    assert len({draw(seed, step) for seed in (0, 1, 2**53) for step in range(50)}) == 150


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ([1.0, 0.1, 0, 0, 1, 0, 0, 0, 1], "must be symmetric"),
        ([1.0, 0, 0, 0, -1, 0, 0, 0, 1], "must be positive definite"),
        ([1.0, 2, 0, 2, 1, 0, 0, 0, 1], "must be positive definite"),
        ([1.0, 0, 0, 0, 1, 0, 0, 0, 0], "must be positive definite"),
        ([1.0, 0, 0, 0, 1, 0, 0, 0, 3], "triangle inequality"),
    ],
)
def test_bodies_that_do_not_exist(values: list[float], complaint: str) -> None:
    with pytest.raises(ConfigurationError, match=f"plant inertia.*{complaint}"):
        inertia_matrix("plant inertia", values)


def test_what_rounding_leaves_of_a_product_of_inertia_is_no_asymmetry() -> None:
    """An axisymmetric body was refused in axes that are turned about its own."""
    turned = np.diag([2.5, 2.5, 1.9])
    turned[1, 0] = -1.2e-32  # as NumPy gives it after half a turn
    assert np.array_equal(inertia_matrix("inertia", turned), turned)


def test_a_body_that_turns_too_far_in_a_step_is_refused() -> None:
    def with_rate(rate: float) -> dict[str, Any]:
        given = {"initial_angular_velocity": [0.0, rate, 0.0]}
        return {**rigid_body.COMPONENT.defaults, "rate": 100.0, **given}

    rigid_body.configure(with_rate(29.9))
    with pytest.raises(ConfigurationError, match=r"turns by 0\.301 rad in a step of rate = 100 Hz"):
        rigid_body.configure(with_rate(30.1))
