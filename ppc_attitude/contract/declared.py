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

"""Every topic and column of the contract: the standard ones, and those that components declare."""

from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

from ppc_attitude.contract.parameters import SEND_TRUTH
from ppc_attitude.contract.topics import (
    ALLOCATOR,
    EVENTS,
    HOSTED,
    MARKERS_TOPIC,
    NODE_OF,
    NODES,
    OPTIONAL,
    PLANT,
    RECORDED_TOPIC,
    STANDARD,
    Topic,
    topic_of,
)
from ppc_attitude.science.component import Column, Component
from ppc_attitude.science.kinds import (
    CONTROLLERS,
    ENVIRONMENTS,
    KINDS,
    NONE,
    SENSORS,
    Kind,
    ours_first,
    warn_of_unknown_groups,
)
from ppc_attitude.science.parameter import NodeParameters, Parameter
from ppc_attitude.science.signals import ENVIRONMENT_TORQUE, TOLD, TRUTH

_EVENTS = {topic.name.lstrip("/") for topic in (*EVENTS, RECORDED_TOPIC, MARKERS_TOPIC)}
_OF_ALL = {*_EVENTS, "rosout"}
"""Topics that no column may have: in the root namespace a relative name equals an absolute one."""
_COMMON = {each: each for each in ("form", "unit", "width", "part", "late")}
_COMMON |= {"name": "topic", "frame_id": "frame"}
"""Attributes of a `Topic` that all declarations of a column share, and how `Column` calls them."""


def _problem(topics: Iterable[Topic], declared: Mapping[str, Topic]) -> str:
    """Say why a component's topics are in conflict with those of others; empty if they are not."""
    columns = {each.name: each.column for each in declared.values()}
    for topic in topics:
        known = declared.get(topic.column, topic)
        for name, called in _COMMON.items():
            own, other = getattr(topic, name), getattr(known, name)
            if own != other:
                allowed = f"allowed: {other!r}, as another component declares it"
                return f"its column {topic.column} has {called} = {own!r}; {allowed}"
        if topic.name in _OF_ALL or columns.setdefault(topic.name, topic.column) != topic.column:
            allowed = "allowed: a topic that nothing else has"
            return f"its column {topic.column} has topic = {topic.name!r}; {allowed}"
    return ""


def _unbounded(
    component: Component,
    topics: Iterable[Topic],
    declared: Mapping[str, Topic],
    bounded: Mapping[str, str],
) -> str:
    """Say which column of a component cannot bound what it names; empty if all can.

    `bounded` has the column that each bound of other components bounds: a bound has one such
    column, because the margin that a node tells has the name of the bound.
    """
    known = {**declared, **{each.column: each for each in topics}}
    named = [column.bounds for column in component.outputs]
    for column in component.outputs:
        error = known.get(column.bounds)
        if column.bounds and (
            error is None
            or column.bounds == column.name
            or named.count(column.bounds) > 1
            or bounded.get(column.name, column.bounds) != column.bounds
            or (error.unit, False) != (column.unit, column.late)
            or error.width < column.width
        ):
            return (
                f"its column {column.name} has bounds = {column.bounds!r}; allowed: another "
                f"column, with unit = {column.unit!r} and at least {column.width} numbers, which "
                "no other of the component bounds; a late column bounds none, and one of several "
                "components bounds the same in all"
            )
    return ""


def _merged() -> dict[str, Topic]:
    """Topic of every declared column that goes on record, standard ones first.

    A component of another package whose columns are in conflict with those of others is left out.
    """
    found = {topic.column: topic for topic in STANDARD}
    bounded: dict[str, str] = {}
    components = ours_first(kind for kinds in HOSTED.values() for kind in kinds)
    for kind, component in components:
        given = [topic_of(column, NODE_OF[kind.name]) for column in component.outputs]
        problem = _problem(given, found) or _unbounded(component, given, found, bounded)
        if problem:
            kind.leave_out(component.name, problem)
        else:
            for topic in given:
                found.setdefault(topic.column, topic)
            bounded.update({each.name: each.bounds for each in component.outputs if each.bounds})
    for kind, component in components:  # a second pass, as a plant may read what the law gives
        read = [topic_of(column, "") for column in component.inputs if column.name in found]
        if problem := _problem(read, found):
            kind.leave_out(component.name, problem)
            return _merged()  # once more, without its outputs
    return found


warn_of_unknown_groups()
BY_COLUMN = _merged()
SAMPLED = tuple(BY_COLUMN.values())
TOPICS = SAMPLED + EVENTS
BY_NAME = {topic.name: topic for topic in TOPICS}
ATTITUDE_ERROR = BY_COLUMN["attitude_error"]
ATTITUDE_ENVELOPE = BY_COLUMN["attitude_envelope"]
RATE_ERROR = BY_COLUMN["rate_error"]
RATE_ENVELOPE = BY_COLUMN["rate_envelope"]
UNSATURATED_TORQUE = BY_COLUMN["unsaturated_torque"]
BOUNDS = tuple(
    dict.fromkeys(
        (column.bounds, column.name)
        for _, component in ours_first(KINDS)
        for column in component.outputs
        if column.bounds
    )
)
"""Each column that some component bounds, with the column that bounds it."""


