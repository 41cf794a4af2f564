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

"""The campaign: a scenario, what varies about it, and the seed; read from YAML and checked."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ppc_attitude.analysis.requirements import PAPER, Requirements
from ppc_attitude.campaign.distributions import (
    Attitudes,
    Direction,
    Number,
    Range,
    attitudes,
    direction,
    keys,
    number,
)
from ppc_attitude.campaign.varied import SHORT, Varied, varied
from ppc_attitude.contract.declared import components_of
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.contract.versions import versions
from ppc_attitude.contract.yaml_file import read
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import fault_texts
from ppc_attitude.science.kinds import ACTUATORS, PLANTS
from ppc_attitude.science.plants.rigid_body import INERTIA
from ppc_attitude.simulation.closed_loop import stamps_of, timetable_of
from ppc_attitude.simulation.scenario import Scenario, see_that_it_has, weakened

LARGEST_SEED = 2**63 - 1

_RATE = Range(0.0, 100.0, "rad/s")
_INERTIA = Range(0.0, 0.9)
_TORQUE = Range(0.0, 1e6, "N·m")
_STRENGTH = Range(0.0, 1e3, open_low=True)


@dataclass(frozen=True)
class Pulse:
    """How the sudden pulse of every run is drawn."""

    time: Number  # start [s]
    duration: Number  # [s]
    torque: Number  # norm [N·m]
    direction: Direction  # body axes


@dataclass(frozen=True)
class RandomFault:
    """How the fault of every run is drawn."""

    what: tuple[str, ...]  # texts of faults without times, equally likely
    time: Number  # start [s]
    duration: Number | None  # [s]; None: for ever

    @property
    def columns(self) -> dict[str, str]:
        """What is drawn, and its unit."""
        return {"fault": "", "fault_time": "s"} | ({"fault_duration": "s"} if self.duration else {})

    def draw(self, own: Generator) -> dict[str, Any]:
        """Draw a number for each column, and for the first one a text."""
        numbers = [each.draw(own) for each in (self.time, self.duration) if each]
        return dict(zip(self.columns, [str(own.choice(self.what)), *numbers], strict=True))


def with_fault(plant: Mapping[str, Any], drawn: Mapping[str, Any]) -> list[str]:
    """The plant's own faults, and behind them the one that was drawn."""
    lasts = f" for {drawn['fault_duration']!r}" if "fault_duration" in drawn else ""
    return [*fault_texts(plant), f"{drawn['fault']} from {drawn['fault_time']!r}{lasts}"]


@dataclass(frozen=True)
class Variables:
    """Variables of a campaign; None leaves one as the scenario has it.

    Attributes
    ----------
    initial_attitude : Attitudes or None
        The craft's attitude at t = 0.
    initial_rate : (Number, Direction) or None
        Norm [rad/s] and direction of what is added to the craft's rate at t = 0.
    inertia_error : Number or None
        Largest relative difference, about any axis, of the craft's inertia from the scenario's;
        the controller keeps the scenario's.
    disturbance : Pulse or None
        One sudden pulse, in addition to the scenario's.
    fault : RandomFault or None
        One fault of the craft's hardware, in addition to the scenario's.
    actuator_strength : Number or None
        Factor on the torque limits of the actuator, of which the controller does not know.
    parameters : mapping of str to Varied
        Other numbers that components declare, by the names under which they are drawn.
    """

    initial_attitude: Attitudes | None = None
    initial_rate: tuple[Number, Direction] | None = None
    inertia_error: Number | None = None
    disturbance: Pulse | None = None
    fault: RandomFault | None = None
    actuator_strength: Number | None = None
    parameters: Mapping[str, Varied] = field(default_factory=dict)


