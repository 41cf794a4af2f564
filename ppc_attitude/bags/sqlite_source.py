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

"""Messages of a rosbag2 SQLite file, finished or cut, in bulk."""

import contextlib
import os
import shutil
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import quote

import numpy as np

from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.source import Block, Channel, block_of

_BELOW_ALL_IDS = -(2**63)
_ROWS = 1_000  # their tuples stay in the processor's cache
_JOURNALS = ("-journal", "-wal")
# What a damaged file makes the sqlite3 module raise, in the rows as well as in the schema.
_DAMAGE = (sqlite3.Error, TypeError, ValueError, OverflowError, KeyError)


class SqliteSource:
    """A SQLite file.

    Parameters
    ----------
    path : Path
        The file.
    times : bool
        Whether blocks say when a message was received; if not, the time is 0 and reading faster.

    Raises
    ------
    BagError
        The file is empty or no rosbag2 database.
    """

    def __init__(self, path: Path, times: bool = True) -> None:
        self.path = path
        self._times = times
        self.custom_data: dict[str, str] = {}
        self.cut = ""
        if path.stat().st_size == 0:
            raise BagError(f"{path} is empty")
        with self._open() as database:
            try:
                self.channels = _channels(database)
            except _DAMAGE as error:
                raise BagError(f"{path} cannot be read as a rosbag2 database: {error}") from error

    def blocks(self) -> Iterator[Block]:
        """Messages in the order of the file.

        The database is locked only while a block is fetched: a reader that takes its time must
        not keep a recorder from writing.
        """
        columns = "id, topic_id, data, timestamp" if self._times else "id, topic_id, data"
        query = f"SELECT {columns} FROM messages WHERE id > ? ORDER BY id LIMIT {_ROWS}"
        last = _BELOW_ALL_IDS
        with self._open() as database:
            try:
                while batch := database.execute(query, (last,)).fetchall():
                    if batch[-1][0] <= last:
                        raise ValueError(f"message {batch[-1][0]} follows message {last}")
                    last = batch[-1][0]
                    yield self._block(database, batch)
            except _DAMAGE as error:
                self.cut = f"{self.path.name} is damaged: {error}"

    def _block(self, database: sqlite3.Connection, rows: list[tuple[Any, ...]]) -> Block:
        channel = [row[1] for row in rows]
        data = [row[2] for row in rows]
        time = [row[3] for row in rows] if self._times else np.zeros(len(rows))
        if not self.channels.keys() >= set(channel):
            self.channels = _channels(database)  # a recorder may have met another topic meanwhile
        for unknown in set(channel) - self.channels.keys():
            raise ValueError(f"message of topic {unknown}, which is not defined")
        return block_of(channel, time, data)

    @contextlib.contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        """Open for reading; what a killed writer left half done is undone in a copy."""
        with contextlib.ExitStack() as stack:
            path, mode = self.path, "ro"
            left = _journals(path)
            torn = 0 if left else _bytes_of_torn_page(path)
            if left or torn:
                folder = Path(stack.enter_context(TemporaryDirectory()))
                _copy(path, folder)
                path, mode = folder / path.name, "rw"
            if torn:
                self.cut = f"{self.path.name} ends within a page"
                os.truncate(path, path.stat().st_size - torn)
            uri = f"file:{quote(str(path.absolute()))}?mode={mode}"
            database = stack.enter_context(
                contextlib.closing(sqlite3.connect(uri, uri=True, check_same_thread=False))
            )
            yield database


def _journals(path: Path) -> list[str]:
    return [journal for journal in _JOURNALS if Path(f"{path}{journal}").exists()]


def _copy(path: Path, folder: Path) -> None:
    """Copy a database with its journals; a living writer may end one meanwhile: then once more."""
    complete = False
    while not complete:
        for old in folder.iterdir():
            old.unlink()
        try:
            for suffix in ("", *_journals(path)):
                shutil.copyfile(f"{path}{suffix}", folder / f"{path.name}{suffix}")
            complete = True
        except FileNotFoundError:
            if not path.exists():
                raise


def _bytes_of_torn_page(path: Path) -> int:
    """Size of an incomplete last page, the rest of which SQLite would read as zeros."""
    with path.open("rb") as file:
        head = file.read(18)
    page = int.from_bytes(head[16:18], "big")
    # The format writes 65536 as 1; the header of no database may say anything.
    page = 65536 if page == 1 else page
    return path.stat().st_size % page if page else 0


def settle(path: Path) -> None:
    """Undo what a killed writer left half done, so that no journal is left beside the file.

    Raises
    ------
    BagError
        The database cannot be opened.
    """
    try:
        with contextlib.closing(sqlite3.connect(path)) as database:
            database.execute("SELECT count(*) FROM topics").fetchone()
    except sqlite3.Error as error:
        raise BagError(f"{path} cannot be settled: {error}") from error


def _channels(database: sqlite3.Connection) -> dict[int, Channel]:
    rows = database.execute("SELECT * FROM topics")
    names = [column[0] for column in rows.description]
    found = [dict(zip(names, row, strict=True)) for row in rows]
    return {row["id"]: _channel(row) for row in found}


def _channel(row: dict[str, object]) -> Channel:
    return Channel(
        str(row["name"]),
        str(row["type"]),
        str(row["serialization_format"]),
        str(row.get("offered_qos_profiles", "")),
    )
