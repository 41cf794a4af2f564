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

import numpy as np
import pytest
from craft_helpers import case, conditions, pulse
from hypothesis import given
from hypothesis import strategies as st
from record_helpers import configured, derivative, f_matrix, records_of
from scipy.spatial.transform import Rotation

from ppc_attitude.analysis.requirements import PAPER
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, PLANT, REFERENCE
from ppc_attitude.science.controllers import log_barrier
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import scenario


def alpha(error: Rotation, rho: float, rho_rate: float, K1: float, like: np.ndarray) -> np.ndarray:
    q_e = error.as_quat()
    q_e *= math.copysign(1.0, float(q_e @ like))
    return -np.linalg.solve(f_matrix(q_e), (K1 - rho_rate / rho) * q_e[:3])


@given(st.integers(0, 2**32 - 1))
def test_alpha_and_its_derivative_along_the_motion(seed: int) -> None:
    rng = np.random.default_rng(seed)
    error = Rotation.from_rotvec(rng.normal(size=3) * 0.5)
    omega, K1 = rng.normal(size=3) * 0.03, 0.15
    rho, rate, acceleration = 0.5, -0.02, 0.001
    like = error.as_quat()

    def at(t: float) -> np.ndarray:
        turned = error * Rotation.from_rotvec(t * omega)
        now = rho + rate * t + 0.5 * acceleration * t * t
        return alpha(turned, now, rate + acceleration * t, K1, like)

    value, rate_of_it = log_barrier.desired_rate_error(
        tuple(like[:3].tolist()), like[3], tuple(omega.tolist()), rho, rate, acceleration, K1
    )
    assert np.allclose(value, at(0.0), rtol=1e-10)
    assert np.allclose(rate_of_it, derivative(at, 1e-3), rtol=1e-6, atol=1e-9)


def test_step_is_the_reconstruction_of_the_spec() -> None:
    gains = configured(log_barrier.COMPONENT)
    measurement, memory, command = records_of(log_barrier.COMPONENT)
    error = Rotation.from_rotvec([0.2, -0.1, 0.15])
    omega, t = np.array([0.01, -0.02, 0.015]), 10.0
    measurement["attitude"], measurement["angular_velocity"] = error.as_quat(), omega
    measurement["reference_attitude"] = (0.0, 0.0, 0.0, 1.0)
    memory["started"], measurement["t"] = 1.0, t

    def envelope(time: float) -> tuple[float, float]:
        part = 0.9999 * math.exp(-0.05 * time)
        return part + 1e-4, -0.05 * part

    q_e = error.as_quat()
    rho, _ = envelope(t)
    inertia = np.diag([2.8, 2.5, 1.9])

    def at(dt: float) -> np.ndarray:
        return alpha(error * Rotation.from_rotvec(dt * omega), *envelope(t + dt), 0.15, q_e)

    z = omega - at(0.0)
    chi = q_e[:3] / (rho**2 - q_e[:3] ** 2)
    expected = (
        np.cross(omega, inertia @ omega)
        + inertia @ derivative(at, 1e-3)
        - 3.0 * z
        - 1e-3 * f_matrix(q_e).T @ chi
        - gains["D_m"] * np.tanh(z / gains["mu"])
    )
    log_barrier.step(measurement, memory, gains, command)
    assert np.allclose(command["unsaturated_torque"], expected, rtol=1e-7, atol=1e-10)
    assert np.allclose(command["torque_command"], np.clip(expected, -0.05, 0.05), atol=1e-9)


def test_after_a_hit_it_settles_outside_near_the_predicted_error() -> None:
    """Outside, the barrier pushes outward: q*² = ρ² + k_b / (4 K1 K2)."""
    case = scenario(
        {
            "ppc_controller": {"controller": "log_barrier"},
            "disturbance_injector": pulse(80.0, 0.1, 0.8, 0.8, 0.8),
        }
    )
    run = simulate(case, 200.0)
    error = np.abs(run["attitude_error"][:, :3])
    before = error[(run.t > 60.0) & (run.t < 80.0)]
    assert before.max() < 5e-3
    late = error[run.t > 170.0]
    predicted = math.sqrt(5e-3**2 + 1e-3 / (4.0 * 0.15 * 3.0))
    assert np.all(late.max(axis=0) > 5e-3)  # every axis stays outside
    assert late.mean(axis=0) == pytest.approx([predicted] * 3, rel=0.15)


def test_it_never_divides_by_zero() -> None:
    gains = configured(log_barrier.COMPONENT)
    turned = [(0.6, 0.64, 0.48, scalar) for scalar in (0.0, -0.0, 1e-12)]
    for attitude in (*turned, (1.0, 0.0, 0.0, 0.0)):  # the last is on its envelope
        measurement, memory, command = records_of(log_barrier.COMPONENT)
        measurement["attitude"] = attitude
        measurement["reference_attitude"] = (0.0, 0.0, 0.0, 1.0)
        log_barrier.step(measurement, memory, gains, command)
        assert np.isfinite(command["torque_command"]).all()


@pytest.mark.parametrize(("angle", "holds"), [(10.0, True), (40.0, False), (180.0, False)])
def test_check_tells_how_fast_a_law_without_a_limit_of_the_rate_wants_to_turn(
    angle: float, holds: bool
) -> None:
    """A strong actuator makes the most of it true; at 180° there is no limit at all."""
    law = case(max_torque=5.0).with_values(INJECTOR, environment=False)
    law = law.with_values(REFERENCE, amplitude=[0.0] * 3, initial_attitude=[0.0, 0.0, 0.0, 1.0])
    law = law.with_values(CONTROLLER, controller="log_barrier", max_torque=5.0)
    half = math.radians(0.5 * angle)
    error = (math.sin(half), 0.0, 0.0, math.cos(half))
    told = conditions(law, PAPER, error)["rate of the law"]
    assert (told.holds, told.limit) == (holds, 3.0)
    if angle < 180.0:
        craft = law.with_values(PLANT, initial_attitude=list(error))
        rates = np.linalg.norm(simulate(craft, 60.0)["angular_velocity"], axis=1)
        assert 0.6 < math.degrees(rates.max()) / told.value < 1.0
