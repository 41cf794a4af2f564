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

"""Messages of a rosbag2 SQLite file, finished or cut, in bulk.

SQLite opens a file of a stranger only to read, and a finished one as immutable: then it looks at
no other file. A journal may name a further file, which SQLite would read and delete: such a one is
left aside. What a killed writer left half done SQLite undoes in a private copy.
"""

import contextlib
import os
import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import quote

import numpy as np

from ppc_attitude.bags.custom_data import custom_data_in
from ppc_attitude.bags.errors import BagError, shortened
from ppc_attitude.bags.source import Block, Channel, Integers, Source, demand_plain, plain_file

_FUNCTIONS = {"group_concat", "length", "typeof"}
_ANY = "TRUE"
_GOOD = (
    "typeof(topic_id) = 'integer' AND typeof(timestamp) = 'integer' AND typeof(data) = 'blob' "
    "AND topic_id IN (SELECT id FROM topics)"
)
_BELOW_ALL_IDS = -(2**63)
_ROWS = 1_000  # of a block
_MOST_BYTES = 8 * 2**20  # of a block that has several messages
_SMALLEST_ROW = 4  # bytes of it beside the message
_JOURNAL, _WAL, _INDEX_OF_WAL = "-journal", "-wal", "-shm"
# What a damaged file makes the sqlite3 module raise, in the rows as well as in the schema.
_DAMAGE = (sqlite3.Error, TypeError, ValueError, OverflowError, KeyError, MemoryError)
_METADATA = "metadata"  # this table is younger than the others
_TABLES = {
    "messages": {"id", "topic_id", "timestamp", "data"},
    "topics": {"id", "name", "type", "serialization_format"},
    _METADATA: {"id", "metadata"},
}
# https://www.sqlite.org/fileformat2.html#the_rollback_journal: it ends a name, and begins a header
_JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")


