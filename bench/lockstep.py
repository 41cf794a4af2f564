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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from operator import truediv
from pathlib import Path
from statistics import median
from typing import Any

from bench import ROOT, SENSORS
from ppc_attitude.command_line.stack import Stack, private_environment
from ppc_attitude.contract.declared import BY_COLUMN, nodes_of
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE,
    CLOCK_TOPIC,
    DISTURBANCE,
    PLANT,
    RECORDER,
    REFERENCE_ACCELERATION,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    TORQUE_COMMAND,
    Topic,
)
from ppc_attitude.science.controllers import ppc
from ppc_attitude.science.parameter import NodeParameters
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.scenario import load

_SETTLED = 0.25  # fraction of a run that is not timed: discovery, caches, clocks of the cores
_PATIENCE = 60.0  # [s]
_PEER = (sys.executable, "-m", "bench.bare_peer")


def stack_steps_per_s(
    duration: float,
    values: NodeParameters | None = None,
    recorder: bool = True,
    domain: int = 0,
    files: Sequence[Path] = (),
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
    files : sequence of Path
        ROS parameter files of the case.

    Returns
    -------
    dict
        ``steps_per_s``; ``cpu_us_per_step``: CPU time of each process for one step; ``memory_mb``
        of each at the end; ``bag_bytes_per_step``.
    """
    with tempfile.TemporaryDirectory(prefix="ppc_attitude_bench_") as folder:
        run = load(files, values).with_values(PLANT, duration=duration, lockstep=True)
        if recorder:
            run = run.awaiting_recorder().with_values(RECORDER, bag=f"{folder}/bag")
        warm_up(run)
        times: list[tuple[float, float]] = []
        used: list[dict[str, float]] = []
        memory: dict[str, float] = {}
        settled = _SETTLED * duration

        def on_time(simulated: float) -> None:
            if simulated >= settled:
                times.append((time.perf_counter(), simulated))
                used.append({name: cpu_seconds(pid) for name, pid in stack.pids().items()})
                memory.update({name: megabytes(pid) for name, pid in stack.pids().items()})

        environment = private_environment()
        if domain:
            environment["ROS_DOMAIN_ID"] = str(domain)
        nodes = [name for name in nodes_of(run.parameters) if recorder or name != RECORDER]
        stack = Stack(run, on_time, nodes, environment)
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
def peers(roles: list[list[str]]) -> Iterator[Mapping[str, str]]:
    """Keep processes of the bare step running; gives their environment."""
    with tempfile.TemporaryDirectory(prefix="ppc_attitude_bench_") as folder:
        environment = {**private_environment(), "ROS_LOG_DIR": folder}
        processes = [subprocess.Popen([*_PEER, *role], env=environment, cwd=ROOT) for role in roles]
        try:
            yield environment
        finally:
            for process in processes:
                process.terminate()
            for process in processes:
                process.wait()


@dataclass(frozen=True)
class Exchange:
    """Which messages go around in a step: what the plant sends, and who answers what with what."""

    states: tuple[Topic, ...]
    answers: tuple[Topic, ...]  # the plant steps when it has these
    peers: tuple[tuple[tuple[Topic, ...], tuple[Topic, ...]], ...]  # inputs, outputs of each

    def topics(self) -> tuple[Topic, ...]:
        """Everything that is sent: what the recorder takes."""
        return self.states + tuple(topic for _, outputs in self.peers for topic in outputs)


# The yardstick: three peers that answer the plant, with the minimum messages of a step.
MINIMUM = Exchange(
    (ATTITUDE,),
    (REFERENCE_ATTITUDE, TORQUE_COMMAND, DISTURBANCE),
    tuple(((ATTITUDE,), (topic,)) for topic in (REFERENCE_ATTITUDE, TORQUE_COMMAND, DISTURBANCE)),
)
_REFERENCE = (REFERENCE_ATTITUDE, REFERENCE_RATE, REFERENCE_ACCELERATION)
# All messages of our step, by the ways they go and in their order: what transport alone costs us.
ALL = Exchange(
    (APPLIED_TORQUE, CLOCK_TOPIC, ANGULAR_VELOCITY, ATTITUDE),
    (TORQUE_COMMAND, DISTURBANCE),
    (
        ((ATTITUDE,), _REFERENCE),
        (
            (ATTITUDE, ANGULAR_VELOCITY, *_REFERENCE),
            tuple(BY_COLUMN[column.name] for column in ppc.COMPONENT.outputs),
        ),
        ((ATTITUDE,), (DISTURBANCE,)),
    ),
)


def bare_steps_per_s(seconds: float, exchange: Exchange = MINIMUM) -> float:
    """Pass messages around for `seconds` of wall time, with a recorder and with no work."""
    roles = [["answer", _names(inputs), _names(outputs)] for inputs, outputs in exchange.peers]
    roles.append(["listen", _names(exchange.topics())])
    plant = ["plant", str(seconds), _names(exchange.answers), _names(exchange.states)]
    with peers(roles) as environment:
        output = subprocess.run(
            [*_PEER, *plant],
            env=environment,
            cwd=ROOT,
            check=True,
            capture_output=True,
            timeout=_PATIENCE,
        )
    return float(output.stdout)


def _names(topics: Iterable[Topic]) -> str:
    return ",".join(topic.name for topic in topics)


def measure(quick: bool) -> dict[str, Any]:
    """Measure ``lockstep``: ours, also with sensors, the bare step and all messages, in turn."""
    duration, seconds, rounds = (20.0, 1.0, 1) if quick else (60.0, 4.0, 9)
    runs, sensing = [], []
    bare, messages = [], []
    for _ in range(rounds):
        runs.append(stack_steps_per_s(duration))
        sensing.append(stack_steps_per_s(duration, files=[SENSORS]))
        bare.append(bare_steps_per_s(seconds))
        messages.append(bare_steps_per_s(seconds, ALL))
    steps = [run["steps_per_s"] for run in runs]
    return {
        "steps_per_s": median(steps),
        "bare_steps_per_s": median(bare),
        "ratio": median(map(truediv, steps, bare)),
        "messages_steps_per_s": median(messages),
        "messages_ratio": median(map(truediv, steps, messages)),
        "cpu_us_per_step": runs[-1]["cpu_us_per_step"],
        "sensors": {
            "steps_per_s": median(run["steps_per_s"] for run in sensing),
            "cpu_us_per_step": sensing[-1]["cpu_us_per_step"],
        },
    }
