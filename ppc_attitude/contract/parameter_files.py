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

"""Parameters of nodes from ROS parameter files."""

from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from ppc_attitude.contract.parameters import PARAMETERS, is_of_ros
from ppc_attitude.contract.yaml_file import read
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.parameter import nearest

# A pipe can be read only once, so its content is kept by its inode, which another pipe has not.
_read_once = cache(lambda path, inode: read(path, "configuration file"))


def read_files(paths: Iterable[Path | str]) -> dict[str, dict[str, Any]]:
    """Parameters by node from ROS parameter files; of several files the later wins.

    Raises
    ------
    ConfigurationError
        A file is missing, is not YAML, or is not a ROS parameter file; the message names it. Or
        the paths are one path, whose letters would be taken for files.
    """
    if isinstance(paths, str | Path):
        raise ConfigurationError(
            f"files = {str(paths)!r}; allowed: a list of files, such as [file]"
        )
    merged: dict[str, dict[str, Any]] = {}
    for path in map(Path, paths):
        for node, values in read_file(path):
            if node == "**":
                _update_every_node(merged, values, path)
            else:
                merged.setdefault(node, {}).update(values)
    return merged


def _update_every_node(
    merged: dict[str, dict[str, Any]], values: Mapping[str, Any], path: Path
) -> None:
    """Give every node those of a wildcard's values that it knows; some node must know each."""
    known = {node: {p.name for p in table} for node, table in PARAMETERS.items()}
    for name, value in values.items():
        owners = [node for node, names in known.items() if name in names]
        if not owners:
            meant = nearest(name, set().union(*known.values()))
            raise ConfigurationError(
                f"configuration file {path}: no node has a parameter {name}{meant}"
            )
        for node in owners:
            merged.setdefault(node, {})[name] = value


def read_file(path: Path) -> list[tuple[str, dict[str, Any]]]:
    """Node names, or ** for all, with their flat parameters, in the file's order."""
    inode = path.stat().st_ino if path.is_fifo() else None
    content = _read_once(path, inode) if inode else read(path, "configuration file")
    if not isinstance(content, dict):
        raise ConfigurationError(
            f"configuration file {path} is not a ROS parameter file: no node name at its top"
        )
    nodes = []
    for key, body in content.items():
        name = str(key).rsplit("/", 1)[-1]
        if name not in PARAMETERS and name != "**":
            raise ConfigurationError(
                f"configuration file {path} names an unknown node {key}; "
                f"nodes are {', '.join(PARAMETERS)}"
            )
        if not isinstance(body, dict) or not isinstance(body.get("ros__parameters"), dict):
            raise ConfigurationError(
                f"configuration file {path}: {key} has no mapping ros__parameters"
            )
        nodes.append((name, dict(_flattened(body["ros__parameters"]))))
    return nodes


def _flattened(tree: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, Any]]:
    for key, value in tree.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            yield from _flattened(value, f"{name}.")
        elif not is_of_ros(name):
            yield name, value