class SqliteSource(Source):
    """A SQLite file; nobody writes a finished one any more, so no journal belongs to it."""

    def __init__(self, path: Path, finished: bool) -> None:
        super().__init__(path)
        self._held = 0
        self._is_settled = finished  # nobody writes it any more
        self._database = self._open(finished)
        try:
            ((encoding,),) = self._database.execute("PRAGMA encoding")
            if encoding != "UTF-8":  # `_block` passes messages through texts
                raise ValueError(f"its encoding is {encoding}, allowed is UTF-8")
            for table in _TABLES.keys() - {_METADATA}:
                _demand_table(self._database, table)
            self.channels = self._read_channels()
        except _DAMAGE as error:
            self._database.close()
            why = f"cannot be read as a rosbag2 database: {_told(error)}"
            raise BagError(f"{path} {why}") from error
        self._read_metadata()

    def blocks(self) -> Iterator[Block]:
        """Messages in the order of the file.

        The database is locked only while a block is fetched: a reader that takes its time must
        not keep a recorder from writing.
        """
        last = _BELOW_ALL_IDS
        with contextlib.closing(self._database):
            for which in (_ANY, _GOOD):  # the check of each message takes longer: it comes second
                try:
                    while block := self._block(last, which):
                        last, found = block
                        yield found
                    return
                except _DAMAGE as error:
                    self._flaw(f"{self.path.name} is damaged: {_told(error)}")

    def _block(self, last: int, which: str) -> tuple[int, Block] | None:
        """Fetch messages behind an id as one block, and the id of the last; None if there are none.

        SQLite joins them, which costs less than rows. The sizes are fetched first: in a forged file
        all messages may hold the same large part.
        """
        where = "" if last == _BELOW_ALL_IDS else f" after message {last}"
        behind = f"FROM messages WHERE id > {last} AND {which} ORDER BY id LIMIT"
        numbers = [
            _integers(text or "")
            for text in self._database.execute(
                "SELECT group_concat(id), group_concat(topic_id), group_concat(timestamp), "
                "group_concat(size) FROM "
                f"(SELECT id, topic_id, timestamp, length(data) AS size {behind} {_ROWS})"
            ).fetchone()
        ]
        if len({each.size for each in numbers}) > 1:
            told = "lacks a part, or has a topic or time that is no integer"
            raise ValueError(f"a message{where} {told}")
        if not numbers[0].size:
            return None
        count = max(1, int(np.searchsorted(np.cumsum(numbers[3]), _MOST_BYTES)))
        ids, channel, time, length = (each[:count] for each in numbers)
        size = int(length.sum())
        held = self._held + size + _SMALLEST_ROW * ids.size
        self._demand_room(held)
        if ids[0] <= last or (ids[1:] <= ids[:-1]).any():
            raise ValueError(f"messages{where} are out of order")
        (data,) = self._database.execute(
            f"SELECT CAST(group_concat(data, '') AS BLOB) FROM (SELECT data {behind} {ids.size})"
        ).fetchone()
        if len(data) != size:
            raise ValueError(f"a message{where} has another length than it says")
        topics = set(channel.tolist())
        if not self.channels.keys() >= topics:
            # A recorder may have met another topic meanwhile.
            self.channels = self._read_channels()
        for unknown in topics - self.channels.keys():
            raise ValueError(f"message of topic {unknown}, which is not defined")
        self._held = held
        offset = np.cumsum(length) - length
        return int(ids[-1]), Block(np.frombuffer(data, np.uint8), channel, time, offset, length)

    def _demand_room(self, held: int) -> None:
        """Refuse rows of which several lie at the same place of a forged file."""
        if held > self._size and not self._is_settled:
            self._size = self.path.stat().st_size  # a recorder may have gone on
        if held > self._size:
            raise ValueError(f"its rows claim more than the {self._size} bytes of the file")

    def _read_channels(self) -> dict[int, Channel]:
        names = [row[1] for row in self._database.execute("PRAGMA table_xinfo(topics)")]
        qos = "offered_qos_profiles" if "offered_qos_profiles" in names else "''"
        channels, held = {}, 0
        query = f"SELECT id, name, type, {qos} FROM topics"
        for key, *texts in self._database.execute(query):
            if not all(isinstance(text, str) for text in texts):
                raise ValueError(f"topic {key} has a name, type or QoS that is no text")
            held += len("".join(texts))
            self._demand_room(held)
            channels[key] = Channel(*texts)
        return channels

    def _read_metadata(self) -> None:
        """Take the custom data from the file's copy of ``metadata.yaml``, if it has one."""
        if self._database.execute(f"PRAGMA table_xinfo({_METADATA})").fetchone() is None:
            return
        try:
            _demand_table(self._database, _METADATA)
            newest = f"SELECT metadata FROM {_METADATA} ORDER BY id DESC LIMIT 1"
            for (text,) in self._database.execute(newest):
                self._demand_room(len(text))
                self.custom_data = custom_data_in(text)
        except _DAMAGE as error:
            self._flaw(f"the metadata in {self.path.name} are damaged: {_told(error)}")

    def _open(self, finished: bool) -> sqlite3.Connection:
        path = self.path
        torn = _bytes_of_torn_page(path)
        if torn:
            self._flaw(f"{path.name} ends within a page")
        if left := _left_aside(path, finished):
            self._flaw(f"the unfinished transaction in {left} was left aside")
        copied = bool(torn) or (not finished and _is_half_done(path))
        self._is_settled |= copied
        with TemporaryDirectory() if copied else contextlib.nullcontext() as folder:
            if folder:  # SQLite keeps open what it has opened, so a kill leaves no copy
                path = _settled(path, Path(folder), journals=not finished)
            self._size = path.stat().st_size
            database = _connect(path, self._is_settled)
        database.set_authorizer(_only_reading_of_tables)
        return database


def _integers(text: str) -> Integers:
    """Integers in a text; an empty array if a part of it is no integer."""
    try:
        return np.fromstring(text, np.int64, sep=",")
    except ValueError:
        return np.empty(0, np.int64)


def _told(error: Exception) -> str:
    # A MemoryError says nothing.
    return shortened(error) or "a row claims more memory than there is"


def _connect(path: Path, immutable: bool) -> sqlite3.Connection:
    uri = f"file:{quote(str(path.absolute()))}?mode=ro&immutable={int(immutable)}"
    database = sqlite3.connect(uri, uri=True, check_same_thread=False)
    database.execute("PRAGMA trusted_schema=OFF")
    return database


def _only_reading_of_tables(
    action: int, first: str | None, second: str | None, _database: str | None, view: str | None
) -> int:
    """SQLite's authorizer: no view, trigger, other function, other file."""
    allowed = {
        sqlite3.SQLITE_SELECT: True,
        sqlite3.SQLITE_READ: first in {"sqlite_master", *_TABLES} and view is None,
        sqlite3.SQLITE_PRAGMA: first in {"table_xinfo", "encoding"},
        sqlite3.SQLITE_FUNCTION: second in _FUNCTIONS,
    }
    return sqlite3.SQLITE_OK if allowed.get(action) else sqlite3.SQLITE_DENY


