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

"""Files of strangers: opened, measured and unpacked before anything else sees them."""

import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import lz4.frame
import zstandard

from ppc_attitude.bags.errors import BagError

# A compressed file may become so many times its size on disk, and so much more [B].
UNFOLDS, SMALL = 100, 16 * 2**20
_PIECE = 2**20
_LARGEST_WINDOW = 2**31  # [B] of zstd: a frame that was packed in one call is a single window
_KINDS = {stat.S_IFLNK: "a symbolic link", stat.S_IFIFO: "a FIFO", stat.S_IFDIR: "a folder"}


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
