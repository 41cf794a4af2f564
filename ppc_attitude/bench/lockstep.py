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

"""Steps a second of the five nodes in lock-step, beside processes that only pass messages on."""

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ppc_attitude.bench.bare_peer import ANSWERS
from ppc_attitude.bench.pairs import alternating
from ppc_attitude.command_line.parameter_file import parameter_file
from ppc_attitude.command_line.stack import Stack, private_environment
from ppc_attitude.contract.topics import ATTITUDE, NODES, PLANT, RECORDER
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.scenario import Overrides, scenario

_SETTLED = 0.25  # fraction of a run that is not timed: discovery, caches, clocks of the cores
_PATIENCE = 60.0  # [s]


def stack_steps_per_s(
    duration: float, values: Overrides | None = None, recorder: bool = True, domain: int = 0
) -> dict[str, Any]:
    """Run all nodes with their telemetry for `duration` simulated seconds in lock-step.

    Parameters
    ----------
    duration : float
        Length of the run [s].
    values : mapping, optional
        Parameters by node that differ from the defaults.
    recorder : bool
        Whether the recorder runs as well.
    domain : int
        ROS domain; 0 for a random one.

    Returns
    -------
    dict
        ``steps_per_s``; ``cpu_us_per_step``: CPU time of each process for one step; ``memory_mb``
        of each at the end; ``bag_bytes_per_step``.
    """
    with tempfile.TemporaryDirectory(prefix="ppc_attitude_bench_") as folder:
        run = scenario(values or {}).with_values(PLANT, duration=duration, lockstep=True)
        run = run.awaiting_recorder().with_values(RECORDER, bag=f"{folder}/bag")
        warm_up(run)
        path = Path(folder) / "run.yaml"
        path.write_text(parameter_file(run), encoding="utf-8")
        common = ["--ros-args", "--params-file", str(path)]
        arguments = {name: [*common] for name in NODES if recorder or name != RECORDER}
        arguments[PLANT] = ["--progress", *common]
        times: list[tuple[float, float]] = []
        used: list[dict[str, float]] = []
        memory: dict[str, float] = {}
        settled = _SETTLED * duration

        def on_time(simulated: float) -> None:
            if simulated >= settled:
                times.append((time.perf_counter(), simulated))
                used.append({name: cpu_seconds(pid) for name, pid in stack.pids().items()})
                memory.update({name: megabytes(pid) for name, pid in stack.pids().items()})

        environment = {**private_environment(), "ROS_LOG_DIR": folder}
        if domain:
            environment["ROS_DOMAIN_ID"] = str(domain)
        stack = Stack(arguments, environment, on_time)
        try:
            stack.start()
            stack.wait(threading.Event())
            stack.stop()
        finally:
            stack.kill()
        rate = run.number(PLANT, "rate")
        recorded = sum(file.stat().st_size for file in Path(folder).glob("bag/*"))
    steps = (times[-1][1] - times[0][1]) * rate
    return {
        "steps_per_s": steps / (times[-1][0] - times[0][0]),
        "cpu_us_per_step": {
            name: 1e6 * (used[-1][name] - used[0][name]) / steps for name in used[0]
        },
        "memory_mb": memory,
        "bag_bytes_per_step": recorded / (duration * rate),
    }


def cpu_seconds(pid: int) -> float:
    """CPU time of a process until now [s]."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return float("nan")
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def megabytes(pid: int) -> float:
    """Memory that a process holds now and shares with no file, such as a library [MB]."""
    try:
        resident, shared = map(int, Path(f"/proc/{pid}/statm").read_text().split()[1:3])
    except OSError:
        return float("nan")
    return (resident - shared) * os.sysconf("SC_PAGE_SIZE") / 1e6


@contextmanager
def peers(roles: list[list[str]], environment: Mapping[str, str]) -> Iterator[None]:
    """Keep processes of the bare step running."""
    command = [sys.executable, "-m", "ppc_attitude.bench.bare_peer"]
    processes = [subprocess.Popen([*command, *role], env=environment) for role in roles]
    try:
        yield
    finally:
        for process in processes:
            process.terminate()
        for process in processes:
            process.wait()


def bare_steps_per_s(seconds: float, recorder: bool = True) -> float:
    """Pass the minimum messages of a step around for `seconds` of wall time, with no work."""
    roles = [["answer", topic.name] for topic in ANSWERS]
    if recorder:
        roles.append(["listen", ATTITUDE.name, *(topic.name for topic in ANSWERS)])
    with tempfile.TemporaryDirectory(prefix="ppc_attitude_bench_") as folder:
        environment = {**private_environment(), "ROS_LOG_DIR": folder}
        with peers(roles, environment):
            plant = [sys.executable, "-m", "ppc_attitude.bench.bare_peer", "plant", str(seconds)]
            output = subprocess.run(
                plant, env=environment, check=True, capture_output=True, timeout=_PATIENCE
            )
    return float(output.stdout)


def measure(quick: bool) -> dict[str, Any]:
    """Measure ``lockstep``: ours and the bare step in alternating pairs."""
    duration, seconds, pairs = (20.0, 1.0, 1) if quick else (120.0, 6.0, 3)
    runs: list[dict[str, Any]] = []

    def ours() -> float:
        runs.append(stack_steps_per_s(duration))
        return float(runs[-1]["steps_per_s"])

    steps, bare = alternating(pairs, ours, lambda: bare_steps_per_s(seconds))
    return {
        "steps_per_s": steps,
        "bare_steps_per_s": bare,
        "ratio": steps / bare,
        "cpu_us_per_step": runs[-1]["cpu_us_per_step"],
    }
