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

"""The variables of a campaign: how each is read, what is drawn of it, and what that changes.

A component's number that varies is one more (`varied`).
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any, TypeAlias

import numpy as np
from numpy.random import Generator

from ppc_attitude.campaign.distributions import (
    Attitudes,
    Direction,
    Number,
    attitudes,
    direction,
    keys,
    number,
    on_sphere,
    random_axes,
)
from ppc_attitude.contract.declared import parameters_in_use
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import INJECTOR, PLANT, REFERENCE
from ppc_attitude.science.attitude import attitude_error, rotation_angle, unit_quaternion
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import FAULTS, fault_texts
from ppc_attitude.science.kinds import REFERENCES
from ppc_attitude.science.parameter import NodeParameters, Parameter
from ppc_attitude.science.plants.rigid_body import INERTIA
from ppc_attitude.science.references import goal
from ppc_attitude.simulation.scenario import Scenario, weakened

_RATE = Parameter("rate", 0.0, "norm of an added rate", "rad/s", low=0.0, high=100.0)
_ERROR = Parameter("error", 0.0, "relative difference of an inertia", low=0.0, high=0.9)
_TORQUE = Parameter("torque", 0.0, "norm of a pulse", "N·m", low=0.0, high=1e6)
_STRENGTH = Parameter("strength", 1.0, "factor on torque limits", above=0.0, high=1e3)

_Q = [f"initial_attitude_{axis}" for axis in "xyzw"]
_OMEGA = [f"initial_rate_{axis}" for axis in "xyz"]
_TAU = [f"pulse_torque_{axis}" for axis in "xyz"]
_J = {
    f"inertia_{'xyz'[row]}{'xyz'[column]}": (row, column)
    for row, column in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
}

DRAWN: dict[str, str] = {
    **dict.fromkeys(_Q, "1"),
    "initial_error_angle": "rad",
    **dict.fromkeys(_OMEGA, "rad/s"),
    "initial_rate": "rad/s",
    "inertia_error": "1",
    **dict.fromkeys(_J, "kg·m²"),
    "pulse_time": "s",
    "pulse_duration": "s",
    "pulse_torque": "N·m",
    **dict.fromkeys(_TAU, "N·m"),
    "actuator_strength": "1",
    "attitude_noise": "rad",
    "rate_noise": "rad/s",
    "noise_seed": "",
}
"""Columns that every campaign draws, and their units; null without a pulse, or if no component
that runs has such a parameter."""
UPPER = (0, 1, 2, 1, 4, 5, 2, 5, 8)
"""Place, on or above the diagonal, of each number of an inertia: where one varies."""
_PARTS = {*_Q, *_OMEGA, *_J, *_TAU, "noise_seed", "fault"}  # none says alone how hard a run is

Drawn: TypeAlias = tuple[dict[str, Any], dict[str, dict[str, Any]]]
"""What was drawn, by column, and the parameters that it changes, by node."""


class Variable(ABC):
    """Something of a run that may vary."""

    of_plant = ""
    """Parameter of the plant without which there is nothing to vary."""

    @property
    def columns(self) -> dict[str, str]:
        """Columns besides `DRAWN`, and their units."""
        return {}

    @abstractmethod
    def draw(self, own: Generator, values: NodeParameters) -> Drawn:
        """Draw it from a stream of its own, for a run of these parameters."""


def drawn_columns(variables: Mapping[str, Variable]) -> dict[str, str]:
    """Every drawn column and its unit."""
    more = (each.columns.items() for each in variables.values())
    return DRAWN | dict(chain.from_iterable(more))


def varying(variables: Mapping[str, Variable]) -> dict[str, str]:
    """Return the drawn columns that say how hard a run is, and their units."""
    return {name: unit for name, unit in drawn_columns(variables).items() if name not in _PARTS}


@dataclass(frozen=True)
class _InitialAttitude(Variable):
    """The craft's attitude at t = 0."""

    of_plant = "initial_attitude"
    drawn_from: Attitudes | None = None

    @classmethod
    def read(cls, name: str, declared: Any, base: Scenario) -> "_InitialAttitude":
        return cls(attitudes(name, declared))

    def draw(self, own: Generator, values: NodeParameters) -> Drawn:
        """Draw the attitude, and tell its angle from the reference's start, if that is declared."""
        q = unit_quaternion(self.of_plant, values[PLANT][self.of_plant])
        if self.drawn_from is not None:
            q = self.drawn_from.draw(own, q)
        drawn, reference = dict(zip(_Q, q, strict=True)), values[REFERENCE]
        desired = None
        if REFERENCES.selected(reference) is goal.COMPONENT:
            desired = q  # it begins where the craft is
        elif "initial_attitude" in parameters_in_use(REFERENCE, reference):
            desired = unit_quaternion("initial_attitude", reference["initial_attitude"])
        if desired is not None:
            drawn["initial_error_angle"] = float(rotation_angle(attitude_error(q, desired)))
        return drawn, {PLANT: {self.of_plant: list(q)}}


