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

"""A recorder in a process of its own, for tests that kill it or fill its disk.

Usage: bag_child.py endless|idle|full BAG STORAGE. Every report is a line on standard output.
"""

import math
import resource
import signal
import sys
import time
from pathlib import Path

from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.writer import BagWriter, offered_qos
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.topics import STANDARD, Topic
from ppc_attitude.science.component import QUATERNION

STEP_NS = 10_000_000
REPORT_EVERY = 50
PERIOD = 1e-3  # [s]
IDLE_STEPS = 7
TOPICS = STANDARD  # no more: what tells the topics of a run takes a second to import
DISK_BYTES = 1_200_000


def values(step: int, topic: Topic) -> tuple[float, ...]:
    """What the recorder writes at a step."""
    if topic.form == QUATERNION:
        return 0.0, 0.0, math.sin(step), math.cos(step)
    return tuple(step + 0.25 * axis for axis in range(topic.width))


def record(writer: BagWriter, step: int, codecs: list[Codec]) -> None:
    for codec in codecs:
        data = codec.encode(step * STEP_NS, values(step, codec.topic))
        writer.write(f"/{codec.topic.name}", time.monotonic_ns(), data)


def main(mode: str, bag: Path, storage: str) -> None:
    if mode == "full":
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (DISK_BYTES, DISK_BYTES))
    codecs = [Codec(topic) for topic in TOPICS]
    writer = BagWriter(bag, storage=storage)
    writer.set_custom_data("ppc_attitude.controller", "child")
    for codec in codecs:
        writer.add_topic(f"/{codec.topic.name}", codec.topic.msgtype, [offered_qos()])
    step = 0
    try:
        while mode != "idle" or step < IDLE_STEPS:
            record(writer, step, codecs)
            step += 1
            if mode == "endless":
                time.sleep(PERIOD)  # the rate of a fast run
            if step % REPORT_EVERY == 0:
                print(step, time.monotonic_ns(), flush=True)
    except BagError as error:
        print("refused:", error, flush=True)
        try:
            writer.close()
        except BagError as error:
            print("close:", error, flush=True)
        return
    print("idle", flush=True)
    signal.pause()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), sys.argv[3])
