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

"""The campaign: a scenario, what varies about it, and the seed; and the runs drawn from it."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ppc_attitude.analysis.requirements import PAPER, Requirements
from ppc_attitude.campaign.distributions import keys
from ppc_attitude.campaign.variables import NOMINAL, VARIABLES, Drawn, Variable, drawn_columns
from ppc_attitude.campaign.varied import SHORT, varied
from ppc_attitude.contract.declared import components_of, parameters_in_use
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import PLANT, SOURCES
from ppc_attitude.contract.versions import versions
from ppc_attitude.contract.yaml_file import read
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kinds import PLANTS
from ppc_attitude.science.sensors.direct import SEED
from ppc_attitude.simulation.closed_loop import stamps_of, timetable_of
from ppc_attitude.simulation.scenario import Scenario, check_components, see_that_it_has, spread


@dataclass(frozen=True)
class Campaign:
    """Everything that determines every run: run `index` is a function of this and the index."""

    scenario: Scenario  # what is varied; its plant's `duration` is the length of every run
    variables: Mapping[str, Variable]
    """How it is varied, in the order in which they are drawn, by the names of their streams."""
    seed: int  # of all draws, not negative
    declaration: Mapping[str, Any] = field(default_factory=dict)
    """The YAML as read, to be kept with the results."""
    made_with: Mapping[str, str] = field(default_factory=versions)
    """Versions; a worker with others would give other numbers, and refuses."""
    required: Requirements = PAPER  # what every run is judged by

    @property
    def duration(self) -> float:
        """Length of every run [s]."""
        return self.scenario.number(PLANT, "duration")

    @cached_property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Instants [ns] of every run."""
        return stamps_of(self.scenario.number(PLANT, "rate"), self.duration)

    @cached_property
    def timetable(self) -> Array | None:
        """The `timetable_of` all runs; None if a drawn value changes it."""
        _, changed = drawn_run(self, 0)  # what changes in one run changes in every other
        for node, values in changed.items():
            for component in components_of(node, self.scenario.parameters[node]):
                if not component.inputs and not values.keys().isdisjoint(component.defaults):
                    return None
        return timetable_of(self.scenario, self.stamps_ns)


def load_campaign(path: Path, base: Scenario, seed: int) -> Campaign:
    """Read a campaign that varies a scenario.

    The file is YAML with one mapping ``campaign`` of variables; see `variables` and
    `distributions`.

    Raises
    ------
    ConfigurationError
        The file is missing, is not such a YAML, or a value in it is wrong; names it.
    """
    content = read(path, "campaign file")
    if not isinstance(content, Mapping) or list(content) != ["campaign"]:
        raise ConfigurationError(f"campaign file {path}: allowed: one key at its top, campaign")
    try:
        return campaign(content["campaign"], base, seed)
    except ConfigurationError as error:
        raise ConfigurationError(f"campaign file {path}: {error}") from None


def campaign(declaration: Any, base: Scenario, seed: int) -> Campaign:
    """Check a declaration (the mapping under ``campaign``) against the scenario that it varies.

    Raises
    ------
    ConfigurationError
        A name or value in it is wrong, or some draw would make an impossible scenario.
    """
    declared = keys("campaign", declaration, (*VARIABLES, "parameters", *SHORT))
    numbers = varied(declared, base)
    found: dict[str, Variable] = {}
    for name, kind in VARIABLES.items():
        if name in declared:
            if kind.of_plant:
                see_that_it_has(base, PLANTS, name, kind.of_plant)
            found[name] = kind.read(name, declared[name], base)
    # Numbers that components declare come before those that start from them.
    variables = {**numbers, **NOMINAL, **found}
    return Campaign(base, variables, seed, dict(declared))


def stream(campaign: Campaign, index: int, variable: str) -> Generator:
    """Random stream of one variable of one run.

    It is made from the seed, the index and the variable's name. So a run can be drawn alone, and a
    variable that is added or dropped moves no other.
    """
    name = zlib.crc32(variable.encode())
    return Generator(
        np.random.PCG64(np.random.SeedSequence(campaign.seed, spawn_key=(index, name)))
    )


def drawn_run(campaign: Campaign, index: int) -> Drawn:
    """Draw one run by its index from 0: a value for each of `drawn_columns`, and parameters."""
    values = {node: dict(own) for node, own in campaign.scenario.parameters.items()}
    row: dict[str, Any] = dict.fromkeys(drawn_columns(campaign.variables))
    changed: dict[str, dict[str, Any]] = {PLANT: {}}
    of_plant = parameters_in_use(PLANT, values[PLANT])  # what is drawn selects no component
    for name, each in campaign.variables.items():
        if each.of_plant and each.of_plant not in of_plant:
            continue
        drawn, new = each.draw(stream(campaign, index, name), values)
        row |= drawn
        for node, own in new.items():
            values[node].update(own)
            changed.setdefault(node, {}).update(own)
    for name in SHORT:
        if name in of_plant:
            row[name] = float(values[PLANT][name])
    row["noise_seed"] = int(stream(campaign, index, "noise_seed").integers(int(SEED.high)))
    changed = spread(values, changed)
    for node in SOURCES:
        if SEED.name in parameters_in_use(node, values[node]):  # unless it was drawn by itself
            changed[node] = {SEED.name: row["noise_seed"], **changed.get(node, {})}
    return row, changed


def draw(campaign: Campaign, index: int) -> dict[str, float | int | str | None]:
    """Draw one run, and give the values alone."""
    return drawn_run(campaign, index)[0]


def scenario_of_run(campaign: Campaign, index: int) -> Scenario:
    """Scenario of one run: complete, checked, to be simulated here or run over ROS.

    Raises
    ------
    ConfigurationError
        What was drawn is impossible.
    """
    result = campaign.scenario.overlaid(drawn_run(campaign, index)[1])
    for node, values in result.parameters.items():
        check_components(node, values)
    return result
