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

"""The craft that are shipped, by the names of their files, and parts of a craft by themselves."""

from functools import cache
from pathlib import Path
from typing import Any

import yaml

from ppc_attitude.analysis.requirements import PAPER, Requirements
from ppc_attitude.command_line.proportions import conditions_of
from ppc_attitude.contract.topics import CONTROLLER, PLANT
from ppc_attitude.science.conditions import Condition
from ppc_attitude.science.guarantee.assumptions import Assumptions, Law, assumptions_of, law_of
from ppc_attitude.science.kernel import Quaternion
from ppc_attitude.science.orbit import ORBIT_PARAMETERS, orbit_of
from ppc_attitude.science.parameter import NodeParameters
from ppc_attitude.science.part import Part
from ppc_attitude.science.sky import EARTH_RADIUS
from ppc_attitude.simulation.scenario import Scenario, load

ROOT = Path(__file__).parents[1]
CONFIG = ROOT / "config"
FRICTIONLESS = {f"wheels__{name}": [0.0] for name in ("viscous", "coulomb", "static")}


def configs(*names: str) -> list[Path]:
    return [CONFIG / f"{name}.yaml" for name in names]


def overlay(path: Path, nodes: NodeParameters) -> Path:
    """Write a configuration file that gives nodes these parameters."""
    content = {node: {"ros__parameters": dict(values)} for node, values in nodes.items()}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def dotted(values: dict[str, Any]) -> dict[str, Any]:
    """Parameters whose names have __ for dots."""
    return {name.replace("__", "."): value for name, value in values.items()}


def case(*overlays: str, **plant: Any) -> Scenario:
    """The paper's case with overlays, and parameters of the plant (`dotted`)."""
    return load(configs("paper", *overlays), {PLANT: dotted(plant)})


def pulse(time: float, duration: float, *torque: float) -> dict[str, Any]:
    """Parameters of the injector: a torque [N·m] from a time [s] on, so long [s]."""
    return {"pulse_times": [time], "pulse_durations": [duration], "pulse_torques": [*torque]}


def conditions(
    scenario: Scenario,
    required: Requirements = PAPER,
    error: Quaternion = (0.0, 0.0, 0.0, 1.0),
    environment: float = 0.0,
) -> dict[str, Condition]:
    """What `check` says of a craft, by name; q_e at the start, x y z w; environment [N·m]."""
    return {each.name: each for each in conditions_of(scenario, required, error, environment)}


@cache
def guaranteed() -> tuple[Assumptions, Law]:
    """What the certificate of the shipped craft assumes, and its law."""
    values = case("guaranteed").parameters[CONTROLLER]
    return assumptions_of(values), law_of(values)


def orbit_record(semi_major_axis: float, *elements: float) -> Any:
    """Orbit by its semi-major axis [m], eccentricity, inclination and the angles [rad]."""
    given = (semi_major_axis - EARTH_RADIUS, *elements, "", "")
    return orbit_of({each.name: x for each, x in zip(ORBIT_PARAMETERS, given, strict=True)})


def part_of(kind: Any, name: str, *faults: str, **values: Any) -> Part:
    """A component as it is run at 100 Hz, with faults and parameters (`dotted`)."""
    component = kind.components[name]
    given = {**component.defaults, "rate": 100.0, "faults": [*faults], **dotted(values)}
    return Part(component, given)
