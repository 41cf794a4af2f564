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

"""Faults of simulated hardware: what a text says, and what actuator and sensors then do."""

import math
from typing import Any

import numpy as np
import pytest
from craft_helpers import case, part_of
from estimation_helpers import STEP_NS, Array, angles_between
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.science.actuators.ideal import PARTS
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import How, acting_of, fault_of, faults_of
from ppc_attitude.science.kinds import ACTUATORS, SENSORS
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.replay import replay

STILL = [0.0, 0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("overlays", "text", "reason"),
    [
        ((), "wheel/0 effectiveness 0", "has a part wheel/0; allowed: sensor/attitude"),
        ((), "sensor/attitude", "allowed: PART KIND"),
        ((), "sensor/attitude frozen 1", "frozen has 1 numbers; allowed: 0"),
        ((), "sensor/attitude bias 1 2", "bias has 2 numbers; allowed: 3 in rad"),
        ((), "sensor/rate bias 1 2 nan", "bias nan; allowed: a number from -1e+06 to 1e+06 rad/s"),
        ((), "sensor/rate dead", "sensor/rate has no fault dead; allowed: frozen, bias, noise"),
        ((), "sensor/rate noise 10", "noise multiplies rate_noise, which is 0"),
        ((), "actuator/x effectiveness 1.1", "effectiveness 1.1; allowed: a number from 0 to 1"),
        ((), "actuator/x effectiveness half", "effectiveness half; allowed: a number from 0 to 1"),
        ((), "actuator/x effectiveness 0 from -1", "from -1; allowed: a number from 0 to 1e+08 s"),
        ((), "actuator/x effectiveness 0 for inf", "for inf; allowed"),
        ((), "actuator/x effectiveness 0 for 0.009", "allowed: a number from 0.01 to 1e+08 s"),
        ((), "actuator/x from 40 effectiveness 0", "no fault from"),
        ((), "actuator/x effectiveness 0 for 1 from 40", "has 3 numbers"),
        ((), "actuator/x stuck 0 actuator/y stuck 0", "allowed: PART KIND"),
        ((), "actuator/x stuck 0, actuator/y stuck 0", "allowed: PART KIND"),
        ((), "actuator/x effectiveness 0 from", "has 2 numbers"),
        (("wheels",), "wheel/4 seized", "has a part wheel/4; allowed: sensor/attitude"),
        (("wheels",), "actuator/x stuck 0", "has a part actuator/x"),
        (("wheels",), "wheel/1 drag 0.9", "drag 0.9; allowed: a number from 1 to 1e+06"),
        (("wheels",), "wheel/1 drag 11", "11 times its friction: in a step of 0.01 s friction"),
        (("sensors_smallsat",), "sensor/rate frozen", "allowed: gyro, star_tracker, actuator/x"),
        (
            ("sensors_smallsat",),
            "star_tracker outliers 0.5",
            "multiplies star_tracker.outlier_size",
        ),
    ],
)
def test_what_is_no_fault_of_this_craft_is_refused_by_name(
    overlays: tuple[str, ...], text: str, reason: str
) -> None:
    with pytest.raises(ConfigurationError) as refused:
        case(*overlays, faults=["", text])
    assert reason in str(refused.value)
    assert text.split()[0] in str(refused.value) or "wheel 1" in str(refused.value)


def test_friction_that_is_a_little_too_fast_for_the_steps_is_told_with_its_digits() -> None:
    with pytest.raises(ConfigurationError, match=r"takes 1\.00038 times the speed"):
        case("wheels", rate=10.0)


def test_too_many_faults_are_refused() -> None:
    case(faults=["actuator/x stuck 0"] * 16)
    with pytest.raises(ConfigurationError, match="faults has 17 texts; allowed: up to 16"):
        case(faults=["actuator/x stuck 0"] * 17)


KINDS = [each.name.lower() for each in How]
WORDS = st.one_of(
    st.sampled_from([*PARTS, *KINDS, "from", "for", "1", "-1", "nan", "1e-9", "0.5", "1e400"]),
    st.text("az/.- \n\x1b\u00e9", max_size=5),
)


