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

"""Floors of the package: imports go down only, in no circle, and each floor keeps its company."""

import ast
import graphlib
import sys
from functools import cache
from pathlib import Path

import pytest
from craft_helpers import ROOT

PACKAGE = "ppc_attitude"
SOURCES = sorted((ROOT / PACKAGE).rglob("*.py"))

ROS = {
    "diagnostic_msgs",
    "geometry_msgs",
    "rcl_interfaces",
    "rclpy",
    "rosgraph_msgs",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "tf2_ros",
    "trajectory_msgs",
    "visualization_msgs",
}
# Floor: the floors below that it may import, and the only modules of others that it may import.
FLOORS: dict[str, tuple[set[str], set[str]]] = {
    # flint only in science/guarantee, sgp4 only in orbit: imported where they are used.
    "science": (set(), {"flint", "numba", "numpy", "scipy", "sgp4"}),
    "processes": (set(), set()),
    "contract": ({"science"}, {"numpy", "yaml"}),
    "simulation": ({"science", "contract"}, {"numpy"}),
    "analysis": ({"science", "contract"}, {"matplotlib", "numpy"}),
    "campaign": (
        {"science", "contract", "simulation", "analysis", "processes"},
        {"cma", "distributed", "matplotlib", "numpy", "pyarrow", "scipy", "yaml"},
    ),
    "falsify": (
        {"science", "contract", "simulation", "analysis", "processes"},
        {"cma", "numpy"},
    ),
    "bags": (
        {"science", "contract"},
        {"lz4", "mcap", "numpy", "pyarrow", "rosbags", "yaml", "zstandard"},
    ),
    "runtime": ({"science", "contract"}, set()),
    "nodes": (
        {"science", "contract", "simulation", "runtime", "bags", "processes"},
        {"numpy"} | ROS,
    ),
    "command_line": (
        {
            "science",
            "contract",
            "simulation",
            "analysis",
            "campaign",
            "falsify",
            "bags",
            "nodes",
            "processes",
            "runtime",
        },
        {"argcomplete", "distributed", "launch", "launch_ros", "numpy", "rich", "tqdm", "yaml"}
        | ROS,
    ),
}


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def imports_of(path: Path) -> set[str]:
    """Collect the full names that a file of the package imports, wherever in the file."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def floor_of(name: str) -> str | None:
    """Name the floor of a module of the package; None for the package's own `__init__`."""
    parts = name.split(".")
    return parts[1] if len(parts) > 1 else None


def test_every_file_is_on_a_floor() -> None:
    assert {floor_of(module_name(path)) for path in SOURCES} == {None, *FLOORS}


@pytest.mark.parametrize("floor", FLOORS)
def test_floor_imports_downward_only(floor: str) -> None:
    below, others = FLOORS[floor]
    wrong = []
    for path in sorted((ROOT / PACKAGE / floor).rglob("*.py")):
        for name in sorted(imports_of(path)):
            top = name.partition(".")[0]
            if top == PACKAGE:
                allowed = floor_of(name) in {floor, "__version__", *below}
            else:
                allowed = top in others or top in sys.stdlib_module_names
            if not allowed:
                wrong.append(f"{path.relative_to(ROOT)} imports {name}")
    assert not wrong, "\n".join(wrong)


def test_pyplot_is_never_imported() -> None:
    """It would look for a display and keep every figure alive."""
    for path in SOURCES:
        assert not [name for name in imports_of(path) if name.startswith("matplotlib.pyplot")], path


def test_no_circle_of_imports() -> None:
    modules = {module_name(path): path for path in SOURCES}
    graph: dict[str, set[str]] = {}
    for name, path in modules.items():
        # An imported name is a module, or an object in one.
        targets = {n if n in modules else n.rpartition(".")[0] for n in imports_of(path)}
        graph[name] = targets & modules.keys()
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle
