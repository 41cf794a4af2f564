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

"""Relations between two runs that hold whatever the numbers: turned axes, signs, sizes."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from craft_helpers import configs
from scipy.spatial.transform import Rotation

from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import CONTROLLER, ESTIMATOR, INJECTOR, PLANT, REFERENCE
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load

INERTIA = np.array([[2.8, 0.1, -0.1], [0.1, 2.5, 0.2], [-0.1, 0.2, 1.9]])
STRAIGHT, CYCLE = np.eye(3), np.roll(np.eye(3), 1, axis=0)  # x to y, y to z, z to x
SLANTED = Rotation.from_rotvec([0.6, 0.8, -0.5]).as_matrix()
PER_AXIS = [f"momentum_tube.{name}" for name in ("brake", "Y", "B")]
TORQUES = ["max_torque", "max_disturbance", "D_m", "log_barrier.K2", "log_barrier.k_b"]
NO_NOISE = ["gyro.angular_random_walk", "gyro.rate_random_walk", "gyro.initial_bias_sigma"]
NO_NOISE += ["gyro.resolution", "star_tracker.cross_noise", "star_tracker.boresight_noise"]


def run(
    law: str, turn: Array = STRAIGHT, sign: float = 1.0, size: float = 1.0, weak: bool = True
) -> Mapping[str, Array]:
    """Fly with wheels, modes, sensors, goals, a cone, a hit and faults; weak: limited by axis."""

    def vectors(*numbers: float, times: float = 1.0) -> list[float]:
        return (times * np.reshape(numbers, (-1, 3)) @ turn.T).ravel().tolist()

    def attitudes(*numbers: float) -> list[float]:
        turned = Rotation.from_quat(np.reshape(numbers, (-1, 4))) * Rotation.from_matrix(turn.T)
        return (sign * turned.as_quat()).ravel().tolist()

    files = configs("paper", "guaranteed", "flexible", "wheels", "sensors_smallsat")
    mounting = Rotation.from_matrix(turn) * Rotation.from_rotvec([0.3, -1.2, 0.7])
    tracker = {"star_tracker.mounting": (sign * mounting.as_quat()).tolist()}
    inertia = {"inertia": (size * turn @ INERTIA @ turn.T).ravel().tolist()}
    bias = " ".join(map(str, vectors(1e-4, -2e-4, 1e-4)))
    plant: dict[str, Any] = {
        **inertia,
        **tracker,
        **dict.fromkeys(NO_NOISE, 0.0),
        "initial_attitude": attitudes(0.1, -0.5, 0.3, 0.8062257748298549),
        "initial_angular_velocity": vectors(0.01, -0.02, 0.005),
        "flexible.coupling": vectors(0.2, 0.3, -0.1, 0.0, 0.2, 0.1, times=size**0.5),
        "wheels.axes": vectors(1.0, 0.1, 0.3, 0.0, -1.0, 0.2, 0.1, 0.2, 1.0, 1.0, 1.0, -0.8),
        "wheels.initial_speed": [100.0, -50.0, 80.0, 20.0],
        "faults": ["wheel/1 effectiveness 0.3 from 3 for 2", f"gyro bias {bias} from 5"],
    }
    goals = {
        "mode": "goal",
        "goals.times": [1.0, 4.0],
        "goals.frames": ["inertial", "spin"],
        "goals.attitudes": attitudes(0.2, -0.4, 0.4, 0.8, 0.1, -0.5, 0.3, 0.8062257748298549),
        "spin.axis": vectors(0.3, -0.5, 0.8),
        "keep_out.axes": vectors(0.0, 0.6, 0.8),
        "keep_out.directions": ["0.5 -0.1 0.8"],
        "keep_out.half_angles": [0.2],
    }
    hit = {"environment": "none", "pulse_times": [2.0], "pulse_durations": [0.2]}
    hit["pulse_torques"] = vectors(0.1, 0.3, -0.2, times=size)
    scenario = load(files, {CONTROLLER: {"controller": law}})
    control, wheels = scenario.parameters[CONTROLLER], scenario.parameters[PLANT]
    for name in ("inertia", "max_torque", "viscous", "coulomb", "static"):
        plant[f"wheels.{name}"] = [size * wheels[f"wheels.{name}"][0]]
    scaled = {name: size * control[name] for name in TORQUES}
    turned = {name: (np.abs(turn) @ control[name]).tolist() for name in PER_AXIS}
    strong = {} if weak else {"max_torque": 10.0, "max_disturbance": 10.0}
    nodes = {PLANT: plant, REFERENCE: goals, INJECTOR: hit, ESTIMATOR: tracker}
    nodes[CONTROLLER] = {**inertia, **scaled, **turned, **strong}
    return simulate(scenario.overlaid(nodes), 8.0).columns


@pytest.mark.parametrize(
    ("law", "turn", "weak"),
    [(law, CYCLE, True) for law in ("ppc", "log_barrier", "quaternion_feedback", "momentum_tube")]
    + [("quaternion_feedback", SLANTED, False)],
)
def test_a_craft_in_turned_axes_makes_the_turned_motion(law: str, turn: Array, weak: bool) -> None:
    one, other = run(law, weak=weak), run(law, turn, weak=weak)
    for name in ("truth_angular_velocity", "gyro_bias", "torque_command"):
        assert np.abs(one[name] @ turn.T - other[name]).max() < 1e-7 * np.abs(one[name]).max()
    assert np.abs(one["wheel_speed"] - other["wheel_speed"]).max() < 1e-5
    same = Rotation.from_quat(one["truth_attitude"]) * Rotation.from_matrix(turn.T)
    assert (same.inv() * Rotation.from_quat(other["truth_attitude"])).magnitude().max() < 1e-8


@pytest.mark.parametrize("law", ["ppc", "log_barrier", "quaternion_feedback", "momentum_tube"])
def test_the_sign_of_a_quaternion_changes_no_bit_of_the_motion(law: str) -> None:
    one, other = run(law), run(law, sign=-1.0)
    for name in ("truth_angular_velocity", "gyro_bias", "torque_command", "wheel_speed"):
        assert np.array_equal(one[name], other[name])


@pytest.mark.parametrize("law", ["log_barrier", "quaternion_feedback"])
def test_a_craft_of_four_times_the_size_moves_the_same_to_the_last_bit(law: str) -> None:
    one, other = run(law), run(law, size=4.0)
    for name in ("truth_attitude", "truth_angular_velocity", "wheel_speed"):
        assert np.array_equal(one[name], other[name])
    assert np.array_equal(4.0 * one["torque_command"], other["torque_command"])
