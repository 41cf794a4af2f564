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

"""A stand-in for launch and launch_ros, which are not on PyPI: what our launch files use of them.

Constructors take what those of ROS 2 Jazzy take, and refuse everything else. `Session` starts the
nodes as `ros2 launch` does: same command line, a callback when a process ends, SIGINT to all at
a shutdown.
"""

import signal
import subprocess
import sys
import time
import types
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import pytest
from conftest import StartProcess


@dataclass
class LaunchContext:
    launch_configurations: dict[str, str] = field(default_factory=dict)
    is_shutdown: bool = False


@dataclass
class LaunchConfiguration:
    variable_name: str

    def perform(self, context: LaunchContext) -> str:
        return context.launch_configurations[self.variable_name]


class DeclareLaunchArgument:
    def __init__(
        self,
        name: str,
        *,
        default_value: str | None = None,
        description: str | None = None,
        choices: Iterable[str] | None = None,
    ) -> None:
        self.name, self.default_value, self.description = name, default_value, description
        self.choices = None if choices is None else list(choices)
        if self.choices is not None and default_value is not None:
            assert default_value in self.choices

    def execute(self, context: LaunchContext) -> None:
        value = context.launch_configurations.setdefault(self.name, self.default_value or "")
        if self.choices is not None and value not in self.choices:
            raise RuntimeError(f"argument {self.name} = {value!r}; choices: {self.choices}")


@dataclass
class OpaqueFunction:
    function: Callable[[LaunchContext], list[Any] | None]


@dataclass
class Shutdown:
    reason: str = ""


class Node:
    def __init__(
        self,
        *,
        executable: str,
        package: str | None = None,
        name: str | None = None,
        namespace: str | None = None,
        parameters: list[Any] | None = None,
        remappings: list[tuple[str, str]] | None = None,
        output: str = "log",
        sigterm_timeout: str = "5",
        on_exit: Callable[[Any, LaunchContext], list[Any] | None] | None = None,
    ) -> None:
        self.package, self.executable, self.name = package, executable, name
        self.namespace = namespace or ""
        self.parameters, self.remappings = parameters or [], remappings or []
        self.output, self.on_exit = output, on_exit
        assert all(isinstance(p, str) for p in self.parameters), "files only, like ours"
        assert float(sigterm_timeout) > 0.0

    @property
    def command(self) -> list[str]:
        command = [sys.executable, "-m", f"{self.package}.nodes.{self.executable}", "--ros-args"]
        if self.namespace:
            absolute = "/" + self.namespace.lstrip("/")
            command += ["-r", f"__ns:={absolute}"]
        for file in self.parameters:
            command += ["--params-file", file]
        for source, target in self.remappings:
            command += ["-r", f"{source}:={target}"]
        return command


@dataclass
class LaunchDescription:
    entities: list[Any]


@dataclass
class ProcessExited:
    returncode: int


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Put the stand-ins where `import launch` finds them."""
    contents: dict[str, dict[str, Any]] = {
        "launch": {"LaunchDescription": LaunchDescription, "LaunchContext": LaunchContext},
        "launch.actions": {
            "DeclareLaunchArgument": DeclareLaunchArgument,
            "OpaqueFunction": OpaqueFunction,
            "Shutdown": Shutdown,
        },
        "launch.substitutions": {"LaunchConfiguration": LaunchConfiguration},
        "launch_ros": {},
        "launch_ros.actions": {"Node": Node},
    }
    for name, content in contents.items():
        module = types.ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)


def nodes_of(description: LaunchDescription, given: dict[str, str]) -> list[Node]:
    """Nodes that a launch starts with these arguments."""
    context = LaunchContext(dict(given))
    nodes: list[Node] = []
    for entity in description.entities:
        if isinstance(entity, DeclareLaunchArgument):
            entity.execute(context)
        else:
            nodes += entity.function(context) or []
    return nodes


class Session:
    """Runs nodes until one asks for a shutdown."""

    def __init__(self, nodes: list[Node], start: StartProcess) -> None:
        self.processes = [
            (node, start(node.command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE))
            for node in nodes
        ]
        self.reason = ""

    def run(self, timeout: float) -> dict[str, int]:
        """Exit code of every node, by full name."""
        context = LaunchContext()
        codes: dict[str, int] = {}
        deadline = time.monotonic() + timeout
        while len(codes) < len(self.processes):
            assert time.monotonic() < deadline, f"still running; ended: {codes}"
            for node, process in self.processes:
                full_name = f"{node.namespace}/{node.executable}"
                if full_name in codes:
                    continue
                try:
                    codes[full_name] = process.wait(0.05)
                except subprocess.TimeoutExpired:
                    continue
                self._on_exit(node, codes[full_name], context)
        return codes

    def _on_exit(self, node: Node, code: int, context: LaunchContext) -> None:
        assert node.on_exit is not None
        for action in node.on_exit(ProcessExited(code), context) or []:
            assert isinstance(action, Shutdown)
            self.reason = action.reason
            context.is_shutdown = True
            for _, process in self.processes:
                if process.poll() is None:
                    process.send_signal(signal.SIGINT)
