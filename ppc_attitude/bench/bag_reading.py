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

import tempfile
import time
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from ppc_attitude.bags.reader import read_run
from ppc_attitude.bags.writer import write_run
from ppc_attitude.bench.pairs import alternating
from ppc_attitude.contract.topics import BY_NAME
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import scenario


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


def measure(quick: bool) -> dict[str, Any]:
    """Measure ``bag_reading``: a one-hour 100 Hz bag (a minute of it when quick)."""
    duration, pairs = (60.0, 1) if quick else (3600.0, 1)
    with tempfile.TemporaryDirectory(prefix="ppc_attitude_bench_") as folder:
        bag = Path(folder) / "bag"
        write_run(simulate(scenario({}), duration), bag)
        ours, rosbags = alternating(
            pairs, lambda: ours_messages_per_s(bag), lambda: rosbags_messages_per_s(bag)
        )
    return {
        "messages_per_s": ours,
        "rosbags_messages_per_s": rosbags,
        "ratio": ours / rosbags,
    }