def _demand_table(database: sqlite3.Connection, table: str) -> None:
    """Refuse a table whose rows are not stored in the file but computed when they are read."""
    query = "SELECT type, rootpage FROM sqlite_master WHERE name = ? COLLATE NOCASE"
    for kind, root in database.execute(query, (table,)):
        if kind != "table" or not root:
            raise ValueError(f"{table} is a {kind if kind != 'table' else 'virtual table'}")
    columns = {row[1]: row for row in database.execute(f"PRAGMA table_xinfo({table})")}
    if lacking := _TABLES[table] - columns.keys():
        raise ValueError(f"table {table} has no column {', '.join(sorted(lacking))}")
    for name, (_, _, kind, _, default, key, hidden) in columns.items():
        if hidden or default is not None or (name == "id" and (kind, key) != ("INTEGER", 1)):
            raise ValueError(f"column {name} of table {table} is not declared as rosbag2 does")


def _bytes_of_torn_page(path: Path) -> int:
    """Size of an incomplete last page, the rest of which SQLite would read as zeros."""
    page = int.from_bytes(_head(path)[16:18], "big")
    # The format writes 65536 as 1; a file that is no database may say anything here.
    page = 65536 if page == 1 else page
    return path.stat().st_size % page if page else 0


def _head(path: Path) -> bytes:
    with plain_file(path) as file:
        return file.read(20)


def _is_half_done(path: Path) -> bool:
    """Whether a writer that is gone has left a transaction that is in the file in part."""
    journals = _journals_of(path)
    for each in journals:
        with contextlib.suppress(FileNotFoundError):  # its writer has just ended it
            demand_plain(each)
    if any(each.name.endswith(_WAL) for each in journals) or _head(path)[19:] == b"\x02":
        return True  # to read it in place, SQLite would make a file for its log
    if not journals:
        return False
    try:
        with contextlib.closing(_connect(path, False)) as database:
            database.execute("SELECT count(*) FROM sqlite_master")
    except sqlite3.DatabaseError as error:
        return "readonly" in str(error)  # it would have to undo it first
    return False


def _journals_of(path: Path) -> list[Path]:
    """Files beside a database in which its writer keeps what is not settled."""
    beside = (path.with_name(path.name + suffix) for suffix in (_JOURNAL, _WAL))
    return [each for each in beside if os.path.lexists(each)]


def _left_aside(path: Path, finished: bool) -> str:
    """Name of a journal that is not taken for the file's own."""
    for journal in _journals_of(path):
        if finished or (journal.name.endswith(_JOURNAL) and _names_a_file(journal)):
            return journal.name
    return ""


def _names_a_file(journal: Path) -> bool:
    try:
        with plain_file(journal) as file:
            file.seek(-min(8, os.fstat(file.fileno()).st_size), os.SEEK_END)
            return file.read() == _JOURNAL_MAGIC
    except FileNotFoundError:  # its writer has just ended it
        return False


def _settled(path: Path, folder: Path, *, journals: bool) -> Path:
    """Private copy of a database without what its writer left half done."""
    target = folder / path.name
    complete = False
    while not complete:
        _copy(path, target)
        try:
            for journal in _journals_of(path) if journals else ():
                _copy(journal, folder / journal.name)
            complete = True
        except FileNotFoundError:  # a living writer has ended its journal meanwhile: once more
            shutil.rmtree(folder)
            folder.mkdir()
    for journal in _journals_of(target):
        if journal.name.endswith(_JOURNAL) and _names_a_file(journal):
            journal.unlink()
    most = sum(file.stat().st_size for file in folder.iterdir())
    # If the file is no database, its reader says so.
    with (
        contextlib.suppress(sqlite3.Error),
        contextlib.closing(sqlite3.connect(target)) as database,
    ):
        database.execute("PRAGMA journal_mode=DELETE")
    if target.stat().st_size > most:
        raise BagError(f"the journal beside {path} would make it larger than {most} bytes")
    os.truncate(target, target.stat().st_size - _bytes_of_torn_page(target))
    return target


def _copy(path: Path, target: Path) -> None:
    with plain_file(path) as file, target.open("wb") as copy:
        shutil.copyfileobj(file, copy, 2**20)


def settle(path: Path, folder: Path) -> None:
    """Undo what a killed writer left half done, so that no journal is left beside the file.

    A copy is made in a folder that is empty and on the same file system.

    Raises
    ------
    BagError
        The database cannot be settled.
    """
    try:
        if _is_half_done(path):
            _settled(path, folder, journals=True).replace(path)
    except sqlite3.Error as error:
        raise BagError(f"the unfinished transaction of {path} cannot be undone: {error}") from error
    for suffix in (_JOURNAL, _WAL, _INDEX_OF_WAL):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