def bounds_of(controller: str, parameters: NodeParameters) -> tuple[tuple[str, str], ...]:
    """Return pairs of a column and the column that bounds it, as a run's components declare them.

    For a column that none of the run's components gives, the first component that has it counts;
    so it does for every column if the run's components are not known.

    Parameters
    ----------
    controller : str
        Name of the control law.
    parameters : mapping of str to mapping
        Node name to its parameters, as far as they are known.
    """
    chosen = [each for node in parameters for each in components_of(node, parameters[node])]
    if controller in CONTROLLERS.components:
        chosen.append(CONTROLLERS.components[controller])
    return _bounds_of(tuple(chosen))


@cache
def _bounds_of(components: tuple[Component, ...]) -> tuple[tuple[str, str], ...]:
    own = {column.name: column.bounds for each in components for column in each.outputs}
    found: dict[str, str] = {}
    for name, bound in BOUNDS:
        if name not in own or own.get(bound) == name:
            found.setdefault(name, bound)
    return tuple(found.items())


def components_of(node: str, values: Mapping[str, Any]) -> tuple[Component, ...]:
    """Components that a node runs with its parameters, in their order within an instant."""
    chosen = [kind.selected(values) for kind in HOSTED.get(node, ())]
    return tuple(component for component in chosen if component is not None)


def parameters_in_use(node: str, values: Mapping[str, Any]) -> dict[str, Parameter]:
    """Parameters, by name, of the components that a node runs; values of others have no meaning."""
    return {p.name: p for component in components_of(node, values) for p in component.parameters}


def craft_of(parameters: NodeParameters) -> dict[str, Any]:
    """Values, by name, of the parameters that the selected parts of the craft have.

    What simulated hardware and flight software both have is that of the hardware.
    """
    nodes = ((node, parameters.get(node, {})) for node in (ALLOCATOR, PLANT))
    return {
        name: values[name] for node, values in nodes for name in parameters_in_use(node, values)
    }


def not_installed(parameters: NodeParameters) -> list[str]:
    """Selections in nodes' parameters of components that are not installed."""
    return [
        f"{kind.selector} = {name}"
        for node, kinds in HOSTED.items()
        for kind in kinds
        if (name := parameters.get(node, {}).get(kind.selector, NONE)) != NONE
        and kind.selected(parameters[node]) is None
    ]


def nodes_of(parameters: NodeParameters) -> tuple[str, ...]:
    """Nodes that a run with these parameters has."""
    chosen = (node for node in OPTIONAL if components_of(node, parameters.get(node, {})))
    return (*chosen, *NODES)


def columns_of(node: str, values: Mapping[str, Any]) -> tuple[Column, ...]:
    """Columns that a node puts on record at each instant.

    The torque of an environment of ours is recorded only in the sum of all disturbances: it is
    smooth, so sudden disturbances can be told from it there.
    """
    columns = [column for each in components_of(node, values) for column in each.outputs]
    hidden = []
    if ENVIRONMENTS in HOSTED.get(node, ()) and _is_ours(ENVIRONMENTS, values):
        hidden.append(ENVIRONMENT_TORQUE.name)
    unasked = not values.get(SEND_TRUTH.name, False)
    if SENSORS in HOSTED.get(node, ()) and unasked and is_told_the_truth(values):
        hidden += (column.name for column in TRUTH)
    return tuple(column for column in columns if column.name not in hidden)


def samples_of(node: str, values: Mapping[str, Any]) -> list[Topic]:
    """Topics on which a node sends one message at each instant."""
    return [BY_COLUMN[column.name] for column in columns_of(node, values) if not column.late]


def promised(parameters: NodeParameters) -> list[Topic]:
    """Return the topics that must have a message at every instant, by what is known of the nodes.

    Known are the nodes of ours that took part, with their parameters. A node of the user's in the
    place of one of ours promises nothing.
    """
    sent = [topic for node in sorted(parameters) for topic in samples_of(node, parameters[node])]
    return list(dict.fromkeys(sent))


def gives(node: str) -> tuple[Column, ...]:
    """Columns that a node gives at each instant whatever components it runs."""
    columns = [column for kind in HOSTED.get(node, ()) for column in kind.gives]
    told = TOLD if node == PLANT else ()
    return (*told, *(each for each in columns if each not in {ENVIRONMENT_TORQUE, *TRUTH}))


def is_told_the_truth(values: Mapping[str, Any]) -> bool:
    """True if the plant's sensors, by its parameters, give nothing but the truth.

    What sensors of another package say of themselves is no proof, and an estimator may spoil what
    they give: with such sensors the truth goes on record.
    """
    sensors = SENSORS.selected(values)
    if sensors is None or not _is_ours(SENSORS, values):
        return False
    return sensors.exact({**sensors.defaults, **values})


def _is_ours(kind: Kind, values: Mapping[str, Any]) -> bool:
    component = kind.selected(values)
    return component is None or component.name not in kind.origins
