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

"""What both storages share: how a stranger's file is opened and unpacked, and what the reader gets.

Nothing sees such a file before it is known to be plain, and not to unfold into too much. The reader
gets channels, and messages in large blocks.
"""

import errno
import os
import stat
from abc import ABC, abstractmethod
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path
from typing import BinaryIO, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from ppc_attitude.bags.errors import BagError

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

# A compressed file may become so many times its size on disk, and so much more [B].
UNFOLDS, SMALL = 100, 16 * 2**20
_PIECE = 2**20
_LARGEST_WINDOW = 2**31  # [B] of zstd: a frame that was packed in one call is a single window
_KINDS = {stat.S_IFLNK: "a symbolic link", stat.S_IFIFO: "a FIFO", stat.S_IFDIR: "a folder"}
_BLOCK_BYTES = 8 * 2**20
_LONGEST_FLAW = 1_000  # characters


def demand_plain(path: Path) -> None:
    """Refuse a file of a bag that would lead out of it, block or never end.

    Raises
    ------
    BagError
        It is a link, FIFO, device or folder.
    """
    kind = stat.S_IFMT(path.lstat().st_mode)
    if kind != stat.S_IFREG:
        raise BagError(f"{path} is {_KINDS.get(kind, 'a device')}, allowed are plain files")


def plain_file(path: Path) -> BinaryIO:
    """Open a file of a bag to read it (`demand_plain`).

    Raises
    ------
    BagError
        It is no plain file, or has so many holes that it is much larger than what is on disk.
    """
    demand_plain(path)
    file = os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb")
    holes = _holes(file.fileno())
    if holes > SMALL:
        file.close()
        raise BagError(f"{path} is a sparse file: {holes} bytes of holes; allowed: {SMALL}")
    return file


def _holes(descriptor: int) -> int:
    """Bytes of a file that take no place on disk, as far as its file system tells."""
    size = os.fstat(descriptor).st_size
    held = end = 0
    try:
        while end < size:
            start = os.lseek(descriptor, end, os.SEEK_DATA)
            end = os.lseek(descriptor, start, os.SEEK_HOLE)
            held += end - start
    except OSError as error:
        if error.errno != errno.ENXIO:  # which means that nothing but a hole is left
            return 0
    finally:
        os.lseek(descriptor, 0, os.SEEK_SET)
    return size - held


class Allowance:
    """How many bytes the compressed data of a file may still become."""

    def __init__(self, path: Path) -> None:
        self._name = path.name
        self._most = self._left = SMALL + UNFOLDS * path.stat().st_size

    def take(self, count: int) -> None:
        """Allow so many bytes more.

        Raises
        ------
        BagError
            That is more than the size of the file allows.
        """
        self._left -= count
        if self._left < 0:
            raise BagError(
                f"the compressed data of {self._name} unpack to {self._most - self._left} bytes or "
                f"more; allowed: {self._most}, which is {UNFOLDS} times its size and {SMALL}"
            )


def unzstd(source: bytes | memoryview | BinaryIO, allowance: Allowance) -> Iterator[bytes]:
    """Yield the content of a zstd frame piece by piece, as far as it is whole.

    Raises
    ------
    BagError
        It is no zstd frame, or unfolds into too much.
    """
    unpacker = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
    try:
        with unpacker.stream_reader(source) as stream:
            while piece := stream.read(_PIECE):
                allowance.take(len(piece))
                yield piece
    except zstandard.ZstdError as error:
        raise BagError(f"zstd cannot unpack it: {error}") from error


def unlz4(data: bytes | memoryview, size: int, allowance: Allowance) -> bytes:
    """Content of an lz4 frame, as far as it is whole; one byte beyond `size` if it has more.

    Raises
    ------
    BagError
        It is no lz4 frame, or claims too much.
    """
    allowance.take(size)
    try:
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    except RuntimeError as error:
        raise BagError(f"lz4 cannot unpack it: {error}") from error


