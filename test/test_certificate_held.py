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


"""The row of the verdict that says whether a certificate held."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ppc_attitude.analysis.guarantee import certificate_held
from ppc_attitude.analysis.metrics import analyse
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load

CONFIG = Path(__file__).parent.parent / "config"


def record_of(*overlays: str, **nodes: dict[str, Any]) -> RunRecord:
    files = [CONFIG / "paper.yaml", *(CONFIG / f"{each}.yaml" for each in overlays)]
    return simulate(load(files, nodes), 25.0)


def test_a_run_within_the_assumptions_holds() -> None:
    held = certificate_held(record_of("guaranteed"))
    assert held is not None
    assert (held.reason, held.note, held.outside.any()) == ("", "", False)


def test_a_hit_suspends_the_promise_and_says_so() -> None:
    record = record_of("guaranteed", "sudden_disturbance")
    held = certificate_held(record)
    assert held is not None
    assert not held.outside.any()
    assert held.note == "suspended: a torque beyond the assumed one at 10 instants"


@pytest.mark.parametrize(
    ("plant", "told"),
    [
        ({"max_torque": 0.03}, "max_torque = 0.03 N·m; assumed: at least 0.05"),
        ({"late_command": True}, "late_command = true; assumed"),
        ({"inertia": [2.9, 0, 0, 0, 2.5, 0, 0, 0, 1.9]}, "the craft's inertia is 0.0357 off"),
        ({"rate_noise": 2e-5}, "rate_noise = 2e-05: 5 deviations pass"),
    ],
)
def test_a_craft_that_is_not_as_assumed_is_not_judged(plant: dict[str, Any], told: str) -> None:
    held = certificate_held(record_of("guaranteed", spacecraft_plant=plant))
    assert held is not None
    assert held.reason.startswith(told)
    assert not held.outside.any()


def test_sensors_without_a_known_bound_suspend_the_promise() -> None:
    held = certificate_held(record_of("guaranteed", "sensors_flagship"))
    assert held is not None
    assert "sensors = gyro_star_tracker" in held.reason


def test_a_changed_number_is_not_judged() -> None:
    record = record_of("guaranteed", ppc_controller={"momentum_tube.kappa": 15.1})
    rows = [each for each in analyse(record).requirements if each.key == "certificate"]
    assert [row.met for row in rows] == [None]
    assert rows[0].reason == "the certificate is for other numbers"


def test_a_broken_promise_is_found() -> None:
    record = record_of("guaranteed")
    turn = record["turn"].copy()
    turn[1000:1010] = record["turn_envelope"][1000:1010] * 1.01
    forged = replace(record, columns={**record.columns, "turn": turn})
    held = certificate_held(forged)
    assert held is not None
    assert np.flatnonzero(held.outside).tolist() == list(range(1000, 1010))


def test_a_law_without_certificate_has_no_such_row() -> None:
    assert certificate_held(record_of()) is None
    bare = record_of(ppc_controller={"controller": "momentum_tube"})
    assert certificate_held(bare) is None
