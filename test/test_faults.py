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

"""Faults of a run, with real processes: no hang, no orphan, the cause named, a bag that is true."""

import os
import resource
import select
import signal
import sys
import threading
from pathlib import Path

import pytest

from ppc_attitude.bags.reader import read_run
from ppc_attitude.contract.topics import CONTROLLER, NODES, PLANT, RECORDER

PAPER = Path(__file__).parents[1] / "config" / "paper.yaml"
COMMAND = [sys.executable, "-m", "ppc_attitude.command_line.main"]
PAUSE = 3.0  # [s]

pytestmark = [pytest.mark.ros, pytest.mark.long]


def started(start_process, bag, *options, **popen):
    process = start_process(
        [*COMMAND, "run", "--config", str(PAPER), "--bag", str(bag), *options], **popen
    )
    for line in process.stderr:
        if "s/s]" in line and "/s [" in line:
            break
        # the bar moves: time has begun
        if "simulated:   1%" in line or "simulated:   2%" in line:
            break
    return process


def nodes_of(process):
    """Process ids of the nodes by name."""
    found = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
            command = (stat.parent / "cmdline").read_text()
        except OSError:
            continue
        for name in NODES:
            if parent == process.pid and f"ppc_attitude.nodes.{name}\0" in command:
                found[name] = int(stat.parent.name)
    return found


def finished(process, timeout=90.0):
    out, err = process.communicate(timeout=timeout)
    return process.returncode, out, err


def alive(pid):
    return Path(f"/proc/{pid}").exists()


@pytest.mark.parametrize("mode", [(), ("--realtime",)], ids=["lockstep", "realtime"])
@pytest.mark.parametrize("name", NODES)
def test_a_killed_node_ends_the_run_and_is_named(tmp_path, start_process, name, mode):
    bag = tmp_path / "bag"
    process = started(start_process, bag, "--duration", "1000", *mode)
    pids = nodes_of(process)
    assert pids.keys() == set(NODES)
    os.kill(pids[name], signal.SIGKILL)
    code, _, err = finished(process)
    assert code == 3
    assert f"error: {name} was killed by SIGKILL" in err
    assert f"bag: {bag}" in err
    assert not any(map(alive, pids.values()))
    record = read_run(bag)
    assert record.stamps_ns.size > 1
    cut = any("cut" in warning for warning in record.warnings)
    assert cut == (name == RECORDER)
    if cut:
        recovery = start_process([*COMMAND, "recover", str(bag)])
        assert finished(recovery)[0] == 0
        assert (bag / "metadata.yaml").exists()


@pytest.mark.parametrize("name", NODES)
def test_a_pause_costs_lockstep_nothing_but_time(tmp_path, start_process, name):
    process = started(start_process, tmp_path / "bag", "--duration", "60")
    pid = nodes_of(process)[name]
    os.kill(pid, signal.SIGSTOP)
    threading.Timer(PAUSE, os.kill, (pid, signal.SIGCONT)).start()
    code, _, err = finished(process)
    assert code == 1, err  # sixty seconds end before the last requirement can be judged
    assert read_run(tmp_path / "bag").missing_messages == 0


def test_a_paused_controller_in_real_time_is_told_and_leaves_a_gap(tmp_path, start_process):
    process = started(start_process, tmp_path / "bag", "--duration", "6", "--realtime")
    pid = nodes_of(process)[CONTROLLER]
    os.kill(pid, signal.SIGSTOP)
    threading.Timer(PAUSE, os.kill, (pid, signal.SIGCONT)).start()
    code, _, err = finished(process)
    assert code == 3
    assert "no torque_command for 0.5 s: zero torque" in err
    assert "torque_command has" in err
    assert read_run(tmp_path / "bag").missing["torque_command"] > 100


def test_a_full_disk_is_named_and_what_was_written_can_be_read(tmp_path, start_process):
    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (2_000_000, 2_000_000))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    process = started(start_process, tmp_path / "bag", "--duration", "1000", preexec_fn=limit)
    code, _, err = finished(process)
    assert code == 3
    assert "cannot be written any further" in err
    record = read_run(tmp_path / "bag")
    assert record.stamps_ns.size > 1
    assert any("cut" in warning for warning in record.warnings)


def test_nodes_end_with_their_killed_starter(tmp_path, start_process):
    process = started(start_process, tmp_path / "bag", "--duration", "1000")
    pids = nodes_of(process)
    ends = [os.pidfd_open(pid) for pid in pids.values()]
    process.kill()
    for end in ends:
        assert select.select([end], [], [], 30.0)[0], "a node outlives its starter"
        os.close(end)


def test_a_second_plant_ends_and_says_why(tmp_path, start_process):
    process = started(start_process, tmp_path / "bag", "--duration", "1000", "--realtime")
    second = start_process([sys.executable, "-m", f"ppc_attitude.nodes.{PLANT}"])
    code, _, err = finished(second)
    assert code == 3
    assert "another node publishes attitude" in err
    process.send_signal(signal.SIGINT)
    assert finished(process)[0] == 3
