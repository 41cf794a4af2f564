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

"""A parameter: declared once, with description, unit and range; validated in one place."""

import json
import math
import re
import sys
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from ppc_attitude.science.errors import ConfigurationError

Value: TypeAlias = bool | int | float | str | list[Any]
NodeParameters: TypeAlias = Mapping[str, Mapping[str, Any]]
"""Values of parameters, by the name of the node and then by their own."""
LARGEST = 1e30
"""No number of a craft is larger: products of several such numbers are still finite."""
_LARGEST_INTEGER = 2**63 - 1
_NAME = re.compile(r"[A-Za-z_]\w*(\.\w+)*", re.ASCII)


@dataclass(frozen=True)
class Parameter:
    """One parameter of a node.

    Attributes
    ----------
    name : str
        ROS parameter name; dots group.
    default : bool, int, float, str or list
        Its type is the parameter's type; a list holds floats (or strings where the default does).
    description : str
        One line for people.
    unit : str
        Empty for a number without unit.
    low, high : float
        Allowed range of a number, or of each number of a list, both ends included; by default up
        to `LARGEST`.
    length : int
        Required length of a list; 0 allows any, a negative −n any multiple of n.
    choices : tuple of str
        Allowed strings (of a list: allowed elements); empty allows any.
    read_only : bool
        True if it only has effect at start.
    above : float
        Numbers must be strictly larger than this.
    switch : mapping of bool to str
        Choices that true and false stand for.
    quaternion : bool
        True if its numbers are one quaternion x y z w (of length 4) or several (of length −4).
    agreed : bool
        True if all nodes that use it must have the same value, because it describes what they
        exchange, or the craft itself.
    """

    name: str
    default: Value
    description: str
    unit: str = ""
    low: float = -LARGEST
    high: float = LARGEST
    length: int = 0
    choices: tuple[str, ...] = ()
    read_only: bool = False
    above: float = -math.inf
    switch: Mapping[bool, str] = field(default_factory=dict)
    quaternion: bool = False
    agreed: bool = False

    def __post_init__(self) -> None:
        """Limit an integer to those of ROS."""
        if isinstance(self.default, int):
            object.__setattr__(self, "low", max(self.low, -_LARGEST_INTEGER))
            object.__setattr__(self, "high", min(self.high, _LARGEST_INTEGER))

    @property
    def field(self) -> tuple[Any, ...]:
        """Field of a record that holds the parameter's number or numbers; see `record_type`."""
        if self.of_strings or (self.is_list and self.length < 1):
            raise ValueError(
                f"no field of a record holds {self.name}, {self.allowed}; allowed: a number, or a "
                "list of a certain length"
            )
        name = self.name.rpartition(".")[2]
        if self.is_list:
            return name, np.float64, (self.length,)
        return name, np.float64 if isinstance(self.default, bool | float) else np.int64

    @property
    def is_list(self) -> bool:
        """True if the parameter is an array."""
        return isinstance(self.default, list)

    @property
    def of_strings(self) -> bool:
        """True if the parameter is a string or an array of strings."""
        first = self.default[:1] if isinstance(self.default, list) else [self.default]
        return any(isinstance(value, str) for value in first)

    @property
    def is_real(self) -> bool:
        """True if it is a real number, or an array of them."""
        return not self.of_strings and not isinstance(self.default, int)

    @property
    def allowed(self) -> str:
        """The allowed values, in words, for documentation and errors."""
        parts = []
        if isinstance(self.default, bool):
            parts.append("true or false")
        elif self.choices:
            parts.append(("any of " if self.is_list else "one of ") + ", ".join(self.choices))
            parts.extend(f"{str(on).lower()} for {name}" for on, name in self.switch.items())
        elif self.of_strings:
            parts.append("a list of texts" if self.is_list else "text")
        else:
            parts.append("an integer" if isinstance(self.default, int) else "finite")
            parts.extend(self._bounds())
        if self.is_list and self.length:
            parts.append(
                f"{self.length} values" if self.length > 0 else f"a multiple of {-self.length}"
            )
        return ", ".join(parts)

    def _bounds(self) -> Iterable[str]:
        if max(self.low, self.above) == -LARGEST and self.high == LARGEST:
            yield f"up to ±{LARGEST:g}"
            return
        if math.isfinite(self.above):
            yield f"> {exact_text(self.above)}"
        if self.low > self.above:
            yield f"≥ {exact_text(self.low)}"
        yield f"≤ {exact_text(self.high)}"

    def demand_declarable(self) -> None:
        """Check that a node can declare it: a node declares those of all components it might run.

        Raises
        ------
        ConfigurationError
            The default is not allowed.
        ValueError
            The name is no parameter name, the description or the unit is no text, or a list of
            quaternions may have any length.
        """
        texts = (self.name, self.description, self.unit)
        if not all(isinstance(each, str) for each in texts) or not _NAME.fullmatch(self.name):
            raise ValueError(
                f"parameter {self.name!r} with description = {self.description!r}, unit = "
                f"{self.unit!r}; allowed: a name of letters, digits and _, in groups with . "
                "between them, and texts"
            )
        if self.quaternion and abs(self.length) != 4:
            raise ValueError(f"{self.name}: length = {self.length}; allowed for quaternions: 4, -4")
        self.checked(self.default)

    def checked(self, value: Any) -> Value:
        """Return the value in the parameter's own type.

        Raises
        ------
        ConfigurationError
            Wrong type, length or range, or not finite; the message says what is allowed.
        """
        if not self.is_list:
            scalar: Value = self._element(value, self.default)
            return scalar
        if isinstance(value, str | Mapping) or not hasattr(value, "__iter__"):
            raise self._refusal(value)
        elements = list(value)
        count = len(elements)
        if (self.length > 0 and count != self.length) or (self.length < 0 and count % -self.length):
            raise ConfigurationError(
                f"{self.name} = {elements} has {count} values; allowed: {self.allowed}"
            )
        prototype: Value = "" if self.of_strings else 0.0
        return [self._element(element, prototype) for element in elements]

    def _element(self, value: Any, prototype: Any) -> Any:
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(prototype, str):
            value = self.switch.get(value, value) if isinstance(value, bool) else unquoted(value)
            fits = isinstance(value, str) and (not self.choices or value in self.choices)
        elif isinstance(prototype, bool) or isinstance(value, bool):
            fits = isinstance(prototype, bool) and isinstance(value, bool)
        else:
            fits = (
                isinstance(value, int | float)
                and self.low <= value <= self.high
                and self.above < value
                and abs(value) <= sys.float_info.max
                and (isinstance(prototype, float) or value == int(value))
            )
        if not fits:
            raise self._refusal(value)
        return type(prototype)(value)

    def _refusal(self, value: Any) -> ConfigurationError:
        unit = f" {self.unit}" if self.unit else ""
        return ConfigurationError(f"{self.name} = {value!r}{unit}; allowed: {self.allowed}")


