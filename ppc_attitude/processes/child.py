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

"""A process of our own: a module of this package, run by this Python, gone with its starter."""

import contextlib
import ctypes
import faulthandler
import gc
import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any, TypeAlias

from ppc_attitude.processes.copied import Copy, become, can_copy
from ppc_attitude.processes.imports import drop_empty_entries
from ppc_attitude.processes.telling import tell_broken, tell_through

_START = str(Path(__file__).resolve().with_name("start.py"))
_KILLED_AFTER = 5.0  # [s] how long a process may take to end when it was killed
_SPEAKS_WITHIN = 0.5  # [s] within which a process says where it hangs
_GLANCE = 0.02  # [s] between two looks at a process that is to end
_LAST = 5  # niceness by which a process comes last; 10 makes no step shorter
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
Handler: TypeAlias = Callable[[int, FrameType | None], object] | signal.Handlers
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT) + (
    # A process that was started by nohup goes on when its terminal closes.
    (signal.SIGHUP,) if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN else ()
)
"""By these a process is asked to end, and does so in good order."""
SAY_WHERE = signal.SIGUSR1
"""On this a process prints where each of its threads is; one that has left Python ends."""


class Child:
    """The `main` of a module of this package as a process of its own.

    The current folder is not on its path (see `start.py`). It prints to our standard error, because
    our standard output is for results. A request to end is granted at once until the module does
    otherwise; the kernel sends SIGTERM when the starting thread has ended. A Ctrl-C at the terminal
    does not reach the process: its starter ends it, in order.

    Parameters
    ----------
    module : str
        Full name of the module.
    *arguments : str
        Its command line.
    environment : mapping of str to str
        Its environment.
    inherited : sequence of int
        File descriptors that it shares with this process.
    hear : callable, optional
        Called by `listen` with each line of its standard error; default that of this process.
    copy : bool, optional
        True to copy this process, if it can be copied: then what is imported here need not be
        imported again.
    """

    def __init__(
        self,
        module: str,
        *arguments: str,
        environment: Mapping[str, str] = os.environ,
        inherited: Sequence[int] = (),
        hear: Callable[[str], None] | None = None,
        copy: bool = False,
    ) -> None:
        self.told: dict[str, Any] = {}
        """Facts that it has told, by name (see `telling`): the latest of each."""
        self._pipes: list[int] = []
        self._readers: dict[int, _Lines] = {}
        theirs = self._new_pipe(self._take)
        errors = self._new_pipe(hear) if hear else None
        kept, safe = (*inherited, theirs), dict(environment)
        drop_empty_entries(safe)
        self.process: subprocess.Popen[bytes] | Copy
        # A child inherits that signals are blocked, so none comes before it has its handlers.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
        try:
            if copy and can_copy():
                work = partial(begin, os.getpid(), theirs, module, *arguments)
                self.process = Copy(partial(become, work, module, errors or 2, kept, safe))
            else:
                self.process = subprocess.Popen(
                    [sys.executable, _START, str(os.getpid()), str(theirs), module, *arguments],
                    env=safe,
                    stdin=subprocess.DEVNULL,
                    stdout=2,
                    stderr=errors,
                    pass_fds=kept,
                    start_new_session=True,
                )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            for pipe in (theirs, errors):
                if pipe is not None:
                    os.close(pipe)

    def _new_pipe(self, take: Callable[[str], None]) -> int:
        """Open a pipe whose lines are taken by `listen`; return the end for the child."""
        ours, theirs = os.pipe()
        self._pipes.append(ours)
        self._readers[ours] = _Lines(take)
        return theirs

    def _take(self, line: str) -> None:
        self.told.update(json.loads(line))

    def listen(self, patience: float = 0.0) -> None:
        """Take in what it has told and logged; wait some time [s] if there is nothing."""
        while ready := select.select(list(self._readers), [], [], patience)[0]:
            for pipe in ready:
                if not self._readers[pipe].read(pipe):  # it is about to end
                    del self._readers[pipe]
            patience = 0.0

    def ends(self, patience: float, enough: str = "") -> bool:
        """Wait for its end; False if it has not come after some time [s] in which it could run.

        Once it tells the fact `enough`, that counts as its end. The time in which others had the
        processor does not count: on a busy machine a process that is all right has been seen to
        need half a minute for a quarter of a second's work.
        """
        pid = self.process.pid
        late = time.monotonic() + patience - starved(pid)
        while time.monotonic() < late + starved(pid):
            self.listen(_GLANCE)  # a process that is not heard may wait for room in its pipe
            if self.process.poll() is not None or enough in self.told:
                return True
        return False

    def says_where(self) -> None:
        """Pass on what it prints of where it hangs, which may come in pieces."""
        self.process.send_signal(SAY_WHERE)
        late = time.monotonic() + _SPEAKS_WITHIN
        while (left := late - time.monotonic()) > 0.0 and self._readers:
            self.listen(left)

    def kill(self) -> None:
        """Kill it and all that it has started."""
        self.process.send_signal(signal.SIGKILL)  # a copy that has just begun leads no group yet
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(_KILLED_AFTER)

    def __del__(self) -> None:
        """Close the pipes."""
        for pipe in self._pipes:
            os.close(pipe)


