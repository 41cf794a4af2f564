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

"""Bags and configurations that claim more than they hold cost no more than they hold."""

import itertools
import json
import math
import re
import shutil
import struct
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import lz4.frame
import pytest
import yaml
import zstandard
from bag_helpers import database_of, messages, record_all, storage_file
from process_helpers import ran
from synthetic import SAMPLED, normal_run

from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.reader import read_run
from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.bags.source import SMALL, UNFOLDS
from ppc_attitude.bags.writer import BagWriter
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.topics import ATTITUDE

MIB = 2**20
RUN = normal_run(duration=0.2)
DEEP = "[" * 100_000
TOPICS = range(10, 32_000)
TOO_DEEP = "nested too deeply, allowed are 64|maximum nesting depth"  # ours; libyaml's since 0.2.6
LAUGHS = "l0: &l0 [lol, lol, lol, lol, lol, lol, lol, lol, lol, lol]\n" + "".join(
    f"l{n}: &l{n} [{', '.join([f'*l{n - 1}'] * 10)}]\n" for n in range(1, 10)
)
# Reads each bag with so much memory on top of what reading a good one took.
CHILD = """
import resource, sys
from pathlib import Path
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.custom_data import write_unfinished
from ppc_attitude.bags.reader import read_run
from ppc_attitude.bags.recover import recover
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.scenario import load

good, *rest = sys.argv[1:]
read_run(good)
with open("/proc/self/statm") as file:
    used = int(file.read().split()[0]) * resource.getpagesize()
for path, more in zip(rest[::2], map(int, rest[1::2])):
    resource.setrlimit(resource.RLIMIT_AS, (used + more, resource.RLIM_INFINITY))
    try:
        if path.endswith(".yaml"):
            load([Path(path)])
        print("read;", *read_run(path).warnings)
    except (BagError, ConfigurationError) as error:
        print("refused;", error)
"""


def metadata(bag: Path, **entries: object) -> None:
    content = yaml.safe_load((bag / "metadata.yaml").read_text())
    content["rosbag2_bagfile_information"].update(entries)
    (bag / "metadata.yaml").write_text(yaml.safe_dump(content))


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(*texts: bytes) -> bytes:
    return b"".join(struct.pack("<I", len(each)) + each for each in texts)


def append(bag: Path, added: bytes) -> None:
    """Put records behind the magic number and the head of an MCAP file."""
    file = storage_file(bag)
    content = file.read_bytes()
    place = 17 + struct.unpack_from("<Q", content, 9)[0]
    file.write_bytes(content[:place] + added + content[place:])


def chunk(compression: bytes, size: int, body: bytes) -> bytes:
    head = struct.pack("<QQQI", 0, 0, size, 0) + text(compression)
    return record(6, head + struct.pack("<Q", len(body)) + body)


def deep_metadata(bag: Path) -> None:
    (bag / "metadata.yaml").write_text(DEEP)


def deep_metadata_in_mcap(bag: Path) -> None:
    (bag / "metadata.yaml").unlink()
    table = text(b"serialized_metadata", b"custom_data: " + DEEP.encode())
    append(bag, record(12, text(b"rosbag2") + struct.pack("<I", len(table)) + table))


def deep_metadata_in_sqlite(bag: Path) -> None:
    (bag / "metadata.yaml").unlink()
    with database_of(bag) as database:
        database.execute("UPDATE metadata SET metadata = ?", (f"custom_data: {DEEP}",))


def deep_json(bag: Path) -> None:
    metadata(bag, custom_data={"ppc_attitude.parameters": DEEP})


def deep_unfinished_json(bag: Path) -> None:
    (bag / "metadata.yaml").unlink()
    (bag / "unfinished.json").write_text(DEEP)


def one_file_many_times(bag: Path) -> None:
    metadata(bag, relative_file_paths=["bag.mcap"] * 2_000)


def zstd_bomb(bag: Path) -> None:
    compressor = zstandard.ZstdCompressor(write_content_size=False)
    packed = compressor.compress(bytes(2**29))  # of more than the child may have
    append(bag, chunk(b"zstd", 100, packed))


def lz4_claim(bag: Path) -> None:
    append(bag, chunk(b"lz4", 2**40, lz4.frame.compress(b"few")))


def zstd_file(bag: Path) -> None:
    compressor = zstandard.ZstdCompressor(write_content_size=False)
    name = storage_file(bag).name
    packed = compressor.compress(storage_file(bag).read_bytes() + bytes(2**29))
    (bag / f"{name}.zstd").write_bytes(packed)
    storage_file(bag).unlink()
    metadata(bag, relative_file_paths=[f"{name}.zstd"], compression_mode="FILE")


