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

"""CDR of Imu and JointState, against the serialisers of rosbags and rclpy, and by hand."""

from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from ppc_attitude.contract.carriers import carriers, decode_rows
from ppc_attitude.contract.cdr import CdrError, Codec
from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.topics import ATTITUDE

STORE = get_typestore(Stores.ROS2_JAZZY)
MSGTYPE = "sensor_msgs/msg/Imu"
STAMP = 12_345_678_901_234
NONE = [-1.0] + [0.0] * 8  # REP 145: there is no such quantity


def message(data: bytes) -> Any:
    return STORE.deserialize_cdr(data, MSGTYPE)


def symmetric(a: list[float]) -> list[float]:
    xx, xy, xz, yy, yz, zz = a
    return [xx, xy, xz, xy, yy, yz, xz, yz, zz]


def numbers(vector: Any) -> list[float]:
    return [getattr(vector, name) for name in ("x", "y", "z", "w") if hasattr(vector, name)]


def sent(column: str) -> tuple[list[float], Any]:
    topic = BY_COLUMN[column]
    values = [0.5 * k + 0.25 for k in range(topic.width)]
    data = Codec(topic).encode(STAMP, values)
    read = message(data)
    assert read.header.frame_id == topic.frame_id
    assert read.header.stamp.sec * 10**9 + read.header.stamp.nanosec == STAMP
    assert numbers(read.linear_acceleration) == [0.0] * 3
    assert read.linear_acceleration_covariance.tolist() == NONE
    return values, read


def test_what_is_too_short_for_a_message_is_not_read_whatever_its_length() -> None:
    for msgtype in carriers(ATTITUDE):
        for length in range(2, 40):
            *_, readable = decode_rows(ATTITUDE, msgtype, np.zeros((2, length), np.uint8))
            assert not readable.any()


def test_a_gyro_sample_has_no_orientation() -> None:
    values, read = sent("gyro")
    assert read.orientation_covariance.tolist() == NONE
    assert numbers(read.angular_velocity) == values[:3]
    v = values[3]
    assert read.angular_velocity_covariance.tolist() == [v, 0, 0, 0, v, 0, 0, 0, v]


def test_a_fix_has_no_rate() -> None:
    values, read = sent("star_fix")
    assert numbers(read.orientation) == values[:4]
    a, b, c = values[4:]
    assert read.orientation_covariance.tolist() == [a, 0, 0, 0, b, 0, 0, 0, c]
    assert numbers(read.angular_velocity) == [0.0] * 3
    assert read.angular_velocity_covariance.tolist() == NONE


def test_an_estimate_has_both_with_whole_covariances() -> None:
    values, read = sent("estimate")
    assert numbers(read.orientation) == values[:4]
    assert read.orientation_covariance.tolist() == symmetric(values[4:10])
    assert numbers(read.angular_velocity) == values[10:13]
    assert read.angular_velocity_covariance.tolist() == symmetric(values[13:19])


@pytest.mark.parametrize("column", ["gyro", "star_fix", "estimate"])
@pytest.mark.parametrize("little_endian", [True, False])
def test_what_was_sent_is_read_again(column: str, little_endian: bool) -> None:
    topic = BY_COLUMN[column]
    codec = Codec(topic)
    rows = np.random.default_rng(3).normal(size=(5, topic.width))
    encoded = [codec.encode(STAMP + k, row.tolist()) for k, row in enumerate(rows)]
    data = [
        bytes(STORE.serialize_cdr(message(each), MSGTYPE, little_endian=little_endian))
        for each in encoded
    ]
    for k, each in enumerate(data):
        sample = codec.decode(each)
        assert (sample.stamp_ns, sample.frame_id) == (STAMP + k, topic.frame_id)
        assert list(sample.values) == rows[k].tolist()
    stamps, values, readable = codec.decode_rows(np.array([list(each) for each in data], np.uint8))
    assert readable.all()
    assert stamps.tolist() == [STAMP + k for k in range(5)]
    assert np.array_equal(values, rows)


