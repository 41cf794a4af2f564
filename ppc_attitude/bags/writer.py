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

"""Recording a run as a rosbag2 bag that survives a kill.

The bag is rosbag2 format version 9, as rosbags writes it. Until it is closed the folder holds no
``metadata.yaml`` but ``unfinished.json``, with the custom data that rosbags would only write at the
end: so a reader can tell a cut recording from a complete one.
"""

import contextlib
import errno
import os
import shutil
import sqlite3
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import WriterError
from rosbags.typesys import TypesysError

from ppc_attitude.bags.changes import jazzy
from ppc_attitude.bags.custom_data import UNFINISHED, claim, write_unfinished
from ppc_attitude.bags.errors import BagError, shortened
from ppc_attitude.bags.storage import PLUGINS, KillSafeWriter

FLUSH_PERIOD = 0.5  # [s]; at most a second may be lost, so twice as often

_GONE = "its folder or a file of it was moved or removed"
_FOREVER = QosTime(9223372036, 854775807)


def offered_qos(
    reliability: str = "RELIABLE", durability: str = "VOLATILE", depth: int = 10
) -> Qos:
    """QoS, as a bag describes it, of a publisher that keeps the last messages; no deadlines."""
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        QosReliability[reliability],
        QosDurability[durability],
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        False,
    )


class BagWriter:
    """Writer of one bag, in a folder that must not exist yet; any thread may call it.

    The custom data are facts about the run, made by `custom_data.encode_custom_data`.

    Raises
    ------
    BagError
        The folder exists or cannot be made, or the storage is unknown.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        storage: str = "mcap",
        custom_data: Mapping[str, str] | None = None,
    ) -> None:
        self.path = Path(path)
        if storage not in PLUGINS:
            raise BagError(f"storage is {storage!r}, allowed are {', '.join(PLUGINS)}")
        self._lock = threading.Lock()
        self._refusal = ""  # why nothing can be written; empty if it can
        self._flush_is_due = False
        self._connections: dict[str, Connection] = {}
        try:
            self._writer = KillSafeWriter(self.path, version=9, storage_plugin=PLUGINS[storage])
            self._writer.open()
            assert self._writer.storage is not None
            self._file = self._writer.storage.path
            self._claim = claim(self.path)
            for key, value in (custom_data or {}).items():
                self._writer.set_custom_data(key, value)
            write_unfinished(self.path, self._writer.custom_data)
        except WriterError as error:
            raise BagError(f"bag {self.path}: {error}") from error
        except (OSError, sqlite3.Error) as error:
            shutil.rmtree(self.path, ignore_errors=True)  # it was made here, and is in the way
            raise BagError(f"bag {self.path} cannot be made: {_reason(error)}") from error
        self._closed = threading.Event()
        self._clock = threading.Thread(target=self._flush_regularly, name="bag", daemon=True)
        self._clock.start()

    @staticmethod
    def knows(msgtype: str) -> bool:
        """True if messages of a type can be written: it is a ROS 2 Jazzy type."""
        return msgtype in jazzy().fielddefs

    def add_topic(self, topic: str, msgtype: str, offered_qos: Sequence[Qos] = ()) -> None:
        """Announce a topic by absolute name and ROS type, with what each of its publishers offers.

        Raises
        ------
        BagError
            The topic is there already, its type is no ROS 2 Jazzy type, or writing failed.
        """
        with self._writing():
            if topic in self._connections:
                raise BagError(f"bag {self.path} has topic {topic} already")
            try:
                self._connections[topic] = self._writer.add_connection(
                    topic, msgtype, typestore=jazzy(), offered_qos_profiles=offered_qos
                )
            except (TypesysError, KeyError) as error:
                raise BagError(
                    f"{shortened(msgtype)!r}, the type of {topic}, is no type of ROS 2 Jazzy"
                ) from error

    def write(self, topic: str, receive_time_ns: int, data: bytes) -> None:
        """Append a message, as CDR, to a topic that was announced; it was received at a time [ns].

        Raises
        ------
        BagError
            The topic or the time is not allowed, the bag is closed, or writing failed (disk
            full); what was written before can still be read.
        """
        if receive_time_ns < 0:
            raise BagError(f"receive time of {topic} is {receive_time_ns} ns, allowed are >= 0")
        with self._lock:  # as in `_writing`, whose price every message would pay
            if self._refusal:
                raise BagError(self._refusal)
            connection = self._connections.get(topic)
            if connection is None:
                raise BagError(f"topic {topic} was not announced to bag {self.path}")
            try:
                self._writer.write(connection, receive_time_ns, data)
                if self._flush_is_due:
                    self._flush()
            except (OSError, sqlite3.Error) as error:
                raise self._fail(error) from error

    def set_custom_data(self, key: str, value: str) -> None:
        """State one more fact about the run; kept even if the recorder is killed.

        Raises
        ------
        BagError
            The bag is closed or writing failed.
        """
        with self._writing():
            self._writer.set_custom_data(key, value)
            write_unfinished(self.path, self._writer.custom_data)

    def flush(self) -> None:
        """Make everything written so far safe from a kill; happens by itself every `FLUSH_PERIOD`.

        Raises
        ------
        BagError
            The bag is closed or writing failed.
        """
        with self._writing():
            self._flush()

    def close(self) -> None:
        """Finish the bag: index, ``metadata.yaml``. Closing twice is harmless.

        Raises
        ------
        BagError
            Writing failed, now or earlier: the bag can be read, but is cut.
        """
        if self._closed.is_set():
            return
        self._closed.set()
        self._clock.join()
        try:
            with self._writing():
                self._writer.close()
                (self.path / UNFINISHED).unlink()
                self._refusal = f"bag {self.path} is closed"
        finally:
            os.close(self._claim)

    def __enter__(self) -> "BagWriter":
        """Return self; unlike rosbags' writer it keeps the bag when an exception passes."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Finish the bag; an exception on its way keeps precedence over a failure to do so."""
        with contextlib.suppress(BagError) if kind else contextlib.nullcontext():
            self.close()

    def _flush_regularly(self) -> None:
        """Keep the promise when messages come slowly or not at all."""
        while not self._closed.wait(FLUSH_PERIOD):
            # A writer in full flow may never leave us the lock: then it flushes at this sign.
            self._flush_is_due = True
            with contextlib.suppress(BagError), self._writing():
                if self._flush_is_due:
                    self._flush()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Write alone, into a bag that is open; end for good where that fails."""
        with self._lock:
            if self._refusal:
                raise BagError(self._refusal)
            try:
                yield
            except (OSError, sqlite3.Error) as error:
                raise self._fail(error) from error

    def _flush(self) -> None:
        self._flush_is_due = False
        self._writer.flush()
        # The system goes on writing into a file that was moved or removed, without an error.
        if self._is_gone():
            raise FileNotFoundError(errno.ENOENT, _GONE)

    def _is_gone(self) -> bool:
        return not (self._file.exists() and (self.path / UNFINISHED).exists())

    def _fail(self, error: Exception) -> BagError:
        """Stop recording for good and leave what is on disk as it is."""
        reason = _GONE if self._is_gone() else _reason(error)  # SQLite calls it read-only then
        self._refusal = (
            f"bag {self.path} cannot be written any further: {reason}; "
            f"what was on disk before can be read"
        )
        with contextlib.suppress(OSError, sqlite3.Error):
            self._writer.abort()
        return BagError(self._refusal)


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
