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

"""What a bag lacks, repeats or has out of order: read as far as it goes, and counted."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bag_helpers import assert_same, messages, record_all, write_messages
from synthetic import SAMPLED, normal_run, part_of, with_parameters, without_columns

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.bags.changes import encode_changes
from ppc_attitude.bags.custom_data import GAPS_KEY
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.reader import read_run, read_runs
from ppc_attitude.bags.run_writer import write_run
from ppc_attitude.bags.writer import BagWriter
from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.declared import BY_NAME
from ppc_attitude.contract.run_record import Change
from ppc_attitude.contract.topics import (
    ALLOCATOR,
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE,
    CHANGES_TOPIC,
    CONTROLLER,
    DISTURBANCE,
    PLANT,
    REFERENCE,
    REFERENCE_RATE,
    TORQUE_COMMAND,
    Topic,
)

RUN = normal_run(duration=1.0)
STEPS = len(RUN.stamps_ns)


@pytest.mark.parametrize("equal", [True, False])
def test_of_several_messages_of_one_stamp_the_first_counts(tmp_path: Path, equal: bool) -> None:
    """Those with other numbers say what the record does not: it tells that they are left out."""
    sequence = []
    for topic, stamp, data in messages(RUN):
        sequence.append((topic, stamp, data))
        if topic is TORQUE_COMMAND:
            other = Codec(topic).encode(stamp, (9.0, 9.0, 9.0))
            sequence.append((topic, stamp, data if equal else other))
    read = read_run(write_messages(tmp_path / "bag", sequence))
    assert_same(read, RUN)
    told = f"{STEPS} messages of torque_command have the stamp of an earlier one and other numbers"
    assert (read.missing, read.warnings) == ({}, () if equal else (f"{told}: left out",))


def test_a_state_that_waits_for_its_answer_is_no_reset(tmp_path: Path) -> None:
    sequence, place = list(messages(RUN)), 30 * len(SAMPLED)
    sequence[place:place] = sequence[place : place + len(SAMPLED)] * 6
    read = read_run(write_messages(tmp_path / "bag", sequence))
    assert_same(read, RUN)
    assert read.warnings == ()


def test_a_late_message_is_put_in_its_place(tmp_path: Path) -> None:
    sequence = list(messages(RUN))
    per_step = len(SAMPLED)
    late = sequence[20 * per_step]
    again = [*sequence[: 25 * per_step], late, *sequence[25 * per_step :]]
    without = [message for message in again if message is not late]
    delayed = [*without[: 25 * per_step], late, *without[25 * per_step :]]
    for count, one in enumerate((again, delayed)):
        read = read_run(write_messages(tmp_path / f"bag{count}", one))
        assert_same(read, RUN)
        assert read.warnings == (f"1 messages of {late[0].name} arrived out of order",)
        assert read.missing == {}


def test_three_states_that_are_late_are_no_reset(tmp_path: Path) -> None:
    late = [one for one in messages(RUN) if one[0] is ATTITUDE][20:23]
    others = [one for one in messages(RUN) if one not in late]
    place = 25 * len(SAMPLED)
    delayed = [*others[:place], *late, *others[place:]]
    read = read_run(write_messages(tmp_path / "bag", delayed, run=RUN))
    assert_same(read, RUN)
    assert read.missing == {}


@pytest.mark.parametrize("with_rate", [True, False])
def test_gaps_are_nan_and_counted(tmp_path: Path, with_rate: bool) -> None:
    """Instants 40 to 42 lack everything, 50 lacks the plant, 60 to 64 the command."""
    lost = [
        *((topic, step) for topic in SAMPLED for step in (40, 41, 42)),
        *((topic, 50) for topic in (ATTITUDE, ANGULAR_VELOCITY, APPLIED_TORQUE)),
        *((TORQUE_COMMAND, step) for step in range(60, 65)),
    ]
    lost_stamps = {(topic, int(RUN.stamps_ns[step])) for topic, step in lost}
    sequence = [one for one in messages(RUN) if (one[0], one[1]) not in lost_stamps]
    bag = write_messages(tmp_path / "bag", sequence, run=RUN if with_rate else None)
    read = read_run(bag)
    np.testing.assert_array_equal(read.stamps_ns, RUN.stamps_ns)
    plant = {"attitude": 4, "angular_velocity": 4, "applied_torque": 4, "torque_command": 8}
    assert read.missing == {topic.name: plant.get(topic.name, 3) for topic in SAMPLED}
    assert read.missing_messages == len(lost)
    assert read.warnings == ()
    for topic in SAMPLED:
        gone = [step for one, step in lost if one is topic]
        expected = RUN[topic.column].copy()
        expected[gone] = np.nan
        np.testing.assert_array_equal(read[topic.column], expected, err_msg=topic.name)


def test_what_its_recorder_knew_to_be_incomplete_is_told(tmp_path: Path) -> None:
    told = ["torque_command came from several nodes: /one, /other"]
    path = tmp_path / "bag"
    with BagWriter(path, custom_data={GAPS_KEY: json.dumps(told)}) as writer:
        record_all(writer, messages(RUN))
    assert read_run(path).warnings == (f"the recorder calls the bag incomplete: {told[0]}",)


@pytest.mark.parametrize(("rate", "begin"), [(300.0, 0), (100.0, 3_000_000)])
def test_gaps_of_a_rate_without_whole_nanoseconds_and_of_a_plant_that_begins_at_any_time(
    tmp_path: Path, rate: float, begin: int
) -> None:
    """The stamps filled in are those that the other topics have, also if most are lost."""
    run = normal_run(300.0 / rate, rate)
    run = replace(run, stamps_ns=run.stamps_ns + begin)
    lost = set(run.stamps_ns[np.arange(301) % 4 > 0].tolist())
    sequence = [
        one
        for one in messages(run)
        if one[0] not in (ATTITUDE, ANGULAR_VELOCITY, APPLIED_TORQUE) or one[1] not in lost
    ]
    read = read_run(write_messages(tmp_path / "bag", sequence, run=run))
    np.testing.assert_array_equal(read.stamps_ns, run.stamps_ns)
    assert read.missing == {"attitude": 225, "angular_velocity": 225, "applied_torque": 225}
    np.testing.assert_array_equal(read["torque_command"], run["torque_command"])


@pytest.mark.parametrize(("duration", "lost"), [(1.0, {"control/attitude_error": 1}), (2.0, {})])
def test_only_a_run_that_was_stopped_may_lack_the_answer_to_its_last_state(
    tmp_path: Path, duration: float, lost: dict[str, int]
) -> None:
    run = with_parameters(RUN, PLANT, {"duration": duration})
    read = read_run(write_messages(tmp_path / "bag", list(messages(RUN))[:-1], run=run))
    assert (read.missing, len(read.stamps_ns)) == (lost, STEPS if lost else STEPS - 1)


def test_a_leap_of_the_clock_is_not_filled_in(tmp_path: Path) -> None:
    """A wrong clock must not make the reader allocate a century of NaN."""
    far = replace(RUN, stamps_ns=RUN.stamps_ns + 10**18)
    read = read_run(write_messages(tmp_path / "bag", [*messages(RUN), *messages(far)], run=RUN))
    assert len(read.stamps_ns) == 2 * STEPS
    assert read.missing["attitude"] == 10**11 - STEPS
    assert any("left out of the record" in warning for warning in read.warnings)


def test_messages_beside_the_plants_stamps_are_reported(tmp_path: Path) -> None:
    sequence = list(messages(RUN))
    stray = (TORQUE_COMMAND, 5, Codec(TORQUE_COMMAND).encode(5, (1.0, 1.0, 1.0)))
    read = read_run(write_messages(tmp_path / "bag", [*sequence[:60], stray, *sequence[60:]]))
    assert_same(read, RUN)
    told = "1 messages of torque_command have stamps that no state of the plant has: left out"
    assert told in read.warnings


@pytest.mark.parametrize("places", [[1], [30], [30, 31, 32], [30, 32, 34]])
def test_stamps_that_leap_ahead_are_missing_and_no_reset(tmp_path: Path, places: list[int]) -> None:
    sequence, count = list(messages(RUN)), len(places)
    wrong = RUN.stamps_ns[places]
    for place, (topic, stamp, _) in enumerate(sequence):
        if topic == ATTITUDE and stamp in wrong:
            leap = Codec(ATTITUDE).encode(10**12, tuple(RUN["attitude"][30]))
            sequence[place] = (ATTITUDE, 10**12, leap)
    read = read_run(write_messages(tmp_path / "bag", sequence, run=RUN))
    np.testing.assert_array_equal(read.stamps_ns, RUN.stamps_ns)
    assert read.missing == {"attitude": count}
    assert f"{count} messages of attitude have stamps that leap ahead: left out" in read.warnings


@pytest.mark.parametrize("steps", [[30, STEPS], [30, 50, STEPS], [STEPS, 20]])
def test_after_a_reset_the_last_epoch_is_read(tmp_path: Path, steps: list[int]) -> None:
    """Each epoch has other numbers; the last command of an epoch arrives in the next.

    By 1e-4 a quaternion may be off.
    """
    sequence: list = []
    for epoch, count in enumerate(steps):
        run = replace(RUN, columns={k: v * (1.0 + 1e-4 * epoch) for k, v in RUN.columns.items()})
        part = list(messages(run))[: count * len(SAMPLED)]
        if sequence:
            held = sequence.pop()
            part.insert(len(SAMPLED) - 1, held)  # behind the attitude
        sequence += part
    read = read_run(write_messages(tmp_path / "bag", sequence, run=RUN))
    assert_same(read, part_of(run, slice(steps[-1])))
    times = "time" if len(steps) == 2 else "times"
    assert f"the clock went back {len(steps) - 1} {times}" in read.warnings[0]
    assert "to 0 s (plant reset or restarted)" in read.warnings[0]


def test_a_clock_of_the_wall_that_goes_back_is_told_to_its_last_digits(tmp_path: Path) -> None:
    """From 1.7e+09 s to 1.7e+09 s, it was told."""
    wall = 1_700_000_000 * 10**9
    run = replace(RUN, stamps_ns=RUN.stamps_ns + wall, parameters={})
    sequence = list(messages(run))
    again = sequence[: 60 * len(SAMPLED)] + sequence[20 * len(SAMPLED) :]
    read = read_run(write_messages(tmp_path / "bag", again))
    assert "last from 1700000000.59 s to 1700000000.2 s" in read.warnings[0]


def test_after_a_reset_a_second_node_that_answers_late_takes_nothing_away(tmp_path: Path) -> None:
    """What it sends again goes back in time, but no time has begun again there."""
    states = list(messages(RUN))
    commands = [message for message in states if message[0] == TORQUE_COMMAND]
    late, here = commands[30:37], states.index(commands[40])
    sequence = [*states[: 50 * len(SAMPLED)], *states[:here], *late, *states[here:]]
    read = read_run(write_messages(tmp_path / "bag", sequence, run=RUN))
    assert not read.missing
    assert_same(read, RUN)


def told(stamp: int, name: str, value: float) -> list:
    change = Change(stamp, CONTROLLER, name, value)
    return [(CHANGES_TOPIC, *each) for each in encode_changes([change])]


def test_after_a_reset_the_changes_of_the_last_epoch_are_read(tmp_path: Path) -> None:
    """What is told anew at its begin may be written before it, and what was told before after."""
    states = list(messages(RUN))
    late = int(RUN.stamps_ns[-1])
    sequence = [*states, *told(late, "k", 0.7), *told(0, "k", 0.7)]
    sequence += [*states[:40], *told(late, "enabled", True), *told(0, "enabled", False)]
    sequence += [*states[40:], *told(late, "eta", 0.2)]
    began = {**RUN.parameters, CONTROLLER: {"k": 0.5, "eta": 0.3}}
    bag = write_messages(tmp_path / "bag", sequence, run=replace(RUN, parameters=began))
    read = read_run(bag)
    assert read.parameters[CONTROLLER] == {"k": 0.7, "eta": 0.3}
    assert read.changes == (
        Change(0, CONTROLLER, "enabled", False),
        Change(late, CONTROLLER, "eta", 0.2),
    )


def test_after_a_reset_a_node_has_what_it_was_started_again_with(tmp_path: Path) -> None:
    """The recorder told that once, when the node came; the first start had told a change anew."""
    states = list(messages(RUN))
    late = int(RUN.stamps_ns[-1])
    sequence = [*states, *told(late, "k", 0.7), *told(0, "k", 0.7), *told(0, "enabled", False)]
    again = [*told(late, "k", 0.5), *told(late, "eta", 0.1), *told(late, "enabled", True)]
    sequence += [*states, *again, *states, *told(0, "enabled", True)]  # told anew, and no news
    began = {**RUN.parameters, CONTROLLER: {"k": 0.6, "eta": 0.3}}
    bag = write_messages(tmp_path / "bag", sequence, run=replace(RUN, parameters=began))
    read = read_run(bag)
    assert read.parameters[CONTROLLER] == {"k": 0.5, "eta": 0.1}
    assert read.changes == ()


@pytest.mark.parametrize(
    ("states", "begin"),
    [
        *(((101, 60, 101), 0), ((101, 80, 15, 101), 0), ((101, 15, 15, 60), 0)),
        *(((101, 15, 15, 60), 20), ((9, 60), 20)),
    ],
)
def test_what_comes_seldom_is_of_the_last_epoch_too(
    tmp_path: Path, states: tuple[int, ...], begin: int
) -> None:
    """As fixes of a star tracker: they come before their state, and an epoch may have only one.

    In the last epoch they begin at a step.
    """
    sequence, whole = [], list(messages(RUN))
    for epoch, count in enumerate(states):
        for step in range(count):
            instant = whole[step * len(SAMPLED) : (step + 1) * len(SAMPLED)]
            for topic, stamp, data in sorted(
                instant, key=lambda each: each[0] is not REFERENCE_RATE
            ):
                if topic is not REFERENCE_RATE:
                    sequence.append((topic, stamp, data))
                elif step % 10 == 0 and (epoch < len(states) - 1 or step >= begin):
                    sequence.append((topic, stamp, Codec(topic).encode(stamp, (epoch, 0.0, 0.0))))
    read = read_run(write_messages(tmp_path / "bag", sequence, run=RUN))
    rates = read[REFERENCE_RATE.column][:, 0]
    came = rates[begin::10].tolist()
    assert came == [len(states) - 1] * math.ceil((states[-1] - begin) / 10)
    assert np.count_nonzero(~np.isnan(rates)) == len(came)
    assert len(read.warnings) == 1  # of the resets


def test_every_time_that_a_node_began_anew_is_read(tmp_path: Path) -> None:
    """Switched off and on between two states, or started again twice: replay begins anew, too."""
    stamps = RUN.stamps_ns[1:3].tolist()
    anew = [Change(stamp, CONTROLLER, "enabled", True) for stamp in stamps]
    sequence = [*messages(RUN), *told(stamps[0], "k", 0.7), *told(stamps[1], "k", 0.7)]
    sequence += [(CHANGES_TOPIC, *each) for each in encode_changes(anew)]
    read = read_run(write_messages(tmp_path / "bag", sequence, run=RUN))
    assert read.changes == (Change(stamps[0], CONTROLLER, "k", 0.7), *anew)


def test_a_change_to_what_no_node_can_have_is_left_out(tmp_path: Path) -> None:
    sequence = [*messages(RUN), *told(20_000_000, "k", "fast"), *told(30_000_000, "eta", 0.3)]
    read = read_run(write_messages(tmp_path / "bag", sequence, run=RUN))
    assert [change.name for change in read.changes] == ["eta"]
    (warning,) = read.warnings
    assert warning.startswith(
        f"the bag's parameters of {CONTROLLER} cannot be used: k = 'fast'; allowed"
    )


def test_undecodable_messages_are_counted(tmp_path: Path) -> None:
    sequence = list(messages(RUN))
    places = [place for place, (topic, _, _) in enumerate(sequence) if topic == ATTITUDE]
    sequence[places[3]] = (ATTITUDE, 0, b"\0\1\0\0short")
    sequence[places[4]] = (ATTITUDE, 0, Codec(ATTITUDE).encode(-1, (0.0, 0.0, 0.0, 1.0)))
    sequence.append((CHANGES_TOPIC, 0, b"\0\1\0\0short"))
    read = read_run(write_messages(tmp_path / "bag", sequence, run=RUN))
    names = {"2": "/attitude", "1": f"/{CHANGES_TOPIC.name}"}
    told = tuple(
        f"{count} messages of {name} have no readable value, or a stamp below 0: left out"
        for count, name in names.items()
    )
    assert read.warnings == told
    assert read.missing == {"attitude": 2}
    assert np.isnan(read["attitude"][3:5]).all()


def test_a_topic_that_only_ends_like_one_of_ours_is_no_matter_of_the_run(tmp_path: Path) -> None:
    """Sensors whose package is not installed sent what could be the Sun of another namespace."""
    sun = replace(BY_NAME["sun"], name="sunmag/sun", frame_id="body")
    sequence = [*messages(RUN), (sun, 0, Codec(sun).encode(0, (1.0, 0.0, 0.0)))]
    assert not read_run(write_messages(tmp_path / "bag", sequence, run=RUN)).warnings


def test_a_topic_of_another_craft_is_no_topic_of_a_wrong_type(tmp_path: Path) -> None:
    """The command of the craft `/wheels` has the name of wheels' torques without a namespace."""
    both, told = ("", "/wheels"), list(messages(RUN))
    for read in read_runs(write_messages(tmp_path / "bag", told, namespaces=both, run=RUN)):
        assert not read.warnings
        assert read.missing_messages == 0
    allocates = replace(RUN, parameters={**RUN.parameters, ALLOCATOR: {"allocator": "wheel_drive"}})
    bag = write_messages(tmp_path / "lacks", told, namespaces=both, run=allocates)
    (warning,) = read_run(bag, namespace="").warnings
    assert "lacks messages of wheels/torque_command (its type is geometry_msgs" in warning


