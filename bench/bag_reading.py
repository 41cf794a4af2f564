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

"""Messages a second of our reader, beside rosbags' typed deserialisation of the same topics."""

import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from bench import alternating
from ppc_attitude.bags.reader import read_run
from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.contract.declared import BY_NAME
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import scenario

# What is in memory already after a first, small read is no part of the second: code, caches.
_MEMORY = """
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from ppc_attitude.bags.reader import read_run
from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import scenario

def peak():  # getrusage would tell that of who has started this process, where it is larger
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line for line in lines if line.startswith("VmHWM:")).split()[1])

with TemporaryDirectory() as folder:
    write_run(simulate(scenario({}), 1.0), f"{folder}/bag")
    read_run(f"{folder}/bag")
before = peak()
record = read_run(sys.argv[1])
print(before, peak(), sum(column.nbytes for column in record.columns.values()))
"""


def ours_messages_per_s(bag: Path) -> float:
    """Read every sampled topic into arrays."""
    begin = time.perf_counter()
    record = read_run(bag)
    elapsed = time.perf_counter() - begin
    return len(record.columns) * record.stamps_ns.size / elapsed


def rosbags_messages_per_s(bag: Path) -> float:
    """Deserialise every message of the same topics into rosbags' objects."""
    begin = time.perf_counter()
    count = 0
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        wanted = [c for c in reader.connections if c.topic.strip("/") in BY_NAME]
        for connection, _, data in reader.messages(connections=wanted):
            reader.deserialize(data, connection.msgtype)
            count += 1
    return count / (time.perf_counter() - begin)


def memory(bag: Path) -> dict[str, float]:
    """Largest memory [MB] of a process that reads a bag, and what of it is the result."""
    done = subprocess.run(
        [sys.executable, "-c", _MEMORY, str(bag)], capture_output=True, check=True, text=True
    )
    before, peak, result = (float(number) / 1e6 for number in done.stdout.split())
    return {"peak_mb": peak - before, "result_mb": result}


def of_storage(storage: str, duration: float, pairs: int) -> dict[str, float]:
    """Measure a bag of a run of `duration` [s] at 100 Hz."""
    with tempfile.TemporaryDirectory(prefix="ppc_attitude_bench_") as folder:
        bag = Path(folder) / "bag"
        write_run(simulate(scenario({}), duration), bag, storage=storage)
        ours, rosbags = alternating(
            pairs, lambda: ours_messages_per_s(bag), lambda: rosbags_messages_per_s(bag)
        )
        used = memory(bag)
    return {
        "messages_per_s": ours,
        "rosbags_messages_per_s": rosbags,
        "ratio": ours / rosbags,
        **used,
    }


def measure(quick: bool) -> dict[str, Any]:
    """Measure ``bag_reading``: one-hour 100 Hz bags (a minute of it when quick)."""
    duration, pairs = (60.0, 1) if quick else (3600.0, 2)
    return {
        **of_storage("mcap", duration, pairs),
        "sqlite3": of_storage("sqlite3", duration, pairs),
    }
