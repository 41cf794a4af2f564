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

"""Nodes on two hosts, which a cable joins that loses frames."""

import os
import random
import select
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import pytest
from bag_helpers import assert_flown
from conftest import StartProcess
from process_helpers import PAPER, Node, end_all, until

from ppc_attitude.bags.reader import read_run
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, PLANT, RECORDER, REFERENCE
from ppc_attitude.simulation.closed_loop import simulate, warm_up
from ppc_attitude.simulation.scenario import load

long = pytest.mark.long
_HOSTS = "10.9.0.1", "10.9.0.2"
_ALONE = ["unshare", "--net", "--map-root-user"]
_INSIDE = ["nsenter", "--net", "--user", "--preserve-credentials", "--target"]
_FRAME = 65536  # [bytes] more than the longest
_LOSS = 0.03  # of the frames
_MULTICAST = b"\x01\x00\x5e"  # how such a frame by IPv4 begins
_AMID = 2000  # frames that are carried when the run is under way


def _can_make_hosts() -> bool:
    tools = all(map(shutil.which, (_ALONE[0], _INSIDE[0], "ip")))
    return (
        tools
        and os.access("/dev/net/tun", os.R_OK | os.W_OK)
        and not subprocess.run([*_ALONE, "true"], capture_output=True, check=False).returncode
    )


class _Cable(Thread):
    """Carries frames between two hosts, and loses some."""

    def __init__(self, ends: list[int]) -> None:
        super().__init__()
        self._other = dict(zip(ends, reversed(ends), strict=True))
        self._chance = random.Random(1)
        self.carried = self.lost = 0
        self.out = self.no_multicast = self.ended = False

    def run(self) -> None:
        while not self.ended:
            for end in select.select(self._other, [], [], 0.1)[0]:
                frame = os.read(end, _FRAME)
                refused = self.no_multicast and frame.startswith(_MULTICAST)
                if refused or self.out or self._chance.random() < _LOSS:
                    self.lost += 1
                else:
                    self.carried += 1
                    os.write(self._other[end], frame)


@contextmanager
def _two_hosts(
    folder: Path, start_process: StartProcess
) -> Iterator[tuple[list[tuple[str, ...]], _Cable]]:
    """Give, for each host, the words before a command that runs there, and the cable."""
    listener = str(folder / "socket")
    host = [*_ALONE, sys.executable, str(Path(__file__).with_name("host.py")), listener]
    inside, ends = [], []
    with socket.create_server(listener, family=socket.AF_UNIX) as server:
        server.settimeout(60.0)
        for address in _HOSTS:
            process = start_process([*host, address], stdin=subprocess.PIPE)
            connection, _ = server.accept()
            with connection:
                ends += socket.recv_fds(connection, 16, 1)[1]
            inside.append((*_INSIDE, str(process.pid)))
    cable = _Cable(ends)
    cable.start()
    try:
        yield inside, cable
    finally:
        cable.ended = True
        cable.join()
        for end in ends:
            os.close(end)


@pytest.mark.ros
@pytest.mark.skipif(not _can_make_hosts(), reason="no hosts with a cable can be made here")
@pytest.mark.parametrize(
    ("peers", "out"),
    [
        ("", 0.0),
        pytest.param("", 10.0, marks=long),
        pytest.param(";".join(_HOSTS), 0.0, marks=long),
    ],
)
def test_lockstep_is_exact_across_hosts(
    peers: str,
    out: float,
    tmp_path: Path,
    start_process: StartProcess,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Craft and disturbances are on one host, all else on the other; no message stays lost.

    The cable may be out for some time [s] amid the run, or carry no multicast to named peers.
    """
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    monkeypatch.setenv("ROS_STATIC_PEERS", peers)
    warm_up(load([PAPER]))
    bag, recorded = tmp_path / "bag", "wait_for_recorder:=true"
    with _two_hosts(tmp_path, start_process) as ((space, ground), cable):
        cable.no_multicast = bool(peers)

        def start(name: str, *parameters: str, before: tuple[str, ...]) -> Node:
            return Node(start_process, tmp_path, name, *parameters, before=before)

        nodes = [
            start(RECORDER, f"bag:={bag}", before=ground),
            start(REFERENCE, recorded, before=ground),
            start(CONTROLLER, recorded, before=ground),
            start(INJECTOR, recorded, before=space),
        ]
        plant = start(PLANT, recorded, "lockstep:=true", "duration:=3.0", before=space)
        until(lambda: cable.carried > _AMID, "a run that is under way")
        cable.out = bool(out)
        time.sleep(out)  # the fault lasts; nothing is waited for
        cable.out = False
        assert plant.ends() == 0, plant.err
        end_all(nodes)
        assert cable.lost > 20
    assert "none missing" in nodes[0].err
    assert_flown(read_run(bag), simulate(load([PAPER]), 3.0))
