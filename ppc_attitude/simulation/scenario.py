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

"""The scenario: ROS parameter files, overlaid, checked, turned into the kernels' records."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ppc_attitude.contract.declared import columns_of, components_of, parameters_in_use
from ppc_attitude.contract.parameter_files import read_file, read_files
from ppc_attitude.contract.parameters import OWN, PARAMETERS, SEND_TRUTH
from ppc_attitude.contract.topics import (
    ALLOCATOR,
    CONTROLLER,
    ESTIMATOR,
    HOSTED,
    INJECTOR,
    NODE_OF,
    PLANT,
    SOURCES,
)
from ppc_attitude.science.component import Column, Component, read_from_elsewhere
from ppc_attitude.science.disturbances.pulses import scheduled_pulses
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import see_that_parts_exist
from ppc_attitude.science.kinds import ACTUATORS, Kind, all_components, not_given
from ppc_attitude.science.parameter import NodeParameters, Value, checked, resolved
from ppc_attitude.science.part import configured
from ppc_attitude.science.sensors.star_tracker import check_slots
from ppc_attitude.science.stamps import NANOSECONDS, first_step, seconds


@dataclass(frozen=True)
class Scenario:
    """Checked parameters of every node."""

    parameters: Mapping[str, dict[str, Any]]  # node name to parameter values, complete

    @property
    def controller(self) -> Component:
        """The selected control law."""
        return components_of(CONTROLLER, self.parameters[CONTROLLER])[0]

    @property
    def used(self) -> dict[str, dict[str, Any]]:
        """The parameters that a node or a selected component of it has."""
        found = {}
        for node, values in self.parameters.items():
            names = {parameter.name for parameter in OWN[node]}
            names |= {kind.selector for kind in HOSTED.get(node, ())}
            names |= parameters_in_use(node, values).keys()
            found[node] = {name: value for name, value in values.items() if name in names}
        return found

    def number(self, node: str, name: str) -> float:
        """Value of a parameter that is a number."""
        return float(self.parameters[node][name])

    def overlaid(self, chosen: NodeParameters) -> "Scenario":
        """Return a copy with some parameters replaced by allowed values.

        Whether the components can run with them is checked by `check_components`, or by the run.

        Raises
        ------
        ConfigurationError
            Unknown node or name, a value that is not allowed, or pulses that do not fit.
        """
        _see_that_nodes_exist(chosen)
        changed = {
            node: {**self.parameters[node], **checked(PARAMETERS[node], values, node)}
            for node, values in chosen.items()
        }
        result = Scenario({**self.parameters, **changed})
        if INJECTOR in changed:
            check_pulses(result.parameters[INJECTOR], result.number(PLANT, "rate"))
        return result

    def with_values(self, node: str, **values: Any) -> "Scenario":
        """Return a copy with some parameters of one node replaced, and that node checked again."""
        result = self.overlaid({node: values})
        check_components(node, result.parameters[node])
        return result

    def awaiting_recorder(self) -> "Scenario":
        """Return the scenario of a run that is recorded from its first message on."""
        return self.overlaid({node: {"wait_for_recorder": True} for node in SOURCES})


def weakened(plant: Mapping[str, Any], strength: float) -> dict[str, Any]:
    """Torque limits that the plant's actuator declares, by name, each times a strength.

    Raises
    ------
    ConfigurationError
        The actuator is to be weaker, but declares none.
    """
    actuator = ACTUATORS.selected(plant)
    names = actuator.limits if actuator else ()
    if strength != 1.0 and not names:
        name = f"{ACTUATORS.selector} = {plant[ACTUATORS.selector]}"
        raise ConfigurationError(f"strength = {strength:g}; allowed: 1, as {name} has no limits")
    return {name: np.multiply(strength, plant[name]).tolist() for name in names}


def see_that_it_has(base: Scenario, kind: Kind, what: str, name: str) -> None:
    """Check that a selected component has the parameter that is to be varied.

    Raises
    ------
    ConfigurationError
        It has not, so that varying it would have no effect; the message names the component.
    """
    component = kind.selected(base.parameters[NODE_OF[kind.name]])
    if component is not None and name not in component.defaults:
        raise ConfigurationError(
            f"{what}: {kind.selector} = {component.name} has no parameter {name}"
        )


def scenario(chosen: NodeParameters) -> Scenario:
    """Check given parameters, fill in the defaults, and see that all of it fits together.

    Raises
    ------
    ConfigurationError
        Unknown node or name, or a value that is wrong, infeasible or does not fit another.
    """
    _see_that_nodes_exist(chosen)
    parameters = {
        node: resolved(table, chosen.get(node, {}), node) for node, table in PARAMETERS.items()
    }
    for node, values in parameters.items():
        try:
            check_components(node, values)
        except ConfigurationError as error:  # the cause may be that nothing gives its inputs
            lacking = map(not_given, _absent(parameters, node))
            more = [told for told in lacking if told not in str(error)]
            raise ConfigurationError(f"; {node} reads ".join([str(error), *more[:1]])) from None
    found = Scenario(parameters)
    _check_agreement(parameters)
    _check_allocation(parameters)
    check_pulses(parameters[INJECTOR], found.number(PLANT, "rate"))
    return found


def _see_that_nodes_exist(chosen: NodeParameters) -> None:
    """Raise ConfigurationError if parameters are given for a node that is unknown."""
    if unknown := sorted(chosen.keys() - PARAMETERS.keys()):
        raise ConfigurationError(f"unknown node {unknown[0]}; nodes are {', '.join(PARAMETERS)}")


def check_exchange(parameters: NodeParameters) -> None:
    """Check that no node would wait for ever for an input; in process none waits.

    Raises
    ------
    ConfigurationError
        A component reads a column that no node sends, or a late one without saying when it comes.
    """
    sent = {column.name for node in HOSTED for column in columns_of(node, parameters[node])}
    for component in components_of(ESTIMATOR, parameters[ESTIMATOR]):
        check_slots(component)
    for node in HOSTED:
        absent = _absent(parameters, node)
        for column in read_from_elsewhere(components_of(node, parameters[node])):
            if column.late and node != ESTIMATOR:
                raise ConfigurationError(
                    f"{node}: its components read {column.name}, which comes late; between nodes "
                    "only an estimator may read it; `ppc_attitude simulate` can run this"
                )
            if column in absent:
                raise ConfigurationError(f"{node}: its components read {not_given(column)}")
            if column.name not in sent:
                raise ConfigurationError(
                    f"{node}: its components read {column.name}, which no node sends (the truth is "
                    f"sent where sensors or noise differ from it, or with {SEND_TRUTH.name} of "
                    f"{PLANT}); `ppc_attitude simulate` can run this"
                )


def _absent(parameters: NodeParameters, node: str) -> list[Column]:
    """Columns that components of a node read and no selected component gives."""
    chosen = [each for host in HOSTED for each in components_of(host, parameters[host])]
    given = {column.name for component in chosen for column in component.outputs}
    read = read_from_elsewhere(components_of(node, parameters[node]))
    return [column for column in read if column.name not in given]


def _check_agreement(parameters: NodeParameters) -> None:
    """Check that nodes have one value of each parameter of which all must have the same."""
    told: dict[str, tuple[str, Value]] = {}
    for node in HOSTED:
        values = parameters[node]
        for name in agreed(node, values):
            first, value = told.setdefault(name, (node, values[name]))
            if values[name] != value:
                raise ConfigurationError(
                    f"{node}: {name} = {values[name]}; allowed: {value}, as in {first}, because "
                    "nodes must agree (under /** a file sets it in all nodes)"
                )


def _check_allocation(parameters: NodeParameters) -> None:
    """Check that the selected actuator reads what the selected allocator gives."""
    read = {each.name for part in components_of(PLANT, parameters[PLANT]) for each in part.inputs}
    for component in components_of(ALLOCATOR, parameters[ALLOCATOR]):
        for column in component.outputs:
            takers = [name for name, each in ACTUATORS.components.items() if column in each.inputs]
            if takers and column.name not in read:
                would = " or ".join(f"{ACTUATORS.selector} = {name}" for name in takers)
                raise ConfigurationError(
                    f"{ALLOCATOR}: {component.name} gives {column.name}, which no selected "
                    f"component reads; {would} would read it"
                )


def agreed(node: str, values: Mapping[str, Value]) -> list[str]:
    """Parameters of a node and of its components of which all nodes must have the same value."""
    in_use = parameters_in_use(node, values)
    return [p.name for p in (*OWN[node], *in_use.values()) if p.agreed]


def spread(base: NodeParameters, changed: NodeParameters) -> dict[str, dict[str, Any]]:
    """Give changes of `agreed` parameters to every node that gets no value of its own for them."""
    alike = {node: agreed(node, base[node]) for node in SOURCES}
    shared: dict[str, Any] = {}
    for node in reversed(SOURCES):  # the plant's come last, and stay
        own = changed.get(node, {})
        shared |= {name: own[name] for name in alike[node] if name in own}
    told = {node: {name: shared[name] for name in alike[node] if name in shared} for node in alike}
    every = {node: {**told[node], **changed.get(node, {})} for node in alike}
    return {node: values for node, values in every.items() if values}


def check_pulses(injector: Mapping[str, Any], rate: float) -> None:
    """Check that every scheduled pulse acts at some instant of a plant that runs at a rate [Hz].

    Raises
    ------
    ConfigurationError
        One lies between two instants.
    """
    for hit in scheduled_pulses(injector):
        start, end = int(hit["start_ns"]), int(hit["end_ns"])
        if first_step(start, rate) == first_step(end, rate):
            least = math.ceil(NANOSECONDS / rate)  # no two stamps are further apart
            raise ConfigurationError(
                f"{INJECTOR}: the pulse from {seconds(start)} to {seconds(end)} s lies between two "
                f"instants of {rate} Hz; allowed: pulse_durations from {seconds(least)} s on"
            )


def check_components(node: str, values: Mapping[str, Value]) -> None:
    """Check that the components that a node's parameters select can run with them.

    Raises
    ------
    ConfigurationError
        A value is infeasible, or does not fit another; or a component cannot be configured.
    """
    chosen = components_of(node, values)
    given = {column for component in chosen for column in component.outputs}
    possible = _given_by(node) - given
    try:
        parts = (component.faults(values).items() for component in chosen)
        see_that_parts_exist(values, dict(chain.from_iterable(parts)))
        for component in chosen:
            configured(component, values)
            component.advice(np.zeros((), component.state)[()])  # a node asks before the first step
            component.torques(values)  # in a verdict an error would mean another limit
            for column in component.inputs:
                if column in possible:
                    raise ConfigurationError(f"{component.name} reads {not_given(column)}")
    except ConfigurationError as error:
        raise ConfigurationError(f"{node}: {error}") from None


def _given_by(node: str) -> set[Column]:
    """Columns that components of a node give, and those of no other node."""
    others = {c for each in HOSTED if each != node for kind in HOSTED[each] for c in kind.gives}
    return {c for each in all_components(HOSTED.get(node, ())) for c in each.outputs} - others


def load(paths: Sequence[Path | str], overrides: NodeParameters | None = None) -> Scenario:
    """Read parameter files, apply overrides, check.

    Raises
    ------
    ConfigurationError
        See `read_files` and `scenario`. It names the file with which this error begins; those
        before it are accepted together, or have another one.
    """
    chosen = _overridden(paths, overrides)
    try:
        return scenario(chosen)
    except ConfigurationError as error:
        for count in reversed(range(len(paths))):
            if _refusal(_overridden(paths[:count], overrides)) != str(error):
                break
        else:
            raise
        since = f"the error begins with configuration file {paths[count]}"
        raise ConfigurationError(f"{error}; {since}") from None


def _refusal(chosen: NodeParameters) -> str:
    """Why given parameters are refused; empty if they are not."""
    try:
        scenario(chosen)
    except ConfigurationError as error:
        return str(error)
    return ""


def idle_parameters(paths: Sequence[Path | str], found: Scenario) -> list[str]:
    """Parameters that files set to other values than the defaults, but that nothing selected has.

    Those of laws are left out: one file may have the numbers of several, of which one is selected.
    The name of one that something selected of another node has begins with that of its node.
    """
    every = set().union(*found.used.values())
    used = {**found.used, "**": every}
    return sorted(
        {
            f"{node}.{parameter.name}" if parameter.name in every else parameter.name
            for path in paths
            for told, chosen in read_file(Path(path))
            for node in (PARAMETERS if told == "**" else [told])
            for parameter in PARAMETERS[node]
            if node != CONTROLLER and parameter.name in chosen.keys() - used[told]
            if chosen[parameter.name] != parameter.default
        }
    )


def _overridden(paths: Sequence[Path | str], overrides: NodeParameters | None) -> NodeParameters:
    chosen = read_files(paths)
    for node, values in (overrides or {}).items():
        chosen.setdefault(node, {}).update(values)
    return chosen