@given(st.lists(WORDS, max_size=8).map(" ".join))
def test_any_text_is_a_fault_or_a_clear_error(text: str) -> None:
    values = {"faults": [text], "rate": 100.0}
    acts = acting_of([text], 0)
    try:
        record = faults_of(values, PARTS)
    except ConfigurationError as error:
        assert "allowed" in str(error)
    else:
        assert record["count"] <= 1
        if record["count"]:
            fault = record["fault"][0]
            assert 0 <= fault["start_ns"] < fault["end_ns"]
            assert np.isfinite(fault["value"]).all()
            assert acts == ([fault_of(text).what] if fault["start_ns"] == 0 else [])


@given(st.floats(0.0, 1e8), st.none() | st.floats(0.01, 1e8), st.floats(-1e6, 1e6))
def test_a_text_says_what_it_is_written_from(start: float, lasts: float | None, x: float) -> None:
    until = "" if lasts is None else f" for {lasts!r}"
    text = f"  actuator/y   bias {x!r} from {start!r}{until} "
    record = faults_of({"faults": ["actuator/x stuck 0", text], "rate": 100.0}, PARTS)
    assert record["count"] == 2
    fault = record["fault"][1]
    assert (fault["kind"], fault["part"], fault["value"][0]) == (How.BIAS, 1, x)
    assert fault["start_ns"] == round(start * 1e9)
    end = np.iinfo(np.int64).max if lasts is None else round((start + lasts) * 1e9)
    assert fault["end_ns"] == end


def test_a_fault_acts_from_its_first_instant_until_before_its_end_and_the_last_one_wins() -> None:
    given = ["actuator/x bias 0.01 from 0.02 for 0.03", "actuator/x bias 0.02 from 0.03 for 0.01"]
    part = part_of(ACTUATORS, "ideal", *given)
    # What a command asks for, and the bias that a fault adds at each instant.
    bias = [0.0, 0.0, 0.01, 0.02, 0.01, 0.0]
    for k, more in enumerate(bias):
        assert part.step(k * STEP_NS, [0.004, 0.003, -0.002]) == (0.004 + more, 0.003, -0.002)
    assert part.step(2 * STEP_NS - 1, [0.004, 0.0, 0.0])[0] == 0.004
    assert part.step(5 * STEP_NS - 1, [0.004, 0.0, 0.0])[0] == 0.014


def test_an_axis_that_fails_gives_what_is_left_within_its_limit() -> None:
    texts = ["actuator/x effectiveness 0.5", "actuator/x bias 0.01", "actuator/y stuck -0.02"]
    part = part_of(ACTUATORS, "ideal", *texts, "actuator/z bias 1")
    assert part.step(0, [0.04, 0.03, -0.01]) == pytest.approx((0.03, -0.02, 0.05), abs=1e-17)
    assert part.step(0, [-0.5, 0.0, -0.5]) == pytest.approx((-0.015, -0.02, 0.05), abs=1e-17)


def test_direct_sensors_tell_what_their_faults_make_of_the_truth() -> None:
    turn = Rotation.from_rotvec([0.3, -0.2, 0.1])
    faults = ["sensor/attitude bias 0.3 -0.2 0.1", "sensor/rate bias 0.1 0 -0.1 from 0.01"]
    part = part_of(SENSORS, "direct", *faults)
    q = Rotation.random(random_state=3)
    before, after = (
        np.array(part.step(k * STEP_NS, [*q.as_quat(), 1.0, 2.0, 3.0])) for k in (0, 1)
    )
    assert (Rotation.from_quat(before[:4]).inv() * (q * turn)).magnitude() < 1e-15
    assert before[4:] == pytest.approx([1.0, 2.0, 3.0])
    assert after[4:] == pytest.approx([1.1, 2.0, 2.9])


