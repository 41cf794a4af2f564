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

"""Goals of the adversary: their values for runs of which the errors are known, and their limits."""

import math

import numpy as np
import pytest
from craft_helpers import configs
from process_helpers import PAPER
from synthetic import normal_run, with_error

from ppc_attitude.contract.topics import CONTROLLER, PLANT
from ppc_attitude.falsify.goals import Goal, goal_of
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load


@pytest.mark.parametrize(
    ("outside", "value"), [([2.0, 7.0], 7.0), ([0.0], 0.0), ([4.0, 10.0], 10.0 + np.sin(0.1))]
)
def test_a_run_settles_after_its_last_error_or_never_if_it_ends_with_one(
    outside: list[float], value: float
) -> None:
    run = normal_run(duration=10.0)
    half = np.where(np.isin(run.t, outside), 0.1, 1e-4)
    zero = np.zeros_like(half)
    erring = with_error(run, np.stack([zero, np.sin(half), zero, np.cos(half)], axis=1))
    goal = Goal("settling")
    found = goal.value(erring)
    assert found == pytest.approx(value, abs=1e-12)
    assert goal.text(found, 10.0).startswith("not settled at 10 s") == (10.0 in outside)


def test_only_a_time_is_compared_with_the_length_of_a_run() -> None:
    assert Goal("settling").text(5.0, 5.0) == "5 s"
    assert Goal("rate").text(9.0, 5.0) == "9 deg/s"


def test_a_bounded_column_that_is_no_attitude_error_is_what_the_law_saw() -> None:
    base = load(configs("paper", "guaranteed", "sensors_cubesat"))
    record = simulate(base, 10.0)
    goal = goal_of("momentum_error", base, 5e-3, 0.0)
    shares = np.abs(record["momentum_error"]) / record["momentum_tube"]
    assert goal.value(record) == shares.max()
    assert goal.limit == 1.0


@pytest.mark.parametrize("name", ["speed", "torque_command"])
def test_a_goal_that_is_no_column_with_a_bound_is_refused(name: str) -> None:
    base = load([PAPER])
    with pytest.raises(ConfigurationError, match=f"goal = {name}; allowed for ppc: settling"):
        goal_of(name, base, 5e-3, 0.0)


@pytest.mark.filterwarnings("ignore:overflow encountered")
@pytest.mark.parametrize("name", ["settling", "terminal", "rate"])
def test_a_run_that_diverges_is_worst_of_all(name: str) -> None:
    law = {"controller": "quaternion_feedback", "max_torque": 1e6}
    gains = {"quaternion_feedback.natural_frequency": 3.0}  # a sample lasts three times as long
    base = load([PAPER], {PLANT: {"rate": 1.0, "max_torque": 1e6}, CONTROLLER: law | gains})
    assert Goal(name).value(simulate(base, 20.0)) == math.inf
