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

import os
import re
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ppc_attitude.command_line.parameter_file import parameter_file
from ppc_attitude.contract.declared import nodes_of
from ppc_attitude.contract.topics import OF_A_RUN, PLANT, RECORDER
from ppc_attitude.nodes.discovery import DOMAIN, MIDDLEWARE, RANGE, check_discovery, choose_domain
from ppc_attitude.processes.child import Child, starved
from ppc_attitude.processes.exits import BAD_INPUT
from ppc_attitude.processes.telling import AT, BROKEN, FINISHED, LINGERS, TIME, WAITING
from ppc_attitude.runtime.health import Stall
from ppc_attitude.simulation.scenario import Scenario

_PATIENCE = 20.0  # [s] of the processor's time for a process to end after it was asked to
_EVENT = re.compile(r"(\x1b\[\d*m)*\[(INFO|DEBUG)\]")  # how ROS begins such a line
_NO_MIDDLEWARE = 102  # with which rcl ends the process that loads it, before our first line runs
_GLANCE = 0.02  # [s] between two looks at the processes
# All nodes import these, and none starts a thread: imported here once, each copy has them.
_SHARED = (
    "diagnostic_msgs.msg",
    "geometry_msgs.msg",
    "rcl_interfaces.srv",
    "rosidl_generator_py",
    "std_msgs.msg",
    "type_description_interfaces.srv",
)
# The recorder goes last, when all others have sent their last message.
_OTHERS = tuple(name for name in OF_A_RUN if name not in (PLANT, RECORDER))
_STOP_ORDER = ((PLANT,), _OTHERS, (RECORDER,))
_STOP_BROKEN = ((PLANT, *_OTHERS), (RECORDER,))


class StackError(Exception):
    """The run broke: says where and how; `refused` if a node did not take what it was given."""

    def __init__(self, text: str, refused: bool = False) -> None:
        super().__init__(text)
        self.refused = refused


def private_environment(domain: str = "") -> dict[str, str]:
    """Environment of the processes of a run: this host only, and a domain of their own.

    A range or domain that the user has set is kept. Else the domain is the one given, or, where
    none is, one that nobody uses.

    Raises
    ------
    ConfigurationError
        What the user has set is wrong.
    ModuleNotFoundError
        ROS is not installed, so that no process of a run could begin.
    """
    if find_spec("rclpy") is None:  # not imported: a process in which tracing has begun a thread
        raise ModuleNotFoundError("No module named 'rclpy'", name="rclpy")  # cannot be copied
    environment = dict(os.environ)
    environment[RANGE] = environment.get(RANGE) or "LOCALHOST"
    environment[DOMAIN] = environment.get(DOMAIN) or domain or str(choose_domain())
    check_discovery(environment)
    return environment


def pass_on(line: str) -> None:
    """Show the user warnings, errors and tracebacks; events are for the log and ``/rosout``."""
    if not _EVENT.match(line):
        print(line, file=sys.stderr, flush=True)


