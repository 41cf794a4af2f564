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

"""Seconds from the command to the first step of simulated time, without and with cached kernels."""

import os
import subprocess
import sys
import tempfile
import time
from typing import Any

from ppc_attitude.command_line.stack import private_environment

_DURATION = "1"  # [s] simulated; the progress of the first step is what counts


def command_seconds(cache: str, folder: str) -> float:
    """Wall time [s] of a whole `run` of one simulated second, verdict included.

    This is an upper bound of the time to the first step.
    """
    command = [sys.executable, "-m", "ppc_attitude.command_line.main", "run"]
    command += ["--duration", _DURATION, "--bag", f"{folder}/bag_{time.monotonic_ns()}"]
    environment = {**os.environ, **private_environment(), "NUMBA_CACHE_DIR": cache}
    begin = time.perf_counter()
    # The verdict of so short a run is no matter; that it ran is.
    done = subprocess.run(command, env=environment, capture_output=True, check=False)
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stderr.decode(errors="replace"))
    return time.perf_counter() - begin


def measure(quick: bool) -> dict[str, Any]:
    """Measure ``start_up``; when quick only with cached kernels of this installation."""
    with tempfile.TemporaryDirectory(prefix="ppc_attitude_bench_") as folder:
        if quick:
            cache = os.environ.get("NUMBA_CACHE_DIR", "")
            return {"first_s": None, "second_s": command_seconds(cache, folder)}
        return {
            "first_s": command_seconds(f"{folder}/kernels", folder),
            "second_s": command_seconds(f"{folder}/kernels", folder),
        }
