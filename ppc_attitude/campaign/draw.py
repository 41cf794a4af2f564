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

"""From a campaign and an index to a run: what is drawn, and the scenario that it makes.

Every variable has a random stream of its own, made from the seed, the index and the variable's
name. So a run can be drawn alone, and a variable that is added or dropped moves no other.
"""

import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.random import Generator

from ppc_attitude.campaign.declaration import Campaign, Pulse, Variables, with_fault
from ppc_attitude.campaign.distributions import random_axes
from ppc_attitude.campaign.varied import SHORT, values_of
from ppc_attitude.contract.declared import has_parameter
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import INJECTOR, PLANT, REFERENCE, SOURCES
from ppc_attitude.science.attitude import attitude_error, rotation_angle, unit_quaternion
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import FAULTS
from ppc_attitude.science.kernel import Quaternion
from ppc_attitude.science.kinds import REFERENCES
from ppc_attitude.science.references import goal
from ppc_attitude.science.sensors.direct import SEED
from ppc_attitude.simulation.scenario import Scenario, agreed, check_components, weakened

_ELEMENTS = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
_OF_PLANT = {
    "initial_attitude": [f"initial_attitude_{axis}" for axis in "xyzw"],
    "initial_angular_velocity": [f"initial_rate_{axis}" for axis in "xyz"],
    "inertia": [f"inertia_{min(i, j)}{max(i, j)}" for i in "xyz" for j in "xyz"],
}
"""Parameters of the plant, and the drawn columns that have their numbers."""

DRAWN: dict[str, str] = {
    **{f"initial_attitude_{axis}": "1" for axis in "xyzw"},
    "initial_error_angle": "rad",
    **{f"initial_rate_{axis}": "rad/s" for axis in "xyz"},
    "initial_rate": "rad/s",
    "inertia_error": "1",
    **{f"inertia_{element}": "kg·m²" for element in _ELEMENTS},
    "pulse_time": "s",
    "pulse_duration": "s",
    "pulse_torque": "N·m",
    **{f"pulse_torque_{axis}": "N·m" for axis in "xyz"},
    "actuator_strength": "1",
    "attitude_noise": "rad",
    "rate_noise": "rad/s",
    "noise_seed": "",
}
"""Columns that every campaign draws, and their units; null without a pulse, or if no component
that runs has such a parameter."""

_VARYING = (
    "initial_error_angle",
    "initial_rate",
    "inertia_error",
    "pulse_time",
    "pulse_duration",
    "pulse_torque",
    "actuator_strength",
    "attitude_noise",
    "rate_noise",
)
"""Those of them that say how hard a run is, one number a variable."""


def drawn_columns(variables: Variables) -> dict[str, str]:
    """Every drawn column and its unit."""
    units = {
        column: each.unit or "1"
        for name, each in variables.parameters.items()
        for column in each.columns(name)
    }
    return {**DRAWN, **(variables.fault.columns if variables.fault else {}), **units}


def varying(variables: Variables) -> dict[str, str]:
    """Return the drawn columns that say how hard a run is, and their units."""
    units = drawn_columns(variables)
    known = {*DRAWN, "fault"}
    return {name: units[name] for name in units if name in _VARYING or name not in known}


def stream(campaign: Campaign, index: int, variable: str) -> Generator:
    """Random stream of one variable of one run."""
    name = zlib.crc32(variable.encode())
    return Generator(
        np.random.PCG64(np.random.SeedSequence(campaign.seed, spawn_key=(index, name)))
    )


def draw(campaign: Campaign, index: int) -> dict[str, float | int | str | None]:
    """Draw one run, by its index from 0: a value for every key of `drawn_columns`.

    Raises
    ------
    ConfigurationError
        The index is negative.
    """
    if index < 0:
        raise ConfigurationError(f"index = {index}; allowed: ≥ 0")
    variables = campaign.variables
    varied: dict[str, float] = {}
    for name, each in variables.parameters.items():
        numbers = each.draw(stream(campaign, index, name), campaign.scenario)
        varied |= zip(each.columns(name), numbers, strict=True)
    values = _overlaid(campaign, values_of(campaign.scenario, variables.parameters, varied))
    plant, strength, fault = values[PLANT], variables.actuator_strength, variables.fault
    drawn: dict[str, Any] = dict.fromkeys(drawn_columns(variables))
    if has_parameter(PLANT, plant, "initial_attitude"):
        drawn |= _attitude(campaign, index, values)
    if has_parameter(PLANT, plant, "initial_angular_velocity"):
        drawn |= _rate(campaign, index, plant)
    if has_parameter(PLANT, plant, "inertia"):
        drawn |= _inertia(campaign, index, plant)
    for name in SHORT:
        if has_parameter(PLANT, plant, name):
            drawn[name] = float(plant[name])
    own = stream(campaign, index, "actuator_strength")
    drawn["actuator_strength"] = 1.0 if strength is None else strength.draw(own)
    if variables.disturbance is not None:
        drawn |= _pulse(variables.disturbance, stream(campaign, index, "disturbance"))
    if fault:
        drawn |= fault.draw(stream(campaign, index, "fault"))
    drawn["noise_seed"] = int(stream(campaign, index, "noise_seed").integers(int(SEED.high)))
    return drawn | varied


