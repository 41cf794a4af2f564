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

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from shutil import which
from typing import Any

from launch.actions import DeclareLaunchArgument, Shutdown
from launch.logging import launch_config
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from ppc_attitude.command_line.launching import ARGUMENTS
from ppc_attitude.command_line.parameter_file import ros_parameters, run_info
from ppc_attitude.contract.declared import nodes_of
from ppc_attitude.contract.topics import CLOCK_TOPIC, MARKERS, PLANT, RECORDER
from ppc_attitude.science.parameter import NodeParameters
from ppc_attitude.simulation.scenario import Scenario

_PATIENCE = "20"  # [s] how long a node may take to end after SIGINT, before it gets SIGTERM
# A launch that gets SIGTERM, or is killed, ends at once and tells its processes nothing.
_ENDS_WITH_THE_LAUNCH = "setpriv --pdeathsig INT" if which("setpriv") else ""


def arguments(names: Iterable[str]) -> list[Any]:
    """Declare launch arguments."""
    return [DeclareLaunchArgument(name, **ARGUMENTS[name]._asdict()) for name in names]


class Ending:
    """Ends the launch with its last plant or any other node; one that fails makes it fail."""

    def __init__(self, plants: int = 1) -> None:
        self._plants = plants

    def __call__(self, event: Any, context: Any) -> list[Any]:
        """Decide what follows from the end of a node.

        Raises
        ------
        RuntimeError
            The node failed: `ros2 launch` then ends all others, and with exit code 1.
        """
        if event.returncode != 0:
            raise RuntimeError(f"{event.process_name} ended with exit code {event.returncode}")
        if event.action.node_executable == PLANT:
            self._plants -= 1
            if self._plants:
                return []
        return [] if context.is_shutdown else [Shutdown(reason=f"{event.process_name} has ended")]


def stack(scenario: Scenario, names: Iterable[str], namespace: str) -> list[Any]:
    """Return the nodes of one run."""
    known = _parameters(scenario, names)
    told = scenario.with_values(RECORDER, run_info=run_info(known)).parameters
    return _nodes({name: told[name] for name in known}, namespace, Ending())


def side_by_side(runs: Mapping[str, Scenario], names: Collection[str]) -> list[Any]:
    """Return the nodes of several runs, each in its namespace, and one recorder for all."""
    own = {namespace: _parameters(run, names) for namespace, run in runs.items()}
    known = {
        f"{home}/{name}": values for home, each in own.items() for name, values in each.items()
    }
    first = next(iter(runs.values()))
    told = first.with_values(RECORDER, namespaces=list(runs), run_info=run_info(known))
    ending = Ending(len(runs))
    actions = _nodes({RECORDER: told.parameters[RECORDER]}, "", ending)
    for namespace, nodes in own.items():
        others = {name: values for name, values in nodes.items() if name != RECORDER}
        actions += _nodes(others, namespace, ending)
    return actions


def _parameters(scenario: Scenario, names: Iterable[str]) -> NodeParameters:
    """Parameters of the named nodes, as far as they are of the run or draw it."""
    needed = (*nodes_of(scenario.parameters), MARKERS)
    return {name: scenario.parameters[name] for name in names if name in needed}


def _nodes(parameters: NodeParameters, namespace: str, ending: Ending) -> list[Any]:
    """Return the nodes for which there are parameters, which go to a file among the launch's logs.

    In a namespace of its own a run has a clock of its own too. All nodes of a launch share what
    happens when one ends.
    """
    path = Path(launch_config.log_dir, f"parameters{namespace.replace('/', '_')}.yaml")
    path.write_text(ros_parameters(parameters), encoding="utf-8")
    # Two plants on /clock would be two times.
    own_clock = [(CLOCK_TOPIC.name, CLOCK_TOPIC.name.lstrip("/"))] if namespace else []
    return [
        Node(
            package="ppc_attitude",
            executable=name,
            exec_name=name,  # what the output is labelled with, in spite of the prefix
            namespace=namespace,
            parameters=[str(path)],
            remappings=own_clock,
            prefix=LaunchConfiguration("launch-prefix", default=_ENDS_WITH_THE_LAUNCH),
            output="screen",
            sigterm_timeout=_PATIENCE,
            on_exit=ending,
        )
        for name in parameters
    ]
