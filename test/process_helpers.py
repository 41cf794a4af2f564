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

"""Processes of a stack as tests start them: what they say, where their time is, how they end."""

import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import Any
from unittest import mock

from conftest import StartProcess
from craft_helpers import CONFIG

from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, OF_A_RUN, PLANT, REFERENCE
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.scenario import load

PAPER = CONFIG / "paper.yaml"
COMMAND = [sys.executable, "-m", "ppc_attitude.command_line.main"]
PATIENCE = 240.0  # [s] a machine may be busy
LOOP = (PLANT, REFERENCE, CONTROLLER, INJECTOR)
ENDLESS = ("--duration", "10000")
LOCKSTEP = ("lockstep:=true", "real_time_factor:=1.0")
_TIME = re.compile(r"\| (\d+\.\d)/")


def doze() -> None:
    """Let others have the processor for a moment."""
    time.sleep(0.01)


def until(condition: Callable[[], Any], what: str, meanwhile: Callable[[], object] = doze) -> Any:
    """Wait until a condition holds, and return what it gave; a failure names what did not come."""
    end = time.monotonic() + PATIENCE
    while not (result := condition()):
        assert time.monotonic() < end, f"waited in vain for {what}"
        meanwhile()
    return result


def ran(
    command: list[str], code: int = 0, env: Mapping[str, str] | None = None, **popen: Any
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end, with more in its environment, and see its exit code."""
    given = {"text": True, "capture_output": True, "timeout": PATIENCE, "check": False, **popen}
    done = subprocess.run(command, env={**os.environ, **(env or {})}, **given)
    assert done.returncode == code, done.stdout + done.stderr
    return done


def niceness(pid: int) -> list[int]:
    """Niceness, beyond ours, of the threads of a process; and that of the session it leads."""
    ours = os.getpriority(os.PRIO_PROCESS, 0)
    threads = [int(thread.name) for thread in Path(f"/proc/{pid}/task").iterdir()]
    found = {os.getpriority(os.PRIO_PROCESS, thread) - ours for thread in threads}
    with suppress(OSError):  # the kernel shares the processor among processes alone
        found.add(int(Path(f"/proc/{pid}/autogroup").read_text().split()[-1]))
    return sorted(found)


class Process:
    """A process whose output goes to files, so that nothing blocks and everything can be read."""

    def __init__(
        self, start_process: StartProcess, folder: Path, name: str, command: list[str], **popen: Any
    ) -> None:
        folder.mkdir(exist_ok=True)
        self.name = name
        self._out, self._err = folder / f"{name}.out", folder / f"{name}.err"
        with self._out.open("w") as out, self._err.open("w") as err:
            self.process: subprocess.Popen[str] = start_process(
                command, stdout=out, stderr=err, **popen
            )

    @property
    def pid(self) -> int:
        return self.process.pid

    @property
    def out(self) -> str:
        return self._out.read_text()

    @property
    def err(self) -> str:
        return self._err.read_text(errors="replace")

    def says(self, text: str) -> None:
        def said() -> bool:
            assert text in self.err or self.process.poll() is None, f"ended: {self.err}"
            return text in self.err

        until(said, f"{self.name}: {text}")

    def send(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def ends(self) -> int:
        """Wait for the end; return the exit code."""
        until(lambda: self.process.poll() is not None, f"the end of {self.name}")
        return int(self.process.returncode)


class Node(Process):
    def __init__(
        self,
        start_process: StartProcess,
        folder: Path,
        name: str,
        *parameters: str,
        mark: str = "",
        file: Path = PAPER,
        remap: tuple[str, ...] = (),
        before: tuple[str, ...] = (),
        **popen: Any,
    ) -> None:
        arguments = ["--ros-args", "--params-file", str(file)]
        for parameter in parameters:
            arguments += ["-p", parameter]
        for rule in remap:
            arguments += ["-r", rule]
        code = f"import sys; from ppc_attitude.nodes.executables import {name}; sys.exit({name}())"
        command = [*before, sys.executable, "-c", code, *arguments]  # as `ros2 run` begins it
        super().__init__(start_process, folder, f"{name}{mark}", command, **popen)


@contextmanager
def room_for(size: int) -> Iterator[None]:
    """Let no file of this process grow beyond some bytes, as on a full disk."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@contextmanager
def node_here(name: str, *arguments: str) -> Iterator[tuple[Callable[[], int], Any]]:
    """Give the `main` of a node, for this process, and what has it end when that is requested."""
    stop: list[int] = []
    main = import_module(f"ppc_attitude.nodes.{name}").main
    with (
        mock.patch("ppc_attitude.nodes.running.stop_requests", lambda: stop),
        mock.patch("ppc_attitude.nodes.running.handle_ending"),  # takes over no signals
        mock.patch.object(sys, "argv", [name, *arguments]),
    ):
        yield main, stop


@contextmanager
def serving(name: str, *arguments: str) -> Iterator[None]:
    """Let a node live in this process, beside what a test does."""
    with node_here(name, *arguments) as (main, stop):
        thread = Thread(target=main)
        thread.start()
        try:
            yield
        finally:
            stop.append(signal.SIGINT)
            thread.join()


def loop_nodes(
    start_process: StartProcess, folder: Path, mode: str, *names: str
) -> dict[str, Node]:
    """Start nodes of the loop, at the pace of the wall clock in either mode."""
    warm_up(load([PAPER]))  # once here, instead of in several processes at a time
    pace = LOCKSTEP if mode == "lockstep" else ()
    return {
        name: Node(start_process, folder, name, *(pace if name == PLANT else ())) for name in names
    }


def end_all(nodes: Collection[Node]) -> None:
    """Ask nodes to end, all at once; each does so in good order, and says why, once."""
    for node in nodes:
        node.send(signal.SIGINT)
    for node in nodes:
        assert node.ends() == 0, node.err
        assert "Traceback" not in node.err
        assert node.err.count("ends: it was asked to end") == 1, node.err


def plans(controller: Process) -> list[tuple[float, float]]:
    """Start [s] and attitude error [deg] of each envelope plan that a controller announced."""
    found = re.findall(r"plan from t = ([\d.]+) s: attitude error ([\d.]+)", controller.err)
    return [(float(start), float(error)) for start, error in found]


class Run(Process):
    def __init__(
        self,
        start_process: StartProcess,
        bag: Path,
        *options: str,
        overlay: str = "",
        before: tuple[str, ...] = (),
        **popen: Any,
    ) -> None:
        self.bag = bag
        folder = bag.parent
        words = ["run", "--config", str(PAPER), "--bag", str(bag)]
        if overlay:
            path = folder / "overlay.yaml"
            path.write_text(overlay)
            words += ["--config", str(path)]
        super().__init__(
            start_process, folder, "run", [*before, *COMMAND, *words, *options], **popen
        )

    @property
    def time(self) -> float:
        """Simulated time [s] that the progress bar shows."""
        shown = _TIME.findall(self.err)
        return float(shown[-1]) if shown else 0.0

    def reaches(self, simulated: float) -> None:
        """Wait until simulated time has come."""

        def reached() -> bool:
            assert self.process.poll() is None, f"ended: {self.err}"
            return self.time >= simulated

        until(reached, f"t = {simulated} s")

    def nodes(self) -> dict[str, int]:
        """Process id of each node that runs."""
        found = {}
        for pid in _children(self.pid):
            command = _command(pid)
            found.update({n: pid for n in OF_A_RUN if f"ppc_attitude.nodes.{n}\0" in command})
        return found


def workers_of(pid: int) -> list[int]:
    return [each for each in _children(pid) if "ppc_attitude.campaign.worker\0" in _command(each)]


def pace(factor: float) -> str:
    """Parameters of a lock-step run that does not outrun its test."""
    return f"/**/spacecraft_plant:\n  ros__parameters:\n    real_time_factor: {factor}\n"


def family(pid: int) -> list[int]:
    return [pid, *(each for child in _children(pid) for each in family(child))]


def alive(pid: int) -> bool:
    """True if a process runs, or is stopped; a zombie has ended."""
    try:
        return _status(pid)[0] != "Z"
    except OSError:
        return False


def pause(pid: int) -> None:
    """Stop a process, and see that it has stopped."""
    os.kill(pid, signal.SIGSTOP)
    until(lambda: _status(pid)[0] == "T", "the pause")


def _status(pid: int) -> list[str]:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()


def _command(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return ""


def _children(parent: int) -> list[int]:
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if int(_status(int(folder.name))[1]) == parent:
                found.append(int(folder.name))
        except OSError:
            continue
    return found
