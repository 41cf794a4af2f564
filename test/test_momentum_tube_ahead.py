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

"""The momentum-tube law that is told what lies ahead goes the way round that takes less time."""

import math
from typing import Any

import numpy as np
import pytest
from craft_helpers import configs
from record_helpers import configured, records_of, settled_after
from scipy.integrate import quad_vec
from scipy.spatial.transform import Rotation

from ppc_attitude.contract.topics import CONTROLLER, PLANT, REFERENCE
from ppc_attitude.science.controllers import momentum_tube_ahead, tube_parameters
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.references import paper, paper_ahead
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load

FILES = configs("paper", "guaranteed_ahead")
LEAD = 0.6


@pytest.mark.parametrize(
    "values", [{}, {"begin": 321.0, "ahead": 40.0, "amplitude": [0.01, 0, 0.02]}]
)
def test_what_is_told_is_the_integral_of_the_desired_rate(values: dict[str, Any]) -> None:
    record = configured(paper_ahead.COMPONENT, values)
    for t in (0.0, 17.3, 300.0):
        told = paper_ahead.turn_ahead(t, record)
        expected, _ = quad_vec(
            lambda time: np.array(paper.desired_rate(time, record)), t, t + float(record["ahead"])
        )
        assert told == pytest.approx(tuple(expected), abs=1e-9)


def way_of(error: Rotation, ahead: Any) -> tuple[float, Any, float]:
    """Way round that an event chooses; axis and angle of the error that way."""
    gains = configured(momentum_tube_ahead.COMPONENT, {"momentum_tube.lead": LEAD})
    measurement, memory, command = records_of(momentum_tube_ahead.COMPONENT)
    measurement["attitude"] = error.as_quat()
    measurement["reference_attitude"] = (0.0, 0.0, 0.0, 1.0)
    measurement["reference_turn_ahead"] = ahead
    momentum_tube_ahead.step(measurement, memory, gains, command)
    q = error.as_quat()
    n = float(memory["way"]) * q[:3] / np.linalg.norm(q[:3])
    return float(memory["way"]), n, float(memory["phi"])


def test_a_way_is_chosen_by_how_far_the_desired_frame_comes_to_meet_it() -> None:
    """No more than π + n·Θ is left, and the other way would leave more than π + n·Θ."""
    random = np.random.default_rng(6)
    ways = set()
    for _ in range(200):
        axis = random.normal(size=3)
        angle = random.uniform(2.2, math.pi)
        error = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        ahead = random.uniform(0.0, 1.0) * random.normal(size=3)
        way, n, phi = way_of(error, ahead)
        ways.add(way)
        lead = float(np.clip(n @ ahead, -LEAD, LEAD))
        assert phi <= math.pi + lead + 1e-12
        assert 2 * math.pi - phi >= math.pi - lead - 1e-12
        assert min(phi, 2 * math.pi - phi) == pytest.approx(angle, abs=1e-9)
    assert ways == {-1.0, 1.0}


def test_the_way_that_is_chosen_takes_less_time() -> None:
    """From near half a turn, against the same law that is told nothing."""
    case = load(FILES)
    gains = []
    for attitude in Rotation.random(40, random_state=np.random.default_rng(8)):
        start = {"initial_attitude": attitude.as_quat().tolist()}
        told = case.with_values(PLANT, **start)
        untold = told.with_values(CONTROLLER, controller=tube_parameters.LAW)
        first = simulate(told, 0.0)
        if abs(first["attitude_error"][0, 3]) > 0.3:
            continue
        record = simulate(told, 100.0)
        assert (record["turn"] <= record["turn_envelope"]).all()
        assert settled_after(record) < 68.0
        gains.append(settled_after(simulate(untold, 100.0)) - settled_after(record))
    assert len(gains) > 5
    assert min(gains) > -0.3, "near a tie either way will do"
    assert max(gains) > 3.0


def test_a_reference_that_knows_nothing_ahead_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="gives; mode = paper_ahead would"):
        simulate(load(FILES, {REFERENCE: {"mode": "paper"}}), 1.0)
