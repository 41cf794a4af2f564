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

"""CDR, the wire format of ROS messages, for the stamped messages of the contract.

A stamped quaternion, vector or wrench is a time, a frame name and a few float64; an Imu has 37,
and a JointState has names and three lists, of which ours fill one.
Packing and unpacking that with `struct` costs a fiftieth of a generated message class, so the hot
path of every node and the bag reader work on bytes, and this file is the one place that knows them.

Layout after the 4-byte encapsulation header: int32 sec, uint32 nanosec, uint32 length of the
frame name with its NUL, the name, padding to 8, then the float64 values. That is XCDR1, which every
middleware of ROS sends, in either byte order.
"""

import math
import struct
from collections.abc import Sequence
from contextlib import suppress
from operator import itemgetter
from string import ascii_lowercase
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.topics import CLOCK, MSGTYPES, Topic
from ppc_attitude.science.component import (
    FIX,
    GYRO,
    JOINTS,
    MAGNETIC,
    MOTION,
    POINT,
    QUATERNION,
    VECTOR,
    WRENCH,
)
from ppc_attitude.science.stamps import NANOSECONDS

LARGEST = 1e6
"""No rate [rad/s] or torque [N·m] of a spacecraft is larger."""
_MAX_FRAME_ID = 4096
# What each float64 of a message is. A letter stands for a number of the form, in the order of the
# alphabet; "o" is zero, as the force of a wrench, and "-" the −1 of REP 145: there is no such
# quantity. An Imu has orientation, its covariance (9), angular velocity, its covariance, linear
# acceleration, its covariance.
_NONE = "-oooooooo"
_NO_ACCELERATION = "ooo" + _NONE
_LAYOUTS = {
    QUATERNION: "abcd",
    VECTOR: "abc",
    WRENCH: "ooo" + "abc",
    POINT: "abc",
    MAGNETIC: "abc" + "ooooooooo",  # its covariance is not known
    GYRO: "oooo" + _NONE + "abc" + "dooodoood" + _NO_ACCELERATION,
    FIX: "abcd" + "eooofooog" + "ooo" + _NONE + _NO_ACCELERATION,
    MOTION: "abcd" + "efgfhigij" + "klm" + "npqprsqst" + _NO_ACCELERATION,
}
_OF_JOINTS = ascii_lowercase.replace("o", "")  # as many of them as there are parts
_OURS = b"\x00\x01"  # little-endian
_BYTE_ORDERS = {b"\x00\x00": ">", _OURS: "<"}
_LITTLE_ENDIAN = _OURS + b"\x00\x00"
_STAMPS = {order: struct.Struct(f"{order}iI") for order in "<>"}
_STAMP_OFFSET, _AFTER_STAMP = 4, 12
_STAMPED = {*MSGTYPES.values(), CLOCK}


class CdrError(ValueError):
    """The bytes are not a message of the type."""


class Sample(NamedTuple):
    """The content of one stamped message."""

    stamp_ns: int
    frame_id: str
    values: tuple[float, ...]


class Joints(NamedTuple):
    """What the numbers of a JointState are of: parts of one sort, such as wheels."""

    part: str  # name of a part, to which the message appends _ and the part's index
    number: int  # how many parts the message names
    place: int  # list of the message with the numbers: 0 position, 1 velocity, 2 effort


