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

"""Bags that strangers send: they read nothing but themselves, and delete and overwrite nothing."""

import os
import shutil
import struct
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from bag_helpers import assert_same, database_of, hot, storage_file, unfinished
from conftest import Ask
from matplotlib.figure import Figure
from synthetic import normal_run

from ppc_attitude.analysis.drawing import save
from ppc_attitude.analysis.page import write_page
from ppc_attitude.bags.custom_data import PARAMETERS_KEY, decode_custom_data, read_run_info
from ppc_attitude.bags.errors import BagError, printable
from ppc_attitude.bags.export import export_csv, export_parquet
from ppc_attitude.bags.reader import read_run
from ppc_attitude.bags.recover import recover
from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.bags.sqlite_source import settle
from ppc_attitude.bags.writer import BagWriter
from ppc_attitude.science.errors import ConfigurationError

RUN = normal_run(duration=1.0)


def name_super_journal(journal: Path, named: Path) -> None:
    """Let SQLite believe that the transaction is one of several files', listed in the one named."""
    page = struct.unpack(">I", journal.read_bytes()[24:28])[0]
    name = str(named).encode()
    with journal.open("ab") as file:
        file.write(struct.pack(">I", 2**30 // page + 1) + name)
        file.write(struct.pack(">II", len(name), sum(name)))
        file.write(bytes.fromhex("d9d505f920a163d7"))


@pytest.mark.parametrize("finished", [False, True])
@pytest.mark.parametrize("command", [read_run, recover])
def test_a_journal_deletes_no_file_that_it_names(
    tmp_path: Path, finished: bool, command: Callable[[Path], object]
) -> None:
    bag, journal = hot(tmp_path, RUN, finished)
    mine = tmp_path / "thesis.tex"
    mine.write_text("years of work")
    name_super_journal(journal, mine)
    with pytest.raises(BagError, match=r"|the unfinished transaction in .*-journal was left aside"):
        command(bag)
        raise BagError("")
    assert mine.read_text() == "years of work"


@pytest.mark.parametrize("change", ["", "PRAGMA synchronous=OFF", "PRAGMA locking_mode=EXCLUSIVE"])
def test_what_is_undone_is_what_sqlite_would_undo(tmp_path: Path, change: str) -> None:
    bag, journal = hot(tmp_path, RUN, change=change)
    theirs = tmp_path / "theirs"
    shutil.copytree(bag, theirs)
    with database_of(theirs) as database:
        database.execute("SELECT count(*) FROM messages").fetchone()
    before = storage_file(bag).read_bytes()
    assert_same(read_run(bag), RUN)
    assert storage_file(bag).read_bytes() == before and journal.exists()
    (tmp_path / "work").mkdir()
    settle(storage_file(bag), tmp_path / "work")
    assert storage_file(bag).read_bytes() == storage_file(theirs).read_bytes() != before
    assert not journal.exists()


def test_a_journal_makes_no_file_larger_than_both(tmp_path: Path) -> None:
    bag, journal = hot(tmp_path, RUN)
    with journal.open("r+b") as file:
        file.seek(16)  # how many pages the database had
        file.write(struct.pack(">I", 2**20))
    with pytest.raises(BagError, match=r"would make it larger than \d+ bytes"):
        read_run(bag)


def test_a_log_beside_no_database_is_told(tmp_path: Path) -> None:
    for name in ("bag.db3", "bag.db3-wal"):
        (tmp_path / name).write_bytes(b"whatever" * 100)
    with pytest.raises(BagError, match=r"bag\.db3 cannot be read as a rosbag2 database"):
        read_run(tmp_path)


def test_a_journal_beside_a_finished_bag_is_not_its_own(tmp_path: Path) -> None:
    write_run(RUN, tmp_path / "bag", storage="sqlite3")
    for kind in ("-journal", "-wal"):
        journal = Path(f"{storage_file(tmp_path / 'bag')}{kind}")
        journal.write_bytes(b"whatever")
        read = read_run(tmp_path / "bag")
        assert_same(read, RUN)
        assert f"the unfinished transaction in bag.db3{kind} was left aside" in read.warnings[0]
        assert journal.read_bytes() == b"whatever"
        journal.unlink()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            "CREATE VIEW messages AS SELECT id, topic_id, timestamp, data FROM stored",
            "messages is a view",
        ),
        (
            "CREATE VIEW Messages(id, topic_id, timestamp, data) AS WITH RECURSIVE n(i) AS "
            "(SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i, 1, i, zeroblob(1e9) FROM n",
            "messages is a view",
        ),
        (
            "CREATE VIRTUAL TABLE messages USING fts4(id, topic_id, timestamp, data)",
            "messages is a virtual table",
        ),
        (
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, "
            "data AS (zeroblob(1e9)))",
            "column data of table messages is not declared as rosbag2 does",
        ),
        (
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, "
            "data DEFAULT x'00')",
            "column data of table messages is not declared as rosbag2 does",
        ),
        (
            "CREATE TABLE messages(id, topic_id, timestamp, data)",
            "column id of table messages is not declared as rosbag2 does",
        ),
        ("CREATE TABLE messages(id INTEGER PRIMARY KEY)", "has no column data, timestamp, topic"),
    ],
)
def test_rows_that_do_not_lie_in_the_file_are_refused(
    tmp_path: Path, change: str, message: str
) -> None:
    write_run(RUN, tmp_path / "bag", storage="sqlite3")
    with database_of(tmp_path / "bag") as database:
        database.executescript(f"ALTER TABLE messages RENAME TO stored; {change};")
    with pytest.raises(BagError, match=f"cannot be read as a rosbag2 database: .*{message}"):
        read_run(tmp_path / "bag")