class _Lines:
    """A pipe that is read line by line."""

    def __init__(self, take: Callable[[str], None]) -> None:
        self._take, self._unread = take, b""

    def read(self, pipe: int) -> bool:
        """Take what there is; False at the end."""
        data = os.read(pipe, 65536)
        *lines, self._unread = (self._unread + data).split(b"\n")
        if not data and self._unread:
            lines.append(self._unread)
        for line in lines:
            self._take(line.decode(errors="replace"))
        return bool(data)


def begin(parent: int, pipe: int, module: str, *arguments: str) -> int:
    """Run the `main` of a module as the child of a process, and return its exit code.

    The kernel sends SIGTERM when that parent ends, however that happens. The pipe is the file
    descriptor through which it is told (see `telling`).
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it ended before the kernel knew
        os._exit(1)
    tell_through(pipe)
    faulthandler.register(SAY_WHERE)
    end_at_once()
    gc.disable()  # collections that walk through imported objects again and again took 60 ms
    sys.argv[:] = [module, *arguments]
    try:
        code: int = import_module(module).main()
    except Exception as error:
        tell_broken(f"{type(error).__name__}: {error}")
        raise
    return code


def starved(pid: int) -> float:
    """How long [s] a process has waited for the processor so far; 0 if the system does not tell."""
    try:
        _, waiting, _ = Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii").split()
    except (OSError, ValueError):
        return 0.0
    return float(waiting) * 1e-9


def give_way() -> None:
    """Let no thread of this process interrupt another of its session, because nobody waits for it.

    The process gets its share of the processor all the same, in longer slices.
    """
    if hasattr(os, "SCHED_BATCH"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def come_last() -> None:
    """Let this process have the processor after others: they wait for it if it falls behind.

    A process that wants a whole core leaves it a quarter. Linux shares the processor among sessions
    first (sched(7), autogroup), so that a process with a session of its own, as ours have, comes
    after others only if its session does.
    """
    for thread in Path("/proc/self/task").glob("*"):
        with contextlib.suppress(OSError):  # it has ended
            number = int(thread.name)
            began = os.getpriority(os.PRIO_PROCESS, number)  # the user's own: nice ppc_attitude run
            os.setpriority(os.PRIO_PROCESS, number, began + _LAST)
    with contextlib.suppress(OSError):  # a kernel without autogroup shares among processes alone
        if os.getsid(0) == os.getpid():
            Path("/proc/self/autogroup").write_text(str(_LAST), encoding="ascii")


def handle_ending(handler: Handler) -> dict[int, Any]:
    """Set the handler of requests to end this process; return the former handler of each."""
    return {number: signal.signal(number, handler) for number in ENDING}


def take_signals() -> None:
    """Let the signals in that have waited since this process was started."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)


def end_at_once() -> None:
    """Let a request to end simply end this process: it has not begun anything.

    Python would raise KeyboardInterrupt amidst an import, and a start can take long.
    """
    handle_ending(lambda number, frame: os._exit(0))
    take_signals()
