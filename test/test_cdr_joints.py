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

"""The uses of sensor_msgs/JointState, against rclpy's own serialiser and by hand."""

import struct

import numpy as np
import pytest

from ppc_attitude.contract.cdr import CdrError, Codec
from ppc_attitude.contract.declared import BY_COLUMN

# Part, how many, and which list of position, velocity and effort.
USES = {
    "wheel_speed": ("wheel", 8, 1),
    "wheel_torque": ("wheel", 8, 2),
    "thruster_on_time": ("thruster", 16, 2),
}
COLUMNS = pytest.mark.parametrize("column", USES)


def sent(column: str) -> tuple[float, ...]:
    return tuple(k - 3.5 for k in range(USES[column][1]))


def joint_state(representation: int, frame: str, names: list[str], *lists: list[float]) -> bytes:
    """A message as the standard says, in any of the four plain encodings."""
    order, align = "<" if representation % 2 else ">", 8 if representation < 6 else 4
    body = bytearray()

    def put(form: str, value: float) -> None:
        size = struct.calcsize(form)
        body.extend(bytes(-len(body) % min(size, align)))
        body.extend(struct.pack(order + form, value))

    def put_text(text: str) -> None:
        put("I", len(text) + 1)
        body.extend(text.encode() + b"\0")

    put("i", 12)
    put("I", 345)
    put_text(frame)
    begin = None
    if align == 4:  # the size of a list of texts, in bytes
        put("I", 0)
        begin = len(body)
    put("I", len(names))
    for name in names:
        put_text(name)
    if begin is not None:
        body[begin - 4 : begin] = struct.pack(order + "I", len(body) - begin)
    for numbers in lists:
        put("I", len(numbers))
        for number in numbers:
            put("d", number)
    return bytes([0, representation, 0, 0]) + bytes(body)


@COLUMNS
def test_a_number_for_each_part_is_a_joint_state(column: str) -> None:
    from rclpy.serialization import deserialize_message, serialize_message
    from sensor_msgs.msg import JointState

    part, count, place = USES[column]
    data = Codec(BY_COLUMN[column]).encode(12_000_000_345, sent(column))
    message = deserialize_message(data, JointState)
    assert message.name == [f"{part}_{k}" for k in range(count)]
    lists = [tuple(each) for each in (message.position, message.velocity, message.effort)]
    assert lists.pop(place) == sent(column)
    assert lists == [(), ()]
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345)
    assert Codec(BY_COLUMN[column]).decode(serialize_message(message)).values == sent(column)


@COLUMNS
@pytest.mark.parametrize("representation", [0, 1, 6, 7])
def test_the_joint_states_of_others_are_read(column: str, representation: int) -> None:
    codec, place = Codec(BY_COLUMN[column]), USES[column][2]
    lists = [[1.0] * 5, [2.0], [3.0]]
    lists[place] = list(sent(column))
    rows = [
        joint_state(representation, frame, names, *lists)
        for frame in ("other", "a", "")
        for names in ([""] * 3 + ["a long name"], ["a long name"] + [""] * 3, [])
    ]
    for row in rows:
        told = codec.decode(row)
        assert (told.stamp_ns, told.values) == (12_000_000_345, sent(column))
    assert codec.decode(rows[0]).frame_id == "other"
    for length in {len(row) for row in rows}:
        alike = [row for row in rows if len(row) == length]
        stamps, values, readable = codec.decode_rows(np.array([list(row) for row in alike], "u1"))
        assert readable.all()
        assert stamps.tolist() == [12_000_000_345] * len(alike)
        assert values.tolist() == [list(sent(column))] * len(alike)


@COLUMNS
@pytest.mark.parametrize("representation", [0, 1, 6, 7])
def test_joints_in_another_order_are_refused(column: str, representation: int) -> None:
    """They are told apart by their places: the numbers would be those of other wheels."""
    codec, (part, count, place) = Codec(BY_COLUMN[column]), USES[column]
    lists: list[list[float]] = [[], [], []]
    lists[place] = list(sent(column))
    names = [f"{part}_{k}" for k in range(count)]
    assert codec.decode(joint_state(representation, "body", names, *lists)).values == sent(column)
    message = f"{names[-1]} at place 0; allowed: {part}s in their order"
    with pytest.raises(CdrError, match=message):
        codec.decode(joint_state(representation, "body", names[::-1], *lists))


@COLUMNS
@pytest.mark.parametrize("representation", [0, 1, 6, 7])
def test_what_is_no_joint_state_of_all_parts_is_refused(column: str, representation: int) -> None:
    codec, (part, count, place) = Codec(BY_COLUMN[column]), USES[column]
    lists: list[list[float]] = [[], [], []]
    lists[place] = list(sent(column))
    whole = joint_state(representation, "body", [part] * count, *lists)
    for length in range(len(whole) - 4):
        with pytest.raises(CdrError):
            codec.decode(whole[:length])
    few = joint_state(representation, "body", [], [], [1.0] * 4, [1.0] * 4)
    with pytest.raises(CdrError, match=f"for 4 joints; allowed: {count}, one a {part}"):
        codec.decode(few)
    endless = bytearray(joint_state(representation, "b", [], [], [], []))
    endless[20:] = b"\xff" * (len(endless) - 20)
    with pytest.raises(CdrError):
        codec.decode(bytes(endless))