@dataclass(frozen=True)
class _InitialRate(Variable):
    """Norm [rad/s] and direction of what is added to the craft's rate at t = 0."""

    of_plant = "initial_angular_velocity"
    size: Number | None = None
    direction: Direction = on_sphere

    @classmethod
    def read(cls, name: str, declared: Any, base: Scenario) -> "_InitialRate":
        parts = keys(name, declared, ("magnitude", "direction"))
        return cls(
            number(f"{name}.magnitude", parts.get("magnitude"), _RATE),
            direction(f"{name}.direction", parts.get("direction", "sphere")),
        )

    def draw(self, own: Generator, values: NodeParameters) -> Drawn:
        rate = np.array(values[PLANT][self.of_plant])
        if self.size is not None:
            rate = rate + self.size.draw(own) * np.array(self.direction(own))
        drawn = dict(zip(_OMEGA, rate.tolist(), strict=True))
        drawn["initial_rate"] = float(np.linalg.norm(rate))
        return drawn, {PLANT: {self.of_plant: rate.tolist()}}


@dataclass(frozen=True)
class _InertiaError(Variable):
    """Largest relative difference, about any axis, of the craft's inertia from the scenario's.

    The controller keeps the scenario's.
    """

    of_plant = INERTIA.name
    error: Number | None = None

    @classmethod
    def read(cls, name: str, declared: Any, base: Scenario) -> "_InertiaError":
        return cls(number(name, declared, _ERROR))

    def draw(self, own: Generator, values: NodeParameters) -> Drawn:
        inertia: Array = np.array(values[PLANT][self.of_plant])[[*UPPER]].reshape(3, 3)
        error = 0.0
        if self.error is not None:
            error = self.error.draw(own)
            inertia = perturbed_inertia(inertia, error, own)
        drawn = {name: float(inertia[place]) for name, place in _J.items()}
        changed = {PLANT: {self.of_plant: inertia.ravel().tolist()}}
        return {"inertia_error": error, **drawn}, changed


def perturbed_inertia(inertia: Array, error: float, own: Generator) -> Array:
    """Draw a rigid body's inertia that differs by at most a part `error` about any axis.

    What is given, shape (3, 3) [kg·m²], and what is drawn are symmetric, positive definite, and of
    a body that can exist; 0 ≤ error < 1.

    Notes
    -----
    A body's second moments S = ½ tr(J) 1 − J are positive semidefinite, and every such S is that
    of a body. So S is what is perturbed: S^½ (1 + error E) S^½ with ‖E‖ = 1 stays between
    (1 ± error) S, and J, linear and monotone in S, between (1 ± error) J.
    """
    moments = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    values, axes = np.linalg.eigh(moments)
    root = axes * np.sqrt(np.maximum(values, 0.0)) @ axes.T
    part = 2.0 * own.random(3) - 1.0
    frame = random_axes(own)
    change = frame * (part / np.abs(part).max()) @ frame.T
    new = moments + error * root @ change @ root
    result = np.trace(new) * np.eye(3) - new
    return np.asarray(0.5 * (result + result.T))


@dataclass(frozen=True)
class _Disturbance(Variable):
    """One sudden pulse, in addition to the scenario's: start [s], duration [s], norm [N·m]."""

    numbers: tuple[Number, Number, Number]
    direction: Direction  # body axes

    @classmethod
    def read(cls, name: str, declared: Any, base: Scenario) -> "_Disturbance":
        parts = keys(name, declared, ("time", "duration", "torque", "direction"))
        within, lasting = _times(base)
        time = number(f"{name}.time", parts.get("time"), within)
        duration = number(f"{name}.duration", parts.get("duration"), lasting)
        torque = number(f"{name}.torque", parts.get("torque"), _TORQUE)
        sense = direction(f"{name}.direction", parts.get("direction", "sphere"))
        return cls((time, duration, torque), sense)

    def draw(self, own: Generator, values: NodeParameters) -> Drawn:
        time, duration, size = (each.draw(own) for each in self.numbers)
        torque = [size * part for part in self.direction(own)]
        drawn = {"pulse_time": time, "pulse_duration": duration, "pulse_torque": size}
        drawn |= zip(_TAU, torque, strict=True)
        pulses = (
            ("pulse_times", [time]),
            ("pulse_durations", [duration]),
            ("pulse_torques", torque),
        )
        return drawn, {INJECTOR: {name: [*values[INJECTOR][name], *new] for name, new in pulses}}


