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
from statistics import median
from typing import IO, Any

from ppc_attitude.command_line.stack import private_environment

_DURATION = "1"  # [s] simulated
_BAR = b"simulated:"  # drawn when the nodes are started, and again at the first step


def first_step_s(cache: str, folder: str) -> float:
    """Wall time [s] from the start of a `run` to its first step of simulated time.

    Raises
    ------
    RuntimeError
        The run broke.
    """
    command = [sys.executable, "-m", "ppc_attitude.command_line.main", "run"]
    command += ["--duration", _DURATION, "--bag", f"{folder}/bag_{time.monotonic_ns()}"]
    environment = {**private_environment(), "NUMBA_CACHE_DIR": cache, "TQDM_MININTERVAL": "0.1"}
    begin = time.perf_counter()
    process = subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, bufsize=0
    )
    assert process.stderr is not None
    first_step, said = _second_bar(process.stderr)
    said += process.stderr.read() or b""
    # The verdict of so short a run is no matter; that it ran is.
    if process.wait() not in (0, 1) or first_step is None:
        raise RuntimeError(said.decode(errors="replace"))
    return first_step - begin


def _second_bar(stream: IO[bytes]) -> tuple[float | None, bytes]:
    """When the bar moved first, if it did, and what was read until then."""
    said = b""
    while said.count(_BAR) < 2:
        part = stream.read(4096)
        if not part:
            return None, said
        said += part
    return time.perf_counter(), said


def measure(quick: bool) -> dict[str, Any]:
    """Measure ``start_up``; when quick only with the kernels that this installation has cached."""
    with tempfile.TemporaryDirectory(prefix="ppc_attitude_bench_") as folder:
        if quick:
            cache = os.environ.get("NUMBA_CACHE_DIR", "")
            return {"first_run_s": None, "second_run_s": first_step_s(cache, folder)}
        cache = f"{folder}/kernels"
        return {
            "first_run_s": first_step_s(cache, folder),
            "second_run_s": median(first_step_s(cache, folder) for _ in range(3)),
        }
