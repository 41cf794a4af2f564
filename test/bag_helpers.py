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

"""Bags for the tests: raw messages, comparison of runs, cut copies."""

import shutil
import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from synthetic import SAMPLED

from ppc_attitude.bags.custom_data import encode_custom_data
from ppc_attitude.bags.recover import recover
from ppc_attitude.bags.writer import BagWriter, offered_qos
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import Topic
from ppc_attitude.simulation.replay import replay

Message = tuple[Topic, int, bytes]
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types


def serialised(message: Any, little_endian: bool = True) -> bytes:
    """A message of one of the types, in CDR."""
    return bytes(STORE.serialize_cdr(message, message.__msgtype__, little_endian=little_endian))


def header(stamp: int, frame: str) -> Any:
    """The header of a message, with its stamp [ns]."""
    time = TYPES["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9))
    return TYPES["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def vector(values: Any) -> Any:
    return TYPES["geometry_msgs/msg/Vector3"](*values)


def quaternion(values: Any) -> Any:
    """Four numbers, x y z w, as a message."""
    return TYPES["geometry_msgs/msg/Quaternion"](*values)


def imu(head: Any, orientation: Any, rate: Any, acceleration: Any) -> Any:
    """An Imu of numbers, each with a covariance of nine."""
    (q, q_covariance), (w, w_covariance), (a, a_covariance) = orientation, rate, acceleration
    return TYPES["sensor_msgs/msg/Imu"](
        *(head, quaternion(q), np.array(q_covariance)),
        *(vector(w), np.array(w_covariance)),
        *(vector(a), np.array(a_covariance)),
    )


def messages(run: RunRecord) -> Iterator[Message]:
    """Every sample as (topic, stamp, CDR), instant by instant."""
    topics = [BY_COLUMN[column] for column in run.columns]
    codecs = [Codec(topic) for topic in topics]
    for step, stamp in enumerate(run.stamps_ns.tolist()):
        for topic, codec in zip(topics, codecs, strict=True):
            sample = tuple(run[topic.column][step].tolist())
            yield topic, stamp, codec.encode(stamp, sample)


def write_messages(
    path: Path,
    sequence: list[Message],
    *,
    namespaces: tuple[str, ...] = ("",),
    run: RunRecord | None = None,
) -> Path:
    """Write messages in the order given, in each namespace; the receive time counts them."""
    facts = {} if run is None else encode_custom_data(run.controller, run.parameters, run.metadata)
    with BagWriter(path, custom_data=facts) as writer:
        for topic in dict.fromkeys(topic for topic, _, _ in sequence):
            for namespace in namespaces:
                writer.add_topic(f"{namespace}/{topic.name}", topic.msgtype, [offered_qos()])
        for count, (topic, _, data) in enumerate(sequence):
            for namespace in namespaces:
                writer.write(f"{namespace}/{topic.name}", count, data)
    return path


def written_by_rosbags(
    path: Path, storage: StoragePlugin, mode: CompressionMode, run: RunRecord
) -> Path:
    """Write the messages of a run, compressed or not, as rosbags itself does."""
    writer = Writer(path, version=8, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(f"/{topic.name}", topic.msgtype, typestore=STORE)
            for topic in SAMPLED
        }
        for topic, stamp, data in messages(run):
            writer.write(connections[topic], stamp, data)
    return path


def record_all(writer: BagWriter, sequence: Iterable[Message]) -> None:
    """Announce every sampled topic, and write messages at their stamps."""
    for topic in SAMPLED:
        writer.add_topic(f"/{topic.name}", topic.msgtype)
    for topic, stamp, data in sequence:
        writer.write(f"/{topic.name}", stamp, data)


def unfinished(path: Path, storage: str, run: RunRecord) -> Path:
    """A bag as a killed recorder leaves it: everything flushed, nothing closed."""
    live = path.with_name("live")
    facts = {"ppc_attitude.controller": "ppc"}
    with BagWriter(live, storage=storage, custom_data=facts) as writer:
        record_all(writer, messages(run))
        writer.flush()
        shutil.copytree(live, path)
    return path


def storage_file(path: Path) -> Path:
    (file,) = (file for file in path.iterdir() if file.suffix in (".mcap", ".db3"))
    return file


@contextmanager
def database_of(bag: Path) -> Iterator[sqlite3.Connection]:
    """Open the database of a bag, in which each statement is a transaction."""
    with closing(sqlite3.connect(storage_file(bag), isolation_level=None)) as database:
        yield database


def hot(
    tmp_path: Path, run: RunRecord, finished: bool = False, change: str = ""
) -> tuple[Path, Path]:
    """A SQLite bag in the midst of a transaction that spoils every message, and its journal."""
    bag = unfinished(tmp_path / "bag", "sqlite3", run)
    if finished:
        recover(bag)
    file = storage_file(bag)
    database = sqlite3.connect(file, isolation_level=None)
    database.execute("PRAGMA cache_size=1")  # write pages before the commit
    database.executescript(change)
    database.execute("BEGIN")
    database.execute("UPDATE messages SET data = zeroblob(length(data) + 7)")
    killed = tmp_path / "killed"
    shutil.copytree(bag, killed)
    database.close()
    journal = killed / f"{file.name}-journal"
    assert journal.stat().st_size > 0
    return killed, journal


def cut_copy(bag: Path, target: Path, size: int, *, with_metadata: bool = False) -> Path:
    """Copy of a bag whose storage file ends after `size` bytes."""
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir()
    source = storage_file(bag)
    (target / source.name).write_bytes(source.read_bytes()[:size])
    if with_metadata:
        shutil.copy(bag / "metadata.yaml", target)
    return target


def assert_same(read: RunRecord, run: RunRecord) -> None:
    """Both have the same samples to the last bit."""
    np.testing.assert_array_equal(read.stamps_ns, run.stamps_ns)
    assert set(read.columns) == set(run.columns)
    for column in run.columns:
        np.testing.assert_array_equal(read[column], run[column], err_msg=column)


def assert_flown(recorded: RunRecord, expected: RunRecord) -> None:
    """A recorded run lacks nothing, has every bit of the loop in process, and so has its replay."""
    assert (recorded.warnings, recorded.missing) == ((), {})
    assert_same(recorded, expected)
    again = replay(recorded)
    assert {each.largest for each in again.found} == {0.0}


def assert_prefix(read: RunRecord, run: RunRecord) -> None:
    """Every sample read is the one that was recorded at that instant."""
    places = np.searchsorted(run.stamps_ns, read.stamps_ns)
    np.testing.assert_array_equal(run.stamps_ns[places], read.stamps_ns)
    for column, samples in read.columns.items():
        there = ~np.isnan(samples).all(axis=1)
        np.testing.assert_array_equal(samples[there], run[column][places][there], err_msg=column)