@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize(
    ("put", "kind"),
    [
        (lambda place: place.symlink_to("bag"), "a symbolic link"),
        (os.mkfifo, "a FIFO"),
        (Path.mkdir, "a folder"),
    ],
)
def test_what_is_no_plain_file_is_refused_by_name(
    tmp_path: Path, storage: str, finished: bool, put: Callable[[Path], None], kind: str
) -> None:
    bag = tmp_path / "bag"
    write_run(RUN, bag, storage=storage) if finished else unfinished(bag, storage, RUN)
    file = storage_file(bag).name
    names = [file, "metadata.yaml"] if finished else [file, "unfinished.json"]
    if storage == "sqlite3" and not finished:
        names += [f"{file}-journal", f"{file}-wal"]
    for name in names:
        changed = shutil.copytree(bag, tmp_path / f"without {name}")
        (changed / name).unlink(missing_ok=True)
        put(changed / name)
        with pytest.raises(BagError, match=f"{name} is {kind}, allowed are plain files"):
            read_run(changed)


def test_a_file_of_holes_is_refused_by_name(tmp_path: Path, storage: str) -> None:
    bag = unfinished(tmp_path / "bag", storage, RUN)
    names = [storage_file(bag).name]
    if storage == "sqlite3":
        names += [f"{names[0]}-journal", f"{names[0]}-wal"]
    for name in names:
        place = bag / name
        place.touch()
        size = place.stat().st_size
        os.truncate(place, 2**40)
        with pytest.raises(
            BagError, match=f"{name} is a sparse file: .* bytes of holes; allowed: 16777216"
        ):
            read_run(bag)
        os.truncate(place, size)
        if not size:
            place.unlink()


@pytest.mark.parametrize("export", [export_csv, export_parquet])
def test_an_export_follows_no_link(tmp_path: Path, export: Callable[[object, Path], None]) -> None:
    if export is export_parquet:
        pytest.importorskip("pyarrow")
    mine = tmp_path / "thesis.tex"
    for there in (True, False):
        if there:
            mine.write_text("years of work")
        (tmp_path / "run").symlink_to(mine)
        with pytest.raises(BagError, match="run exists already"):
            export(RUN, tmp_path / "run")
        assert not there or mine.read_text() == "years of work"
        mine.unlink(missing_ok=not there)
        assert not mine.exists() and (tmp_path / "run").is_symlink()
        (tmp_path / "run").unlink()


