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

"""The end of a process whose middleware may not let it go.

Fast DDS 2.14 can wait for ever while a node is destroyed if its peers are destroyed at the same
time: `DomainParticipant::set_listener` spins, and a thread that tells of a reader that has gone
waits for its lock. Where four nodes end at one instant again and again, one of them hangs about
once in 250 times. All that was sent has arrived by then. rclpy holds Python's lock meanwhile, so no
thread of Python can end the wait, and no handler of a signal runs; a timer of the C library can.
"""

import ctypes
import faulthandler
import struct
from collections.abc import Iterator
from contextlib import contextmanager

_MONOTONIC = 1  # CLOCK_MONOTONIC
_THREAD = 2  # SIGEV_THREAD: at its time the timer calls a function in a thread of its own
_NOTICE = struct.Struct("@PiiP40x")  # struct sigevent of Linux: value, signal, what, function
_TIMES = struct.Struct("@4l")  # struct itimerspec: a period, and the time until then [s, ns]
_PATIENCE = 10  # [s] for the middleware to let a process go that has nothing left to do
_SAYS_BEFORE = 0.5  # [s] before its end the process prints where it hangs


@contextmanager
def leaving(code: int) -> Iterator[None]:
    """End this process with an exit code if to leave the middleware takes too long.

    If the C library has no such timer, as outside Linux, there is no limit.
    """
    library, timer = ctypes.CDLL(None), ctypes.c_void_p()
    leave = ctypes.cast(library._exit, ctypes.c_void_p).value
    notice = _NOTICE.pack(code, 0, _THREAD, leave)
    create = getattr(library, "timer_create", lambda *_: -1)
    if create(_MONOTONIC, notice, ctypes.byref(timer)) != 0:
        yield
        return
    library.timer_settime(timer, 0, _TIMES.pack(0, 0, _PATIENCE, 0), None)
    faulthandler.dump_traceback_later(_PATIENCE - _SAYS_BEFORE)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        library.timer_delete(timer)
