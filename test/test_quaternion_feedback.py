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

import numpy as np
import pytest
from record_helpers import configured, records_of
from scipy.spatial.transform import Rotation

from ppc_attitude.science.controllers import quaternion_feedback
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import scenario

STILL = {
    "reference_generator": {"amplitude": [0.0, 0.0, 0.0], "initial_attitude": [0, 0, 0, 1]},
    "disturbance_injector": {"environment": False},
}


def from_rest(axis: list[float], angle: float, **values: float) -> dict[str, dict[str, object]]:
    unit = np.array(axis) / np.linalg.norm(axis)
    start = Rotation.from_rotvec(angle * unit).as_quat()
    return {
        **STILL,
        "spacecraft_plant": {"initial_attitude": start.tolist(), "min_torque": 0.0},
        "ppc_controller": {"controller": "quaternion_feedback", **values},
    }


def test_small_errors_follow_the_chosen_second_order_dynamics() -> None:
    """φ'' = −2 ζ ω_n φ' − ω_n² φ, from rest, critically damped, no integral to speak of."""
    frequency, start = 0.3, 1e-3
    case = from_rest([1, 0, 0], start)
    case["ppc_controller"] |= {
        "quaternion_feedback.natural_frequency": frequency,
        "quaternion_feedback.damping": 1.0,
        "quaternion_feedback.integral_time": 1e9,
    }
    case["spacecraft_plant"] |= {"rate": 1000.0}
    run = simulate(scenario(case), 30.0)
    angle = 2.0 * np.arcsin(run["attitude_error"][:, 0])
    expected = start * (1.0 + frequency * run.t) * np.exp(-frequency * run.t)
    assert np.abs(angle - expected).max() < 2e-3 * start


def test_slew_keeps_the_rate_limit_and_the_eigenaxis_and_limits_torque_as_a_vector() -> None:
    run = simulate(scenario(from_rest([1, 2, -1], 2.5)), 300.0)
    rates = np.linalg.norm(run["angular_velocity"], axis=1)
    assert rates.max() == pytest.approx(0.03, rel=0.02)  # used, and kept
    error = run["attitude_error"][:, :3]
    axis = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    off_axis = error - np.outer(error @ axis, axis)
    assert np.linalg.norm(off_axis, axis=1).max() < 1e-6
    assert np.abs(error[-1]).max() < 1e-6
    assert np.abs(run["applied_torque"]).max() <= 0.05
    wanted, given = run["unsaturated_torque"], run["torque_command"]
    limited = np.abs(wanted).max(axis=1) > 0.05
    assert limited.any()
    assert np.abs(given[limited]).max(axis=1) == pytest.approx(0.05, rel=1e-12)
    assert np.allclose(np.cross(wanted, given), 0.0, atol=1e-15)


def test_tracks_the_papers_reference_under_the_environment_within_its_limits() -> None:
    run = simulate(scenario({"ppc_controller": {"controller": "quaternion_feedback"}}), 300.0)
    error = np.abs(run["attitude_error"][:, :3]).max(axis=1)
    assert error[run.t > 200.0].max() < 1e-3
    assert np.abs(run["applied_torque"]).max() <= 0.05
    slew = np.linalg.norm(run["rate_error"], axis=1)
    assert slew.max() <= 0.03 * 1.05


def test_it_takes_the_short_way() -> None:
    gains = configured(quaternion_feedback.COMPONENT)
    torques = []
    for sign in (1.0, -1.0):
        measurement, memory, command = records_of(quaternion_feedback.COMPONENT)
        measurement["attitude"] = sign * Rotation.from_rotvec([0.5, 0, 0]).as_quat()
        measurement["reference_attitude"] = (0.0, 0.0, 0.0, 1.0)
        quaternion_feedback.step(measurement, memory, gains, command)
        torques.append(command["torque_command"].copy())
    assert torques[0][0] < 0.0
    assert np.array_equal(*torques)


def test_integral_rests_while_the_error_is_limited_and_is_bounded() -> None:
    gains = configured(quaternion_feedback.COMPONENT)
    measurement, memory, command = records_of(quaternion_feedback.COMPONENT)
    measurement["reference_attitude"] = (0.0, 0.0, 0.0, 1.0)

    def hold(angle: float, seconds: int) -> float:
        measurement["attitude"] = Rotation.from_rotvec([angle, 0.0, 0.0]).as_quat()
        for _ in range(seconds):
            measurement["t"] += 1.0
            quaternion_feedback.step(measurement, memory, gains, command)
        return float(np.linalg.norm(memory["integral"]))

    limit = gains["damping"] * gains["max_rate"] / gains["stiffness"]
    assert hold(2.5, 100) == 0.0
    assert hold(0.02, 10_000) == pytest.approx(limit * gains["integral_time"], rel=1e-12)