def scenario_of_run(campaign: Campaign, index: int) -> Scenario:
    """Scenario of one run: complete, checked, to be simulated here or run over ROS.

    Raises
    ------
    ConfigurationError
        The index is negative, or what was drawn is impossible.
    """
    result = scenario_with(campaign, draw(campaign, index))
    for node, values in result.parameters.items():
        check_components(node, values)
    return result


def scenario_with(campaign: Campaign, drawn: Mapping[str, Any]) -> Scenario:
    """Scenario of a run from what was drawn for it, with components that nobody has tried.

    Raises
    ------
    ConfigurationError
        What was drawn is not allowed.
    """
    variables = campaign.variables
    changed = values_of(campaign.scenario, variables.parameters, drawn)
    values = _overlaid(campaign, changed)
    numbers = {name: [drawn[each] for each in columns] for name, columns in _OF_PLANT.items()}
    changed[PLANT] = {
        **changed.get(PLANT, {}),
        **{name: each for name, each in numbers.items() if None not in each},
        **weakened(values[PLANT], drawn["actuator_strength"]),
    }
    if variables.fault:
        changed[PLANT][FAULTS.name] = with_fault(values[PLANT], drawn)
    for node in SOURCES:
        names = [name for name in agreed(node, values[node]) if name in changed[PLANT]]
        told = {name: changed[PLANT][name] for name in names}
        if has_parameter(node, values[node], SEED.name):
            told[SEED.name] = drawn["noise_seed"]
        if told:
            changed[node] = {**told, **changed.get(node, {})}  # unless it was drawn by itself
    if drawn["pulse_torque"]:
        pulses, torque = values[INJECTOR], [drawn[f"pulse_torque_{axis}"] for axis in "xyz"]
        changed[INJECTOR] = {
            **changed.get(INJECTOR, {}),
            "pulse_times": [*pulses["pulse_times"], drawn["pulse_time"]],
            "pulse_durations": [*pulses["pulse_durations"], drawn["pulse_duration"]],
            "pulse_torques": [*pulses["pulse_torques"], *torque],
        }
    return campaign.scenario.overlaid(changed)


def _overlaid(
    campaign: Campaign, changed: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Parameters of every node with some of them changed; not checked."""
    parameters = campaign.scenario.parameters
    return {node: {**values, **changed.get(node, {})} for node, values in parameters.items()}


def _attitude(
    campaign: Campaign, index: int, values: Mapping[str, Mapping[str, Any]]
) -> dict[str, float]:
    q = _first_attitude(values[PLANT])
    if campaign.variables.initial_attitude is not None:
        q = campaign.variables.initial_attitude.draw(stream(campaign, index, "initial_attitude"), q)
    named = dict(zip(_OF_PLANT["initial_attitude"], q, strict=True))
    reference = values[REFERENCE]
    if REFERENCES.selected(reference) is goal.COMPONENT:
        desired = q  # it begins where the craft is
    elif has_parameter(REFERENCE, reference, "initial_attitude"):
        desired = _first_attitude(reference)
    else:
        return named
    return {**named, "initial_error_angle": float(rotation_angle(attitude_error(q, desired)))}


def _first_attitude(values: Mapping[str, Any]) -> Quaternion:
    x, y, z, w = unit_quaternion("initial_attitude", values["initial_attitude"]).tolist()
    return x, y, z, w


def _rate(campaign: Campaign, index: int, plant: Mapping[str, Any]) -> dict[str, float]:
    rate = np.array(plant["initial_angular_velocity"])
    if campaign.variables.initial_rate is not None:
        size, direction = campaign.variables.initial_rate
        own = stream(campaign, index, "initial_rate")
        rate = rate + size.draw(own) * np.array(direction(own))
    named = dict(zip(_OF_PLANT["initial_angular_velocity"], rate.tolist(), strict=True))
    return {**named, "initial_rate": float(np.linalg.norm(rate))}


def _inertia(campaign: Campaign, index: int, plant: Mapping[str, Any]) -> dict[str, float]:
    inertia: Array = np.array(plant["inertia"]).reshape(3, 3)
    error = 0.0
    if campaign.variables.inertia_error is not None:
        own = stream(campaign, index, "inertia_error")
        error = campaign.variables.inertia_error.draw(own)
        inertia = perturbed_inertia(inertia, error, own)
    named = {f"inertia_{name}": float(inertia[place]) for name, place in _ELEMENTS.items()}
    return {"inertia_error": error, **named}


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


def _pulse(pulse: Pulse, own: Generator) -> dict[str, float]:
    time, duration, size = (part.draw(own) for part in (pulse.time, pulse.duration, pulse.torque))
    parts = zip("xyz", pulse.direction(own), strict=True)
    return {
        "pulse_time": time,
        "pulse_duration": duration,
        "pulse_torque": size,
        **{f"pulse_torque_{axis}": size * part for axis, part in parts},
    }