class Stack:
    """The processes of one run: by default all that the scenario needs, in `private_environment`.

    The kernels of the scenario should be warm. `on_time` is called with simulated time [s] as the
    plant advances, and `on_line` with each line that a process prints.
    """

    def __init__(
        self,
        scenario: Scenario,
        on_time: Callable[[float], None],
        nodes: Iterable[str] | None = None,
        environment: Mapping[str, str] | None = None,
        on_line: Callable[[str], None] = pass_on,
    ) -> None:
        self.environment = private_environment() if environment is None else environment
        chosen = set(nodes_of(scenario.parameters) if nodes is None else nodes)
        self._names = [name for name in OF_A_RUN if name in chosen]
        self._parameters = parameter_file(scenario)
        self._on_time, self._on_line = on_time, on_line
        self.nodes: dict[str, Child] = {}
        self._time: float | None = None
        self._stall = Stall(time.monotonic())

    @property
    def has_begun(self) -> bool:
        """True if simulated time has advanced."""
        return self._time is not None

    def start(self) -> None:
        """Start every process."""
        with suppress(ImportError):  # a node that cannot do without says so
            for module in _SHARED:
                import_module(module)
        # A file without a name: whatever ends this process, nothing stays behind.
        with tempfile.TemporaryFile() as file:
            file.write(self._parameters.encode())
            file.flush()
            options = ["--ros-args", "--params-file", f"/dev/fd/{file.fileno()}"]
            if "ROS_LOG_DIR" not in self.environment:
                options.append("--disable-external-lib-logs")
            for name in self._names:
                self.nodes[name] = Child(
                    f"ppc_attitude.nodes.{name}",
                    *options,
                    environment=self.environment,
                    inherited=[file.fileno()],
                    hear=self._on_line,
                    copy=True,
                )

    def wait(self, stop: threading.Event) -> None:
        """Wait until the plant has finished or a stop is asked for.

        Raises
        ------
        StackError
            Another process ended first, the plant broke, waits in vain for a peer, or hangs.
        """
        while self.goes_on(stop, _GLANCE):
            pass

    def goes_on(self, stop: threading.Event, patience: float = 0.0) -> bool:
        """Look at the processes; False if the run has ended, or is to be stopped.

        If the plant has told nothing, it is waited for with some patience [s].

        Raises
        ------
        StackError
            As `wait`.
        """
        plant = self.nodes[PLANT]
        plant.listen(patience)
        self._stall.look(time.monotonic())
        ended = {name: code for name, code in self.exit_codes().items() if code is not None}
        self.told()  # afterwards, so that all that a process told before its end is heard
        now: float | None = plant.told.pop(TIME, None)
        if now is not None:
            self._stall.hear(time.monotonic())
        if now is not None and now != self._time:
            self._time = now
            self._stall.advance(time.monotonic(), self._starvation())
            for node in self.nodes.values():
                node.told.pop(WAITING, None)
            self._on_time(now)
        done = ended.get(PLANT, 0 if LINGERS in plant.told else None) == 0
        finished = done and FINISHED in plant.told
        if broken := [name for name in ended if not (name == PLANT and finished)]:
            raise self._broken(broken)
        if why := self._stall.reason(time.monotonic(), self._starvation, self._hindrances):
            raise StackError(why)
        return not (finished or stop.is_set())

    def _starvation(self) -> dict[str, float]:
        return {name: starved(node.process.pid) for name, node in self.nodes.items()}

    def _hindrances(self) -> list[str]:
        """Nodes that somebody has paused; if there are none, what each node waits for."""
        paused = [name for name, node in self.nodes.items() if _is_paused(node.process.pid)]
        if paused:
            return [f"{name} is paused (SIGSTOP)" for name in paused]
        return [node.told.get(WAITING, "") for node in self.nodes.values()]

    def stop(self) -> None:
        """Ask every process to end, the recorder last; kill what does not.

        Raises
        ------
        StackError
            A process had to be killed or ended with an error.
        """
        hanging = []
        try:
            broken = any(node.process.poll() for node in self.nodes.values())
            for names in _STOP_BROKEN if broken else _STOP_ORDER:
                nodes = {name: self.nodes[name] for name in names if name in self.nodes}
                for node in nodes.values():
                    node.process.send_signal(signal.SIGINT)
                for name, node in nodes.items():
                    if not node.ends(_PATIENCE, LINGERS):
                        hanging.append(name)
                        node.says_where()
                        node.kill()
            # A node that lingers ends when the recorder has gone, which got all that was sent.
            for name, node in self.nodes.items():
                if not node.ends(_PATIENCE):
                    hanging.append(name)
        finally:
            self.kill()
            self.told()
        codes = self.exit_codes()
        if failed := [name for name, code in codes.items() if code and name not in hanging]:
            raise self._broken(failed)
        if hanging:
            late = ", ".join(hanging)
            raise StackError(f"{late} did not end within {_PATIENCE:g} s and was killed")

    def kill(self) -> None:
        """Kill whatever still runs; nothing of the stack survives its starter."""
        for node in self.nodes.values():
            node.kill()

    def told(self) -> dict[str, dict[str, Any]]:
        """Facts that each process has told, by name (see `telling`)."""
        for node in self.nodes.values():
            node.listen()
        return {name: node.told for name, node in self.nodes.items()}

    def exit_codes(self) -> dict[str, int | None]:
        """Exit code of each process; None while it runs."""
        return {name: node.process.poll() for name, node in self.nodes.items()}

    def pids(self) -> dict[str, int]:
        """Process id of each node."""
        return {name: node.process.pid for name, node in self.nodes.items()}

    def _broken(self, ended: Iterable[str]) -> StackError:
        """Say how the node ended that ended first, because the others ended as a consequence."""
        name = min(ended, key=lambda each: _broke_at(self.nodes[each]))
        node = self.nodes[name]
        code = node.process.returncode
        if code < 0:  # a process that was killed says nothing about it
            return StackError(f"{name} was killed by {signal.Signals(-code).name}")
        unsaid = "it gave no reason" if code else "somebody else asked it to end"
        reason, refused = node.told.get(BROKEN, unsaid), code == BAD_INPUT
        if code == _NO_MIDDLEWARE:
            asked, refused = self.environment.get(MIDDLEWARE, ""), True
            reason = f"{MIDDLEWARE} = {asked!r}; allowed: an installed middleware, or unset"
        return StackError(f"{name} ended with exit code {code}: {reason}", refused)


def _broke_at(node: Child) -> float:
    """When a node that has ended broke, on the monotonic clock [s].

    A killed node could not tell, and did not end as a consequence of others: so it comes first.
    """
    if node.process.returncode < 0:
        return 0.0
    at: float = node.told.get(AT, time.monotonic())
    return at


def _is_paused(pid: int) -> bool:
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
    except OSError:
        return False
    return text.rpartition(")")[2].split()[0] == "T"