at_start = partial(Parameter, read_only=True)
"""Make a parameter that takes effect at start only."""
RATE = at_start(
    "rate", 100.0, "steps per second of simulated time", "Hz", low=1.0, high=10000.0, agreed=True
)
"""Parameter of the plant, and of every node that counts the plant's steps."""


def record_type(*fields: Any) -> np.dtype[Any]:
    """Type of a record of a kernel: its fields are laid out as in C.

    Parameters
    ----------
    fields : Parameter, Column, numpy.dtype or tuple
        A parameter (its field has the last part of its name, and its length if it is a list), a
        column, a type of which all fields are taken, or a field as NumPy describes it.
    """
    described: list[Any] = []
    for each in fields:
        if isinstance(each, np.dtype):
            described += [(name, each[name]) for name in each.names or ()]
        else:
            described.append(each if isinstance(each, tuple) else each.field)
    return np.dtype(described, align=True)


def filled(kind: np.dtype[Any], values: Any, group: str = "", **made: Any) -> Any:
    """Record whose fields are the given ones, and otherwise values of parameters.

    Parameters
    ----------
    kind : numpy.dtype
        Type of the record.
    values : mapping
        Checked parameter values, or a record that has the other fields.
    group : str
        Prefix, with its dot, of the parameters' names before the names of the fields.
    made : value
        Values of fields that no parameter has, by name.
    """
    record = np.zeros((), kind)[()]
    for name in kind.names or ():
        record[name] = made[name] if name in made else values[group + name]
    return record


def exact_text(limit: float) -> str:
    """Write a limit short if no digit is lost: a rounded limit might itself not be allowed."""
    short = f"{limit:g}"
    return short if float(short) == limit else str(limit)


def unquoted(value: Any) -> Any:
    """Return the text that stands in double quotes, as JSON writes it; anything else as it is.

    The quotes keep YAML from reading a text as a date or as a mapping.
    """
    if isinstance(value, str) and len(value) > 1 and value[0] == value[-1] == '"':
        with suppress(ValueError):
            return json.loads(value)
    return value


def checked(table: Iterable[Parameter], chosen: Mapping[str, Any], owner: str) -> dict[str, Value]:
    """Return given values in their parameters' own types.

    Parameters
    ----------
    table : iterable of Parameter
        What may be given.
    chosen : mapping
        What was given, by name.
    owner : str
        Whose parameters they are, for errors.

    Raises
    ------
    ConfigurationError
        An unknown name (with the nearest known one), or a value that is not allowed.
    """
    known = {parameter.name: parameter for parameter in table}
    values = {}
    for name, value in chosen.items():
        if name not in known:
            raise ConfigurationError(unknown(name, known, owner))
        try:
            values[name] = known[name].checked(value)
        except ConfigurationError as error:
            raise ConfigurationError(f"{owner}: {error}") from None
    return values


def unknown(name: str, known: Collection[str], owner: str) -> str:
    """Say that the owner has no parameter of a name, and name the nearest one that it has."""
    return f"{owner} has no parameter {name}{nearest(name, known)}"


def nearest(name: str, known: Collection[str]) -> str:
    """Ask whether the nearest name that is known was meant; empty if none is near."""
    close = get_close_matches(name, known, n=1)
    return f"; did you mean {close[0]}?" if close else ""


def resolved(
    table: Collection[Parameter], chosen: Mapping[str, Any], owner: str
) -> dict[str, Value]:
    """Defaults overlaid with checked values; arguments and errors as of `checked`."""
    defaults = {parameter.name: parameter.default for parameter in table}
    return checked(table, {**defaults, **chosen}, owner)
