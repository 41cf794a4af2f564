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

"""The kinds of component, and every component of ours by kind.

A new component is one file and one line here. Another package adds one without touching ours, by
an entry point of the group ``ppc_attitude.<kind>`` that leads to a `Component`. That works for
every kind from which a parameter selects a component.
"""

import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from ppc_attitude.science.component import Column, Component
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.parameter import Parameter
from ppc_attitude.science.signals import (
    APPLIED_TORQUE,
    DESIRED_MOTION,
    DISTURBANCE,
    ENVIRONMENT_TORQUE,
    TOLD,
    TORQUE_COMMAND,
    TRUTH,
)

NONE = "none"
_SCIENCE = "ppc_attitude.science"
_GROUP = "ppc_attitude."


# Read once, because that opens a file of every installed package.
_installed = cache(entry_points)


def _warn(text: str) -> None:
    """Warn of a component of another package; no line of ours is the cause, so none is shown."""
    warnings.warn_explicit(text, UserWarning, "ppc_attitude", 0)


@dataclass(frozen=True)
class Kind:
    """One kind of component: what its components have in common, and which there are."""

    name: str  # its folder in `science`, and the last part of its entry-point group
    selector: str  # name of the parameter that selects one; empty if there is nothing to select
    description: str  # of that parameter
    modules: tuple[str, ...]  # our components, by their file's name; the first one is the default
    gives: tuple[Column, ...]  # columns that each of its components gives
    optional: bool = False  # true if there may be none, which is then the default
    switch: Mapping[bool, str] = field(default_factory=dict)  # what the values true, false select
    read_only: bool = True  # true if one can be selected at start only
    front: str = ""  # module whose `with_front` completes each component; empty: they are complete
    # Entry point of each component of another package; empty before they are loaded.
    origins: dict[str, str] = field(default_factory=dict, init=False)

    @cached_property
    def components(self) -> dict[str, Component]:
        """Every component of this kind by its name, ours first."""
        ours = [import_module(f"{_SCIENCE}.{self.name}.{each}").COMPONENT for each in self.modules]
        found = {component.name: self._completed(component) for component in ours}
        for point in self.points:
            origin = f"entry point {point.name} = {point.value} of {point.group}"
            try:
                component = self._completed(self._fitting(point.load(), found))
            except ConfigurationError as error:
                _warn(f"{origin} is left out: {error}")
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # one of another package may fail in any way
                _warn(f"{origin} cannot be loaded: {error!r}")
            else:
                found[component.name] = component
                self.origins[component.name] = origin
        return found

    @property
    def points(self) -> Iterable[EntryPoint]:
        """Entry points of what other packages add."""
        return _installed().select(group=f"{_GROUP}{self.name}") if self.selector else ()

    def leave_out(self, name: str, problem: str) -> None:
        """Leave out a component of another package that does not go with the others, and warn.

        Raises
        ------
        AssertionError
            It is one of ours.
        """
        if name not in self.origins:
            raise AssertionError(f"{name}: {problem}")
        del self.components[name]
        _warn(f"{self.origins.pop(name)} is left out: {problem}")

    def _completed(self, component: Component) -> Component:
        """Put before a component what every component of this kind has in common (`front`)."""
        if not self.front:
            return component
        completed: Component = import_module(self.front).with_front(component)
        return completed

    def _fitting(self, component: Any, others: Mapping[str, Component]) -> Component:
        """Return what an entry point gave, if it can be a component of this kind; else say why."""
        if not isinstance(component, Component):
            raise ConfigurationError(f"it is a {type(component).__name__}, not a Component")
        if not isinstance(component.name, str) or not component.name:
            raise ConfigurationError(f"its name = {component.name!r}; allowed: a text")
        if component.name in others or (self.optional and component.name == NONE):
            owner = self.origins.get(component.name, "ppc_attitude itself")
            raise ConfigurationError(f"the name {component.name} is taken by {owner}")
        absent = [column.name for column in self.gives if column not in component.outputs]
        if absent:
            raise ConfigurationError(f"{component.name} lacks the outputs {', '.join(absent)}")
        return component

    @property
    def default(self) -> str:
        """Default of the selecting parameter."""
        return NONE if self.optional else next(iter(self.components))

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the selecting parameter, if there is one, and those of all components."""
        merged = {}
        if self.selector:
            merged[self.selector] = Parameter(
                self.selector,
                self.default,
                self.description,
                choices=(NONE,) * self.optional + tuple(self.components),
                read_only=self.read_only,
                switch=self.switch,
            )
        for component in self.components.values():
            merged.update({parameter.name: parameter for parameter in component.parameters})
        return tuple(merged.values())

    def selected(self, values: Mapping[str, Any]) -> Component | None:
        """Component that parameter values select; None where there is none, or an unknown one."""
        name = values.get(self.selector, self.default)
        return self.components.get(self.switch.get(name, name))


PLANTS = Kind(
    "plants",
    "plant",
    "the craft's dynamics",
    ("rigid_body", "flexible", "gyrostat", "gyrostat_rods"),
    TRUTH,
)
SENSORS = Kind(
    "sensors",
    "sensors",
    "the sensors of the craft",
    ("direct", "gyro_star_tracker"),
    (),
    switch={True: "gyro_star_tracker", False: "direct"},
)
ESTIMATORS = Kind(
    "estimators",
    "estimator",
    "the filter that estimates attitude and rate",
    ("mekf",),
    TOLD,
    optional=True,
)
REFERENCES = Kind(
    "references", "mode", "the desired motion", ("paper", "goal", "paper_ahead"), DESIRED_MOTION
)
ENVIRONMENTS = Kind(
    "environments",
    "environment",
    "the torque of the environment",
    ("paper", "orbit", "none"),
    (ENVIRONMENT_TORQUE,),
    switch={True: "paper", False: "none"},
    read_only=False,
)
DISTURBANCES = Kind("disturbances", "", "all external torque", ("pulses",), (DISTURBANCE,))
CONTROLLERS = Kind(
    "controllers",
    "controller",
    "the control law",
    ("ppc", "log_barrier", "quaternion_feedback", "momentum_tube", "momentum_tube_ahead"),
    (TORQUE_COMMAND,),
    front="ppc_attitude.science.rate_observer",
)
ALLOCATORS = Kind(
    "allocators",
    "allocator",
    "the allocator that shares the commanded torque among the actuators",
    ("wheel_drive", "wheel_drive_rods"),
    (),
    optional=True,
)
ACTUATORS = Kind(
    "actuators",
    "actuator",
    "the actuators that turn the command into torque",
    ("ideal", "wheels", "wheels_rods", "wheel_motors", "wheel_motors_rods", "thrusters"),
    (APPLIED_TORQUE,),
)

KINDS = (
    PLANTS,
    SENSORS,
    ESTIMATORS,
    REFERENCES,
    ENVIRONMENTS,
    DISTURBANCES,
    CONTROLLERS,
    ALLOCATORS,
    ACTUATORS,
)
"""In the order in which the components of an instant run."""


def warn_of_unknown_groups() -> None:
    """Warn of entry points whose group begins as ours do, but is that of no selectable kind."""
    groups = {f"{_GROUP}{kind.name}" for kind in KINDS if kind.selector}
    problem = f"is left out: allowed groups: {', '.join(sorted(groups))}"
    for group in _installed().groups - groups:
        for point in _installed().select(group=group) if group.startswith(_GROUP) else ():
            _warn(f"entry point {point.name} = {point.value} of {group} {problem}")


def all_components(kinds: Iterable[Kind] = KINDS) -> Iterator[Component]:
    """Yield every component of some kinds."""
    for kind in kinds:
        yield from kind.components.values()


def ours_first(kinds: Iterable[Kind]) -> list[tuple[Kind, Component]]:
    """Return every component of some kinds with its kind; those of other packages come last."""
    found = [(kind, component) for kind in kinds for component in kind.components.values()]
    return sorted(found, key=lambda each: each[1].name in each[0].origins)


def not_given(column: Column) -> str:
    """Say that no selected component gives a column, and which ones would, if there are any."""
    found = [
        f"{kind.selector} = {component.name}"
        for kind in KINDS
        for component in kind.components.values()
        if column in component.outputs
    ]
    would = f"; {' or '.join(found)} would give it" if found else ""
    return f"{column.name}, which no selected component gives{would}"


def given_twice(column: Column, *owners: tuple[Kind, Component]) -> str:
    """Say that two selected components give a column, and what to select instead of either."""
    both = " and ".join(f"{kind.selector} = {component.name}" for kind, component in owners)
    others = [
        f"{kind.selector} = {name}"
        for kind, _ in owners
        for name, outputs in (
            *((each.name, each.outputs) for each in kind.components.values()),
            *(((NONE, ()),) if kind.optional else ()),
        )
        if column not in outputs
    ]
    return f"{both} both give {column.name}; allowed instead: {' or '.join(others)}"