def test_a_law_is_not_asked_for_what_it_does_not_send(tmp_path: Path) -> None:
    run = without_columns(RUN, "attitude_envelope", "rate_envelope", "auxiliary_state")
    law = {**RUN.parameters, CONTROLLER: {"controller": "quaternion_feedback"}}
    write_run(replace(run, parameters=law), tmp_path / "bag")
    read = read_run(tmp_path / "bag")
    assert_same(read, run)
    assert "attitude_envelope" not in read
    write_run(run, tmp_path / "paper")
    with pytest.raises(BagError, match=r"lacks messages of control/attitude_envelope, control/rat"):
        read_run(tmp_path / "paper", whole=True)


def test_nodes_of_the_users_own_are_asked_for_nothing(tmp_path: Path) -> None:
    """A controller in place of ours sends a torque; the run is judged as far as its topics go."""
    own = {name: RUN.parameters[name] for name in (PLANT, REFERENCE)}
    control = [topic.column for topic in SAMPLED if topic.source == CONTROLLER]
    control.remove(TORQUE_COMMAND.column)
    run = without_columns(RUN, *control, DISTURBANCE.column)
    write_run(replace(run, parameters=own), tmp_path / "bag")
    read = read_run(tmp_path / "bag")
    assert_same(read, run)
    assert read.missing_messages == 0
    assert Verdict(read).metrics.terminal_error is None  # too short for one


@pytest.mark.parametrize("topic", [ATTITUDE, APPLIED_TORQUE, TORQUE_COMMAND])
def test_a_lacking_topic_is_named_with_what_was_read(tmp_path: Path, topic: Topic) -> None:
    write_run(without_columns(RUN, topic.column), tmp_path / "bag")
    with pytest.raises(BagError) as error:
        read_run(tmp_path / "bag", whole=True)
    message = str(error.value)
    assert f"lacks messages of {topic.name}; messages read: " in message
    for other in set(SAMPLED) - {topic}:
        assert f"{other.name} ({STEPS})" in message
