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

"""What arrives from outside: used only if it is a finite, possible message of its topic."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.declared import BY_COLUMN, SAMPLED
from ppc_attitude.contract.topics import ATTITUDE, REFERENCE_ATTITUDE, TORQUE_COMMAND
from ppc_attitude.nodes.messages import Inbox
from ppc_attitude.runtime.stamps import RefusedError
from ppc_attitude.science.component import OWN_TOLERANCE
from ppc_attitude.science.given import misfit, rules_of
from ppc_attitude.science.signals import ATTITUDE as ATTITUDE_COLUMN

UNIT = (0.0, 0.0, 0.0, 1.0)


def read(topic, stamp_ns, values):
    return Inbox(topic).read(Codec(topic).encode(stamp_ns, values))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e308])
@pytest.mark.parametrize("topic", SAMPLED, ids=lambda topic: topic.name)
def test_impossible_numbers_are_refused_and_the_topic_is_named(topic, bad):
    with pytest.raises(RefusedError, match=topic.name):
        read(topic, 0, (bad,) + (0.0,) * (topic.width - 1))


def test_a_quaternion_is_normalised_within_a_thousandth_and_refused_beyond():
    sample = read(ATTITUDE, 0, (0.0, 0.0, 0.0, 1.0009))
    assert sample.values == UNIT
    ours = (0.0, 0.0, 0.0, 1.0 + 0.5 * OWN_TOLERANCE)
    assert read(ATTITUDE, 0, ours).values == ours, "as it was sent, to the last bit"
    assert read(ATTITUDE, 0, (0.0, 0.0, 0.0, 0.0)).values == (0.0,) * 4  # no estimate yet
    with pytest.raises(RefusedError, match="norm"):
        read(REFERENCE_ATTITUDE, 0, (0.0, 0.0, 0.0, 0.0))
    for norm in (1e-6, 0.99, 1.01):
        with pytest.raises(RefusedError, match="norm"):
            read(ATTITUDE, 0, (0.0, 0.0, 0.0, norm))


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4), st.floats(-9e-4, 9e-4))
def test_a_quaternion_becomes_the_one_that_replay_computes_with(q: list[float], off: float) -> None:
    """An IMU's float32 numbers gave a difference of 1e-16 N·m, and replay exit code 1."""
    length = math.hypot(*q)
    assume(length > 0.1)
    given_ = np.array([(1.0 + off) * each / length for each in q])
    taken = read(ATTITUDE, 0, given_.tolist()).values
    assert misfit(given_, rules_of([ATTITUDE_COLUMN])) == -1
    assert taken == tuple(given_.tolist())


def test_negative_stamps_are_refused():
    with pytest.raises(RefusedError, match="stamp -1 ns"):
        read(ATTITUDE, -1, UNIT)


@pytest.mark.parametrize("topic", SAMPLED, ids=lambda topic: topic.name)
def test_other_frames_are_refused_and_named(topic):
    data = Codec(replace(topic, frame_id="moon")).encode(
        0, (*UNIT, *[1.0] * topic.width)[: topic.width]
    )
    with pytest.raises(
        RefusedError, match=f"{topic.name}: frame_id 'moon'; allowed: '{topic.frame_id}'"
    ):
        Inbox(topic).read(data)


def test_impossible_variances_of_sensors_are_refused():
    gyro, fix = BY_COLUMN["gyro"], BY_COLUMN["star_fix"]
    for variance in (0.0, 1e4):
        read(gyro, 0, (0.1, 0.2, 0.3, variance))
    for rate in (0.0, 0.3, math.nan):  # whatever stands there, no rate
        assert read(gyro, 0, (0.0, 0.0, rate, -1.0)).values == (0.0, 0.0, 0.0, -1.0)
    for variance in (-1e-9, 1.1e5, 1e6, math.nan):
        with pytest.raises(RefusedError, match="imu/data_raw"):
            read(gyro, 0, (0.1, 0.2, 0.3, variance))
    for variances in ((1e-10, 2e-10, 1e-8), (0.0, 0.0, 0.0)):  # the default: an exact tracker
        assert read(fix, 0, (0.0, 0.0, 0.0, 1.0009, *variances)).values == (*UNIT, *variances)
    for attitude in ((0.0, 0.0, 0.0, 0.0), UNIT, (math.nan,) * 4):  # whatever stands there, no fix
        nothing = read(fix, 0, (*attitude, -1.0, 2.0, 0.0)).values
        assert nothing == (0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0)
    impossible = ((-1e-9, 0.0, 0.0), (9.9, 0.0, 0.0), (1e-10, 1e-10, -1e-8), (math.nan,) * 3)
    for variances in (*impossible, (1e-10, 1e-10, 9.9), (1e300,) * 3):
        with pytest.raises(RefusedError, match="star_tracker/attitude"):
            read(fix, 0, (*UNIT, *variances))


@settings(max_examples=500, deadline=None)
@given(st.sampled_from(SAMPLED), st.integers(0, 2 * 10**18), st.data())
def test_mutated_bytes_are_refused_or_finite(topic, stamp_ns, data):
    whole = bytearray(Codec(topic).encode(stamp_ns, (1.0,) + (0.0,) * (topic.width - 1)))
    place = data.draw(st.integers(0, len(whole) - 1))
    whole[place] = data.draw(st.integers(0, 255))
    length = data.draw(st.integers(0, len(whole)))
    try:
        sample = Inbox(topic).read(bytes(whole[: length or None]))
    except RefusedError:
        return
    assert sample.stamp_ns >= 0
    assert all(map(math.isfinite, sample.values))


def test_a_force_without_a_torque_is_refused():
    """Whoever fills the wrong half of a wrench is told, instead of doing nothing."""
    data = bytearray(Codec(TORQUE_COMMAND).encode(0, (0.0, 0.0, 0.0)))
    data[-40:-32] = struct.pack("<d", 0.3)
    with pytest.raises(RefusedError, match="force without a torque"):
        Inbox(TORQUE_COMMAND).read(bytes(data))
    data[-8:] = struct.pack("<d", 0.1)
    assert Inbox(TORQUE_COMMAND).read(bytes(data)).values == (0.0, 0.0, 0.1)
    data[-40:-32] = struct.pack("<d", math.nan)
    with pytest.raises(RefusedError, match=r"force .*nan.*allowed: finite"):
        Inbox(TORQUE_COMMAND).read(bytes(data))
