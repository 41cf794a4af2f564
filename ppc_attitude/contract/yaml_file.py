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

"""YAML and JSON of unknown origin: all of the content, or one error that says what is wrong.

It may nest to 64 levels and have 4 Mi characters, where aliases count unfolded and every node as 32
characters: the parsers themselves do not limit their stack, time and memory.
"""

import json
import re
from pathlib import Path
from typing import Any

import yaml

from ppc_attitude.science.errors import ConfigurationError

_FAST: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
LARGEST = 4 * 2**20  # characters
_DEEPEST = 64
_NODE = 32
_LONGEST_NUMBER = 250  # digits, of which every integer fits into a float
_NUMBER = re.compile(r"[-+]?(0x[0-9a-fA-F_]+|0b[01_]+|[0-9_:.]+)")
_STEERING = re.compile(  # characters that steer a terminal or page, or the direction of writing
    "[\0-\x08\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]"
)
_JSON = re.compile(r'"(?:[^"\\]|\\.)*"?|[][{}]', re.DOTALL)
# What PyYAML's constructors raise besides its own errors, for values such as `2020-13-01`.
_ITS_ERRORS = (yaml.YAMLError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError)


def parsed(text: str, loader: Any = _FAST) -> Any:
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
        raise ValueError(" ".join(str(error).split())) from None  # the parser's text has lines


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
    return json.loads(text, parse_int=_integer)


def _integer(text: str) -> int:
    _demand_short(text)
    return int(text)


def _measure(text: str) -> None:
    """Refuse what would take more stack, time or memory than its length lets expect."""
    _demand_size(len(text))
    size = 0
    sizes: dict[str | None, int] = {}  # of what an anchor names
    begun: list[tuple[str | None, int]] = []
    for event in yaml.parse(text, _FAST):
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise ValueError(f"*{event.anchor} is used before the end of &{event.anchor}")
            size += sizes[event.anchor]
        elif isinstance(event, yaml.ScalarEvent):
            if (event.implicit[0] or event.tag) and _NUMBER.fullmatch(event.value):
                _demand_short(event.value)
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
        raise ValueError(f"with its aliases it has {size} characters, allowed are {LARGEST}")


def _demand_depth(depth: int) -> None:
    if depth > _DEEPEST:
        raise ValueError(f"nested too deeply, allowed are {_DEEPEST} levels")


def _demand_short(number: str) -> None:
    # Time and digits of a number to base 60 (1:30:00) grow with the square of its length.
    if len(number) > _LONGEST_NUMBER:
        raise ValueError(f"number of {len(number)} characters, allowed are {_LONGEST_NUMBER}")


def _demand_harmless(content: Any, file: str) -> None:
    if isinstance(content, dict):
        _demand_harmless([*content, *content.values()], file)
    elif isinstance(content, list):
        for each in content:
            _demand_harmless(each, file)
    elif isinstance(content, str) and _STEERING.search(content):
        raise ConfigurationError(f"{file}: control characters in {content!r}; allowed: none")


class _Loader(_FAST):  # type: ignore[misc]  # PyYAML carries no types
    """YAML as ROS reads it: 1e-4 is a number, although YAML 1.1 asks for 1.0e-4."""

    def get_single_node(self) -> Any:
        node = super().get_single_node()
        _demand_different_keys(node)
        return node


def _demand_different_keys(node: Any) -> None:
    """Refuse a key that stands twice: one of the two would be lost, where ROS takes both."""
    if isinstance(node, yaml.SequenceNode):
        for each in node.value:
            _demand_different_keys(each)
    elif isinstance(node, yaml.MappingNode):
        seen: set[str] = set()
        for key, value in node.value:
            _demand_different_keys(value)
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    raise ValueError(f"{key.value} is repeated in line {key.start_mark.line + 1}")
                seen.add(key.value)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


def read(path: Path, kind: str) -> Any:
    """Content of a file of the user's; `kind` is what errors call it.

    Raises
    ------
    ConfigurationError
        It cannot be read, is not YAML, or holds control characters.
    """
    try:
        with path.open(encoding="utf-8") as file:
            content = parsed(file.read(LARGEST + 1), _Loader)
    except OSError as error:
        raise ConfigurationError(f"{kind} {path}: {error.strerror}") from None
    except ValueError as error:
        raise ConfigurationError(f"{kind} {path} cannot be read as YAML: {error}") from None
    _demand_harmless(content, f"{kind} {path}")
    return content
