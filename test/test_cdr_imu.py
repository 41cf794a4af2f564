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

"""The three uses of sensor_msgs/Imu, against rosbags' own serialiser."""

from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.declared import BY_COLUMN

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
