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

"""The launch files under the real `ros2 launch`, where a workspace with this package is sourced."""

import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import StartProcess
from process_helpers import PATIENCE, alive, until

from ppc_attitude.bags.reader import read_run, read_runs
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, MARKERS, NODES, RECORDER

pytestmark = pytest.mark.ros


@pytest.fixture(autouse=True)
def temporary_folder(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """Whatever a launch leaves in the temporary folder fails the test."""
    folder = tmp_path_factory.mktemp("temporary")
    monkeypatch.setenv("TMPDIR", str(folder))
    yield
    assert not list(folder.iterdir())


class Launch:
    """A running `ros2 launch`, its output in one stream."""

    def __init__(self, start: StartProcess, file: str, *arguments: str) -> None:
        command = ["ros2", "launch", "ppc_attitude", file, *arguments]
        self.process = start(command, stderr=subprocess.STDOUT)
        self.said = ""

    def until(self, text: str) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said += line
            if text in line:
                return
        pytest.fail(f"{text!r} was not said: {self.said}")

    def end(self) -> int:
        """Read the rest, which ends when launch and all its nodes have ended; exit code."""
        self.said += self.process.communicate(timeout=PATIENCE)[0]
        return self.process.returncode


def test_paper_runs_and_records(start_process: StartProcess, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    arguments = ("duration:=1", f"bag:={bag}", "namespace:=/craft", "markers:=true")
    launch = Launch(start_process, "paper.launch.py", *arguments)
    assert launch.end() == 0, launch.said
    for name in (*NODES, MARKERS):
        assert re.search(rf"\[{name}-\d\]: process has finished cleanly", launch.said)
    run = read_run(bag)
    assert run.controller == "ppc"
    assert run.missing_messages == 0
    assert run.t[-1] == 1.0


def test_two_controllers_in_one_bag(start_process: StartProcess, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    launch = Launch(start_process, "compare.launch.py", "duration:=1", f"bag:={bag}")
    assert launch.end() == 0, launch.said
    proposed, traditional = read_runs(bag)
    assert (proposed.controller, traditional.controller) == ("ppc", "log_barrier")
    for run in (proposed, traditional):
        assert run.missing_messages == 0
        assert run.t[-1] == 1.0
        assert run.parameters[INJECTOR]["pulse_times"] == [80.0]
    assert (proposed["torque_command"] != traditional["torque_command"]).any()


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_launch_ends_every_node_and_closes_the_bag(
    stop: signal.Signals, start_process: StartProcess, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    launch = Launch(start_process, "paper.launch.py", f"bag:={bag}")
    launch.until("envelope plan")
    nodes = list(map(int, re.findall(r"process started with pid \[(\d+)\]", launch.said)))
    assert len(nodes) == len(NODES)
    launch.process.send_signal(stop)
    # After SIGTERM launch itself waits for nobody.
    assert launch.end() == (0 if stop == signal.SIGINT else -signal.SIGTERM), launch.said
    until(lambda: not any(map(alive, nodes)), "the end of the nodes")
    assert read_run(bag).missing_messages == 0
    assert (bag / "metadata.yaml").is_file()


def test_a_node_that_fails_ends_the_launch_and_makes_it_fail(
    start_process: StartProcess, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    launch = Launch(start_process, "paper.launch.py", f"bag:={bag}")
    assert launch.end() == 1
    assert f"error: bag {bag}: {bag} exists already" in launch.said
    assert f"{RECORDER}-5 ended with exit code 2" in launch.said


@pytest.mark.parametrize(
    ("given", "message"),
    [("without:=controller", "controller is no node"), ("controller:=pid", "pid")],
)
def test_what_is_wrong_is_named(given: str, message: str, start_process: StartProcess) -> None:
    launch = Launch(start_process, "paper.launch.py", given)
    assert launch.end() == 1
    assert message in launch.said
    assert "process started" not in launch.said


def test_a_users_own_node_takes_a_place(start_process: StartProcess, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    arguments = ("duration:=1", f"bag:={bag}", f"without:={CONTROLLER}")
    launch = Launch(start_process, "paper.launch.py", *arguments)
    start_process(["ros2", "run", "ppc_attitude", CONTROLLER])
    assert launch.end() == 0, launch.said
    assert CONTROLLER not in launch.said
    run = read_run(bag)
    assert run.missing_messages == 0
    assert CONTROLLER not in run.parameters, "the bag must not claim our controller"
