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

"""A bag's folder, read as one bag: storage files, ``metadata.yaml``, marks."""

import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ppc_attitude.bags.custom_data import METADATA, UNFINISHED, claimed, custom_data_of
from ppc_attitude.bags.errors import BagError, shortened
from ppc_attitude.bags.mcap_source import McapSource
from ppc_attitude.bags.source import (
    Allowance,
    Block,
    Channel,
    Source,
    decompressed,
    demand_plain,
    merge_blocks,
    plain_file,
    unzstd,
)
from ppc_attitude.bags.sqlite_source import SqliteSource
from ppc_attitude.contract.yaml_file import LARGEST, parsed, parsed_json

STORAGES = {".mcap": "mcap", ".db3": "sqlite3"}
"""Suffix of a storage file to the name of its storage."""
_COMPRESSED = ".zstd"
_INFORMATION = "rosbag2_bagfile_information"  # what the metadata hold, by this key


class Bag:
    """A bag to be read: a folder, or one ``.mcap`` or ``.db3`` file.

    Attributes
    ----------
    topics : dict of str to str
        Type of each topic; complete after `blocks`.
    counts : dict of str to int
        Messages of each topic; complete after `blocks`.
    custom_data : dict of str to str
        What the bag says about its run; complete after `blocks`.
    live : bool
        Whether a process was still recording it, or recovering it, when it was opened.
    flaws : list of str
        Why the recording counts as cut; empty for a complete bag; complete after `blocks`.
    damaged : bool
        Whether a copy may lack more than the end that is missing; complete after `blocks`.

    Raises
    ------
    BagError
        There is no bag at this path.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.topics: dict[str, str] = {}
        self.counts: Counter[str] = Counter()
        folder = self.path if self.path.is_dir() else self.path.parent
        self.live = claimed(folder)
        self.flaws: list[str] = []
        self.damaged = False
        self._finished = not self.live and (folder / METADATA).exists()
        try:
            self._information = self._read_information()
            self.files = self._storage_files()
            self.custom_data = custom_data_of(self._information)
        except OSError as error:
            raise BagError(f"{self.path} cannot be read: {error.strerror}") from error

    def blocks(self) -> Iterator[tuple[Mapping[int, Channel], Block]]:
        """Messages in the order of the files, with the channels they refer to.

        Raises
        ------
        BagError
            A file is no storage or cannot be read.
        """
        try:
            for path in self.files:
                allowance = Allowance(path)
                yield from self._blocks_of(self._source(path, allowance), allowance)
        except OSError as error:
            raise BagError(f"{self.path} cannot be read: {error.strerror}") from error
        promised, found = self._information.get("message_count"), self.counts.total()
        if isinstance(promised, int) and promised != found:
            self.damaged |= not self.flaws  # else these explain the difference
            self.flaws.append(f"{METADATA} promises {promised} messages, {found} are there")

    def _blocks_of(
        self, source: Source, allowance: Allowance
    ) -> Iterator[tuple[Mapping[int, Channel], Block]]:
        for raw in merge_blocks(source.blocks()):
            # The metadata, if there are any, also say whether messages are compressed.
            block = decompressed(raw, allowance)
            for key, met in zip(*np.unique(block.channel, return_counts=True), strict=True):
                self.counts[source.channels[int(key)].topic] += int(met)
            yield source.channels, block
        for channel in source.channels.values():
            msgtype = self.topics.setdefault(channel.topic, channel.msgtype)
            self.damaged |= msgtype != channel.msgtype  # a copy would have only one of both types
            self.counts.setdefault(channel.topic, 0)
        if source.cut:
            self.flaws.append(source.cut)
        self.damaged |= source.damaged
        self.custom_data = {**source.custom_data, **self.custom_data}

    def _source(self, path: Path, allowance: Allowance) -> Source:
        """Storage file; where rosbag2 has compressed it whole, a copy."""
        if path.suffix != _COMPRESSED:
            return _opened(path, allowance, self._finished)
        with TemporaryDirectory() as folder:  # gone before a message is read: a kill leaves none
            plain = Path(folder) / path.stem
            try:
                with plain_file(path) as compressed, plain.open("wb") as target:
                    target.writelines(unzstd(compressed, allowance))
            except BagError as error:
                self._damage(f"{path.name} is damaged: {error}")
            try:
                return _opened(plain, allowance, finished=True)
            except BagError as error:  # names the copy
                raise BagError(str(error).replace(str(plain), str(path))) from error

    def _read_information(self) -> dict[str, Any]:
        """Take what ``metadata.yaml`` says, or else the mark of an unfinished bag; or nothing."""
        if not self.path.exists():
            raise BagError(f"{self.path} does not exist")
        if self.path.is_file():
            return {}
        found: Any = None
        if os.path.lexists(self.path / METADATA):
            found = self._content(METADATA, lambda text: dict(parsed(text)[_INFORMATION]))
        else:
            self.flaws.append(f"it has no {METADATA}")
        if not found and os.path.lexists(self.path / UNFINISHED):
            found = self._content(UNFINISHED, parsed_json)
        return found if isinstance(found, dict) else {}

    def _content(self, name: str, read: Callable[[str], Any]) -> Any:
        """What a file beside the messages says; None, and a flaw, if it is damaged."""
        with plain_file(self.path / name) as opened:
            content = opened.read(LARGEST + 1)
        try:
            return read(content.decode())
        except (TypeError, KeyError, ValueError) as error:
            self._damage(f"its {name} is damaged: {shortened(error)}")
            return None

    def _damage(self, text: str) -> None:
        self.flaws.append(text)
        self.damaged = True

    def _storage_files(self) -> list[Path]:
        if self.path.is_file():
            demand_plain(self.path)
            if _kind(self.path) not in STORAGES:
                raise BagError(f"{self.path} is no bag; allowed: a folder, or a file .mcap or .db3")
            return [self.path]
        named = self._information.get("relative_file_paths")
        if isinstance(named, list) and named:
            files = {self.path / Path(str(name)).name: None for name in named}
            lost = [file.name for file in files if not os.path.lexists(file)]
            if lost:
                self._damage(f"{', '.join(map(shortened, lost))} is missing")
            found = [file for file in files if file.name not in lost and _kind(file) in STORAGES]
        else:
            found = sorted(
                (file for file in self.path.iterdir() if _kind(file) in STORAGES), key=_natural
            )
        if not found:
            held = sorted(each.name for each in self.path.iterdir())
            what = "is no bag: it holds no .mcap or .db3 file" if held else "is an empty folder"
            if others := [name for name in held if _kind(Path(name)) in STORAGES]:
                lacks = ", ".join(map(shortened, named or ()))
                what = f"lacks {lacks} of its {METADATA}, and holds {', '.join(others)}"
            raise BagError(f"{self.path} {what}")
        for file in found:
            demand_plain(file)
        return found


def _opened(path: Path, allowance: Allowance, finished: bool) -> Source:
    return McapSource(path, allowance) if path.suffix == ".mcap" else SqliteSource(path, finished)


def _kind(path: Path) -> str:
    return Path(path.stem).suffix if path.suffix == _COMPRESSED else path.suffix


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key that puts bag_10 behind bag_9."""
    return [(int(part or 0), text) for text, part in re.findall(r"(\D*)(\d*)", path.name)]
