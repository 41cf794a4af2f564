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

"""What a run in process tells of its parts: the same, and at the same instants, as the nodes."""

from pathlib import Path

import numpy as np
import pytest
from conftest import Ask
from craft_helpers import case, configs, overlay

from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science.stamps import seconds
from ppc_attitude.simulation.closed_loop import stamps_of
from ppc_attitude.simulation.diagram import Diagram
from ppc_attitude.simulation.news import concerns
from ppc_attitude.simulation.scenario import Scenario

LOSSES = [
    "wheel/3 seized from 2 for 2",
    "wheel/2 effectiveness 0.0 from 20.0 for 30.0",
    "wheel/1 seized from 45 for 2",
]


def asked_at_each(scenario: Scenario, stamps_ns: np.ndarray) -> list[tuple[float, str]]:
    """What parts warn of, and what ends it, asked after each instant as in a node."""
    diagram, told, warned = Diagram(scenario.parameters), [], set()
    samples = np.zeros((200, 1))
    for stamp in stamps_ns:
        diagram.run(np.array([stamp]), samples)
        for name, part in diagram.parts.items():
            if part.advices == part.told:
                continue
            part.told = part.advices
            if part.advice.warning or name in warned:
                told.append((seconds(int(stamp)), part.advice.text))
            (warned.add if part.advice.warning else warned.discard)(name)
    return told


def test_a_warning_and_its_end_are_told_at_the_instant_at_which_a_node_tells_them() -> None:
    scenario, stamps_ns = case("wheels", faults=LOSSES), stamps_of(100.0, 52.0)
    told = [(time, advice.text) for time, advice in concerns(scenario, stamps_ns)]
    assert told == asked_at_each(scenario, stamps_ns)
    assert told == [
        (3.0, "wheel 3 lost: the others give the torque"),
        (4.0, "no wheel is lost any more"),
        (21.0, "wheel 2 lost: the others give the torque"),
        (46.0, "wheels 1, 2 lost: the others give torque in one plane only"),
        (47.0, "wheel 2 lost: the others give the torque"),
        (50.0, "no wheel is lost any more"),
    ]


def test_a_part_that_warns_all_the_time_is_heard_ten_times() -> None:
    scenario, stamps_ns = case("sensors_cubesat", "guaranteed"), stamps_of(100.0, 20.0)
    told = [(time, advice.text) for time, advice in concerns(scenario, stamps_ns)]
    (*first, last), every = told, asked_at_each(scenario, stamps_ns)
    assert len(told) == 10 < len(every)
    assert first == every[:9]
    assert last == (every[9][0], f"{every[9][1]}; later advice of momentum_tube is left out")


@pytest.mark.parametrize("command", [["simulate"], ["campaign", "--only", "3", "--campaign"]])
def test_fuel_that_is_used_up_is_told_beside_the_result(
    tmp_path: Path, ask: Ask, command: list[str]
) -> None:
    little = overlay(tmp_path / "little.yaml", {PLANT: {"thrusters.fuel": 1e-4}})
    varied = tmp_path / "varied.yaml"
    varied.write_text("campaign: {initial_attitude: {distribution: cone, angle: 0.1}}\n")
    if "--campaign" in command:
        command = [*command, str(varied)]
    files = [f"--config={file}" for file in (*configs("paper", "thrusters"), little)]
    told = ask(*command, *files, "--duration", 10, "--json", code=1)
    assert told.json["controller"] == "ppc"
    (line,) = (line for line in told.err.splitlines() if "fuel" in line)
    assert line.startswith("error: at t = ")
    assert line.endswith(" s the fuel is used up: the thrusters give no torque")