# Part, how many, and which list of position, velocity and effort.
USES = {
    "wheel_speed": ("wheel", 8, 1),
    "wheel_torque": ("wheel", 8, 2),
    "thruster_on_time": ("thruster", 16, 2),
}
COLUMNS = pytest.mark.parametrize("column", USES)


def row_of(column: str) -> tuple[float, ...]:
    return tuple(k - 3.5 for k in range(USES[column][1]))


def joint_state(frame: str, names: list[str], *lists: list[float], little: bool = True) -> bytes:
    types = STORE.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](12, 345), frame)
    state = types["sensor_msgs/msg/JointState"](header, names, *map(np.array, lists))
    return bytes(STORE.serialize_cdr(state, state.__msgtype__, little_endian=little))


@COLUMNS
def test_a_number_for_each_part_is_a_joint_state(column: str) -> None:
    topic, (part, count, place) = BY_COLUMN[column], USES[column]
    lists: list[list[float]] = [[], [], []]
    lists[place] = list(row_of(column))
    expected = joint_state(topic.frame_id, [f"{part}_{k}" for k in range(count)], *lists)
    assert Codec(topic).encode(12_000_000_345, row_of(column)) == expected
    assert Codec(topic).decode(expected).values == row_of(column)


@COLUMNS
@pytest.mark.parametrize("little", [True, False])
def test_the_joint_states_of_others_are_read(column: str, little: bool) -> None:
    codec, place = Codec(BY_COLUMN[column]), USES[column][2]
    lists = [[1.0] * 5, [2.0], [3.0]]
    lists[place] = list(row_of(column))
    rows = [
        joint_state(frame, names, *lists, little=little)
        for frame in ("other", "a", "")
        for names in ([""] * 3 + ["a long name"], ["a long name"] + [""] * 3, [])
    ]
    for row in rows:
        told = codec.decode(row)
        assert (told.stamp_ns, told.values) == (12_000_000_345, row_of(column))
    assert codec.decode(rows[0]).frame_id == "other"
    for length in {len(row) for row in rows}:
        alike = [row for row in rows if len(row) == length]
        stamps, values, readable = codec.decode_rows(np.array([list(row) for row in alike], "u1"))
        assert readable.all()
        assert stamps.tolist() == [12_000_000_345] * len(alike)
        assert values.tolist() == [list(row_of(column))] * len(alike)


@COLUMNS
@pytest.mark.parametrize("little", [True, False])
def test_joints_in_another_order_are_refused(column: str, little: bool) -> None:
    """They are told apart by their places: the numbers would be those of other wheels."""
    codec, (part, count, place) = Codec(BY_COLUMN[column]), USES[column]
    lists: list[list[float]] = [[], [], []]
    lists[place] = list(row_of(column))
    names = [f"{part}_{k}" for k in range(count)]
    ours = joint_state("body", names, *lists, little=little)
    assert codec.decode(ours).values == row_of(column)
    message = f"{names[-1]} at place 0; allowed: {part}s in their order"
    with pytest.raises(CdrError, match=message):
        codec.decode(joint_state("body", names[::-1], *lists, little=little))


@COLUMNS
@pytest.mark.parametrize("little", [True, False])
def test_what_is_no_joint_state_of_all_parts_is_refused(column: str, little: bool) -> None:
    codec, (part, count, place) = Codec(BY_COLUMN[column]), USES[column]
    lists: list[list[float]] = [[], [], []]
    lists[place] = list(row_of(column))
    whole = joint_state("body", [part] * count, *lists, little=little)
    for length in range(len(whole) - 4):
        with pytest.raises(CdrError):
            codec.decode(whole[:length])
    few = joint_state("body", [], [], [1.0] * 4, [1.0] * 4, little=little)
    with pytest.raises(CdrError, match=f"for 4 joints; allowed: {count}, one a {part}"):
        codec.decode(few)
    endless = bytearray(joint_state("b", [], [], [], [], little=little))
    endless[20:] = b"\xff" * (len(endless) - 20)
    with pytest.raises(CdrError):
        codec.decode(bytes(endless))
