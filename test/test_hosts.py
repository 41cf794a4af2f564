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

"""Two hosts, each a network of its own: apart by default, one loop where the user asks for it."""

import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from conftest import StartProcess
from process_helpers import PAPER, Process, until

from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, PLANT, REFERENCE
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.scenario import load

pytestmark = [pytest.mark.ros, pytest.mark.long]

NEW = ("unshare", "--user", "--map-root-user", "--net")


class Host:
    """A network that lasts as long as a process that sleeps in it."""

    def __init__(self, start_process: StartProcess, folder: Path, *command: str) -> None:
        self._start, self._folder = start_process, folder
        name = f"host_{len(list(folder.iterdir()))}"
        self._sleeper = Process(start_process, folder, name, [*command, "sleep", "infinity"])
        self.pid = self._sleeper.pid
        until(lambda: self._runs("sleep"), "the network")

    def _runs(self, name: str) -> bool:
        if self._sleeper.process.poll() is not None:
            pytest.skip(f"no network of its own may be made here: {self._sleeper.err}")
        return Path(f"/proc/{self.pid}/comm").read_text().strip() == name

    @property
    def enter(self) -> tuple[str, ...]:
        """What comes before a command that is to run there."""
        target = str(self.pid)
        return ("nsenter", "-t", target, "--user", "--preserve-credentials", "--net")

    def node(self, name: str, *parameters: str) -> Process:
        """Start an executable there."""
        arguments = ["--ros-args", "--params-file", str(PAPER)]
        for parameter in parameters:
            arguments += ["-p", parameter]
        return self._run(name, [sys.executable, "-m", f"ppc_attitude.nodes.{name}", *arguments])

    def ip(self, *words: str) -> None:
        """Configure the network."""
        done = self._run("_".join(("ip", *words)).replace("/", "_"), ["ip", *words])
        assert done.ends() == 0, done.err

    def _run(self, name: str, command: Sequence[str]) -> Process:
        return Process(self._start, self._folder, name, [*self.enter, *command])


@pytest.fixture
def hosts(start_process: StartProcess, tmp_path: Path) -> tuple[Host, Host]:
    """Two hosts with a cable between them."""
    first = Host(start_process, tmp_path, *NEW)
    second = Host(start_process, tmp_path, *first.enter, "unshare", "--net")
    first.ip("link", "add", "cable", "type", "veth", "peer", "cable", "netns", str(second.pid))
    for number, host in enumerate((first, second), start=1):
        host.ip("address", "add", f"10.77.0.{number}/24", "dev", "cable")
        host.ip("link", "set", "cable", "up")
        host.ip("link", "set", "lo", "up")
    return first, second


def loop(hosts: tuple[Host, Host]) -> Process:
    """Start controller and injector on one host, reference and plant on the other."""
    warm_up(load([PAPER]))
    first, second = hosts
    for node in (second.node(CONTROLLER), second.node(INJECTOR), first.node(REFERENCE)):
        node.says("ready")
    return first.node(PLANT, "lockstep:=true", "duration:=2.0")


def test_a_loop_over_two_hosts(hosts: tuple[Host, Host], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    plant = loop(hosts)
    assert plant.ends() == 0, plant.err


def test_localhost_keeps_the_hosts_apart(
    hosts: tuple[Host, Host], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    plant = loop(hosts)
    plant.says("nobody publishes torque_command, disturbance/torque")
    assert plant.process.poll() is None