def test_a_frozen_sensor_goes_on_with_what_it_told_last() -> None:
    part = part_of(SENSORS, "direct", "sensor/attitude frozen from 0.02 for 0.02")
    told = [part.step(k * STEP_NS, [0.0, 0.0, 0.0, 1.0, 0.1 * k, 0.0, 0.0]) for k in range(2)]
    for k in (2, 3, 4):
        told.append(part.step(k * STEP_NS, [0.6, 0.0, 0.0, 0.8, 0.1 * k, 0.0, 0.0]))
    assert [each[0] for each in told] == [0.0, 0.0, 0.0, 0.0, 0.6]
    assert [each[4] for each in told] == [0.1 * k for k in range(5)]
    # Also if it is set in flight, and from the start it is the first that it goes on with.
    part.configure({**part.component.defaults, "rate": 100.0, "faults": ["sensor/rate frozen"]})
    assert part.step(5 * STEP_NS, [*STILL, 7.0, 0.0, 0.0])[4] == 0.4
    part.forget()
    rates = [part.step(k * STEP_NS, [*STILL, 7.0 + k, 0.0, 0.0])[4] for k in range(3)]
    assert rates == [7.0, 7.0, 7.0]


def test_noise_is_multiplied() -> None:
    plain, loud = (
        part_of(SENSORS, "direct", *faults, rate_noise=1e-3)
        for faults in ((), ("sensor/rate noise 5",))
    )
    for k in range(9):
        one, five = (
            np.array(each.step(k * STEP_NS, [*STILL, 0.0, 0.0, 0.0])) for each in (plain, loud)
        )
        assert five[4:] == pytest.approx(5.0 * one[4:], rel=1e-14)
        assert np.array_equal(five[:4], one[:4])


def sensed(*faults: str, **values: Any) -> tuple[Array, Array]:
    """Samples of the gyro and fixes over 2 s of a turn at (0.1, −0.2, 0.05) rad/s, 100 Hz."""
    part = part_of(SENSORS, "gyro_star_tracker", *faults, **values)
    rate = np.array([0.1, -0.2, 0.05])
    told = []
    for k in range(201):
        q = Rotation.from_rotvec(rate * k * 0.01).as_quat()
        told.append(part.step(k * STEP_NS, [*q, *rate]))
    rows = np.array(told)
    return rows[:, part.places["gyro"]], rows[:, part.places["star_fix"]]


def test_a_gyro_tells_what_its_faults_make_of_the_rate() -> None:
    rate = [0.1, -0.2, 0.05]
    gyro, fixes = sensed("gyro bias 0.01 0 0 from 0.5", "gyro saturated from 1 for 0.5")
    assert gyro[:50, :3] == pytest.approx(np.tile(rate, (50, 1)), abs=1e-13)
    assert gyro[50:100, :3] == pytest.approx(np.tile([0.11, -0.2, 0.05], (50, 1)), abs=1e-13)
    assert (gyro[100:150, :3] == [20.0, -20.0, 20.0]).all()
    plain, plain_fixes = sensed()
    assert np.array_equal(fixes, plain_fixes)
    dead, _ = sensed("gyro dead from 1 for 0.5")
    assert (dead[100:150] == [0.0, 0.0, 0.0, -1.0]).all()
    assert np.array_equal(np.delete(dead, slice(100, 150), 0), np.delete(plain, slice(100, 150), 0))
    white = {"gyro__angular_random_walk": 1e-3}
    one, _ = sensed(**white)
    ten, _ = sensed("gyro noise 10", **white)
    assert ten[:, :3] - rate == pytest.approx(10.0 * (one[:, :3] - rate), abs=1e-12)
    walks = {"gyro__angular_random_walk": 1e-3, "gyro__rate_random_walk": 2e-3}
    loud, _ = sensed(**{name: 10.0 * size for name, size in walks.items()})
    assert sensed("gyro noise 10", **walks)[0][:, :3] == pytest.approx(loud[:, :3], abs=1e-12)
    frozen, _ = sensed("gyro frozen from 1 for 0.5", **white)
    assert (frozen[100:150, :3] == one[99, :3]).all()
    assert np.array_equal(frozen[150:], one[150:])


