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

"""Finishing bags that were cut."""

import shutil
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from bag_helpers import (
    assert_prefix,
    assert_same,
    cut_copy,
    database_of,
    hot,
    storage_file,
    unfinished,
    written_by_rosbags,
)
from conftest import Ask
from mcap.reader import make_reader
from rosbags.rosbag2 import CompressionMode, Reader, StoragePlugin
from synthetic import SAMPLED, normal_run

from ppc_attitude.bags.custom_data import METADATA, UNFINISHED
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.reader import read_run
from ppc_attitude.bags.recover import recover
from ppc_attitude.bags.run_writer import write_run

RUN = normal_run(duration=1.0)


def test_a_recovered_bag_is_complete_for_everyone(tmp_path: Path, storage: str) -> None:
    bag = unfinished(tmp_path / "bag", storage, RUN)
    summary = recover(bag)
    count = len(RUN.stamps_ns)
    assert summary.counts == {f"/{topic.name}": count for topic in SAMPLED}
    assert (summary.start_ns, summary.end_ns) == (0, RUN.stamps_ns[-1])
    assert summary.flaws[0] == "it has no metadata.yaml"
    suffix = {"mcap": "mcap", "sqlite3": "db3"}[storage]
    assert {file.name for file in bag.iterdir()} == {"metadata.yaml", f"bag.{suffix}"}
    read = read_run(bag)
    assert_same(read, RUN)
    assert read.controller == "ppc"
    with Reader(bag) as reader:
        assert reader.message_count == summary.counts.total()
        assert {connection.digest[:7] for connection in reader.connections} == {"RIHS01_"}
    if storage == "mcap":
        with storage_file(bag).open("rb") as file:
            assert sum(1 for _ in make_reader(file).iter_messages()) == summary.counts.total()


def test_a_truncated_file_is_recovered_as_far_as_it_goes(tmp_path: Path) -> None:
    write_run(RUN, tmp_path / "bag")
    size = storage_file(tmp_path / "bag").stat().st_size // 2
    cut = cut_copy(tmp_path / "bag", tmp_path / "cut", size, with_metadata=True)
    before = read_run(cut)
    recover(cut)
    after = read_run(cut)
    assert_same(after, before)
    assert_prefix(after, RUN)
    assert [file.name for file in cut.glob("*.mcap")] == ["cut.mcap"]


def test_the_command_says_what_it_found(tmp_path: Path, ask: Ask) -> None:
    late = replace(RUN, stamps_ns=RUN.stamps_ns + 3_000_000_000)
    bag = unfinished(tmp_path / "bag", "mcap", late)
    first, cut, last = ask("recover", bag).out.splitlines()
    count = len(RUN.stamps_ns) * len(SAMPLED)
    assert first == f"{count} messages on {len(SAMPLED)} topics, received within 1.000 s"
    assert cut.startswith("the bag was cut: it has no metadata.yaml")
    assert last == f"bag: {bag}"


def test_the_command_says_that_the_bag_stays(tmp_path: Path, ask: Ask) -> None:
    write_run(RUN, tmp_path / "bag")
    (tmp_path / "bag" / METADATA).write_text("")
    *_, stays, last = ask("recover", tmp_path / "bag").out.splitlines()
    assert stays == f"{tmp_path / 'bag'} stays as it is: it may hold more than could be read"
    assert last == f"bag: {tmp_path / 'bag.recovered'}"


def test_a_healthy_bag_is_refused_and_untouched(tmp_path: Path, storage: str) -> None:
    bag = tmp_path / "bag"
    write_run(RUN, bag, storage=storage)
    before = {file.name: file.read_bytes() for file in bag.iterdir()}
    with pytest.raises(BagError, match=r"bag was closed by its recorder, there is nothing"):
        recover(bag)
    assert {file.name: file.read_bytes() for file in bag.iterdir()} == before


