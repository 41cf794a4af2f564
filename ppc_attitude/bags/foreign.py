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
        It is none, or has so many holes that it is much larger than what is on disk.
    """
    demand_plain(path)
    file = os.fdopen(os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK), "rb")
    holes = _holes(file.fileno())
    if holes > SMALL:
        file.close()
        raise BagError(f"{path} has {holes} bytes of holes, allowed are {SMALL}")
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
            That is more than the size of the file lets expect.
        """
        self._left -= count
        if self._left < 0:
            raise BagError(
                f"the compressed data of {self._name} claim {self._most - self._left} bytes, "
                f"allowed are {self._most}: {UNFOLDS} times its size and {SMALL}"
            )


def unzstd(data: bytes | memoryview, allowance: Allowance) -> bytes:
    """Content of one zstd frame.

    Raises
    ------
    BagError
        The bytes are no zstd frame, or claim too much.
    """
    try:
        claimed = zstandard.frame_content_size(data)
        if claimed >= 0:
            allowance.take(claimed)
            return bytes(zstandard.ZstdDecompressor().decompress(data))
        with zstandard.ZstdDecompressor().stream_reader(data) as stream:
            return b"".join(_pieces(stream, allowance))
    except zstandard.ZstdError as error:
        raise BagError(f"damaged zstd data: {error}") from error


def unzstd_file(source: BinaryIO, target: BinaryIO, allowance: Allowance) -> None:
    """Write the content of a zstd file, as far as it is whole, into another one.

    Raises
    ------
    BagError
        The file is no zstd frame, or unfolds into too much.
    """
    try:
        with zstandard.ZstdDecompressor().stream_reader(source) as stream:
            target.writelines(_pieces(stream, allowance))
    except zstandard.ZstdError as error:
        raise BagError(str(error)) from error


def _pieces(stream: zstandard.ZstdDecompressionReader, allowance: Allowance) -> Iterator[bytes]:
    while piece := stream.read(_PIECE):
        allowance.take(len(piece))
        yield piece


def unlz4(data: bytes | memoryview, size: int, allowance: Allowance) -> bytes:
    """Content of one lz4 frame of `size` bytes.

    Raises
    ------
    BagError
        The bytes are no complete lz4 frame, or claim too much.
    """
    allowance.take(size)
    frame = lz4.frame.LZ4FrameDecompressor()
    try:
        content = bytes(frame.decompress(data, max_length=size + 1))
    except RuntimeError as error:
        raise BagError(f"damaged lz4 data: {error}") from error
    if not frame.eof:
        raise BagError(f"damaged lz4 data: the frame does not end after {size} bytes")
    return content
