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

"""The launch files start the stack of `ppc_attitude run`, with holes for nodes of others."""

import runpy
import sys
from pathlib import Path
from typing import Any

import launch_stand_in as stand_in
import pytest
import yaml
from conftest import StartProcess
from docs_helpers import ALL, Command, table
from test_layers import PACKAGE, ROOT

from ppc_attitude.bags.reader import read_run, read_runs
from ppc_attitude.contract.topics import (
    CONTROLLER,
    INJECTOR,
    MARKERS,
    NODES,
    PLANT,
    RECORDER,
    REFERENCE,
)
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.scenario import load

PAPER, COMPARE = ROOT / "launch" / "paper.launch.py", ROOT / "launch" / "compare.launch.py"
CONFIG = ROOT / "config"


@pytest.fixture(autouse=True)
def launch_modules(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "ppc_attitude.command_line.launching", raising=False)
    stand_in.install(monkeypatch)


def description(file: Path) -> stand_in.LaunchDescription:
    found = runpy.run_path(str(file))["generate_launch_description"]()
    assert isinstance(found, stand_in.LaunchDescription)
    return found


def nodes(file: Path, **given: str) -> list[stand_in.Node]:
    return stand_in.nodes_of(description(file), given)


def parameters(node: stand_in.Node) -> dict[str, Any]:
    (file,) = node.parameters
    content = yaml.safe_load(Path(file).read_text(encoding="utf-8"))
    return dict(content[f"/**/{node.executable}"]["ros__parameters"])


def by_name(found: list[stand_in.Node]) -> dict[str, stand_in.Node]:
    named = {f"{node.namespace}/{node.executable}": node for node in found}
    assert len(named) == len(found)
    return named


@pytest.mark.parametrize("file", [PAPER, COMPARE], ids=lambda file: file.name)
def test_every_argument_says_what_it_does(file: Path) -> None:
    declared = [
        e for e in description(file).entities if isinstance(e, stand_in.DeclareLaunchArgument)
    ]
    assert {"config", "bag", "realtime"} <= {argument.name for argument in declared}
    for argument in declared:
        assert argument.description
        assert argument.default_value is not None, "a launch without arguments must run"


def test_the_reference_lists_every_argument() -> None:
    declared = {
        file.name: {
            entity.name: (entity.default_value, entity.description)
            for entity in description(file).entities
            if isinstance(entity, stand_in.DeclareLaunchArgument)
        }
        for file in (PAPER, COMPARE)
    }
    rows = table(ROOT / "docs" / "reference.md", "| launch argument |")
    for file, arguments in declared.items():
        shown = {
            name: (default, means) for name, default, means, only in rows if only in ("", file)
        }
        assert shown == arguments


@pytest.mark.parametrize(
    "command", [each for each in ALL if each.words[:2] == ["ros2", "launch"]], ids=str
)
def test_the_launch_commands_of_the_pages(command: Command) -> None:
    file = ROOT / "launch" / command.words[3]
    given = dict(word.split(":=") for word in command.words[4:])
    declared = [e for e in description(file).entities if hasattr(e, "default_value")]
    assert set(given) <= {argument.name for argument in declared}
    assert nodes(file, **given)


def test_default_is_the_papers_case_in_lockstep() -> None:
    found = nodes(PAPER)
    assert [node.executable for node in found] == list(NODES)
    assert {node.package for node in found} == {PACKAGE}
    expected = load([CONFIG / "paper.yaml"]).parameters
    named = by_name(found)
    plant = {**expected[PLANT], "lockstep": True, "wait_for_recorder": True}
    assert parameters(named[f"/{PLANT}"]) == plant
    assert parameters(named[f"/{CONTROLLER}"]) == {
        **expected[CONTROLLER],
        "wait_for_recorder": True,
    }
    assert not any(node.remappings for node in found)


def test_overlays_by_name_and_by_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = tmp_path / "own.yaml"
    own.write_text(f"/**/{PLANT}:\n  ros__parameters:\n    rate: 50.0\n")
    monkeypatch.chdir(tmp_path)
    named = by_name(nodes(PAPER, config="paper.yaml, sudden_disturbance.yaml,own.yaml"))
    assert parameters(named[f"/{PLANT}"])["rate"] == 50.0
    assert parameters(named[f"/{INJECTOR}"])["pulse_times"] == [20.0, 80.0]


