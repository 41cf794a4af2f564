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

"""No bag, or a damaged one: refused by name, or read as far as it is whole."""

import contextlib
import shutil
import sqlite3
import zlib
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
import zstandard
from bag_helpers import (
    assert_prefix,
    assert_same,
    cut_copy,
    database_of,
    messages,
    storage_file,
    unfinished,
    write_messages,
)
from mcap.records import Footer
from mcap.stream_reader import StreamReader
from synthetic import SAMPLED, normal_run, without_columns

from ppc_attitude.bags import storage
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.folder import Bag, Source
from ppc_attitude.bags.mcap_source import McapSource
from ppc_attitude.bags.reader import read_run
from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.bags.source import Allowance, payloads_of
from ppc_attitude.bags.sqlite_source import SqliteSource
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.topics import ATTITUDE

# Each form has a topic, and two are the controller's: the metadata of more take longer to read.
KEPT = {"attitude", "angular_velocity", "torque_command", "attitude_error", "attitude_envelope"}
WHOLE = normal_run(duration=1.0)
RUN = without_columns(WHOLE, *(WHOLE.columns.keys() - KEPT))
STEPS = len(RUN.stamps_ns)


def test_what_is_no_bag_is_refused_by_name(tmp_path: Path) -> None:
    def refused(path: Path, message: str) -> None:
        with pytest.raises(BagError, match=message):
            read_run(path)

    refused(tmp_path / "nowhere", "nowhere does not exist")
    (tmp_path / "empty").mkdir()
    refused(tmp_path / "empty", "is an empty folder")
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "notes.txt").write_text("no bag")
    refused(tmp_path / "notes", r"is no bag: it holds no \.mcap or \.db3 file")
    refused(
        tmp_path / "notes" / "notes.txt", r"is no bag; allowed: a folder, or a file \.mcap or \.db3"
    )
    for suffix, message in (
        (".mcap", "is no MCAP file"),
        (".db3", "cannot be read as a rosbag2 database"),
    ):
        file = tmp_path / f"text{suffix}"
        file.write_text("no storage, but some text that is long enough to look like one")
        refused(file, message)
        file.write_bytes(b"")
        refused(file, "is an empty file")
    packed = tmp_path / "text.mcap.zstd"
    packed.write_bytes(zstandard.compress(b"no storage"))
    refused(packed, r"text\.mcap\.zstd is no MCAP file")
    (tmp_path / "gone").mkdir()
    (tmp_path / "gone" / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {version: 9, relative_file_paths: [gone.mcap]}"
    )
    refused(tmp_path / "gone", "is no bag: it holds no")


def test_a_file_that_goes_while_a_bag_is_read_is_told(tmp_path: Path) -> None:
    write_run(RUN, tmp_path / "bag")
    bag = Bag(tmp_path / "bag")
    storage_file(tmp_path / "bag").unlink()
    with pytest.raises(BagError, match="bag cannot be read: No such file"):
        next(bag.blocks())


def test_a_database_without_a_copy_of_the_metadata_is_read(tmp_path: Path) -> None:
    """That copy came with ROS 2 Iron."""
    write_run(RUN, tmp_path / "bag", storage="sqlite3")
    with database_of(tmp_path / "bag") as database:
        database.execute("DROP TABLE metadata")
    assert_same(read_run(tmp_path / "bag"), RUN)


def test_a_message_that_is_packed_otherwise_than_others_is_refused(tmp_path: Path) -> None:
    write_run(RUN, tmp_path / "bag", storage="sqlite3")
    with database_of(tmp_path / "bag") as database:
        first = "messages SET data = ? WHERE id = 1"
        database.execute(f"UPDATE {first}", (zstandard.compress(b"message"),))
    with pytest.raises(BagError, match="zstd cannot unpack it"):
        read_run(tmp_path / "bag")


