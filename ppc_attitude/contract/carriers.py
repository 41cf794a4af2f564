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

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.cdr import Codec, Reader
from ppc_attitude.contract.topics import MSGTYPES, Topic
from ppc_attitude.science.component import GYRO, MAGNETIC, POINT, QUATERNION, VECTOR, WRENCH

Rows = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]
_IMU = MSGTYPES[GYRO]
_GEOMETRY = "geometry_msgs/msg/"
# How many float64 a type holds in all, and where among them those of a form begin. One of them, the
# third number, may be −1 to say that there is no such quantity (REP 145).
_OTHERS: dict[str, dict[str, tuple[int, ...]]] = {
    QUATERNION: {
        _GEOMETRY + "Quaternion": (4, 0),
        _GEOMETRY + "Pose": (7, 3),
        _GEOMETRY + "PoseStamped": (7, 3),
        _GEOMETRY + "PoseWithCovarianceStamped": (43, 3),
        _IMU: (37, 0, 4),
    },
    VECTOR: {
        _GEOMETRY + "Vector3": (3, 0),
        _GEOMETRY + "Twist": (6, 3),
        _GEOMETRY + "TwistStamped": (6, 3),
        _GEOMETRY + "Wrench": (6, 3),
        MSGTYPES[WRENCH]: (6, 3),
        _IMU: (37, 13, 16),
    },
    POINT: {MSGTYPES[VECTOR]: (3, 0)},
    MAGNETIC: {MSGTYPES[VECTOR]: (3, 0)},
    WRENCH: {
        _GEOMETRY + "Vector3": (3, 0),
        _GEOMETRY + "Wrench": (6, 3),
        MSGTYPES[VECTOR]: (3, 0),
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
    """Decode many messages of any of the `carriers` of a topic; as `Reader.decode_rows`.

    No row is readable that says that there is no such quantity. In another type than the topic's
    own this holds for a zero quaternion; in its own, that says that there is no estimate yet.
    """
    if msgtype == topic.msgtype:
        return Codec(topic).decode_rows(rows)
    size, first, *absent = _OTHERS[topic.form][msgtype]
    places = [*range(first, first + topic.width), *absent]
    reader = Reader(msgtype, size, places, stamped=is_stamped(msgtype))
    stamps, numbers, readable = reader.decode_rows(rows)
    values = numbers[:, : topic.width]
    readable &= (numbers[:, topic.width :] != -1.0).all(axis=1)
    if topic.form == QUATERNION:
        readable &= values.any(axis=1)
    return stamps, values, readable
