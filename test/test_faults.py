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
import signal
import sys
import time
from pathlib import Path
from random import Random

import pytest
from conftest import StartProcess
from process_helpers import (
    COMMAND,
    ENDLESS,
    Process,
    Run,
    alive,
    family,
    niceness,
    pace,
    pause,
    until,
)

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.reader import read_run
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, NODES, PLANT, RECORDER, REFERENCE

long = pytest.mark.long

pytestmark = pytest.mark.ros


def lasting(seconds: float) -> None:
    """Let a fault last; nothing is waited for."""
    time.sleep(seconds)


def fails(run: Run, cause: str) -> str:
    """The run ends with exit code 3, names the cause and its bag, and leaves no process."""
    pids = family(run.pid)
    assert run.ends() == 3, run.err
    assert cause in run.err
    assert "Traceback" not in run.err
    assert f"bag: {run.bag}" in run.err + run.out
    assert not any(map(alive, pids)), "a node outlives its run"
    return run.err


KILLED = [
    pytest.param(name, mode, id=f"{name}-{mode or 'lockstep'}", marks=marks)
    for name in NODES
    for mode, marks in (("", () if name == CONTROLLER else long), ("--realtime", long))
]


@pytest.mark.parametrize(("name", "mode"), KILLED)
def test_a_killed_node_ends_the_run_and_is_named(
    name: str, mode: str, tmp_path: Path, start_process: StartProcess
) -> None:
    run = Run(start_process, tmp_path / "bag", *ENDLESS, *filter(None, [mode]), overlay=pace(1.0))
    # Of a killed recorder's bag one second of the clock may be lost.
    run.reaches(3.0 if name == RECORDER else 0.5)
    nodes = run.nodes()
    assert nodes.keys() == set(NODES)
    for node, pid in nodes.items():
        last = 5 if node == RECORDER and not mode else 0
        assert niceness(pid) == [last], f"{node} comes last where it is waited for"
    os.kill(nodes[name], signal.SIGKILL)
    fails(run, f"error: {name} was killed by SIGKILL")
    record = read_run(run.bag)
    assert record.stamps_ns.size > 1
    cut = any("cut" in warning for warning in record.warnings)
    assert cut == (name == RECORDER)


@long
@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@pytest.mark.parametrize("seed", range(4))
def test_after_sigkill_of_the_recorder_at_most_the_last_second_is_lost(
    storage: str, seed: int, tmp_path: Path, start_process: StartProcess
) -> None:
    """At the pace of the clock, so that a second of the run is a second, or more of a busy one."""
    overlay = f"{pace(1.0)}/**/{RECORDER}:\n  ros__parameters:\n    storage: {storage}\n"
    run = Run(start_process, tmp_path / "bag", *ENDLESS, overlay=overlay)
    run.reaches(Random(seed).uniform(1.5, 4.0))
    # The plant prints its time after it has published: what it showed had been sent. A busy machine
    # may give the recorder its turn late; how late is no matter of this test.
    published = run.time
    until(lambda: recorded_until(run.bag) >= published - 1.0, "the record")
    os.kill(run.nodes()[RECORDER], signal.SIGKILL)
    fails(run, f"error: {RECORDER} was killed by SIGKILL")

    record = read_run(run.bag)
    assert record.t[-1] >= published - 1.0
    assert record.missing_messages == 0
    (warning,) = record.warnings
    assert "recording was cut" in warning
    judged = Process(start_process, tmp_path, "analyse", [*COMMAND, "analyse", str(run.bag)])
    assert judged.ends() == 0  # too short to settle
    assert "recording was cut" in judged.err + judged.out

    finished = Process(start_process, tmp_path, "recover", [*COMMAND, "recover", str(run.bag)])
    assert finished.ends() == 0, finished.err
    assert (run.bag / "metadata.yaml").exists()
    again = read_run(run.bag)
    assert again.t[-1] >= record.t[-1]
    assert any("since recovered" in warning for warning in again.warnings)


def recorded_until(bag: Path) -> float:
    """Time [s] of the last state that can be read; -1 if none can."""
    try:
        return float(read_run(bag).t[-1])
    except BagError:
        return -1.0


@long
def test_silence_of_all_peers_in_real_time_is_told_and_leaves_a_gap(
    tmp_path: Path, start_process: StartProcess
) -> None:
    """Controller, reference and injector all fall silent; the plant goes on without torque."""
    run = Run(start_process, tmp_path / "bag", "--duration", "8", "--realtime")
    run.reaches(1.0)
    silent = [run.nodes()[name] for name in (CONTROLLER, REFERENCE, INJECTOR)]
    for pid in silent:
        pause(pid)
    lasting(3.0)
    for pid in silent:
        os.kill(pid, signal.SIGCONT)
    err = fails(run, "no torque_command for 0.5 s: zero torque")
    assert "no disturbance/torque for 0.5 s: zero torque" in err
    assert "torque_command has" in err
    record = read_run(run.bag)
    assert record.missing["torque_command"] > 50
    applied = record["applied_torque"]
    assert (applied[-1] != 0.0).any(), "it recovers by itself"
    assert (applied == 0.0).all(axis=1).sum() > 50


class Host:
    """A network of its own, as long as a process sleeps in it."""

    def __init__(self, start_process: StartProcess, folder: Path) -> None:
        self._start, self._folder = start_process, folder
        command = ["unshare", "--user", "--map-root-user", "--net", "sleep", "infinity"]
        self._sleeper = Process(start_process, folder, "host", command)
        until(self._is_there, "the network")

    def _is_there(self) -> bool:
        if self._sleeper.process.poll() is not None:
            pytest.skip(f"no network of its own may be made here: {self._sleeper.err}")
        return Path(f"/proc/{self._sleeper.pid}/comm").read_text().strip() == "sleep"

    @property
    def enter(self) -> tuple[str, ...]:
        """What comes before a command that is to run there."""
        target = str(self._sleeper.pid)
        return ("nsenter", "-t", target, "--user", "--preserve-credentials", "--net")

    def ip(self, *words: str) -> None:
        command = [*self.enter, "ip", *words]
        done = Process(self._start, self._folder, "ip", command)
        assert done.ends() == 0, done.err