def test_a_tracker_tells_what_its_faults_make_of_a_fix() -> None:
    size = {"star_tracker__outlier_size": 0.5, "star_tracker__latency": 0.03}
    plain = sensed(**size)[1]
    came = np.flatnonzero(plain.any(axis=1))
    blind = sensed("star_tracker blind from 1 for 0.5", **size)[1]
    # It is the fix's validity that counts: those of 1.0 to 1.4 s arrive 0.03 s later.
    lost = np.flatnonzero((blind[:, 4] == -1.0) & blind.any(axis=1))
    assert lost.tolist() == [103, 113, 123, 133, 143]
    assert not blind[lost, :4].any()
    # One that is dead still has a message for each slot, which says that it has no fix.
    assert np.array_equal(sensed("star_tracker dead from 1 for 0.5", **size)[1], blind)
    biased = sensed("star_tracker bias 0.1 0.2 -0.3", **size)[1]
    turn = Rotation.from_quat(plain[came, :4]).inv() * Rotation.from_quat(biased[came, :4])
    assert turn.as_rotvec() == pytest.approx(np.tile([0.1, 0.2, -0.3], (came.size, 1)), abs=1e-13)
    wild = sensed("star_tracker outliers 1", **size)[1]
    turn = Rotation.from_quat(plain[came, :4]).inv() * Rotation.from_quat(wild[came, :4])
    assert turn.magnitude() == pytest.approx(np.full(came.size, 0.5), abs=1e-13)
    noisy = {"star_tracker__cross_noise": 1e-3, "star_tracker__boresight_noise": 1e-3}
    one, three = sensed(**noisy)[1], sensed("star_tracker noise 3", **noisy)[1]
    true = Rotation.from_rotvec(np.outer(0.1 * np.arange(21), [0.1, -0.2, 0.05]))
    errors = [(true.inv() * Rotation.from_quat(x[::10, :4])).as_rotvec() for x in (one, three)]
    assert errors[1] == pytest.approx(3.0 * errors[0], abs=1e-12)
    assert np.array_equal(one[:, 4:], three[:, 4:])


def same(a: RunRecord, b: RunRecord, rows: Any) -> bool:
    return all(np.array_equal(a[name][rows], b[name][rows], equal_nan=True) for name in a.columns)


@pytest.mark.parametrize(
    ("overlay", "text"),
    [
        ("paper", "actuator/y stuck 0.02"),
        ("wheels", "wheel/2 drag 3"),
        ("sensors_smallsat", "gyro bias 0.001 0 0"),
        ("sensors_smallsat", "star_tracker bias 0.001 0 0"),
    ],
)
def test_before_a_fault_a_run_has_the_bits_of_one_without(overlay: str, text: str) -> None:
    failed = simulate(case(overlay, faults=[f"{text} from 1 for 1"]), 3.0)
    whole = simulate(case(overlay, faults=[""]), 3.0)
    assert same(failed, whole, slice(0, 100))
    assert not same(failed, whole, slice(100, 110))
    again = replay(failed)
    assert {each.largest for each in again.found} == {0.0}


def test_told_and_true_are_both_on_record_where_a_sensor_may_fail() -> None:
    record = simulate(case(faults=["sensor/attitude bias 0.01 0 0 from 1"]), 2.0)
    off = angles_between(record["truth_attitude"], record["attitude"])
    assert off[:100].max() == 0.0
    assert off[100:] == pytest.approx(np.full(101, 0.01), rel=1e-9)
    assert "truth_attitude" not in simulate(case(faults=["actuator/x stuck 0"]), 0.1)


def test_without_a_gyro_there_is_no_estimate_and_no_torque_and_then_it_begins_anew() -> None:
    record = simulate(case("sensors_smallsat", faults=["gyro dead from 1 for 0.5"]), 3.0)
    lost = ~record["attitude"].any(axis=1)
    first, last = np.flatnonzero(lost)[[0, -1]]
    assert (first, lost.sum()) == (100, last - first + 1)
    # The next fix that is valid after it comes within a slot and the latency.
    assert 149 <= last <= 149 + 10 + 10
    assert not record["torque_command"][lost].any()
    assert record["torque_command"][~lost].any(axis=1).all()
    assert (record["estimate"][100:150, [4, 13]] == -1.0).all()
    for name in ("attitude", "angular_velocity", "torque_command", "estimate", "gyro_bias"):
        assert np.isfinite(record[name]).all()
    error = angles_between(record["truth_attitude"][~lost], record["attitude"][~lost])
    assert error.max() < math.radians(0.05)
