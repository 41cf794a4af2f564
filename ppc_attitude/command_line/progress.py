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

"""The progress bar of the commands that take long."""

import os
import sys
from typing import Any

from tqdm import tqdm

_SELDOM = 10.0  # [s] between two lines of a file or pipe, in which a line cannot be drawn over


def progress_bar(**options: Any) -> "tqdm[Any]":
    """Return a bar on stderr, with the options of tqdm; `TQDM_MININTERVAL` says how often it moves.

    It has no thread of its own, because a process with threads cannot be copied.
    """
    tqdm.monitor_interval = 0
    if not (sys.stderr.isatty() or "TQDM_MININTERVAL" in os.environ):
        options["mininterval"] = _SELDOM
    return tqdm(file=sys.stderr, miniters=0, **options)
