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

"""`python -m bench.soak`: the five nodes in lock-step for long; what grows or is lost.

Every few seconds it notes the steps, the memory of each process and how far |q| is from one. The
recorder itself compares the stamps of all topics, so a lost message ends the soak with exit code 3.
"""

import argparse
import json
import math
import os
import shutil
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from ppc_attitude.command_line.stack import Stack, StackError
from ppc_attitude.command_line.stopping import stop_on_signals
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.topics import ATTITUDE, NODES, PLANT, RECORDER
from ppc_attitude.nodes.messages import ONLOOKER, subscribe
from ppc_attitude.nodes.visiting import listening, visiting
from ppc_attitude.processes.exits import BROKEN, DONE
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.scenario import scenario

OUTPUT = Path("build/soak.json")
_PERIOD = 5.0  # [s] between two looks
_LOOK = 1e-3  # [s] for the latest state; in between none is taken, so that looking costs nothing
_SETTLED = 0.5  # fraction of the soak after which memory is expected not to grow


def memory(pid: int) -> float:
    """Resident memory of a process [MiB]; NaN once it has ended."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except OSError:
        return math.nan
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def summary(looks: list[dict[str, float]], rate: float) -> dict[str, Any]:
    """Steps, pace and, for each process, memory [MiB] and its growth per million steps.

    Parameters
    ----------
    looks : list of dict
        At each look: wall time ``s``, simulated time ``t`` [s], memory [MiB] by process.
    rate : float
        Steps per simulated second [Hz].
    """
    steps = np.array([look["t"] * rate for look in looks])
    seconds = np.array([look["s"] for look in looks])
    later = steps >= _SETTLED * steps[-1]
    processes = {}
    for name in NODES:
        used = np.array([look[name] for look in looks])
        slope = np.polyfit(steps[later] * 1e-6, used[later], 1)[0] if later.sum() > 1 else math.nan
        processes[name] = {
            "first_mib": float(used[0]),
            "last_mib": float(used[-1]),
            "growth_mib_per_million_steps": float(slope),
        }
    return {
        "steps": round(steps[-1]),
        "wall_s": float(seconds[-1]),
        "steps_per_s": float((steps[-1] - steps[0]) / max(seconds[-1] - seconds[0], 1e-9)),
        "memory": processes,
    }


def soak(minutes: float, folder: Path, storage: str) -> dict[str, Any]:
    """Run all nodes in lock-step, as fast as they go, and look at them.

    Raises
    ------
    StackError
        A node broke, or a message was lost.
    """
    bag = folder / "bag"
    values: dict[str, dict[str, Any]] = {
        PLANT: {"lockstep": True},
        RECORDER: {"bag": str(bag), "storage": storage},
    }
    run = scenario(values).awaiting_recorder()
    warm_up(run)
    now = largest = 0.0
    looks: list[dict[str, float]] = []
    decode = Codec(ATTITUDE).decode

    def on_time(simulated: float) -> None:
        nonlocal now
        now = simulated

    def on_attitude(data: bytes) -> None:
        nonlocal largest
        largest = max(largest, abs(math.hypot(*decode(data).values) - 1.0))

    stack = Stack(run, on_time)
    os.environ.update(stack.environment)  # for the node that looks at the attitude
    with stop_on_signals() as stop, visiting("soak", "") as node, listening(node) as listen:
        subscribe(node, ATTITUDE, on_attitude, ONLOOKER, raw=True)

        def watch() -> None:
            begin = time.monotonic()
            while not stop.wait(_PERIOD):
                listen(_LOOK)
                passed = time.monotonic() - begin
                if stack.has_begun:
                    used = {name: memory(pid) for name, pid in stack.pids().items()}
                    looks.append({"s": passed, "t": now, **used})
                    print(f"{passed:7.0f} s  {now:10.1f} s simulated", file=sys.stderr, flush=True)
                if passed >= 60.0 * minutes:
                    stop.set()

        try:
            stack.start()
            watcher = threading.Thread(target=watch)
            watcher.start()
            stack.wait(stop)
            watcher.join()
            stack.stop()
        finally:
            stop.set()
            stack.kill()
    size = sum(file.stat().st_size for file in bag.iterdir())
    result = summary(looks, run.number(PLANT, "rate"))
    return {**result, "largest_norm_error": largest, "bag_bytes": size, "lost_messages": 0}


def table(result: dict[str, Any]) -> str:
    """Lines for people."""
    lines = [
        f"{result['steps']} steps in {result['wall_s']:.0f} s, {result['steps_per_s']:.0f} steps/s",
        f"largest | |q| - 1 |: {result['largest_norm_error']:.2g}",
        f"lost messages: {result['lost_messages']}; bag {result['bag_bytes'] / 2**20:.0f} MiB",
        f"{'process':<22}{'first':>10}{'last':>10}{'growth':>10}  [MiB, MiB, MiB/10⁶ steps]",
    ]
    for name, used in result["memory"].items():
        growth = used["growth_mib_per_million_steps"]
        lines.append(
            f"{name:<22}{used['first_mib']:>10.1f}{used['last_mib']:>10.1f}{growth:>10.2f}"
        )
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Soak, print a table, write the figures."""
    parser = argparse.ArgumentParser(
        prog="python -m bench.soak", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("--minutes", type=float, default=20.0, metavar="M", help="default 20")
    parser.add_argument("--storage", choices=("mcap", "sqlite3"), default="mcap")
    parser.add_argument("--output", type=Path, default=OUTPUT, metavar="FILE")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep the bag there")
    options = parser.parse_args(arguments)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="soak_", dir=options.output.parent) as folder:
        try:
            result = soak(options.minutes, Path(folder), options.storage)
        except StackError as error:
            print(f"error: {error}", file=sys.stderr)
            return BROKEN
        if options.keep:
            shutil.move(Path(folder) / "bag", options.keep)
    print(table(result))
    options.output.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    print(f"written: {options.output}")
    return DONE


if __name__ == "__main__":
    sys.exit(main())
