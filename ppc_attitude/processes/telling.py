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

"""Messages of a process to its starter: JSON objects, a line each, through a pipe of their own."""

import contextlib
import json
import os
import time
from typing import Any

TIME = "time"
"""Simulated time that has been reached [s]."""
WAITING = "waiting"
"""The inputs that are waited for, in words."""
FINISHED = "finished"
"""True once it has done what it was to do; a process without it was asked to end, or broke."""
LINGERS = "lingers"
"""True once it stays only for readers that do not take its messages, and may be strangers."""
BAG = "bag"
"""Folder of the bag that has been begun."""
BROKEN = "broken"
"""Why the process breaks off, in words."""
AT = "at"
"""When it knew that, by the monotonic clock, which all processes share [s]."""

_pipe: int | None = None
_has_broken = False


def tell_through(pipe: int) -> None:
    """Let this process tell its starter through a file descriptor."""
    global _pipe
    _pipe = pipe


def tell(fact: str, value: Any) -> None:
    """Tell the starter of this process a fact, if it has one that listens."""
    _send({fact: value})


def tell_broken(reason: str) -> None:
    """Tell why this process breaks off: the first reason, for what follows are its consequences."""
    global _has_broken
    if not _has_broken:
        _has_broken = True
        _send({BROKEN: reason, AT: time.monotonic()})


def _send(facts: dict[str, Any]) -> None:
    if _pipe is not None:
        with contextlib.suppress(OSError):  # the starter has ended
            os.write(_pipe, (json.dumps(facts) + "\n").encode())
