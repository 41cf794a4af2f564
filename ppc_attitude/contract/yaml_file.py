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

"""YAML and JSON of somebody else's: the whole of it, or one error that says what is wrong with it.

It may nest to 64 levels and be 4 Mi characters large, aliases counted as often as they stand and
every node for 32 characters: the parsers' stack, time and memory have no limits of their own.
"""

import json
import re
from pathlib import Path
from typing import Any

import yaml

from ppc_attitude.science.errors import ConfigurationError

FAST: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
LARGEST = 4 * 2**20  # characters
_DEEPEST = 64
_NODE = 32
_LONGEST_NUMBER = 1_000
_NUMBER = re.compile(r"[-+]?(0x[0-9a-fA-F_]+|[0-9_:.]+)")
_JSON = re.compile(r'"(?:[^"\\]|\\.)*"?|[][{}]', re.DOTALL)
# What PyYAML's constructors raise besides its own errors, for values such as `2020-13-01`.
_ITS_ERRORS = (yaml.YAMLError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError)


def parsed(text: str, loader: Any = yaml.SafeLoader) -> Any:
    """Content of a text.

    Raises
    ------
    ValueError
        The text is not YAML, nests too deeply, or is too large.
    """
    try:
        _measure(text)
        return yaml.load(text, loader)
    except _ITS_ERRORS as error:
        raise ValueError(str(error)) from None


def parsed_json(text: str) -> Any:
    """Content of a text.

    Raises
    ------
    ValueError
        The text is not JSON, nests too deeply, or is too large.
    """
    _demand_size(len(text))
    depth = 0
    for token in _JSON.finditer(text):
        depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(token[0], 0)
        _demand_depth(depth)
    return json.loads(text)


def _measure(text: str) -> None:
    """Refuse what would take more stack, time or memory than its length lets expect."""
    _demand_size(len(text))
    size = 0
    sizes: dict[str | None, int] = {}  # of what an anchor names
    begun: list[tuple[str | None, int]] = []
    for event in yaml.parse(text, FAST):
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ValueError(f"*{event.anchor} stands before the end of what it means")
            size += sizes[event.anchor]
        elif isinstance(event, yaml.ScalarEvent):
            _demand_short_number(event)
            sizes[event.anchor] = _NODE + len(event.value)
            size += sizes[event.anchor]
        elif isinstance(event, yaml.CollectionStartEvent):
            begun.append((event.anchor, size))
            _demand_depth(len(begun))
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = begun.pop()
            size += _NODE
            sizes[anchor] = size - before
        _demand_size(size)


def _demand_size(size: int) -> None:
    if size > LARGEST:
        raise ValueError(f"it unfolds into {size} characters, allowed are {LARGEST}")


def _demand_depth(depth: int) -> None:
    if depth > _DEEPEST:
        raise ValueError(f"nested too deeply, allowed are {_DEEPEST} levels")


def _demand_short_number(scalar: yaml.ScalarEvent) -> None:
    # Time and digits of a number to base 60 (1:30:00) grow with the square of its length.
    size, a_number = len(scalar.value), scalar.implicit[0] or scalar.tag
    if size > _LONGEST_NUMBER and a_number and _NUMBER.fullmatch(scalar.value):
        raise ValueError(f"number of {size} characters, allowed are {_LONGEST_NUMBER}")


def read(path: Path, kind: str, loader: Any = yaml.SafeLoader) -> Any:
    """Content of a file.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        What it is to the user, for the message.
    loader : yaml.SafeLoader or derived, optional
        How scalars are read.

    Raises
    ------
    ConfigurationError
        It cannot be read, or is not YAML.
    """
    try:
        with path.open(encoding="utf-8") as file:
            return parsed(file.read(LARGEST + 1), loader)
    except OSError as error:
        raise ConfigurationError(f"{kind} {path}: {error.strerror}") from None
    except ValueError as error:
        raise ConfigurationError(f"{kind} {path} is not YAML: {error}") from None
