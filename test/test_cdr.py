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

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from bag_helpers import TYPES, header, imu, serialised, vector

from ppc_attitude.contract.carriers import carriers, decode_rows
from ppc_attitude.contract.cdr import CdrError, Codec
from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.topics import ATTITUDE
from ppc_attitude.nodes.messages import Inbox

STAMP = 12_345_678_901_234


def test_what_is_too_short_for_a_message_is_not_read_whatever_its_length() -> None:
    for msgtype in carriers(ATTITUDE):
        for length in range(2, 40):
            *_, readable = decode_rows(ATTITUDE, msgtype, np.zeros((2, length), np.uint8))
            assert not readable.any()


NONE = [-1.0] + [0.0] * 8  # REP 145: there is no such quantity
NO_VECTOR = ([0.0] * 3, NONE)


def diagonal(a: Any) -> list[float]:
    return np.diag(a).ravel().tolist()


def symmetric(a: Any) -> list[float]:
    xx, xy, xz, yy, yz, zz = a
    return [xx, xy, xz, xy, yy, yz, xz, yz, zz]


# Orientation and angular velocity, each with its covariance, of the numbers of a column.
IMUS: dict[str, Callable[[Any], Any]] = {
    "gyro": lambda a: (([0.0] * 4, NONE), (a[:3], diagonal([a[3]] * 3))),
    "star_fix": lambda a: ((a[:4], diagonal(a[4:])), NO_VECTOR),
    "estimate": lambda a: ((a[:4], symmetric(a[4:10])), (a[10:13], symmetric(a[13:]))),
}


@pytest.mark.parametrize("column", IMUS)
@pytest.mark.parametrize("little", [True, False])
def test_what_sensors_and_filters_say_is_an_imu(column: str, little: bool) -> None:
    codec, topic = Codec(BY_COLUMN[column]), BY_COLUMN[column]
    rows = np.random.default_rng(3).normal(size=(5, topic.width)).tolist()
    said = [
        imu(header(STAMP + k, topic.frame_id), *IMUS[column](row), NO_VECTOR)
        for k, row in enumerate(rows)
    ]
    ours = [codec.encode(STAMP + k, row) for k, row in enumerate(rows)]
    assert ours == [serialised(each) for each in said]
    data = [serialised(each, little) for each in said]
    expected = [(STAMP + k, topic.frame_id, tuple(row)) for k, row in enumerate(rows)]
    assert [codec.decode(each) for each in data] == expected
    stamps, values, readable = codec.decode_rows(np.array([list(each) for each in data], np.uint8))
    assert readable.all()
    assert stamps.tolist() == [STAMP + k for k in range(5)]
    assert values.tolist() == rows


def test_a_field_and_a_position_are_messages_that_drivers_and_displays_know() -> None:
    numbers, place = (1.5, -2.0, 6.8e6), TYPES["geometry_msgs/msg/Point"]
    point, field = BY_COLUMN["orbit_position"], BY_COLUMN["magnetic_field"]

    def magnetic(covariance: float) -> bytes:
        head = header(STAMP, field.frame_id)
        known = np.full(9, covariance)
        return serialised(TYPES["sensor_msgs/msg/MagneticField"](head, vector(numbers), known))

    stamped = TYPES["geometry_msgs/msg/PointStamped"](
        header(STAMP, point.frame_id), place(*numbers)
    )
    assert Codec(point).encode(STAMP, numbers) == serialised(stamped)
    assert Codec(field).encode(STAMP, numbers) == magnetic(0.0)
    assert Codec(field).decode(magnetic(0.25)).values == numbers  # a magnetometer knows it
    assert Inbox(point).read(serialised(stamped)).values == numbers  # no rate is as large
    older = TYPES["geometry_msgs/msg/Vector3Stamped"](header(STAMP, "body"), vector(numbers))
    row = np.frombuffer(serialised(older), np.uint8)[None]
    for topic in (point, field):  # as they were in bags of earlier commits
        *_, values, readable = decode_rows(topic, older.__msgtype__, row)
        assert readable.all()
        assert values.tolist() == [[*numbers]]


# Part, how many, and which list of position, velocity and effort.
USES = {
    "wheel_speed": ("wheel", 8, 1),
    "wheel_torque": ("wheel", 8, 2),
    "thruster_on_time": ("thruster", 16, 2),
}
COLUMNS = pytest.mark.parametrize("column", USES)


def row_of(column: str) -> tuple[float, ...]:
    return tuple(k - 3.5 for k in range(USES[column][1]))


def lists_of(column: str) -> list[list[float]]:
    return [list(row_of(column)) if place == USES[column][2] else [] for place in range(3)]


def joint_state(frame: str, names: list[str], *lists: list[float], little: bool = True) -> bytes:
    state = TYPES["sensor_msgs/msg/JointState"]
    return serialised(state(header(12_000_000_345, frame), names, *map(np.array, lists)), little)


@COLUMNS
def test_a_number_for_each_part_is_a_joint_state(column: str) -> None:
    topic, (part, count, _) = BY_COLUMN[column], USES[column]
    lists = lists_of(column)
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
    codec, (part, count, _) = Codec(BY_COLUMN[column]), USES[column]
    lists = lists_of(column)
    names = [f"{part}_{k}" for k in range(count)]
    ours = joint_state("body", names, *lists, little=little)
    assert codec.decode(ours).values == row_of(column)
    message = f"{names[-1]} at place 0; allowed: {part}s in their order"
    with pytest.raises(CdrError, match=message):
        codec.decode(joint_state("body", names[::-1], *lists, little=little))


@COLUMNS
@pytest.mark.parametrize("little", [True, False])
def test_what_is_no_joint_state_of_all_parts_is_refused(column: str, little: bool) -> None:
    codec, (part, count, _) = Codec(BY_COLUMN[column]), USES[column]
    lists = lists_of(column)
    whole = joint_state("body", [part] * count, *lists, little=little)
    for length in range(len(whole) - 4):
        with pytest.raises(CdrError):
            codec.decode(whole[:length])
    few = joint_state("body", [], [], [1.0] * 4, [1.0] * 4, little=little)
    with pytest.raises(CdrError, match=f"for 4 joints; allowed: {count}, one per {part}"):
        codec.decode(few)
    endless = bytearray(joint_state("b", [], [], [], [], little=little))
    endless[20:] = b"\xff" * (len(endless) - 20)
    with pytest.raises(CdrError):
        codec.decode(bytes(endless))