@pytest.mark.parametrize(
    ("write", "name"),
    [
        (partial(export_csv, RUN), "run.csv"),
        (lambda path: write_page(path, title="", date="", body=()), "page.html"),
        (partial(save, Figure()), "figure.png"),
    ],
)
def test_what_is_written_replaces_a_link_and_leaves_what_is_behind_it(
    tmp_path: Path, write: Callable[[Path], object], name: str
) -> None:
    mine = tmp_path / "thesis.tex"
    mine.write_text("years of work")
    (tmp_path / f"{name}.unfinished").symlink_to(mine)
    if name != "run.csv":  # an export replaces nothing
        (tmp_path / name).symlink_to(mine)
    write(tmp_path / name)
    assert mine.read_text() == "years of work"
    names = {"thesis.tex", name, f"{name}.unfinished"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert not (tmp_path / name).is_symlink()


def test_a_recovery_deletes_and_overwrites_nothing_but_its_own(tmp_path: Path) -> None:
    bag = unfinished(tmp_path / "bag", "mcap", RUN)
    storage_file(bag).rename(bag / "theirs.mcap")
    named = "rosbag2_bagfile_information: {message_count: 1, relative_file_paths: [theirs.mcap]}"
    (bag / "metadata.yaml").write_text(named)
    (bag / "bag.mcap").write_text("years of work")
    (bag / "unfinished.tex").write_text("years of work")
    with pytest.raises(BagError, match=r"bag\.mcap exists already and is not of this bag"):
        recover(bag)
    assert (bag / "bag.mcap").read_text() == "years of work"
    (bag / "bag.mcap").unlink()
    recover(bag)
    assert (bag / "unfinished.tex").read_text() == "years of work"


def test_a_recovery_follows_no_link(tmp_path: Path) -> None:
    bag = unfinished(tmp_path / "bag", "mcap", RUN)
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thesis.tex").write_text("years of work")
    (bag / ".recovering").symlink_to(mine)
    with pytest.raises(BagError, match=r"\.recovering exists already"):
        recover(bag)
    assert (mine / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize("value", ["[]", "{}", "null", "NaN", "1e400"])
def test_a_parameter_that_no_node_can_have_is_left_out(value: str) -> None:
    said = f'{{"spacecraft_plant": {{"plant": {value}, "max_torque": {value}, '
    said += '"wait_for": "nobody", "mine": 1}}'  # not a list of names
    facts = decode_custom_data({PARAMETERS_KEY: said}, "")
    assert facts.parameters == {"spacecraft_plant": {"mine": 1}}
    assert len(facts.flaws) == 3
    assert "the bag's parameters of spacecraft_plant cannot be used: plant = " in facts.flaws[1]


@pytest.mark.parametrize(
    "text",
    [
        "{}[}",
        "[]",
        '{"samples": [1]}',
        '{"samples": {"a": [[1]]}}',
        '{"metadata": "a"}',
        '{"parameters": {"a": 1}}',
        f'{{"parameters": {"[" * 3000}}}',
    ],
)
def test_facts_for_the_recorder_have_the_types_that_it_relies_on(text: str) -> None:
    told = r"run_info: .* = .*; allowed: an object|not JSON|allowed: a JSON object"
    with pytest.raises(ConfigurationError, match=told):
        read_run_info(text)


STEERING = "\x1b]0;owned\x07\x1b[2J\u202e\x9b<script>alert(1)</script>"


@pytest.mark.usefixtures("undrawn")
def test_what_steers_a_terminal_or_a_page_is_escaped(tmp_path: Path, ask: Ask) -> None:
    nodes = {f"{STEERING}": {STEERING: [STEERING]}, "ppc_controller": {"controller": STEERING}}
    run = replace(
        RUN, controller=STEERING, parameters=nodes, metadata={STEERING: STEERING, "seed": STEERING}
    )
    bag = tmp_path / "bag"
    write_run(run, bag)
    storage_file(bag).rename(bag / f"{STEERING.replace('/', '')}.mcap")
    (bag / "metadata.yaml").write_text(f'a: "{STEERING}')
    (bag / "unfinished.json").write_text(f'{{"{STEERING}')
    page = tmp_path / "page.html"
    told = ask("analyse", bag, "--report", page)
    assert read_run(bag).controller == printable(STEERING) != STEERING
    with BagWriter(tmp_path / "chatter") as writer:
        writer.add_topic(f"/{STEERING}", "std_msgs/msg/String")
        writer.write(f"/{STEERING}", 1, b"")
    nothing = ask("analyse", tmp_path / "chatter", code=2)
    unknown = ask("replay", bag, code=2)
    assert "x1b" in told.err + nothing.err + unknown.err
    for text in (*told, *nothing, *unknown, page.read_text()):
        assert not set(text) & set("\x1b\x07\u202e\x9b")
    assert "<script>alert" not in page.read_text()
