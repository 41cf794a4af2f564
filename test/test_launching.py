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

"""The arguments of the launch files make the configuration of `ppc_attitude run`."""

import shlex
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest
from craft_helpers import CONFIG, ROOT
from docs_helpers import ALL, Command

from ppc_attitude.command_line.launching import ARGUMENTS, SIDE_BY_SIDE, Request
from ppc_attitude.contract.topics import (
    CONTROLLER,
    INJECTOR,
    MARKERS,
    NODES,
    OF_A_RUN,
    PLANT,
    RECORDER,
    REFERENCE,
)
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.parameter import NodeParameters
from ppc_attitude.simulation.scenario import load


def parameters(**given: str) -> NodeParameters:
    return Request(given).scenario(CONFIG).parameters


def test_default_is_the_papers_case_in_lockstep() -> None:
    assert Request({}).nodes() == OF_A_RUN
    expected = load([CONFIG / "paper.yaml"]).parameters
    found = parameters()
    for node in NODES:
        changed = {
            name: value for name, value in found[node].items() if value != expected[node][name]
        }
        waits = {"wait_for_recorder": True} if node != RECORDER else {}
        assert changed == {**waits, **({"lockstep": True} if node == PLANT else {})}


def test_overlays_by_name_and_by_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = tmp_path / "own.yaml"
    own.write_text(f"/**/{PLANT}:\n  ros__parameters:\n    rate: 50.0\n")
    monkeypatch.chdir(tmp_path)
    found = parameters(config="paper.yaml, sudden_disturbance.yaml,own.yaml")
    assert found[PLANT]["rate"] == 50.0
    assert found[INJECTOR]["pulse_times"] == [20.0, 80.0]
    own.rename("paper.yaml")
    assert parameters()[PLANT]["rate"] == 50.0, "one's own goes before that of the package"


def test_arguments_reach_their_nodes() -> None:
    found = parameters(
        controller="quaternion_feedback", duration="7.5", bag="here", realtime="true"
    )
    assert (found[PLANT]["duration"], found[PLANT]["lockstep"]) == (7.5, False)
    assert found[CONTROLLER]["controller"] == "quaternion_feedback"
    assert found[RECORDER]["bag"] == "here"


def test_a_users_own_node_takes_a_place() -> None:
    asked = Request({"without": f"{CONTROLLER}, {REFERENCE}", "markers": "true"})
    assert set(asked.nodes()) == {*OF_A_RUN, MARKERS} - {CONTROLLER, REFERENCE}


def test_without_a_recorder_nobody_waits_for_one() -> None:
    assert parameters(without=RECORDER)[PLANT]["wait_for_recorder"] is False


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"config": "none.yaml"}, "none.yaml"),
        ({"without": "controller"}, "controller is no node; allowed: attitude_estimator"),
        ({"duration": "long"}, "duration = 'long'"),
        ({"duration": "-1"}, "duration = -1.0 s"),
    ],
)
def test_what_is_wrong_is_named(given: dict[str, str], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        parameters(**given)


def test_two_runs_have_all_their_nodes_and_one_recorder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`launch` is on ROS machines only: stand-ins take what it is told."""
    stand_in = SimpleNamespace(
        launch_config=SimpleNamespace(log_dir=tmp_path),
        **dict.fromkeys(("DeclareLaunchArgument", "Shutdown", "Node"), SimpleNamespace),
        LaunchConfiguration=lambda name, default: default,
    )
    for name in ("launch", "launch_ros"):
        for part in ("", ".actions", ".logging", ".substitutions"):
            monkeypatch.setitem(sys.modules, name + part, stand_in)
    module = "ppc_attitude.command_line.launch_actions"
    asked = Request({"markers": "true"})
    runs = {name: asked.scenario(CONFIG) for name in ("/one", "/other")}
    nodes = import_module(module).side_by_side(runs, asked.nodes())
    del sys.modules[module]
    expected = [("", RECORDER)]
    expected += [(run, n) for run in runs for n in (*NODES, MARKERS) if n != RECORDER]
    assert [(node.namespace, node.executable) for node in nodes] == expected


@pytest.mark.parametrize(
    "command", [each for each in ALL if each.words[:2] == ["ros2", "launch"]], ids=str
)
def test_the_launch_commands_of_the_pages(command: Command) -> None:
    file, *given = command.words[3:]
    assert (ROOT / "launch" / file).is_file()
    asked = Request(dict(word.split(":=") for word in given))
    assert set(asked.values) <= set(SIDE_BY_SIDE if file == "compare.launch.py" else ARGUMENTS)
    assert asked.scenario(CONFIG), shlex.join(given)