def _times(base: Scenario) -> tuple[Parameter, Parameter]:
    """When something may begin in a run, and how long it may last."""
    length, step = base.number(PLANT, "duration"), 1.0 / base.number(PLANT, "rate")
    within = Parameter("time", 0.0, "a begin", "s (the length of a run)", low=0.0, high=length)
    least = "s (the least that acts, the length of a run)"
    return within, Parameter("duration", length, "a length", least, low=step, high=length)


@dataclass(frozen=True)
class _Fault(Variable):
    """One fault of the craft's hardware, in addition to the scenario's."""

    what: tuple[str, ...]  # texts of faults without times, equally likely
    time: Number  # start [s]
    duration: Number | None  # [s]; None: for ever

    @classmethod
    def read(cls, name: str, declared: Any, base: Scenario) -> "_Fault":
        parts = keys(name, declared, ("what", "time", "duration"))
        within, lasting = _times(base)
        what = parts.get("what")
        texts = isinstance(what, list) and all(isinstance(each, str) for each in what)
        if not (texts and what):
            allowed = "a list of faults without times"
            raise ConfigurationError(f"{name}.what = {what!r}; allowed: {allowed}")
        lasts = None
        time = number(f"{name}.time", parts.get("time"), within)
        if "duration" in parts:
            lasts = number(f"{name}.duration", parts["duration"], lasting)
        for each in what:
            _try(f"{name}.what", base, _with_fault(base.parameters[PLANT], each, 0.0))
        return cls(tuple(what), time, lasts)

    @property
    def columns(self) -> dict[str, str]:
        """Columns of the fault, and their units."""
        return {"fault": "", "fault_time": "s"} | ({"fault_duration": "s"} if self.duration else {})

    def draw(self, own: Generator, values: NodeParameters) -> Drawn:
        """Draw times, and then what fails."""
        numbers = [each.draw(own) for each in (self.time, self.duration) if each]
        what = str(own.choice(self.what))
        drawn = dict(zip(self.columns, [what, *numbers], strict=True))
        return drawn, {PLANT: _with_fault(values[PLANT], what, *numbers)}


def _with_fault(plant: Mapping[str, Any], what: str, *times: float) -> dict[str, Any]:
    """Add a fault to the plant's; the times are its start and, unless it lasts, duration [s]."""
    words = zip(("from", "for"), times, strict=False)
    text = " ".join([what, *(f"{word} {time!r}" for word, time in words)])
    return {FAULTS.name: [*fault_texts(plant), text]}


@dataclass(frozen=True)
class _ActuatorStrength(Variable):
    """Factor on the torque limits of the actuator, of which the controller does not know."""

    factor: Number | None = None

    @classmethod
    def read(cls, name: str, declared: Any, base: Scenario) -> "_ActuatorStrength":
        found = number(name, declared, _STRENGTH)
        weakest = weakened(base.parameters[PLANT], found.low)
        _try(f"{name} can become {found.low:g}", base, weakest)
        return cls(found)

    def draw(self, own: Generator, values: NodeParameters) -> Drawn:
        factor = 1.0 if self.factor is None else self.factor.draw(own)
        return {"actuator_strength": factor}, {PLANT: weakened(values[PLANT], factor)}


def _try(what: str, base: Scenario, values: Mapping[str, Any]) -> None:
    """Refuse what would give the plant impossible parameters."""
    try:
        base.with_values(PLANT, **values)
    except ConfigurationError as error:
        raise ConfigurationError(f"{what}: {error}") from None


VARIABLES: dict[str, Any] = {
    "initial_attitude": _InitialAttitude,
    "initial_rate": _InitialRate,
    "inertia_error": _InertiaError,
    "disturbance": _Disturbance,
    "fault": _Fault,
    "actuator_strength": _ActuatorStrength,
}
"""Name in a declaration to what it is; `read` checks what is declared for a scenario."""
NOMINAL: dict[str, Variable] = {
    name: VARIABLES[name]()
    for name in ("initial_attitude", "initial_rate", "inertia_error", "actuator_strength")
}
"""Variables that every run has columns of; undeclared, they are as in the scenario."""
