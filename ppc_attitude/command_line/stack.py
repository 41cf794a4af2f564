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

"""Starting, watching and stopping the five processes of a run."""

import contextlib
import ctypes
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import IO

from ppc_attitude.command_line.domains import choose_domain
from ppc_attitude.command_line.parameter_file import parameter_file
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, NODES, PLANT, RECORDER, REFERENCE
from ppc_attitude.simulation.scenario import Scenario

_PATIENCE = 20.0  # [s] how long a process may take to end after it was asked to
_KILLED_AFTER = 5.0  # [s] how long the family of a killed process may take
_STALLED_AFTER = 30.0  # [s] without a step after which a run in lock-step is given up
_PROGRESS = re.compile(r"^t ([0-9.]+)$")
_LOUD = re.compile(r"\[(WARN|ERROR|FATAL)\]|^error:|Traceback|Error: ")
# The recorder goes last, when all others have sent their last message.
_STOP_ORDER = ((PLANT,), (CONTROLLER, REFERENCE, INJECTOR), (RECORDER,))
_STOP_BROKEN = ((PLANT, CONTROLLER, REFERENCE, INJECTOR), (RECORDER,))


_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None


def _prepare_child(parent: int) -> None:
    """Let the kernel ask this new process to end when its starter dies, however that happens.

    Signals wait until it can take them (`nodes.running.StopRequest`), not amidst its imports.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    if _LIBC is not None:
        _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it died before the kernel knew
        os._exit(1)


class StackError(Exception):
    """The run broke; says which node and what happened."""


@dataclass
class NodeProcess:
    """One running executable."""

    name: str
    process: subprocess.Popen[str]
    tail: deque[str] = field(default_factory=lambda: deque(maxlen=40))
    reader: threading.Thread | None = None

    def ended(self) -> str:
        """How the process ended, in words."""
        code = self.process.returncode
        if code is not None and code < 0:
            return f"was killed by {signal.Signals(-code).name}"
        return f"ended with exit code {code}"


def _is_paused(pid: int) -> bool:
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
    except OSError:
        return False
    return text.rpartition(")")[2].split()[0] == "T"


def private_environment() -> dict[str, str]:
    """Environment of the processes of a run: this host only, and a domain of their own.

    A range or domain that the user has set is kept.
    """
    environment = dict(os.environ)
    environment.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    if "ROS_DOMAIN_ID" not in environment:
        environment["ROS_DOMAIN_ID"] = str(choose_domain())
    environment["PYTHONUNBUFFERED"] = "1"
    return environment


class Stack:
    """The processes of one run.

    Parameters
    ----------
    arguments : mapping of str to sequence of str
        Executable to its command-line arguments; the executables that are to run.
    environment : mapping of str to str
        Environment of all of them.
    on_time : callable
        Called with simulated time [s] as the plant advances.
    """

    def __init__(
        self,
        arguments: Mapping[str, Sequence[str]],
        environment: Mapping[str, str],
        on_time: Callable[[float], None],
    ) -> None:
        self._arguments = arguments
        self.environment = environment
        self._on_time = on_time
        self._nodes: dict[str, NodeProcess] = {}
        self.has_begun = False  # simulated time has advanced
        self._advanced = time.monotonic()

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        folder: Path,
        on_time: Callable[[float], None],
        nodes: Iterable[str] = NODES,
        environment: Mapping[str, str] | None = None,
    ) -> "Stack":
        """Processes that run a scenario.

        Parameters
        ----------
        scenario : Scenario
            What they run; its kernels should be warm.
        folder : Path
            Where their parameters and, unless the environment says otherwise, their logs go.
        on_time : callable
            Called with simulated time [s] as the plant advances.
        nodes : iterable of str
            Which executables run.
        environment : mapping of str to str, optional
            Environment of all of them; default `private_environment`.
        """
        path = folder / "run.yaml"
        path.write_text(parameter_file(scenario), encoding="utf-8")
        arguments = {name: ["--ros-args", "--params-file", str(path)] for name in nodes}
        if PLANT in arguments:
            arguments[PLANT].insert(0, "--progress")
        environment = private_environment() if environment is None else environment
        return cls(arguments, {"ROS_LOG_DIR": str(folder), **environment}, on_time)

    def start(self) -> None:
        """Start every process."""
        for name in NODES:
            if name in self._arguments:
                self._start(name)

    def _start(self, name: str) -> None:
        module = f"ppc_attitude.nodes.{name}"
        process = subprocess.Popen(
            [sys.executable, "-m", module, *self._arguments[name]],
            env=dict(self.environment),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            # A Ctrl-C at the terminal is ours to pass on, in the order that loses nothing.
            start_new_session=True,
            preexec_fn=partial(_prepare_child, os.getpid()),
        )
        node = NodeProcess(name, process)
        assert process.stdout is not None
        node.reader = threading.Thread(
            target=self._read, args=(node, process.stdout), name=name, daemon=True
        )
        self._nodes[name] = node
        node.reader.start()

    def _read(self, node: NodeProcess, stream: IO[str]) -> None:
        for line in stream:
            progress = _PROGRESS.match(line)
            if progress:
                self._advanced = time.monotonic()
                self.has_begun = True
                self._on_time(float(progress[1]))
                continue
            node.tail.append(line.rstrip("\n"))
            if _LOUD.search(line):
                print(f"{node.name}: {line}", end="", file=sys.stderr, flush=True)

    def wait(self, stop: threading.Event) -> None:
        """Wait until the plant has finished or a stop is asked for.

        Raises
        ------
        StackError
            Another process ended first, the plant broke, or it waits in vain for a peer.
        """
        self._advanced = time.monotonic()
        while not stop.is_set():
            self._look_for_stall()
            for node in self._nodes.values():
                if node.process.poll() is None:
                    continue
                if node.name == PLANT and node.process.returncode == 0:
                    return
                raise self._broken(node)
            stop.wait(0.02)

    def _look_for_stall(self) -> None:
        if time.monotonic() - self._advanced < _STALLED_AFTER:
            return
        paused = [name for name, node in self._nodes.items() if _is_paused(node.process.pid)]
        waiting = [line for line in self._nodes[PLANT].tail if "waiting" in line][-1:]
        reasons = [f"{name} is paused (SIGSTOP)" for name in paused] or waiting
        if reasons:
            raise StackError(f"no step for {_STALLED_AFTER:g} s: {', '.join(reasons)}")

    def stop(self) -> None:
        """Ask every process to end, the recorder last; kill what does not.

        Raises
        ------
        StackError
            A process had to be killed or ended with an error.
        """
        problems: list[StackError] = []
        try:
            broken = any(node.process.poll() for node in self._nodes.values())
            for names in _STOP_BROKEN if broken else _STOP_ORDER:
                nodes = [self._nodes[name] for name in names if name in self._nodes]
                for node in nodes:
                    if node.process.poll() is None:
                        node.process.send_signal(signal.SIGINT)
                for node in nodes:
                    problems += self._wait_for_end(node)
        finally:
            self.kill()
        if problems:
            raise problems[0]

    def _wait_for_end(self, node: NodeProcess) -> list[StackError]:
        try:
            node.process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            node.process.kill()
            node.process.wait()
            return [StackError(f"{node.name} did not end within {_PATIENCE:g} s and was killed")]
        self._finish_reading(node)
        return [self._broken(node)] if node.process.returncode != 0 else []

    def kill(self) -> None:
        """Kill whatever still runs; nothing of the stack survives its starter."""
        for node in self._nodes.values():
            with contextlib.suppress(ProcessLookupError):
                os.killpg(node.process.pid, signal.SIGKILL)
            with contextlib.suppress(subprocess.TimeoutExpired):
                node.process.wait(_KILLED_AFTER)

    def exit_codes(self) -> dict[str, int | None]:
        """Exit code of each process; None while it runs."""
        return {name: node.process.poll() for name, node in self._nodes.items()}

    def pids(self) -> dict[str, int]:
        """Process id of each node."""
        return {name: node.process.pid for name, node in self._nodes.items()}

    def _finish_reading(self, node: NodeProcess) -> None:
        if node.reader is not None:
            node.reader.join(timeout=2.0)

    def _broken(self, node: NodeProcess) -> StackError:
        self._finish_reading(node)
        if node.process.returncode < 0:  # a process that was killed says nothing about it
            return StackError(f"{node.name} {node.ended()}")
        reason = next((line for line in reversed(node.tail) if line.strip()), "without saying why")
        return StackError(f"{node.name} {node.ended()}: {reason}")
