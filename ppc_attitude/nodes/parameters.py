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

"""ROS parameters from the one table: declared with descriptors, checked at start and when set."""

import json
import re
from array import array
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import date
from functools import cache
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter_service import ParameterService

from ppc_attitude.contract.parameters import PARAMETERS, is_of_ros
from ppc_attitude.contract.yaml_file import parsed
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.parameter import LARGEST, Parameter, Value, resolved, unknown

_EXPONENT = re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+")
_LIST = re.compile(r"\[.+\]")
_TYPES = {each.value: each.name for each in RosParameter.Type}

Check = Callable[[Mapping[str, Value]], None]


class NodeParameters:
    """The parameters of one node, declared there from the table of an executable.

    `check` raises ConfigurationError if values do not fit together.

    Attributes
    ----------
    values : dict
        Checked values by name, as of the last accepted change.
    changed : bool
        True if values differ from those that the node took over at its last step boundary.
    """

    def __init__(self, node: Node, executable: str, check: Check) -> None:
        self._check = check
        self._table = {parameter.name: parameter for parameter in PARAMETERS[executable]}
        # rcl gives an empty list, such as `ros2 param dump` writes, without type and value.
        chosen = {
            name: []
            if override.type_ == RosParameter.Type.NOT_SET
            else with_lists(self._read(name, override.value))
            for name, override in node._parameter_overrides.items()
            if not is_of_ros(name)
        }
        strange = chosen.keys() - self._table.keys()
        if strange:
            # A section for all nodes has names of other nodes; a name of no node is a mistake.
            if others := sorted(strange & _of_others(executable)):
                told = f"not used here, as other nodes have them: {', '.join(others)}"
                node.get_logger().warning(told)
            chosen = {name: value for name, value in chosen.items() if name not in others}
        self.values = resolved(self._table.values(), chosen, executable)
        check(self.values)
        for parameter in self._table.values():
            _declare(node, parameter, _quoted(self.values[parameter.name]))
        self.changed = False
        self._taken = self.values
        node.add_pre_set_parameters_callback(self._with_numbers)
        node.add_on_set_parameters_callback(self._on_set)
        self._services = _Services(node, executable)

    def __getitem__(self, name: str) -> Any:
        """Value of a parameter."""
        return self.values[name]

    def is_agreed(self, name: str) -> bool:
        """True if other nodes must have the same value of a parameter."""
        return self._table[name].agreed

    def take_changes(self) -> dict[str, Value]:
        """Return the values that have changed since the last call, and count them as taken over."""
        changes = {name: value for name, value in self.values.items() if value != self._taken[name]}
        self._taken, self.changed = self.values, False
        return changes

    def _read(self, name: str, value: Any) -> Any:
        """Value with numbers where a parameter of numbers comes as text."""
        entry = self._table.get(name)
        return value if entry is None or entry.of_strings else _numbers(value)

    def _with_numbers(self, parameters: list[RosParameter]) -> list[RosParameter]:
        """Make numbers of those that come as text, so that a dump has numbers too."""
        return [
            each if read is each.value else RosParameter(each.name, value=read)
            for each in parameters
            for read in [self._read(each.name, each.value)]
        ]

    def _on_set(self, parameters: list[RosParameter]) -> SetParametersResult:
        proposed = dict(self.values)
        try:
            for parameter in parameters:
                if entry := self._table.get(parameter.name):
                    proposed[parameter.name] = entry.checked(with_lists(parameter.value))
            self._check(proposed)
        except ConfigurationError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self.values = proposed
        self.changed = proposed != self._taken
        return SetParametersResult(successful=True)


