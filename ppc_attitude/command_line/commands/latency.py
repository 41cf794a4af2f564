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

"""`ppc_attitude latency`: from a state to the torque that answers it, in real time."""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from ppc_attitude.command_line.errors import BROKEN, DONE, RunError
from ppc_attitude.command_line.options import PAPER_DURATION, positive
from ppc_attitude.command_line.paths import new_folder
from ppc_attitude.command_line.stack import private_environment
from ppc_attitude.contract.topics import ATTITUDE, PLANT

_FIRST_STATE = 15.0  # [s] how long a live graph may take to show a state


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "latency",
        help="deadline misses and state-to-torque latency in real time",
        description=(
            "Runs the stack in real time as `run --realtime` does, or listens to one that runs "
            "already, and prints deadline misses and percentiles of the latency."
        ),
    )
    parser.add_argument(
        "--config", metavar="FILE", type=Path, action="append", default=[], help="as for `run`"
    )
    parser.add_argument("--rate", metavar="HZ", type=positive, help="the plant's `rate`")
    parser.add_argument(
        "--duration", metavar="S", type=positive, default=PAPER_DURATION, help="[s]; default 120"
    )
    parser.add_argument(
        "--bag", metavar="DIR", type=new_folder, help="as for `run`; default: none kept"
    )
    parser.add_argument(
        "--live", action="store_true", help="listen to the running graph instead of starting one"
    )
    parser.add_argument("--namespace", metavar="NS", default="", help="with --live: its namespace")
    parser.set_defaults(execute=execute)


def execute(arguments: argparse.Namespace) -> int:
    """Measure and print."""
    return _live(arguments) if arguments.live else _started(arguments)


def _live(arguments: argparse.Namespace) -> int:
    begin = time.monotonic()
    first = [0.0]

    def goes_on(states: int) -> bool:
        now = time.monotonic()
        if not states:
            if now - begin > _FIRST_STATE:
                raise RunError(f"no message on {ATTITUDE.name} within {_FIRST_STATE:g} s")
            return True
        first[0] = first[0] or now
        return bool(now - first[0] < arguments.duration)

    _measure_and_print(goes_on, arguments.namespace)
    return DONE


def _started(arguments: argparse.Namespace) -> int:
    os.environ.update(private_environment())
    with tempfile.TemporaryDirectory(prefix="ppc_attitude_latency_") as folder:
        command = [sys.executable, "-m", "ppc_attitude.command_line.main", "run", "--realtime"]
        for path in arguments.config:
            command += ["--config", str(path)]
        if arguments.rate:
            overlay = Path(folder) / "rate.yaml"
            values = {f"/**/{PLANT}": {"ros__parameters": {"rate": arguments.rate}}}
            overlay.write_text(yaml.safe_dump(values), encoding="utf-8")
            command += ["--config", str(overlay)]
        bag = arguments.bag or Path(folder) / "bag"
        command += ["--duration", str(arguments.duration), "--bag", str(bag)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        try:
            _measure_and_print(lambda states: process.poll() is None, "")
            said, _ = process.communicate()
            print(said if arguments.bag else said.replace(str(bag), "not kept"), end="")
            if process.returncode == BROKEN and not arguments.bag:
                print("bag: not kept", file=sys.stderr)  # what broke has named the temporary one
            return process.returncode
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()


def _measure_and_print(goes_on: Callable[[int], bool], namespace: str) -> None:
    from ppc_attitude.nodes.latency_probe import measure

    result = measure(goes_on, namespace)
    if not result.answered.size:
        print(f"states {result.states}, none answered")
        return
    p50, p99, p999 = (1e3 * np.percentile(result.answered, (50.0, 99.0, 99.9))).tolist()
    print(
        f"states {result.states}, deadline {1e3 * result.period:g} ms, missed {result.missed}; "
        f"state to torque: p50 {p50:.3f} ms, p99 {p99:.3f} ms, p99.9 {p999:.3f} ms"
    )