def shared_pages(bag: Path) -> None:
    """Let every branch of a table's tree lead to the same rows, whose payloads are large."""
    with database_of(bag) as database:
        database.execute("PRAGMA page_size=512")
        database.execute("VACUUM")
        database.execute("BEGIN")  # else every row is a transaction that waits for the disk
        database.execute("DELETE FROM messages")
        rows = [(bytes(30_000),)] * 400
        database.executemany("INSERT INTO messages VALUES (NULL, 1, 0, ?)", rows)
        database.execute("COMMIT")
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
        (root,) = database.execute(query).fetchone()
    content = bytearray(storage_file(bag).read_bytes())
    start = (root - 1) * 512
    assert content[start] == 5  # a page of branches
    (cells,) = struct.unpack_from(">H", content, start + 3)
    places = [start + at for at in struct.unpack_from(f">{cells}H", content, start + 12)]
    places.append(start + 8)  # the last branch
    for place in places:
        content[place : place + 4] = content[places[0] : places[0] + 4]
    content[28:32] = struct.pack(">I", 2_000)  # pages, most of those that nothing leads to left out
    storage_file(bag).write_bytes(content[: 2_000 * 512])


def many_attitudes(bag: Path) -> Path:
    """A bag with one message of all topics but one, in whose stamps are many gaps."""
    facts = {"ppc_attitude.parameters": json.dumps({"spacecraft_plant": {"rate": 100.0}})}
    codec, values = Codec(ATTITUDE), tuple(RUN["attitude"][0])
    with BagWriter(bag, custom_data=facts) as recorder:
        record_all(recorder, itertools.islice(messages(RUN), len(SAMPLED)))
        for step in range(100, 1_500_000, 15):
            recorder.write("/attitude", 0, codec.encode(step * 10_000_000, values))
    return bag


HOSTILE: list[tuple[Callable[[Path], None], str, bool, str]] = [
    (deep_metadata, "mcap", False, f"metadata.yaml is damaged: .*({TOO_DEEP})"),
    (deep_metadata_in_mcap, "mcap", False, f"metadata in bag.mcap are damaged: .*({TOO_DEEP})"),
    (deep_metadata_in_sqlite, "sqlite3", False, f"metadata in bag.db3 are damaged: .*({TOO_DEEP})"),
    (
        deep_json,
        "mcap",
        False,
        "the bag's ppc_attitude.parameters cannot be read: nested too deeply",
    ),
    (deep_unfinished_json, "mcap", False, "its unfinished.json is damaged: nested too deeply"),
    (one_file_many_times, "mcap", False, "^read;$"),
    (zstd_bomb, "mcap", True, "data of bag.mcap unpack to .* bytes or more; allowed: "),
    (lz4_claim, "mcap", True, "data of bag.mcap unpack to 1099511627776 bytes or more; allowed: "),
    (zstd_file, "mcap", True, "bag.mcap.zstd is damaged: .* unpack to .* bytes or more; allowed: "),
    (shared_pages, "sqlite3", False, "bag.db3 is damaged: its rows claim more than the .* bytes"),
]
CONFIGURATIONS = [
    (DEEP, TOO_DEEP),
    (LAUGHS, "with its aliases it has .* characters, allowed are 4194304"),
    ("&a {b: *a}", r"\*a is used before the end of &a"),
    (f"a: {'1:' * 1_000_000}1", "number of 2000001 characters, allowed are 250"),
    (f"a: 0b{'1' * 20_000}", "number of 20002 characters, allowed are 250"),
]


def test_memory_stays_below_the_stated_multiple_of_the_bag(tmp_path: Path) -> None:
    for storage in ("mcap", "sqlite3"):
        (tmp_path / storage).mkdir()
        write_run(RUN, tmp_path / storage / "bag", storage=storage)
    good = tmp_path / "mcap" / "bag"
    given, expected = [], []
    for make, storage, compressed, message in HOSTILE:
        bag = shutil.copytree(tmp_path / storage, tmp_path / make.__name__) / "bag"
        make(bag)
        size = sum(file.stat().st_size for file in bag.iterdir())
        given += [bag, 256 * MIB + 8 * (SMALL + UNFOLDS * size if compressed else size)]
        expected.append(message)
    lonely = many_attitudes(tmp_path / "lonely")
    given += [lonely, 8 * storage_file(lonely).stat().st_size]
    expected.append("read; .* instants are missing")
    for count, (content, message) in enumerate(CONFIGURATIONS):
        file = tmp_path / f"{count}.yaml"
        file.write_text(content)
        given += [file, 256 * MIB]
        expected.append(f"refused; configuration file .* cannot be read as YAML: .*({message})")
    told = ran([sys.executable, "-c", CHILD, str(good), *map(str, given)]).stdout.splitlines()
    for line, message in zip(told, expected, strict=True):
        assert re.search(message, line), f"{line} is not {message}"


def long_compression(bag: Path) -> None:
    append(bag, chunk(LONG.encode(), 0, b""))


