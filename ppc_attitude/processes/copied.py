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

"""A copy of this process that becomes another one, with all that is imported and compiled here.

To import Numba and to load the kernels takes a node a second; a copy of a process that has done so
needs none of it. Only a process with a single thread can be copied: what another thread holds, such
as a lock, would be held for ever. Each copy imports `rclpy` itself, whose tracing starts threads.
"""

import ctypes
import gc
import math
import os
import sys
import time
import traceback
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn, TextIO

_PR_SET_NAME = 15  # linux/prctl.h
_COMMAND_LINE = slice(48 - 3, 50 - 3)  # fields 48 and 49 of proc_pid_stat(5): where it is
_GLANCE = 0.01  # [s] between two looks at a process whose end is waited for


class Copy:
    """A copy of this process, seen by it as by `subprocess.Popen`.

    Up to its end it does what is given (see `become`).

    Attributes
    ----------
    pid : int
        Its process id; it leads a session of its own.
    returncode : int or None
        Exit code once `poll` has found its end: minus the signal's number if one killed it.
    """

    def __init__(self, live: Callable[[], NoReturn]) -> None:
        self.returncode: Any = None
        self.pid = os.fork()
        if self.pid == 0:
            live()

    def poll(self) -> Any:
        """Return the exit code; None while it runs, or while another thread looks."""
        if self.returncode is None:
            # The system tells the end once: a second thread that asks finds no such process.
            with suppress(ChildProcessError):
                ended, status = os.waitpid(self.pid, os.WNOHANG)
                if ended:
                    self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def wait(self, timeout: float = math.inf) -> Any:
        """Wait for its end, at most some time [s]; return as `poll`."""
        late = time.monotonic() + timeout
        while self.poll() is None and time.monotonic() < late:
            time.sleep(_GLANCE)
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)


def can_copy() -> bool:
    """True if this process can be copied: it has a single thread, on a system that tells."""
    try:
        return len(list(Path("/proc/self/task").iterdir())) == 1
    except OSError:
        return False


def become(
    begin: Callable[[], int],
    name: str,
    errors: int,
    kept: Collection[int],
    environment: Mapping[str, str],
) -> NoReturn:
    """Become another process, in the copy; nothing of the copied process runs on.

    Parameters
    ----------
    begin : callable
        What it does; returns its exit code, and leaves by no exception.
    name : str
        The name under which it is listed.
    errors : int
        Which of our file descriptors is its standard error; it prints to ours, its input is empty.
    kept : collection of int
        Which others it keeps.
    environment : mapping of str to str
        Its environment.
    """
    code = 1
    try:
        gc.freeze()  # no inherited object is finalised here: a file would close its reused number
        os.setsid()
        theirs = [os.open(os.devnull, os.O_RDONLY), os.dup(2), os.dup(errors)]
        for number, stream in enumerate(theirs):
            os.dup2(stream, number)
        sys.stdout, sys.stderr = map(_printing_to, (1, 2))
        for number in {int(file.name) for file in Path("/proc/self/fd").iterdir()} - {0, 1, 2}:
            if number not in kept:
                with suppress(OSError):  # that of the list itself is closed
                    os.close(number)
        os.environ.clear()
        os.environ.update(environment)
        _rename(name)
        code = begin()
        sys.stdout.flush()
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def _printing_to(number: int) -> TextIO:
    return open(number, "w", buffering=1, errors="backslashreplace", closefd=False)


def _rename(name: str) -> None:
    """Show a name in lists of processes, cut to the length of the copied process's command line."""
    library = ctypes.CDLL(None)
    library.prctl(_PR_SET_NAME, name.rpartition(".")[2].encode())
    fields = Path("/proc/self/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    start, end = (int(field) for field in fields[_COMMAND_LINE])
    line = f"{sys.executable}\0-m\0{name}".encode()[: end - start - 1]
    ctypes.memmove(start, line.ljust(end - start, b"\0"), end - start)