class Reader:
    """Decoder for messages of a type that has `count` float64, of which those at `places` are read.

    They begin behind a header; of a type that is not `stamped`, at once; of a JointState, behind
    the names of `joints`, in the list that these use.
    """

    def __init__(
        self,
        msgtype: str,
        count: int,
        places: Sequence[int],
        *,
        joints: Joints | None = None,
        stamped: bool = True,
    ) -> None:
        self._msgtype, self._count, self._places = msgtype, count, list(places)
        self._joints, self._stamped = joints, stamped
        first, end = self._places[0], self._places[-1] + 1
        adjacent = self._places == [*range(first, end)]
        self._pick = itemgetter(slice(first, end)) if adjacent else itemgetter(*self._places)

    def decode(self, data: bytes) -> Sample:
        """Stamp, frame and numbers of a message in either byte order.

        Raises
        ------
        CdrError
            The bytes are not a message of this type.
        """
        order, length, start = self._layout(data)
        values = self._pick(struct.unpack_from(f"{order}{self._count}d", data, start))
        if not self._stamped:
            return Sample(0, "", values)
        frame_id = data[_AFTER_STAMP + 4 : _AFTER_STAMP + 3 + length].decode(errors="replace")
        return Sample(_stamp(data, order), frame_id, values)

    def decode_rows(
        self, rows: NDArray[np.uint8]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
        """Decode many messages of one length at once, in either byte order.

        Parameters
        ----------
        rows : ndarray of uint8, shape (n, length)
            The bytes of one message in each row; at least one row.

        Returns
        -------
        stamps_ns : ndarray of int64, shape (n,)
            Zero where the type has no stamp.
        values : ndarray of float64, shape (n, width)
        readable : ndarray of bool, shape (n,)
            False where a row is not a message of this type.
        """
        stamps: NDArray[np.int64] = np.zeros(len(rows), np.int64)
        values = np.full((len(rows), len(self._places)), np.nan)
        readable: NDArray[np.bool_] = np.zeros(len(rows), np.bool_)
        with suppress(CdrError):
            order, _, start = self._layout(rows[0].tobytes())
            # Rows with the encoding and the name length of the first have its layout; those of
            # joints with the same names.
            readable = _hold(rows, 0, rows[0, :2].tobytes())
            if self._stamped:
                named = slice(_AFTER_STAMP, start if self._joints else _AFTER_STAMP + 4)
                readable &= _hold(rows, named.start, rows[0, named].tobytes())
                stamps = _stamps_of_rows(rows, order)
            numbers = rows[:, start : start + 8 * self._count].view(order + "f8")
            values[:] = numbers[:, self._places]
        for row in np.flatnonzero(~readable):
            with suppress(CdrError):
                stamps[row], _, values[row] = self.decode(rows[row].tobytes())
                readable[row] = True
        return stamps, values, readable

    def _layout(self, data: bytes) -> tuple[str, int, int]:
        """Byte order, length of the frame name with its NUL, offset of the first float64."""
        if self._joints:
            return _joint_layout(data, self._msgtype, self._joints)
        if self._stamped:
            return _stamped_layout(data, self._msgtype, self._count)
        order = _byte_order(data)
        if len(data) < 4 + 8 * self._count:
            raise CdrError(f"{len(data)} bytes are too few for a {self._msgtype}")
        return order, 0, 4


class Codec(Reader):
    """Encoder and decoder for the messages of one topic: a stamp, a frame name, float64 numbers."""

    def __init__(self, topic: Topic) -> None:
        self.topic = topic
        joints = None
        if topic.form in JOINTS:
            joints = Joints(topic.part, topic.width, JOINTS.index(topic.form))
        layout = _LAYOUTS.get(topic.form, _OF_JOINTS[: topic.width])
        letters = sorted(set(layout) - {"o", "-"})[: topic.width]
        places = [layout.index(letter) for letter in letters]
        super().__init__(topic.msgtype, len(layout), places, joints=joints)
        # From the numbers of a sample, with 0 and −1 behind them, to those of the message; what a
        # sample of fewer numbers than the form leaves over is zero too.
        order = {"-": -1, **{letter: k for k, letter in enumerate(letters)}}
        self._spread = itemgetter(*(order.get(each, -2) for each in layout))
        name = topic.frame_id.encode() + b"\0"
        # All between the stamp and the numbers, and how many bytes are behind them.
        head, behind = _around_joints(name, joints) if joints else (name, 0)
        self._frame = struct.pack("<I", len(name)) + head
        length = len(self._frame)
        self._struct = struct.Struct(f"<4siI{length}s{-length % 8}x{self._count}d{behind}x")
        # Where the parts of our own messages are, for the fast way of `decode`.
        self._frame_end = _AFTER_STAMP + length
        self._numbers = struct.Struct(f"<{self._count}d")
        self._start = self._struct.size - behind - self._numbers.size

    def encode(self, stamp_ns: int, values: Sequence[float]) -> bytes:
        """Bytes of the message with this stamp and these numbers (of a wrench: the torque)."""
        sec, nanosec = divmod(stamp_ns, NANOSECONDS)
        numbers = self._spread((*values, 0.0, -1.0))
        return self._struct.pack(_LITTLE_ENDIAN, sec, nanosec, self._frame, *numbers)

    def decode(self, data: bytes) -> Sample:
        """As `Reader.decode`, in a fast way for messages that look like our own."""
        if (
            len(data) == self._struct.size
            and data[_AFTER_STAMP : self._frame_end] == self._frame
            and data[:2] == _OURS
        ):
            values = self._pick(self._numbers.unpack_from(data, self._start))
            return Sample(_stamp(data, "<"), self.topic.frame_id, values)
        return super().decode(data)

    def force(self, data: bytes) -> tuple[float, ...]:
        """Force of a message, a wrench that `decode` accepts [N]."""
        order, _, start = self._layout(data)
        return struct.unpack_from(f"{order}{self._places[0]}d", data, start)

    def other_frames(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Which messages, a row each as of `decode_rows`, have another frame than the topic."""
        # With the NUL that ends it, so that a longer name is another one.
        return ~_hold(rows, _AFTER_STAMP + 4, self.topic.frame_id.encode() + b"\0")


def _around_joints(name: bytes, joints: Joints) -> tuple[bytes, int]:
    """Frame name, joint names and counts before the numbers of a JointState; bytes behind them."""
    counts = [0] * joints.place + [joints.number]
    name += bytes(-len(name) % 4) + struct.pack("<I", joints.number)
    for k in range(joints.number):
        text = f"{joints.part}_{k}".encode() + b"\0"
        name += struct.pack("<I", len(text)) + text + bytes(-len(text) % 4)
    return name + struct.pack(f"<{len(counts)}I", *counts), 4 * (2 - joints.place)


def _joint_layout(data: bytes, msgtype: str, joints: Joints) -> tuple[str, int, int]:
    """As `_stamped_layout`, of a JointState: where the list that these joints use begins."""
    order, length, _ = _stamped_layout(data, msgtype, 0)
    at = _AFTER_STAMP + 4 + length

    def number() -> int:
        nonlocal at
        at += -at % 4
        if at + 4 > len(data):
            raise CdrError(f"{len(data)} bytes are too few for a {msgtype}")
        (value,) = struct.unpack_from(order + "I", data, at)
        at += 4
        return int(value)

    ours = [f"{joints.part}_{k}".encode() for k in range(joints.number)]
    for k in range(number()):
        text = number()
        name = data[at : at + text].rstrip(b"\0")
        at += text
        if name in ours and ours.index(name) != k:
            raise CdrError(
                f"a {msgtype} with {name.decode()} at place {k}; allowed: {joints.part}s in "
                "their order"
            )
    for _ in range(joints.place + 1):
        count = number()
        start = at + -(at - 4) % 8 if count else at
        at = start + 8 * count
    if count != joints.number:
        raise CdrError(
            f"a {msgtype} for {count} joints; allowed: {joints.number}, one per {joints.part}"
        )
    if at > len(data):
        raise CdrError(f"{len(data)} bytes are too few for a {msgtype}")
    return order, length, start


def _stamped_layout(data: bytes, msgtype: str, count: int) -> tuple[str, int, int]:
    """As `Reader._layout`, of a message that is a header and `count` float64."""
    order = _byte_order(data)
    if len(data) < _AFTER_STAMP + 4:
        raise CdrError(f"{len(data)} bytes are too few for a header")
    (length,) = struct.unpack_from(order + "I", data, _AFTER_STAMP)
    if not 1 <= length <= _MAX_FRAME_ID:
        raise CdrError(f"frame_id of {length} bytes, allowed are 1 to {_MAX_FRAME_ID}")
    end = _AFTER_STAMP + length  # behind the name, counted from behind the encapsulation header
    start = 4 + end + -end % 8
    if len(data) < start + 8 * count:
        raise CdrError(f"{len(data)} bytes are too few for a {msgtype}")
    return order, length, start


def _hold(rows: NDArray[np.uint8], at: int, what: bytes) -> NDArray[np.bool_]:
    """Which messages, a row each, hold the given bytes at a place; compared word by word."""
    size = next(each for each in (8, 4, 2, 1) if each <= len(what))
    if rows.shape[1] < at + len(what):
        return np.zeros(len(rows), np.bool_)
    held = np.ones(len(rows), np.bool_)
    for first in (*range(0, len(what) - size, size), len(what) - size):
        words = rows[:, at + first : at + first + size].view(f"u{size}")[:, 0]
        held &= words == np.frombuffer(what, f"u{size}", 1, first)
    return held


def _stamps_of_rows(rows: NDArray[np.uint8], order: str) -> NDArray[np.int64]:
    """Stamps [ns] of messages that have one, a row each of shape (n, length), in a byte order."""
    stamps = rows[:, 4:8].view(order + "i4")[:, 0].astype(np.int64)
    stamps *= NANOSECONDS
    stamps += rows[:, 8:12].view(order + "u4")[:, 0]
    return stamps


def _stamp(data: bytes, order: str) -> int:
    """Stamp [ns] of a message that has one."""
    sec, nanosec = _STAMPS[order].unpack_from(data, _STAMP_OFFSET)
    return int(sec) * NANOSECONDS + int(nanosec)


def _byte_order(data: bytes) -> str:
    """Byte order of a message that has a stamp."""
    if len(data) < _AFTER_STAMP:
        raise CdrError(f"{len(data)} bytes are too few for a stamp")
    order = _BYTE_ORDERS.get(bytes(data[:2]))
    if order is None:
        raise CdrError(f"encoding 0x{data[:2].hex()} is not plain CDR")
    return order


def encode_clock(stamp_ns: int) -> bytes:
    """Bytes of a rosgraph_msgs/Clock."""
    sec, nanosec = divmod(stamp_ns, NANOSECONDS)
    return struct.pack("<4siI", _LITTLE_ENDIAN, sec, nanosec)


def header_stamp(data: bytes, msgtype: str) -> int | None:
    """Stamp [ns] of a serialised message whose type begins with a header or is a clock.

    None where the type carries no stamp or the bytes are not CDR.
    """
    if msgtype not in _STAMPED:
        return None
    try:
        return _stamp(data, _byte_order(data))  # a header begins as a clock does
    except CdrError:
        return None


def finite(values: tuple[float, ...]) -> bool:
    """True if no number is NaN or infinite."""
    return all(map(math.isfinite, values))