def contents(folder: Path) -> dict[Path, bytes]:
    return {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def chunks_in(content: bytes) -> list[int]:
    found, place = [], 8
    while place < len(content) - 8:
        kind, length = struct.unpack_from("<BQ", content, place)
        found += [place] if kind == 6 else []
        place += 9 + length
    return found


def recovered_beside(bag: Path) -> Path:
    """Recover a bag that may hold more, and is therefore not touched."""
    before, read = contents(bag), read_run(bag)
    beside = recover(bag).folder
    assert beside == bag.with_name(f"{bag.name}.recovered")
    assert contents(bag) == before and not (bag / ".recovering").exists()
    assert_same(read_run(beside), read)
    return beside


@pytest.mark.parametrize(
    ("cut", "place", "spoilt"),
    [
        (False, 0, bytes(16)),  # the head of the chunk
        (False, 0, b"\x02"),  # its kind: the end of the file
        (False, 7, b"\x01"),  # its length: beyond the file
        (True, 0, b"\x02"),
        (True, 7, b"\x01"),
        (True, 56, b"\x01"),  # the length of a message in it
        (True, 37, b"\x04\0\0\0lz4 "),  # its compression, which nobody unpacks in part
    ],
)
def test_a_file_that_may_hold_more_stays_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cut: bool, place: int, spoilt: bytes
) -> None:
    monkeypatch.setattr("ppc_attitude.bags.storage._CHUNK_BYTES", 2**14)
    monkeypatch.setattr("ppc_attitude.bags.mcap_source._LONGEST_END", 2**12)
    write_run(RUN, tmp_path / "bag")
    file = storage_file(tmp_path / "bag")
    content = bytearray(file.read_bytes())
    second = chunks_in(content)[1]
    content[second + place : second + place + len(spoilt)] = spoilt
    file.write_bytes(content[: second + 5000] if cut else content)
    recovered_beside(tmp_path / "bag")


def test_a_recovery_that_was_killed_can_be_repeated(tmp_path: Path) -> None:
    bag = unfinished(tmp_path / "bag", "mcap", RUN)
    recover(bag)
    # Killed between the two replacements: the file is complete, metadata.yaml is not there yet.
    (bag / "metadata.yaml").unlink()
    (bag / UNFINISHED).write_text("{}")
    (bag / f"{UNFINISHED}.unfinished").write_text("{")
    recover(bag)
    assert {file.name for file in bag.iterdir()} == {"metadata.yaml", "bag.mcap"}
    assert_same(read_run(bag), RUN)


def test_what_sqlite_left_half_done_is_undone(tmp_path: Path) -> None:
    """A kill within a commit leaves a hot journal beside pages of the unfinished transaction."""
    killed, journal = hot(tmp_path, RUN)
    recover(killed)
    assert_same(read_run(killed), RUN)
    assert not journal.exists()


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_messages_that_were_compressed_one_by_one_are_recovered(
    tmp_path: Path, storage: StoragePlugin
) -> None:
    bag = written_by_rosbags(tmp_path / "bag", storage, CompressionMode.MESSAGE, RUN)
    (bag / METADATA).unlink()  # it alone says that they are compressed
    assert_same(read_run(bag), RUN)
    recover(bag)
    assert_same(read_run(bag), RUN)


def test_a_topic_that_nobody_knows_hinders_only_with_messages(tmp_path: Path) -> None:
    bag = unfinished(tmp_path / "bag", "sqlite3", RUN)
    with database_of(bag) as database:
        row = "INSERT INTO topics SELECT 99, '/own', 'own_msgs/msg/Own', 'cdr', '', ''"
        database.execute(row)
    also = shutil.copytree(bag, tmp_path / "also")
    assert recover(bag).counts.total() == len(RUN.stamps_ns) * len(SAMPLED)
    assert_same(read_run(bag), RUN)
    with database_of(also) as database:
        database.execute("INSERT INTO messages SELECT 999999, 99, 7, x'00010000'")
    with pytest.raises(
        BagError, match=r"'own_msgs/msg/Own', the type of /own, is no type of ROS 2 Jazzy"
    ):
        recover(also)


def test_a_row_that_is_none_leaves_the_database_as_it_is(tmp_path: Path) -> None:
    write_run(RUN, tmp_path / "bag", storage="sqlite3")
    with database_of(tmp_path / "bag") as database:
        for place, spoilt in enumerate(
            ("timestamp = 'x'", "timestamp = 1.5", "topic_id = 99", "topic_id = 'x'", "data = 'ö'")
        ):
            database.execute(f"UPDATE messages SET {spoilt} WHERE id = {1005 + place}")
    beside = recovered_beside(tmp_path / "bag")
    with database_of(tmp_path / "bag") as database:
        (whole,) = database.execute("SELECT count(*) FROM messages").fetchone()
    with database_of(beside) as database:
        (read,) = database.execute("SELECT count(*) FROM messages").fetchone()
    assert read == whole - 5


def test_a_bag_with_a_topic_of_two_types_stays_as_it_is(tmp_path: Path) -> None:
    bag = unfinished(tmp_path / "bag", "sqlite3", RUN)
    with database_of(bag) as database:
        name = "SELECT name FROM topics WHERE type LIKE '%Wrench%'"
        database.execute(f"UPDATE topics SET name = ({name}) WHERE type LIKE '%Quaternion%'")
    assert recover(bag).folder != bag


