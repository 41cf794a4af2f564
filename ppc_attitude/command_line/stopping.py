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

"""Being asked to end: granted at once while nothing has begun, afterwards in good order."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TypeVar

from ppc_attitude.processes.child import handle_ending
from ppc_attitude.processes.exits import BROKEN

_Done = TypeVar("_Done")


def say_interrupted() -> None:
    """Print that the command was interrupted, past the streams of Python, which may be in use."""
    with suppress(OSError):
        os.write(2, b"interrupted\n")


def _end_at_once(number: int, frame: FrameType | None) -> None:
    # Imports and compilers do not bear an exception everywhere: end without one.
    say_interrupted()
    os._exit(BROKEN)


def end_at_once() -> None:
    """Let a request to end simply end this process: nothing has begun yet."""
    handle_ending(_end_at_once)


asked: list[int] = []
"""Signals by which this process was asked to end after it had begun.

A list, because one request may interrupt the handler of another: a lock would wait for ever.
"""


def _interrupt(number: int, frame: FrameType | None) -> None:
    asked.append(number)
    sys.unraisablehook = lambda _: None  # a compiler's callback would lose and print the exception
    raise KeyboardInterrupt


def interrupt() -> None:
    """Let a request to end raise KeyboardInterrupt, if it was to end this process at once."""
    if signal.getsignal(signal.SIGINT) is _end_at_once:
        handle_ending(_interrupt)


def stoppable(work: Callable[[], _Done]) -> _Done:
    """Do some work in a thread of its own, so that this one can be asked to end meanwhile.

    A compiled loop comes back to Python, which hears of such a request, only when it is over; with
    a step of somebody else's that may be never.
    """
    done: Future[_Done] = Future()

    def run() -> None:
        try:
            done.set_result(work())
        except BaseException as error:
            done.set_exception(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join()  # a process with threads cannot be copied
    return done.result()


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """Event that a request to end sets, so that a second Ctrl-C cannot break the orderly stop."""
    stop = threading.Event()

    def handle(number: int, frame: FrameType | None) -> None:
        asked.append(number)
        stop.set()

    previous = handle_ending(handle)
    try:
        yield stop
    finally:
        for number, before in previous.items():
            signal.signal(number, before)