def test_a_database_of_other_texts_is_refused(tmp_path: Path) -> None:
    """Messages that pass through its texts would have other bytes."""
    write_run(RUN, tmp_path / "bag", storage="sqlite3")
    file = storage_file(tmp_path / "bag")
    with contextlib.closing(sqlite3.connect(file)) as database:
        content = "".join(database.iterdump())
    file.unlink()
    with contextlib.closing(sqlite3.connect(file)) as database:
        database.execute("PRAGMA encoding = 'UTF-16le'")
        database.executescript(content)
    with pytest.raises(BagError, match="its encoding is UTF-16le, allowed is UTF-8"):
        read_run(tmp_path / "bag")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("topics SET name = x'00' WHERE id = 1", "topic 1 has a name, type or QoS that is no text"),
        (
            "messages SET timestamp = 'x' WHERE id = 2",
            "db3 is damaged: a message lacks a part, or has a topic or time that is no integer",
        ),
        (
            "messages SET timestamp = 'x' WHERE id = 1007",
            "a message after message 1000 lacks a part, or has a topic or time that is no integer",
        ),
        (
            "messages SET data = 'ü' WHERE id = 1007",  # a text is measured in letters
            "a message after message 1000 has another length than it says",
        ),
    ],
)
def test_a_row_that_is_none_is_named(tmp_path: Path, change: str, message: str) -> None:
    write_run(WHOLE, tmp_path / "bag", storage="sqlite3")
    with database_of(tmp_path / "bag") as database:
        database.execute(f"UPDATE {change}")
    with pytest.raises(BagError, match=message):
        raise BagError(read_run(tmp_path / "bag").warnings[0])


@pytest.mark.parametrize("text", ["{", "- a\n- b", "rosbag2_bagfile_information: 3", "\x00", ""])
def test_damaged_metadata_are_a_warning(tmp_path: Path, text: str) -> None:
    write_run(RUN, tmp_path / "bag")
    (tmp_path / "bag" / "metadata.yaml").write_text(text)
    read = read_run(tmp_path / "bag")
    assert_same(read, RUN)
    assert read.warnings[0].startswith("recording was cut: its metadata.yaml is damaged")
    assert read.controller == "ppc"


@pytest.fixture(scope="module", params=["mcap", "sqlite3"])
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    bag = tmp_path_factory.mktemp("whole") / "bag"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(storage, "_CHUNK_BYTES", 2**13)
        write_run(RUN, bag, storage=request.param)
    return bag


@pytest.mark.parametrize("with_metadata", [True, False])
def test_a_file_cut_anywhere_is_read_or_refused(
    tmp_path: Path, whole: Path, with_metadata: bool
) -> None:
    size = storage_file(whole).stat().st_size
    random = Random(1)
    sizes = {*range(20), *(random.randrange(size) for _ in range(30)), *range(size - 20, size)}
    longest = 0
    for length in sorted(sizes):
        bag = cut_copy(whole, tmp_path / "cut", length, with_metadata=with_metadata)
        try:
            run = read_run(bag)
        except BagError:
            continue
        assert_prefix(run, RUN)
        assert run.warnings[0].startswith("recording was cut: "), length
        assert len(run.stamps_ns) >= longest
        longest = max(longest, len(run.stamps_ns))
    if storage_file(whole).suffix == ".mcap":
        assert longest == STEPS


# Pages of a SQLite file depend on each other: there is no such promise.
@pytest.mark.parametrize("whole", ["mcap"], indirect=True)
def test_a_cut_mcap_file_gives_every_whole_message(tmp_path: Path, whole: Path) -> None:
    content = storage_file(whole).read_bytes()
    place = content.index(Codec(ATTITUDE).encode(RUN.stamps_ns[70], tuple(RUN["attitude"][70])))
    run = read_run(cut_copy(whole, tmp_path / "cut", place))
    np.testing.assert_array_equal(run.stamps_ns, RUN.stamps_ns[:70])
    assert run.missing == {}


@pytest.mark.parametrize(("behind", "missing"), [(30, {}), (150, {"torque_command": 50})])
def test_only_what_a_killed_recorder_had_not_yet_taken_is_no_loss(
    behind: int, missing: dict[str, int], tmp_path: Path
) -> None:
    """A busy recorder takes topic after topic, but never one of them a second after another."""
    run = normal_run(duration=3.0)
    steps = len(run.stamps_ns)
    last = {topic.column: run.stamps_ns[-13] for topic in SAMPLED}
    last |= {"attitude": run.stamps_ns[-1], "torque_command": run.stamps_ns[-1 - behind]}
    taken = [each for each in messages(run) if each[1] <= last[each[0].column]]
    path = write_messages(tmp_path / "bag", taken, run=run)
    (path / "metadata.yaml").unlink()
    read = read_run(path)
    assert len(read.stamps_ns) == steps - min(behind, 100)
    assert read.missing == missing