def test_a_channel_that_is_defined_as_two_keeps_its_messages(tmp_path: Path) -> None:
    bag = unfinished(tmp_path / "bag", "mcap", RUN)
    texts = b"".join(struct.pack("<I", len(each)) + each for each in (b"/other", b"cdr", b""))
    with storage_file(bag).open("ab") as file:
        file.write(struct.pack("<BQHH", 4, 4 + len(texts), 1, 1) + texts)
    assert "channel 1 is defined twice" in read_run(bag).warnings[0]
    assert_same(read_run(recovered_beside(bag)), RUN)


def test_a_file_with_less_than_was_promised_stays_as_it_is(tmp_path: Path) -> None:
    write_run(RUN, tmp_path / "bag")
    promise = tmp_path / "bag" / METADATA
    promise.write_text(promise.read_text().replace("message_count: ", "message_count: 9"))
    recovered_beside(tmp_path / "bag")


@pytest.mark.parametrize(
    ("bag", "way", "message"),
    [
        ("bag", "bag.recovered", r"bag\.recovered exists already: .*; move or delete it, and"),
        ("bag", "bag/.recovering", r"\.recovering exists already: .*; move or delete it, and"),
        ("none", "none/.recovering", "is no bag"),
    ],
)
def test_what_stands_in_the_way_is_named_and_stays(
    tmp_path: Path, bag: str, way: str, message: str
) -> None:
    write_run(RUN, tmp_path / "bag")
    (tmp_path / "bag" / METADATA).write_text("")
    (tmp_path / way).mkdir(parents=True)
    (tmp_path / way / "mine").touch()
    with pytest.raises(BagError, match=message):
        recover(tmp_path / bag)
    assert [file.name for file in (tmp_path / way).iterdir()] == ["mine"]


@pytest.mark.parametrize("path", ["..", "../sub/.."])
def test_a_path_may_go_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str) -> None:
    bag = unfinished(tmp_path / "bag", "mcap", RUN)
    (bag / "sub").mkdir()
    monkeypatch.chdir(bag / "sub")
    recover(path)
    assert {file.name for file in bag.iterdir()} == {METADATA, "bag.mcap", "sub"}


@pytest.mark.parametrize(
    ("profiles", "shown"),
    [
        ("'" + 200_000 * "[" + "'", '"\'\\[{299}…"'),  # ended the process, or the parser's stack
        ("- 1", "'- 1'"),
        ("- history: 3", "'- history: 3'"),
    ],
)
def test_profiles_that_are_none_are_named(tmp_path: Path, profiles: str, shown: str) -> None:
    bag = unfinished(tmp_path / "bag", "sqlite3", RUN)
    with database_of(bag) as database:
        database.execute("UPDATE topics SET offered_qos_profiles = ?", [profiles])
    with pytest.raises(BagError, match=rf"the QoS of /\w+ is {shown}, allowed is a list"):
        recover(bag)


def test_refusals_name_what_is_wrong(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r"nowhere is not the folder of a bag"):
        recover(tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagError, match=r"is an empty folder"):
        recover(tmp_path / "empty")
    write_run(RUN, tmp_path / "bag")
    headless = cut_copy(tmp_path / "bag", tmp_path / "headless", 20)
    with pytest.raises(BagError, match=r"holds no messages"):
        recover(headless)
    assert storage_file(headless).stat().st_size == 20
    flipped = cut_copy(tmp_path / "bag", tmp_path / "flipped", 10**9)
    (flipped / "metadata.yaml").unlink(missing_ok=True)
    content = bytearray(storage_file(flipped).read_bytes())
    for chunk in chunks_in(bytes(content)):
        content[chunk + 1000] ^= 1
    storage_file(flipped).write_bytes(content)
    with pytest.raises(BagError, match=r"can be recovered: .*left out: its checksum is wrong"):
        recover(flipped)
    two = cut_copy(tmp_path / "bag", tmp_path / "two", 5000)
    (two / "other.mcap").write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(BagError, match=r"has bag.mcap, other.mcap; allowed: one file"):
        recover(two)
    blocked = unfinished(tmp_path / "blocked", "mcap", RUN)
    (blocked / f"{UNFINISHED}.unfinished").mkdir()
    with pytest.raises(BagError, match=r"blocked cannot be recovered: Is a directory"):
        recover(blocked)
