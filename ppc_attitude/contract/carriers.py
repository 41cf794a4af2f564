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

"""Message types in bags of others that carry the same quantity as a topic of the contract."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.cdr import CdrError, Codec, byte_order, stamped_layout, stamps_of_rows
from ppc_attitude.contract.topics import MSGTYPES, Topic
from ppc_attitude.science.component import GYRO, MAGNETIC, POINT, QUATERNION, VECTOR, WRENCH

Rows = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]


class _Layout(NamedTuple):
    """How many float64 a type holds in all, and where among them those of a form begin.

    One of them may be −1 to say that there is no such quantity (REP 145).
    """

    size: int
    first: int
    absent: int | None = None


_IMU = MSGTYPES[GYRO]
_GEOMETRY = "geometry_msgs/msg/"
_OTHERS = {
    QUATERNION: {
        _GEOMETRY + "Quaternion": _Layout(4, 0),
        _GEOMETRY + "Pose": _Layout(7, 3),
        _GEOMETRY + "PoseStamped": _Layout(7, 3),
        _GEOMETRY + "PoseWithCovarianceStamped": _Layout(43, 3),
        _IMU: _Layout(37, 0, 4),
    },
    VECTOR: {
        _GEOMETRY + "Vector3": _Layout(3, 0),
        _GEOMETRY + "Twist": _Layout(6, 3),
        _GEOMETRY + "TwistStamped": _Layout(6, 3),
        _GEOMETRY + "Wrench": _Layout(6, 3),
        MSGTYPES[WRENCH]: _Layout(6, 3),
        _IMU: _Layout(37, 13, 16),
    },
    POINT: {MSGTYPES[VECTOR]: _Layout(3, 0)},
    MAGNETIC: {MSGTYPES[VECTOR]: _Layout(3, 0)},
    WRENCH: {
        _GEOMETRY + "Vector3": _Layout(3, 0),
        _GEOMETRY + "Wrench": _Layout(6, 3),
        MSGTYPES[VECTOR]: _Layout(3, 0),
    },
}
_UNSTAMPED = frozenset(_GEOMETRY + n for n in ("Quaternion", "Pose", "Vector3", "Twist", "Wrench"))


def carriers(topic: Topic) -> tuple[str, ...]:
    """ROS types that can carry what a topic of the contract carries, its own first."""
    whole = topic.form == QUATERNION or topic.width == 3
    return (topic.msgtype, *(_OTHERS.get(topic.form, ()) if whole else ()))


def is_stamped(msgtype: str) -> bool:
    """False for a carrier without a header, whose time is that of its receipt."""
    return msgtype not in _UNSTAMPED


def decode_rows(topic: Topic, msgtype: str, rows: NDArray[np.uint8]) -> Rows:
    """Decode many messages of one length at once, of any of the `carriers` of a topic.

    Parameters
    ----------
    topic : Topic
        Topic whose quantity is to be read.
    msgtype : str
        ROS type of the messages.
    rows : ndarray of uint8, shape (n, length)
        The bytes of one message in each row, in either byte order.

    Returns
    -------
    stamps_ns : ndarray of int64, shape (n,)
        Zero where the type has no stamp.
    values : ndarray of float64, shape (n, width)
    readable : ndarray of bool, shape (n,)
        False where a row is not a message of this type, says that it has no such quantity, or has
        a zero quaternion in another type than the topic's own. In the topic's own type a zero
        quaternion says that there is no estimate yet.
    """
    if msgtype == topic.msgtype:
        stamps, values, readable = Codec(topic).decode_rows(rows)
    else:
        stamps, values, readable = _decode_others(topic, msgtype, rows)
        if topic.form == QUATERNION:
            readable &= values.any(axis=1)
    return stamps, values, readable


def _decode_others(topic: Topic, msgtype: str, rows: NDArray[np.uint8]) -> Rows:
    """Decode messages of another type, grouped by byte order and length of the frame name."""
    layout, stamped = _OTHERS[topic.form][msgtype], is_stamped(msgtype)
    stamps = np.zeros(len(rows), np.int64)
    values = np.full((len(rows), topic.width), np.nan)
    readable = np.zeros(len(rows), np.bool_)
    heads = rows[:, [0, 1, 12, 13, 14, 15] if stamped and rows.shape[1] > 15 else [0, 1]]
    order_of_heads = np.lexsort(heads.T)
    borders = np.flatnonzero(np.diff(heads[order_of_heads], axis=0).any(axis=1)) + 1
    for alike in np.split(order_of_heads, borders) if len(rows) else ():
        part = rows[alike]
        try:
            order, start = _start(part[0].tobytes(), msgtype, layout.size, stamped)
        except CdrError:
            continue
        numbers = part[:, start : start + 8 * layout.size].view(order + "f8")
        values[alike] = numbers[:, layout.first : layout.first + topic.width]
        readable[alike] = True if layout.absent is None else numbers[:, layout.absent] != -1.0
        if stamped:
            stamps[alike] = stamps_of_rows(part, order)
    return stamps, values, readable


def _start(data: bytes, msgtype: str, count: int, stamped: bool) -> tuple[str, int]:
    """Byte order, and offset of the first float64."""
    if stamped:
        order, _, start = stamped_layout(data, msgtype, count)
        return order, start
    order = byte_order(data)
    if len(data) < 4 + 8 * count:
        raise CdrError(f"{len(data)} bytes are too few for a {msgtype}")
    return order, 4
