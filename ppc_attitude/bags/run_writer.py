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

"""A run that is in memory, written as the recorder would."""

import shutil
from pathlib import Path

import numpy as np

from ppc_attitude.bags.changes import encode_changes
from ppc_attitude.bags.custom_data import encode_custom_data
from ppc_attitude.bags.writer import BagWriter, offered_qos
from ppc_attitude.contract.cdr import Codec, encode_clock
from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import CHANGES_TOPIC, CLOCK_TOPIC


def write_run(record: RunRecord, path: Path | str, *, storage: str = "mcap") -> None:
    """Write a run as the recorder would: every sample a message, received at its stamp.

    A sample of NaN alone stands for a missing message. The folder must not exist yet; it is removed
    again if a request to end comes meanwhile.

    Raises
    ------
    BagError
        The bag cannot be made or written.
    """
    facts = encode_custom_data(record.controller, record.parameters, record.metadata)
    with BagWriter(path, storage=storage, custom_data=facts) as writer:
        try:
            _write(writer, record)
            writer.close()
        except KeyboardInterrupt:  # half of a run that is computed is of no use, and in the way
            shutil.rmtree(path, ignore_errors=True)
            raise


def _write(writer: BagWriter, record: RunRecord) -> None:
    """Write every message of a run, instant by instant."""
    topics = [BY_COLUMN[column] for column in record.columns]
    lanes = [
        (f"/{topic.name}", Codec(topic), samples, np.any(~np.isnan(samples), axis=1).tolist())
        for topic, samples in zip(topics, record.columns.values(), strict=True)
    ]
    writer.add_topic(CLOCK_TOPIC.name, CLOCK_TOPIC.msgtype, [offered_qos()])
    for name, codec, _, _ in lanes:
        writer.add_topic(name, codec.topic.msgtype, [offered_qos()])
    if record.changes:
        writer.add_topic(f"/{CHANGES_TOPIC.name}", CHANGES_TOPIC.msgtype)
    for stamp, data in encode_changes(record.changes):
        writer.write(f"/{CHANGES_TOPIC.name}", stamp, data)
    for step, stamp in enumerate(record.stamps_ns.tolist()):
        writer.write(CLOCK_TOPIC.name, stamp, encode_clock(stamp))
        for name, codec, samples, present in lanes:
            if present[step]:
                writer.write(name, stamp, codec.encode(stamp, tuple(samples[step].tolist())))