@pytest.mark.parametrize("whole", ["mcap"], indirect=True)
def test_a_file_that_grows_is_read_as_far_as_it_went_when_it_was_opened(
    tmp_path: Path, whole: Path
) -> None:
    content = storage_file(whole).read_bytes()
    random = Random(3)
    for length in (*range(8, 60), *(random.randrange(8, len(content)) for _ in range(50))):
        bag = cut_copy(whole, tmp_path / "cut", length)
        file = storage_file(bag)
        expected = messages_of(McapSource(file, Allowance(file)))
        source = McapSource(file, Allowance(file))
        file.write_bytes(content)
        assert messages_of(source) == expected
        assert source.cut, length


def messages_of(source: Source) -> list[bytes]:
    return [payload for block in source.blocks() for payload in payloads_of(block)]


def test_a_slow_reader_does_not_keep_a_recorder_from_writing(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    write_run(WHOLE, bag, storage="sqlite3")  # more messages than are read at a time
    source = SqliteSource(storage_file(bag), finished=False)
    blocks = source.blocks()
    before = len(payloads_of(next(blocks)))
    with contextlib.closing(sqlite3.connect(storage_file(bag), timeout=0.0)) as recorder:
        stored = recorder.execute("SELECT count(*) FROM messages").fetchone()[0]
        assert before < stored
        # Of a topic that was not there when the reader began.
        recorder.execute(
            "INSERT INTO topics SELECT 99, '/late', type, serialization_format, "
            "offered_qos_profiles, '' FROM topics LIMIT 1"
        )
        recorder.execute("INSERT INTO messages VALUES (NULL, 99, 1, x'00')")
        recorder.commit()
    assert before + sum(len(block.channel) for block in blocks) == stored + 1
    assert source.channels[99].topic == "/late"
    assert source.cut == ""


def test_flipped_bits_raise_nothing_but_bag_errors(tmp_path: Path, whole: Path) -> None:
    content = storage_file(whole).read_bytes()
    random = Random(2)
    bag = cut_copy(whole, tmp_path / "bag", len(content), with_metadata=True)
    for _ in range(60):
        damaged = bytearray(content)
        for _ in range(random.choice((1, 3, 30))):
            damaged[random.randrange(len(damaged))] ^= 1 << random.randrange(8)
        storage_file(bag).write_bytes(damaged)
        try:
            run = read_run(bag)
        except BagError:
            continue
        assert set(run.columns) <= set(BY_COLUMN)
        assert (np.diff(run.stamps_ns) > 0).all()


def test_a_log_that_its_writer_ends_while_it_is_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """rosbag2 may record with SQLite's write-ahead log, in which the last messages lie."""
    bag = unfinished(tmp_path / "bag", "sqlite3", RUN)
    recorder = sqlite3.connect(storage_file(bag), isolation_level=None)
    recorder.execute("PRAGMA journal_mode=WAL")
    recorder.execute("BEGIN")
    recorder.execute("UPDATE messages SET timestamp = timestamp + 1")
    recorder.execute("COMMIT")
    log = Path(f"{storage_file(bag)}-wal")
    assert log.stat().st_size > 0
    assert_same(read_run(bag), RUN)
    assert log.exists()
    copy = shutil.copyfileobj

    def copyfileobj(*files: Any) -> None:
        recorder.close()
        copy(*files)

    monkeypatch.setattr(shutil, "copyfileobj", copyfileobj)
    assert_same(read_run(bag), RUN)
    assert not log.exists()


@pytest.mark.parametrize("whole", ["mcap"], indirect=True)
def test_no_flipped_bit_of_the_data_goes_unnoticed(tmp_path: Path, whole: Path) -> None:
    content = storage_file(whole).read_bytes()
    with storage_file(whole).open("rb") as file:
        records = list(StreamReader(file, validate_crcs=True).records)
    footer = records[-1]
    assert isinstance(footer, Footer)
    data_end = footer.summary_start - 13
    assert footer.summary_crc == zlib.crc32(content[footer.summary_start : -12])
    random = Random(4)
    bag = cut_copy(whole, tmp_path / "bag", len(content), with_metadata=True)
    for place in (*range(8, 60, 3), *(random.randrange(8, data_end) for _ in range(60))):
        damaged = bytearray(content)
        damaged[place] ^= 1 << random.randrange(8)
        storage_file(bag).write_bytes(damaged)
        with pytest.raises(BagError, match="recording was cut"):
            run = read_run(bag)
            assert_prefix(run, RUN)
            raise BagError(run.warnings[0])