def long_type(bag: Path) -> None:
    storage_file(bag).write_bytes(b"\x89MCAP0\r\n" + attitudes(1, msgtype=LONG))


def long_frame(bag: Path) -> None:
    storage_file(bag).write_bytes(b"\x89MCAP0\r\n" + attitudes(2, frame=LONG[:4_000]))


def long_file_name(bag: Path) -> None:
    metadata(bag, relative_file_paths=["bag.mcap", LONG])


def long_tag(bag: Path) -> None:
    (bag / "metadata.yaml").write_text(f"!{LONG} 3")


def long_tag_in_mcap(bag: Path) -> None:
    (bag / "metadata.yaml").unlink()
    table = text(b"serialized_metadata", f"!{LONG} custom_data".encode())
    append(bag, record(12, text(b"rosbag2") + struct.pack("<I", len(table)) + table))


def long_parameter(bag: Path) -> None:
    said = json.dumps({"spacecraft_plant": {"rate": LONG}})
    metadata(bag, custom_data={"ppc_attitude.parameters": said})


def long_column(bag: Path) -> None:
    with database_of(bag) as database:
        database.execute(f"ALTER TABLE messages ADD COLUMN {LONG} DEFAULT 1")


LONG = 50_000 * "x"
LONG_WORDS: list[tuple[Callable[[Path], None], str]] = [
    (long_compression, "a chunk of bag.mcap is left out: it is compressed with 'xxx"),
    (long_type, r"is no run of this package; it holds /attitude \(xxx"),
    (long_frame, "2 messages of /attitude are read as if their frame were right: frame_id 'xxx"),
    (long_file_name, "recording was cut: xxx.*… is missing"),
    (long_tag, "its metadata.yaml is damaged: .*xxx"),
    (long_tag_in_mcap, "the metadata in bag.mcap are damaged: .*xxx"),
    (long_parameter, "the bag's parameters of spacecraft_plant cannot be used: rate = .*xxx"),
    (long_column, "cannot be read as a rosbag2 database: column xxx"),
]


@pytest.mark.parametrize(("make", "message"), LONG_WORDS)
def test_long_words_of_a_stranger_are_shortened(
    tmp_path: Path, make: Callable[[Path], None], message: str
) -> None:
    write_run(RUN, tmp_path / "bag", storage="sqlite3" if make is long_column else "mcap")
    make(tmp_path / "bag")
    with pytest.raises(BagError, match=message) as told:
        raise BagError("\n".join(read_run(tmp_path / "bag").warnings))
    assert 300 < len(str(told.value)) < 1_500


def attitudes(
    count: int,
    behind: bytes = b"",
    step: int = 1,
    frame: str = ATTITUDE.frame_id,
    msgtype: str = ATTITUDE.msgtype,
) -> bytes:
    """Records of a topic and its messages, with something behind each; −1: the last one first."""
    schema = record(3, struct.pack("<H", 9) + text(msgtype.encode(), b"", b""))
    channel = record(4, struct.pack("<HH", 9, 9) + text(b"/attitude", b"cdr", b""))
    codec, values = Codec(replace(ATTITUDE, frame_id=frame)), tuple(RUN["attitude"][0])
    told = (codec.encode(k * 10_000_000, values) for k in range(count)[::step])
    head = struct.pack("<HIQQ", 9, 0, 0, 0)
    return schema + channel + b"".join(record(5, head + data) + behind for data in told)


def many_topics(part: int) -> bytes:
    keys = TOPICS[::part]
    said = (struct.pack("<HH", key, 9) + text(f"/{key}".encode(), b"cdr", b"") for key in keys)
    return attitudes(125_000 // part) + b"".join(record(4, each) for each in said)


@pytest.mark.parametrize(
    "records",
    [
        pytest.param(lambda part: attitudes(20_000 // part, record(0x80, b"")), id="interrupted"),
        pytest.param(
            lambda part: chunk(b"", len(it := attitudes(100_000 // part, record(0x80, b""))), it),
            id="interrupted in a chunk",
        ),
        pytest.param(many_topics, id="many topics"),
        pytest.param(lambda part: attitudes(16_000 // part, step=-1), id="backwards"),
    ],
)
def test_time_grows_with_the_bag_and_not_faster(
    records: Callable[[int], bytes], tmp_path: Path
) -> None:
    spent = {4: math.inf, 1: math.inf}  # the least of several: other processes only add to it
    for part in (4, 4, 1, 4, 1):
        if spent[1] < 8 * spent[4] < math.inf:  # in proportion 4 times, with the square 16 times
            return
        (tmp_path / "bag.mcap").write_bytes(b"\x89MCAP0\r\n" + records(part))
        before = time.process_time()
        read_run(tmp_path / "bag.mcap")
        spent[part] = min(spent[part], time.process_time() - before)
    assert spent[1] < 8 * spent[4], spent