@dataclass(frozen=True)
class Campaign:
    """Everything that determines every run: run `index` is a function of this and the index.

    Attributes
    ----------
    scenario : Scenario
        What is varied; its plant's `duration` is the length of every run.
    variables : Variables
        How it is varied.
    seed : int
        Seed of all draws, 0 to 2⁶³ − 1.
    declaration : mapping
        The YAML as read, to be kept with the results.
    made_with : mapping of str to str
        Versions; a worker with others would give other numbers, and refuses.
    required : Requirements
        What every run is judged by.
    """

    scenario: Scenario
    variables: Variables
    seed: int
    declaration: Mapping[str, Any] = field(default_factory=dict)
    made_with: Mapping[str, str] = field(default_factory=versions)
    required: Requirements = PAPER

    def __post_init__(self) -> None:
        """See that it can be drawn from."""
        if not 0 <= self.seed <= LARGEST_SEED:
            raise ConfigurationError(f"seed = {self.seed}; allowed: 0 to {LARGEST_SEED}")
        if self.duration <= 0.0:
            raise ConfigurationError(
                f"{PLANT}: duration = {self.duration:g} s; a campaign needs > 0"
            )

    @property
    def duration(self) -> float:
        """Length of every run [s]."""
        return self.scenario.number(PLANT, "duration")

    @property
    def rate(self) -> float:
        """Steps per second [Hz]."""
        return self.scenario.number(PLANT, "rate")

    @cached_property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Instants [ns] of every run."""
        return stamps_of(self.rate, self.duration)

    @cached_property
    def timetable(self) -> Array | None:
        """The `timetable_of` all runs; None if what is drawn changes it."""
        for each in self.variables.parameters.values():
            for component in components_of(each.node, self.scenario.parameters[each.node]):
                names = [parameter.name for parameter in component.parameters]
                if not component.inputs and each.parameter in names:
                    return None
        return timetable_of(self.scenario, self.stamps_ns)


def load_campaign(path: Path, base: Scenario, seed: int) -> Campaign:
    """Read a campaign that varies a scenario.

    The file is YAML with one mapping ``campaign`` of variables; see `Variables` and
    `distributions`.

    Raises
    ------
    ConfigurationError
        The file is missing, is not such a YAML, or a value in it is wrong; names it.
    """
    content = read(path, "campaign file")
    if not isinstance(content, Mapping) or list(content) != ["campaign"]:
        raise ConfigurationError(f"campaign file {path}: needs the key campaign at its top, alone")
    try:
        return campaign(content["campaign"], base, seed)
    except ConfigurationError as error:
        raise ConfigurationError(f"campaign file {path}: {error}") from None


_OF_PLANT = {
    "initial_attitude": "initial_attitude",
    "initial_rate": "initial_angular_velocity",
    "inertia_error": INERTIA.name,
}
"""Variables of a campaign that vary a parameter of the plant."""


def campaign(declaration: Any, base: Scenario, seed: int) -> Campaign:
    """Check a declaration (the mapping under ``campaign``) against the scenario that it varies.

    Raises
    ------
    ConfigurationError
        A name or value in it is wrong, or some draw would make an impossible scenario.
    """
    allowed = (*(each.name for each in fields(Variables)), *SHORT)
    declared = keys("campaign", declaration, allowed)
    for name, parameter in _OF_PLANT.items():
        if name in declared:
            see_that_it_has(base, PLANTS, name, parameter)
    variables = Variables(
        initial_attitude=_optional(declared, "initial_attitude", attitudes),
        initial_rate=_optional(declared, "initial_rate", _rate),
        inertia_error=_optional(declared, "inertia_error", number, _INERTIA),
        disturbance=_optional(declared, "disturbance", _pulse, base),
        fault=_optional(declared, "fault", _fault, base),
        actuator_strength=_optional(declared, "actuator_strength", _strength, base),
        parameters=varied(declared, base),
    )
    return Campaign(base, variables, seed, dict(declared))


def _optional(declared: Mapping[str, Any], name: str, read: Any, *allowed: Any) -> Any:
    return read(name, declared[name], *allowed) if name in declared else None


def _rate(name: str, declared: Any) -> tuple[Number, Direction]:
    parts = keys(name, declared, ("magnitude", "direction"))
    return (
        number(f"{name}.magnitude", parts.get("magnitude"), _RATE),
        direction(f"{name}.direction", parts.get("direction", "sphere")),
    )


def _times(base: Scenario) -> tuple[Range, Range]:
    """When something may begin in a run, and how long it may last."""
    length, step = base.number(PLANT, "duration"), 1.0 / base.number(PLANT, "rate")
    lasting = Range(step, length, "s (the least that acts, the length of a run)")
    return Range(0.0, length, "s (the length of a run)"), lasting


def _pulse(name: str, declared: Any, base: Scenario) -> Pulse:
    parts = keys(name, declared, ("time", "duration", "torque", "direction"))
    within, lasting = _times(base)
    return Pulse(
        time=number(f"{name}.time", parts.get("time"), within),
        duration=number(f"{name}.duration", parts.get("duration"), lasting),
        torque=number(f"{name}.torque", parts.get("torque"), _TORQUE),
        direction=direction(f"{name}.direction", parts.get("direction", "sphere")),
    )


def _fault(name: str, declared: Any, base: Scenario) -> RandomFault:
    parts, (within, lasting) = keys(name, declared, ("what", "time", "duration")), _times(base)
    what = parts.get("what")
    if not isinstance(what, list) or not what or not all(isinstance(each, str) for each in what):
        raise ConfigurationError(f"{name}.what = {what!r}; allowed: a list of faults without times")
    found = RandomFault(
        tuple(what),
        number(f"{name}.time", parts.get("time"), within),
        number(f"{name}.duration", parts["duration"], lasting) if "duration" in parts else None,
    )
    for each in what:
        drawn = {"fault": each, "fault_time": 0.0}
        _try(f"{name}.what", base, faults=with_fault(base.parameters[PLANT], drawn))
    return found


def _strength(name: str, declared: Any, base: Scenario) -> Number:
    found = number(name, declared, _STRENGTH)
    weakest = weakened(base.parameters[PLANT], found.low)
    if not weakest:
        actuator = base.parameters[PLANT][ACTUATORS.selector]
        raise ConfigurationError(f"{name}: {ACTUATORS.selector} = {actuator} declares no limits")
    _try(f"{name} can become {found.low:g}", base, **weakest)
    return found


def _try(what: str, base: Scenario, **values: Any) -> None:
    """Refuse what would give the plant impossible parameters."""
    try:
        base.with_values(PLANT, **values)
    except ConfigurationError as error:
        raise ConfigurationError(f"{what}: {error}") from None