@long
def test_network_silence(tmp_path: Path, start_process: StartProcess) -> None:
    """All packets are lost for seconds; then the loop goes on by itself."""
    host = Host(start_process, tmp_path)
    host.ip("link", "set", "lo", "up")
    options = ("--duration", "12", "--realtime")
    run = Run(start_process, tmp_path / "bag", *options, before=host.enter)
    run.reaches(1.0)

    host.ip("link", "set", "lo", "down")
    run.says("no torque_command for 0.5 s: zero torque")
    host.ip("link", "set", "lo", "up")
    run.ends()
    # 1: on a busy machine the silence lasts longer, and the craft drifts out of its envelope.
    assert run.process.returncode in (0, 1, 3), run.err
    record = read_run(run.bag)
    assert record.t[-1] == 12.0
    assert (record["applied_torque"][-1] != 0.0).any(), "it recovers by itself"
    assert (run.process.returncode == 3) == (record.missing_messages > 0)


@long
def test_a_recorder_that_cannot_keep_up_is_told(
    tmp_path: Path, start_process: StartProcess
) -> None:
    """In real time nobody waits for it: what its publishers remember runs over."""
    overlay = f"/**/{PLANT}:\n  ros__parameters:\n    rate: 1000.0\n"
    run = Run(start_process, tmp_path / "bag", "--duration", "15", "--realtime", overlay=overlay)
    run.reaches(1.0)
    pid = run.nodes()[RECORDER]
    pause(pid)
    run.reaches(9.0)
    os.kill(pid, signal.SIGCONT)
    fails(run, "is incomplete: ")
    assert read_run(run.bag).missing_messages > 0


@long
def test_a_file_that_cannot_grow_is_named_and_what_was_written_can_be_read(
    tmp_path: Path, start_process: StartProcess
) -> None:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, 1_000_000))
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

    run = Run(start_process, tmp_path / "bag", *ENDLESS, preexec_fn=limit)
    fails(run, "cannot be written any further: File too large")
    record = read_run(run.bag)
    assert record.stamps_ns.size > 100
    assert any("cut" in warning for warning in record.warnings)
    judged = {each.name: each.met for each in Verdict(record).requirements}
    assert judged["settling time"] is None, "nobody knows what would have come"


def listens(run: Run) -> bool:
    """True if the command has begun: it takes SIGTERM, which Python by itself does not."""
    status = Path(f"/proc/{run.pid}/status").read_text()
    caught = int(status.partition("SigCgt:\t")[2].split()[0], 16)
    return bool(caught >> (signal.SIGTERM - 1) & 1)


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(seed, marks=long) for seed in (0, *range(2, 30)))]
)
def test_ctrl_c_at_any_moment_and_again_ends_in_good_order(
    seed: int, tmp_path: Path, start_process: StartProcess
) -> None:
    random = Random(seed)
    run = Run(start_process, tmp_path / "bag", "--duration", "3", overlay=pace(3.0))
    until(lambda: listens(run), "the command")
    lasting(random.uniform(0.0, 5.0))
    pids = family(run.pid)
    run.send(signal.SIGINT)
    lasting(random.choice([0.0, random.uniform(0.0, 2.0)]))
    if run.process.poll() is None:
        pids += family(run.pid)
        run.send(signal.SIGINT)
    code = run.ends()
    assert code == 3 or (code == 0 and run.time == 3.0), run.err  # one came after the end
    assert "Traceback" not in run.err
    assert "Exception ignored" not in run.err
    assert "interrupt" in run.err or code == 0
    assert not any(map(alive, pids))
    if run.bag.exists() and run.time > 0.0:
        assert (run.bag / "metadata.yaml").exists()
        assert not read_run(run.bag).missing_messages


INTERRUPTED = """
import os, signal, sys
from ppc_attitude.nodes import executables

class Interrupt:
    @staticmethod
    def find_spec(name, *rest):
        if name == {module!r}:
            os.kill(os.getpid(), signal.{signal})

sys.meta_path.insert(0, Interrupt)
sys.exit(executables.{node}())
"""


@pytest.mark.parametrize(
    ("module", "stop"),
    [("numpy", "SIGINT"), ("rclpy", "SIGTERM"), ("ppc_attitude.nodes.base", "SIGINT")],
)
def test_a_node_interrupted_while_it_is_imported_ends_in_good_order(
    module: str, stop: str, tmp_path: Path, start_process: StartProcess
) -> None:
    """As `ros2 run` starts it: nobody has blocked the signals for it."""
    script = INTERRUPTED.format(module=module, signal=stop, node=PLANT)
    node = Process(start_process, tmp_path, "node", [sys.executable, "-c", script])
    assert node.ends() == 0, node.err
    assert node.err == ""


@long
def test_a_node_that_stays_paused_ends_the_run(tmp_path: Path, start_process: StartProcess) -> None:
    run = Run(start_process, tmp_path / "bag", *ENDLESS, overlay=pace(20.0))
    run.reaches(0.5)
    pause(run.nodes()[CONTROLLER])
    fails(run, f"no step for 30 s: {CONTROLLER} is paused (SIGSTOP)")
    assert read_run(run.bag).stamps_ns.size > 1
