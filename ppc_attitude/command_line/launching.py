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

"""The stack as actions of `ros2 launch`: what the files in launch/ share.

Only launch files import this: launch and launch_ros are on ROS machines only.
"""

import atexit
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from launch.actions import DeclareLaunchArgument, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from ppc_attitude.command_line.parameter_file import ros_parameters, run_info
from ppc_attitude.contract.parameters import WAIT_FOR_RECORDER
from ppc_attitude.contract.topics import (
    CLOCK_TOPIC,
    CONTROLLER,
    MARKERS,
    NODES,
    PLANT,
    RECORDER,
    SOURCES,
)
from ppc_attitude.science.controllers.registry import CONTROLLERS
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.scenario import Overrides, Scenario, load

_PACKAGE = "ppc_attitude"
_PATIENCE = "20"  # [s] how long a node may take to end before it is told more firmly
_YES_NO = ("true", "false")
# Argument: default, what it does, allowed values (none: any).
_ARGUMENTS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "config": (
        "paper.yaml",
        "ROS parameter files, separated by commas, later ones win; a name without a folder that "
        "is no file here is one of this package's own",
        (),
    ),
    "controller": ("", "the control law; empty: as configured", ("", *CONTROLLERS)),
    "duration": ("", "simulated time [s]; 0: endless; empty: as configured", ()),
    "bag": ("", "folder of the bag; empty: a new, dated one under bags/", ()),
    "realtime": ("false", "free-running on the wall clock instead of lock-step", _YES_NO),
    "namespace": ("", "namespace of every node and topic", ()),
    "without": (
        "",
        f"nodes to leave out, separated by commas, so that yours take their place: "
        f"{', '.join(NODES)}",
        (),
    ),
    "markers": ("false", "draw the run on `markers`, and on /tf where tf2_ros is", _YES_NO),
}


def arguments(*names: str) -> list[Any]:
    """Declare launch arguments, each with its default and description."""
    return [_declared(name, *_ARGUMENTS[name]) for name in names]


def _declared(name: str, default: str, description: str, choices: tuple[str, ...]) -> Any:
    limits = {"choices": list(choices)} if choices else {}
    return DeclareLaunchArgument(name, default_value=default, description=description, **limits)


@dataclass(frozen=True)
class Request:
    """What the user of a launch file asks for; arguments that a file lacks have their default."""

    given: Mapping[str, str]

    @classmethod
    def of(cls, context: Any, *names: str) -> "Request":
        """Read launch arguments."""
        return cls({name: LaunchConfiguration(name).perform(context) for name in names})

    def __getitem__(self, name: str) -> str:
        """Value of an argument."""
        return self.given.get(name, _ARGUMENTS[name][0]).strip()

    def flag(self, name: str) -> bool:
        """Value of an argument that is true or false."""
        return self[name] == "true"

    def words(self, name: str) -> list[str]:
        """Parts of an argument that is a list."""
        return [word.strip() for word in self[name].split(",") if word.strip()]

    def nodes(self) -> tuple[str, ...]:
        """Executables to start.

        Raises
        ------
        ConfigurationError
            A node that is to be left out is none.
        """
        left_out = self.words("without")
        for name in left_out:
            if name not in NODES:
                raise ConfigurationError(f"without: {name} is no node; nodes: {', '.join(NODES)}")
        extra = (MARKERS,) if self.flag("markers") else ()
        return (*(name for name in NODES if name not in left_out), *extra)

    def scenario(self, config: Path, overlay: Sequence[Path] = ()) -> Scenario:
        """Checked parameters of every node.

        Parameters
        ----------
        config : Path
            Folder of the package's own parameter files.
        overlay : sequence of Path
            Parameter files that go over those of the user.

        Raises
        ------
        ConfigurationError
            A file or value is wrong.
        """
        files = [_file(name, config) for name in self.words("config")]
        recorded = RECORDER in self.nodes()
        overrides: dict[str, dict[str, Any]] = {
            name: {WAIT_FOR_RECORDER.name: recorded} for name in SOURCES
        }
        overrides[PLANT]["lockstep"] = not self.flag("realtime")
        if self["duration"]:
            overrides[PLANT]["duration"] = _number("duration", self["duration"])
        if self["controller"]:
            overrides[CONTROLLER]["controller"] = self["controller"]
        if self["bag"]:
            overrides[RECORDER] = {"bag": self["bag"]}
        scenario = load([*files, *overlay], overrides)
        warm_up(scenario)  # once here, instead of in several processes at a time
        return scenario


def _file(name: str, config: Path) -> Path:
    own = config / name
    return own if own.name == name and own.is_file() and not Path(name).is_file() else Path(name)


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ConfigurationError(f"{name} = {text!r}; allowed: a number") from None


class Stacks:
    """The nodes of one run or of several side by side; the launch ends when the runs have ended."""

    def __init__(self) -> None:
        folder = tempfile.TemporaryDirectory(prefix="ppc_attitude_")
        atexit.register(folder.cleanup)
        self._folder = Path(folder.name)
        self._running: set[str] = set()
        self._files = 0

    def nodes(self, scenario: Scenario, names: Iterable[str], namespace: str) -> list[Any]:
        """Return the actions that start nodes in a namespace.

        Parameters
        ----------
        scenario : Scenario
            Parameters.
        names : iterable of str
            Executables.
        namespace : str
            Their namespace; with one of its own, a run has a clock of its own too.
        """
        names = tuple(names)
        known = {name: scenario.parameters[name] for name in names}
        parameters: Overrides = known
        if RECORDER in names:
            parameters = {**known, RECORDER: {**known[RECORDER], "run_info": run_info(known)}}
        file = self._parameter_file(parameters)
        return [self._node(name, namespace, file) for name in names]

    def recorder(self, scenario: Scenario, runs: Mapping[str, Overrides]) -> Any:
        """Return the action that starts one recorder for several runs.

        Parameters
        ----------
        scenario : Scenario
            Where the recorder's own parameters come from.
        runs : mapping of str to mapping
            Namespace of each run to its parameters by node.
        """
        info = {
            f"{namespace}/{node}": values
            for namespace, nodes in runs.items()
            for node, values in nodes.items()
            if node in NODES
        }
        own = {
            **scenario.parameters[RECORDER],
            "namespaces": list(runs),
            "run_info": run_info(info),
        }
        return self._node(RECORDER, "", self._parameter_file({RECORDER: own}))

    def _parameter_file(self, parameters: Overrides) -> Path:
        self._files += 1
        path = self._folder / f"{self._files}.yaml"
        path.write_text(ros_parameters(parameters), encoding="utf-8")
        return path

    def _node(self, name: str, namespace: str, file: Path) -> Any:
        if name == PLANT:
            self._running.add(namespace)
        return Node(
            package=_PACKAGE,
            executable=name,
            namespace=namespace,
            parameters=[str(file)],
            # Time of a run in a namespace is its own: two plants on /clock would be two times.
            remappings=[(CLOCK_TOPIC.name, CLOCK_TOPIC.name.lstrip("/"))] if namespace else [],
            output="screen",
            sigterm_timeout=_PATIENCE,
            on_exit=self._on_exit(name, namespace),
        )

    def _on_exit(self, name: str, namespace: str) -> Callable[[Any, Any], list[Any] | None]:
        def ended(event: Any, context: Any) -> list[Any] | None:
            if context.is_shutdown:
                return None
            if name != PLANT or event.returncode != 0:
                reason = f"{namespace}/{name} ended with exit code {event.returncode}"
                return [Shutdown(reason=reason)]
            self._running.discard(namespace)
            return None if self._running else [Shutdown(reason="the run has ended")]

        return ended