def test_arguments_reach_their_nodes() -> None:
    named = by_name(
        nodes(
            PAPER,
            controller="quaternion_feedback",
            duration="7.5",
            bag="here",
            realtime="true",
            namespace="one",
        )
    )
    assert set(named) == {f"one/{name}" for name in NODES}
    plant = parameters(named[f"one/{PLANT}"])
    assert (plant["duration"], plant["lockstep"]) == (7.5, False)
    assert parameters(named[f"one/{CONTROLLER}"])["controller"] == "quaternion_feedback"
    assert parameters(named[f"one/{RECORDER}"])["bag"] == "here"
    assert named[f"one/{PLANT}"].remappings == [("/clock", "clock")]


def test_a_users_own_node_takes_a_place() -> None:
    named = by_name(nodes(PAPER, without=f"{CONTROLLER}, {REFERENCE}", markers="true"))
    left = {f"/{name}" for name in (*NODES, MARKERS) if name not in (CONTROLLER, REFERENCE)}
    assert set(named) == left
    info = yaml.safe_load(parameters(named[f"/{RECORDER}"])["run_info"])
    assert CONTROLLER not in info["parameters"], "the bag must not claim our controller"
    assert PLANT in info["parameters"]


def test_without_a_recorder_nobody_waits_for_one() -> None:
    named = by_name(nodes(PAPER, without=RECORDER))
    assert parameters(named[f"/{PLANT}"])["wait_for_recorder"] is False


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"config": "none.yaml"}, "none.yaml"),
        ({"without": "controller"}, "controller is no node; nodes: spacecraft_plant"),
        ({"duration": "long"}, "duration = 'long'"),
        ({"duration": "-1"}, "duration = -1.0 s"),
    ],
)
def test_what_is_wrong_is_named(given: dict[str, str], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        nodes(PAPER, **given)


@pytest.mark.parametrize("given", [{"controller": "pid"}, {"realtime": "yes"}])
def test_choices(given: dict[str, str]) -> None:
    with pytest.raises(RuntimeError, match="choices"):
        nodes(PAPER, **given)


def test_the_launch_ends_with_the_run_or_with_what_breaks_it() -> None:
    found = by_name(nodes(COMPARE))
    context = stand_in.LaunchContext()

    def ended(name: str, code: int) -> list[Any] | None:
        node = found[name]
        assert node.on_exit is not None
        return node.on_exit(stand_in.ProcessExited(code), context)

    assert ended(f"/proposed/{PLANT}", 0) is None  # the other run goes on
    assert [type(action) for action in ended(f"/traditional/{PLANT}", 0) or []] == [
        stand_in.Shutdown
    ]
    (shutdown,) = ended(f"/traditional/{CONTROLLER}", 3) or []
    assert shutdown.reason == f"/traditional/{CONTROLLER} ended with exit code 3"
    context.is_shutdown = True
    assert ended(f"/proposed/{CONTROLLER}", 0) is None


@pytest.mark.ros
def test_paper_runs_and_records(start_process: StartProcess, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    session = stand_in.Session(
        nodes(PAPER, duration="1", bag=str(bag), namespace="/craft"), start_process
    )
    codes = session.run(timeout=60.0)
    assert session.reason == "the run has ended"
    assert set(codes.values()) == {0}, codes
    run = read_run(bag)
    assert run.controller == "ppc"
    assert run.missing_messages == 0
    assert run.t[-1] == 1.0


@pytest.mark.ros
def test_two_controllers_in_one_bag(start_process: StartProcess, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    found = nodes(COMPARE, duration="1", bag=str(bag))
    session = stand_in.Session(found, start_process)
    codes = session.run(timeout=90.0)
    assert session.reason == "the run has ended"
    assert set(codes.values()) == {0}, codes
    proposed, traditional = read_runs(bag)
    assert (proposed.controller, traditional.controller) == ("ppc", "log_barrier")
    for run in (proposed, traditional):
        assert run.missing_messages == 0
        assert run.t[-1] == 1.0
        assert run.parameters[INJECTOR]["pulse_times"] == [80.0]
    assert (proposed["torque_command"] != traditional["torque_command"]).any()
