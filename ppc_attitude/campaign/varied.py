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

"""Any declared number of a component as a variable: ``NODE.PARAMETER``, or ``NODE.PARAMETER[0]``.

What may vary, and within which bounds, stands in the component's declaration alone. A parameter
that is one quaternion or several can also vary as such, by a distribution of attitudes.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from numpy.random import Generator

from ppc_attitude.campaign.distributions import Attitudes, Number, attitudes, number
from ppc_attitude.campaign.variables import UPPER, Drawn, Variable
from ppc_attitude.contract.declared import parameters_in_use
from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.topics import PLANT, SOURCES
from ppc_attitude.science.attitude import normalised
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.parameter import NodeParameters, Parameter, nearest
from ppc_attitude.science.plants.rigid_body import INERTIA
from ppc_attitude.simulation.scenario import Scenario

SHORT = {name: f"{PLANT}.{name}" for name in ("attitude_noise", "rate_noise")}
"""Parameters of some sensors that are variables under names of their own; other sensors have none,
so that one declaration serves all."""
_NAME = re.compile(r"(\w+)\.([\w.]+)(?:\[(\d+)\])?")


@dataclass(frozen=True)
class Varied(Variable):
    """A declared number that varies."""

    name: str  # of the variable, and of its random stream
    node: str
    parameter: str  # of the node
    places: tuple[int, ...]  # which of its numbers, from 0; empty if it is a single one
    unit: str
    drawn_from: Number | Attitudes

    @property
    def columns(self) -> dict[str, str]:
        """Columns of the numbers, and their units."""
        several = len(self.places) > 1
        names = [f"{self.name}[{place}]" for place in self.places] if several else [self.name]
        return dict.fromkeys(names, self.unit or "1")

    def draw(self, own: Generator, values: NodeParameters) -> Drawn:
        """Draw the numbers; a list of which some vary stays complete."""
        value = values[self.node][self.parameter]
        if not isinstance(self.drawn_from, Attitudes):
            numbers = [self.drawn_from.draw(own)]
        else:
            quaternions = (tuple(value[k : k + 4]) for k in range(0, len(value), 4))
            turned = (self.drawn_from.draw(own, normalised(q)) for q in quaternions)
            numbers = [number for q in turned for number in q]
        if self.places:
            new = dict(zip(self.places, numbers, strict=True))
            value = [new.get(place, each) for place, each in enumerate(value)]
        else:
            (value,) = numbers
        drawn = dict(zip(self.columns, numbers, strict=True))
        return drawn, {self.node: {self.parameter: value}}


def varied(declaration: Mapping[str, Any], base: Scenario) -> dict[str, Varied]:
    """Read what varies of the declared numbers, by the names under which they are drawn.

    They stand in the section ``parameters`` of a campaign's declaration, or have `SHORT` names.
    The scenario that is varied says which components run, and how many numbers a list has.

    Raises
    ------
    ConfigurationError
        A name is of no number of a component that runs, or what can be drawn is not allowed.
    """
    section = declaration.get("parameters", {})
    if not isinstance(section, Mapping):
        allowed = "a mapping of NODE.PARAMETER to distribution"
        raise ConfigurationError(f"parameters = {section!r}; allowed: {allowed}")
    found = {
        name: _read(name, target, declaration[name], base, PARAMETERS[PLANT])
        for name, target in SHORT.items()
        if name in declaration
    }
    for name in idle(declaration, base):
        del found[name]
    for name, each in section.items():
        node = str(name).partition(".")[0]
        if node not in SOURCES:
            nodes = ", ".join(SOURCES)
            raise ConfigurationError(f"parameters has {name}; allowed: NODE.PARAMETER of {nodes}")
        running = parameters_in_use(node, base.parameters[node])
        found[name] = _read(name, name, each, base, running.values())
    varying: set[tuple[str, str, int]] = set()
    for name, each in found.items():
        targets = {(each.node, each.parameter, place) for place in each.places or (0,)}
        if targets & varying:
            raise ConfigurationError(f"parameters: {name} and another name vary the same number")
        varying |= targets
    return found


def idle(declaration: Mapping[str, Any], base: Scenario) -> list[str]:
    """Return the `SHORT` names of a declaration that the craft's sensors do not have."""
    known = parameters_in_use(PLANT, base.parameters[PLANT])
    return [name for name in SHORT if name in declaration and name not in known]


def _read(
    name: str, target: str, distribution: Any, base: Scenario, table: Iterable[Parameter]
) -> Varied:
    numbers = {each.name: each for each in table if each.is_real}
    node, parameter, place = target.partition(".")[0], "", None
    if match := _NAME.fullmatch(target):
        node, parameter, place = match.groups()
    if parameter not in numbers:
        hint = nearest(target, [f"{node}.{each}" for each in numbers])
        raise ConfigurationError(
            f"parameters has {name}, which is no real number of a component that runs{hint}"
        )
    value, declared = base.parameters[node][parameter], numbers[parameter]
    if place is None and isinstance(value, list) and value and declared.quaternion:
        places = tuple(range(len(value)))
        drawn_from: Number | Attitudes = attitudes(name, distribution)
        return Varied(name, node, parameter, places, declared.unit, drawn_from)
    if isinstance(value, list) and (place is None or int(place) >= len(value)):
        raise ConfigurationError(
            f"parameters has {name}; allowed: {node}.{parameter}[INDEX], for it has "
            f"{len(value)} numbers, from index 0"
        )
    if place is not None and not isinstance(value, list):
        raise ConfigurationError(f"parameters has {name}; {node}.{parameter} is a single number")
    if place is not None and declared.quaternion:
        raise ConfigurationError(
            f"parameters has {name}, one number of a quaternion; allowed: {node}.{parameter}, with "
            "a distribution of attitudes: so3, or cone with an angle"
        )
    places = () if place is None else (int(place),)
    if (node, parameter) == (PLANT, INERTIA.name):
        places = tuple(UPPER[each] for each in places)
    drawn_from = number(name, distribution, replace(declared, default=0.0, length=0))
    return Varied(name, node, parameter, places, declared.unit, drawn_from)