class _Services(ParameterService):
    """The services of a node's parameters; a file with other nodes' values sets no shared name.

    `ros2 param load` sends a node the values of every section of the file. Where two sections have
    a name in common it sends one of the two values, and does not say whose it is.
    """

    def __init__(self, node: Node, executable: str) -> None:
        self._executable = executable
        super().__init__(node)

    def _not_to_be_taken(self, asked: ParameterMessage) -> str:
        """Why a value is refused for which rclpy would raise or omit the name; empty if none is."""
        node = self._get_node()
        if not node.has_parameter(asked.name):
            known = [each.name for each in PARAMETERS[self._executable]]
            return unknown(asked.name, known, node.get_name())
        if asked.value.type in _TYPES:
            return ""
        allowed = ", ".join(f"{number} ({name})" for number, name in _TYPES.items())
        return f"{asked.name} is of type {asked.value.type}; allowed: {allowed}"

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        node = self._get_node()
        ours = all(node.has_parameter(each.name) for each in request.parameters)
        for each in request.parameters:
            reason = self._not_to_be_taken(each)
            if not reason and (ours or each.name not in _of_others(self._executable)):
                super()._set_parameters_callback(SetParameters.Request(parameters=[each]), response)
                continue
            reason = reason or (
                f"{each.name}: the loaded values are of several nodes, and nothing tells which of "
                "them is this node's; load a file that holds this node's parameters alone"
            )
            response.results.append(SetParametersResult(successful=False, reason=reason))
        return response

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        reason = next(filter(None, map(self._not_to_be_taken, request.parameters)), "")
        if not reason:
            return super()._set_parameters_atomically_callback(request, response)
        response.result = SetParametersResult(successful=False, reason=reason)
        return response


@cache
def _of_others(executable: str) -> set[str]:
    """Names of the parameters of all other nodes: looked up late, as it loads their components."""
    tables = (table for node, table in PARAMETERS.items() if node != executable)
    return {each.name for table in tables for each in table}


def _numbers(value: Any) -> Any:
    """Make numbers of text, because `ros2 param load` and `set` read YAML 1.1.

    There 3e-05 is a text. A list of such texts comes as texts, a mixed list as one text.
    """
    if isinstance(value, str) and _EXPONENT.fullmatch(value):
        return float(value)
    texts = value[1:-1].split(",") if isinstance(value, str) and _LIST.fullmatch(value) else value
    if isinstance(texts, list) and all(isinstance(each, str) for each in texts):
        with suppress(ValueError):
            return [float(each) for each in texts]
    return value


def with_lists(value: Any) -> Any:
    """Value with a list in the place of the array or tuple in which rclpy keeps several numbers."""
    return list(value) if isinstance(value, array | tuple) else value


def _quoted(value: Any) -> Any:
    """Put a text in quotes that YAML would read as something else, such as a date or a mapping.

    `ros2 param load` reads every value of a dump as YAML, and breaks at those.
    """
    if not isinstance(value, str):
        return value
    try:
        told = parsed(value)
    except ValueError:
        told = {}
    return json.dumps(value, ensure_ascii=False) if isinstance(told, dict | date) else value


def _declare(node: Node, parameter: Parameter, value: Any) -> None:
    if value != []:
        node.declare_parameter(parameter.name, value, descriptor(parameter), ignore_override=True)
        return
    # rclpy takes an empty list for bytes: declare another, then set the value with its type. Only
    # then may it become read-only.
    described = descriptor(parameter)
    described.read_only = False
    node.declare_parameter(parameter.name, [0.0], described, ignore_override=True)
    kind = (
        RosParameter.Type.STRING_ARRAY if parameter.of_strings else RosParameter.Type.DOUBLE_ARRAY
    )
    node.set_parameters([RosParameter(parameter.name, kind, value)])
    node.set_descriptor(parameter.name, descriptor(parameter))


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """ROS descriptor: description with unit, what is allowed, range, read-only."""
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    result = ParameterDescriptor(
        name=parameter.name,
        description=parameter.description + unit,
        additional_constraints=parameter.allowed,
        read_only=parameter.read_only,
        # Types are for our own check, which also says what is allowed.
        dynamic_typing=True,
    )
    # rcl compares a range's ends inclusively and knows no open end: only closed ones go there.
    low, high = parameter.low, parameter.high
    closed = low > -LARGEST and high < LARGEST
    if closed and not parameter.is_list and parameter.above == -float("inf"):
        if isinstance(parameter.default, int):
            result.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
        else:
            result.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return result