class Channel(NamedTuple):
    """A topic of a storage file."""

    topic: str
    msgtype: str
    offered_qos: str


class Block(NamedTuple):
    """Consecutive messages, at least one: channel, time of receipt [ns], and place in `data`."""

    data: Bytes
    channel: Integers
    time: Integers
    offset: Integers
    length: Integers


class Source(ABC):
    """A storage file that stays open up to the end of `blocks`, so that a copy may be removed.

    Attributes
    ----------
    channels : dict of int to Channel
        The channel of every message that `blocks` has handed out.
    custom_data : dict of str to str
        What the file says about its run; complete after `blocks`, as the next two are.
    cut : str
        Why the file ends early or lacks something; empty if it is whole.
    damaged : bool
        Whether it may hold more than was read.

    Raises
    ------
    BagError
        The file is empty, or is not of this storage.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.custom_data: dict[str, str] = {}
        self.cut = ""
        self.damaged = False
        self._size = path.stat().st_size  # a bag that is being recorded is read up to here
        if self._size == 0:
            raise BagError(f"{path} is an empty file")

    @abstractmethod
    def blocks(self) -> Iterator[Block]:
        """Messages in the order of the file."""

    def _flaw(self, text: str, *, damaged: bool = True) -> None:
        self.damaged |= damaged
        if text not in self.cut and len(self.cut) < _LONGEST_FLAW:
            self.cut = f"{self.cut}; {text}" if self.cut else text


def merge_blocks(blocks: Iterator[Block]) -> Iterator[Block]:
    """Blocks of some megabytes made of smaller ones, so that the cost of a block does not count."""
    pending: list[Block] = []
    size = 0
    for block in blocks:
        if pending and size + len(block.data) > _BLOCK_BYTES:
            yield _merge(pending)
            pending, size = [], 0
        pending.append(block)
        size += len(block.data)
    if pending:
        yield _merge(pending)


def _merge(blocks: list[Block]) -> Block:
    if len(blocks) == 1:
        return blocks[0]
    starts = [0, *accumulate(len(block.data) for block in blocks[:-1])]
    data, channel, time, _, length = map(np.concatenate, zip(*blocks, strict=True))
    offset = [block.offset + start for block, start in zip(blocks, starts, strict=True)]
    return Block(data, channel, time, np.concatenate(offset), length)


def decompressed(block: Block, allowance: Allowance) -> Block:
    """Block with its messages unpacked, if they are zstd frames, as no message in CDR is.

    Raises
    ------
    BagError
        A frame is damaged, or claims too much.
    """
    frame = zstandard.FRAME_HEADER
    if block.data[block.offset[0] :][: len(frame)].tobytes() != frame:
        return block  # as in nearly every bag, without a look at all
    payloads = [b"".join(unzstd(payload, allowance)) for payload in payloads_of(block)]
    length = np.fromiter(map(len, payloads), np.int64, len(payloads))
    data = np.frombuffer(b"".join(payloads), np.uint8)
    return block._replace(data=data, offset=np.cumsum(length) - length, length=length)


def payloads_of(block: Block) -> list[bytes]:
    """Bytes of each message."""
    data = block.data.tobytes()
    ends = (block.offset + block.length).tolist()
    return [data[a:b] for a, b in zip(block.offset.tolist(), ends, strict=True)]


def split_rows(block: Block) -> Iterator[tuple[int, Integers, Bytes]]:
    """Yield the messages of a block of one channel and length: channel, indices, bytes by row."""
    order = np.lexsort((block.length, block.channel))
    channel, length = block.channel[order], block.length[order]
    borders = np.flatnonzero((np.diff(channel) != 0) | (np.diff(length) != 0)) + 1
    for indices in np.split(order, borders):
        first = indices[0]
        starts = sliding_window_view(block.data, int(block.length[first]))
        yield int(block.channel[first]), indices, starts[block.offset[indices]]
