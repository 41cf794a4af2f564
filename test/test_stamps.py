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

"""Stamps: which are new, which are refused, when an instant is complete, how it is answered."""

from fractions import Fraction

import pytest

from ppc_attitude.contract.topics import ATTITUDE
from ppc_attitude.runtime.stamps import (
    SILENCE,
    Answers,
    Instant,
    RefusedError,
    StampGuard,
    StampKind,
    States,
    out_of_order,
)
from ppc_attitude.science import compiled_stamps
from ppc_attitude.science.stamps import (
    LARGEST_STEP,
    LATEST,
    NANOSECONDS,
    nanoseconds,
    span,
    stamp_of,
    step_of,
)

PERIOD = 10_000_000
NEW, REPEATED = StampKind.NEW, StampKind.REPEATED
STALE, RESTART = StampKind.STALE, StampKind.RESTART


def fed(*stamps: int) -> list[StampKind]:
    guard = StampGuard()
    return [guard.judge(stamp, 0.0) for stamp in stamps]


def test_a_text_is_no_time():
    """One of a bag was copied a billion times before it was refused."""
    with pytest.raises(TypeError, match="can't multiply"):
        nanoseconds("")  # type: ignore[arg-type]


@pytest.mark.parametrize("rate", [7.3, 24.0, 60.0, 77.0, 100.0, 1024.0])
def test_a_span_of_whole_steps_has_as_many_stamps_whatever_the_rate(rate: float) -> None:
    """1.12 + 0.64 is more than 1.76 by the last bit, and seconds of a stamp may be as well."""
    for k in range(200):
        first, end = span(k / rate, (k % 7 + 1) / rate)
        acts = [j for j in range(k + 20) if first <= stamp_of(j, rate) < end]
        assert acts == [*range(k, k + k % 7 + 1)]


@pytest.mark.parametrize("rate", [1.0, 7.3, 1000.0, 10000.0])
def test_a_kernel_counts_steps_as_far_as_any_run_reaches(rate: float) -> None:
    """Integers of 64 bits overflowed: after 107 days at 1 kHz a filter knew no fix's instant."""
    steps = step_of(nanoseconds(LATEST), rate)
    for step in (steps, steps // 10, steps // 1000):
        stamp = compiled_stamps.stamp_of(step, rate)
        assert stamp == stamp_of(step, rate)
        off = stamp - Fraction(step * NANOSECONDS) / Fraction(rate)
        assert abs(off) <= 8  # half of a float's last digit
        assert compiled_stamps.step_of(stamp, rate) == step


@pytest.mark.parametrize("start", [3, 1_000_000 * NANOSECONDS], ids=["earlier", "far ahead"])
def test_another_time_is_believed_when_three_messages_agree(start):
    agreeing = [start, start + PERIOD, start + 2 * PERIOD]
    verdicts = fed(NANOSECONDS, *agreeing)
    assert verdicts[1:] == [STALE, STALE, RESTART]


@pytest.mark.parametrize("wrong", [0, 3_600 * NANOSECONDS], ids=["zero", "future"])
def test_one_wrong_stamp_does_not_end_lockstep(wrong: int) -> None:
    """The plant repeats the state that nobody answers: after some repetitions it is believed."""
    now = 0.0
    guard = StampGuard()
    state = 50 * NANOSECONDS
    verdicts = [guard.judge(wrong, now)]
    for wait in (0.0, 0.2, 0.4):
        now += wait
        verdicts.append(guard.judge(state, now))
    assert verdicts == [NEW, STALE, STALE, RESTART]
    assert guard.judge(state, now) is REPEATED


def test_a_flood_of_copies_is_no_agreement() -> None:
    guard = StampGuard()
    guard.judge(50 * NANOSECONDS, 1000.0)
    for copy in range(900):
        assert guard.judge(3_600 * NANOSECONDS, 1000.0 + 1e-4 * copy) is STALE


@pytest.mark.parametrize("step", [-1, -PERIOD, LARGEST_STEP + 1])
def test_stamps_that_do_not_follow_each_other_are_no_agreement(step: int) -> None:
    start = 3_600 * NANOSECONDS
    assert set(fed(50 * NANOSECONDS, *(start + k * step for k in range(20)))[1:]) == {STALE}


def test_three_that_agree_between_those_that_go_on_are_no_agreement() -> None:
    between = [stamp for k in range(20) for stamp in (NANOSECONDS + k * PERIOD, k * PERIOD + 1)]
    assert fed(*between) == [NEW, STALE] * 20


def test_one_message_from_the_future_does_not_stop_the_present():
    future = 2_000_000 * NANOSECONDS
    assert fed(future, 0, PERIOD, future, 2 * PERIOD) == [STALE, NEW, NEW, STALE, NEW]


def test_the_wall_clock_is_no_time_of_a_run() -> None:
    """References integrate from zero to the stamp: to 1970's they would do so for days."""
    wall = 1_764_000_000 * NANOSECONDS
    guard = StampGuard()
    assert {guard.judge(wall + k * PERIOD, 0.01 * k) for k in range(100)} == {STALE}
    assert "; allowed: up to 1e+08 s from the start of the run" in str(out_of_order("q", wall))
    assert [guard.judge(stamp, 1.0) for stamp in (0, wall, 0)] == [NEW, STALE, REPEATED]


def test_an_instant_is_complete_when_all_of_it_is_there_in_any_order():
    instant = Instant(["a", "b"])
    assert instant.add("b", 0, (1.0,)) is None
    assert instant.missing() == ("a",)
    assert instant.add("a", 0, (2.0,)) == {"b": (1.0,), "a": (2.0,)}


def test_a_complete_instant_ends_those_before_it_and_none_after_it():
    instant = Instant(["a", "b"])
    for stamp in range(4):
        instant.add("a", stamp, (0.0,))
    assert instant.add("b", 2, (1.0,)) is not None
    assert instant.dropped == 2
    assert instant.add("b", 3, (1.0,)) is not None


def test_a_repeated_instant_that_the_next_one_overtakes_is_dropped():
    """It was completed after that, and refused as out of order."""
    instant = Instant(["a", "b"])
    for name, stamp in (("a", 0), ("b", 0), ("b", 1), ("a", 0), ("a", 1)):
        complete = instant.add(name, stamp, (0.0,)) is not None
    assert complete
    assert instant.add("b", 0, (0.0,)) is None


def test_messages_that_do_not_pair_lack_each_other():
    instant = Instant(["a", "b"])
    instant.add("a", 0, (0.0,))
    instant.add("b", 1, (0.0,))
    assert instant.missing() == ("a", "b")


def test_incomplete_instants_are_forgotten_and_counted():
    instant = Instant(["a", "b"])
    for stamp in range(1000):
        instant.add("a", stamp, (0.0,))
    assert instant.dropped == 900
    assert instant.add("b", 5, (1.0,)) is None
    assert instant.add("b", 999, (1.0,)) == {"a": (0.0,), "b": (1.0,)}
    assert instant.add("b", 998, (1.0,)) is None


def test_states_of_the_truth_tell_the_time_as_long_as_they_are_sent():
    """An estimator that stops would stop the environment, too."""
    states = States()
    assert [states.tells(stamp, True, 0.0) for stamp in (1, 2)] == [True, True]
    assert not states.tells(3, False, SILENCE)
    assert states.tells(4, False, 1.1 * SILENCE)


def test_estimates_before_the_truth_of_their_instants_take_no_time_back():
    """As for who joins a run with an estimator, or goes on after a pause."""
    states = States()
    assert all(states.tells(stamp, False, 0.0) for stamp in range(500, 515))
    told = [stamp for stamp in (*range(500, 520), 0, 1) if states.tells(stamp, True, 0.0)]
    assert told == [*range(514, 520), 0, 1]
    assert states.tells(600, False, 2.0 * SILENCE)
    assert states.tells(599, True, 3.1 * SILENCE)  # another run, most likely


class Node:
    """Notes what it computes; the answer says how often anything had been computed."""

    def __init__(self, ahead: bool) -> None:
        self.computed: list[int] = []
        self.sent: list[int] = []
        self.restarts: list[int] = []
        self.answers = Answers(self._compute, ahead, self.restarts.append)

    def _compute(self, stamp_ns: int, inputs: object) -> int:
        self.computed.append(stamp_ns)
        return len(self.computed)

    def state(self, stamp_ns: int, now: float = 0.0, x: float = 0.0) -> dict[int, int]:
        given = dict(self.answers.to(ATTITUDE, stamp_ns, {ATTITUDE.column: (x,)}, now))
        self.sent += given
        return given


@pytest.mark.parametrize("rate", [1.0, 100.0, 250.0, 500.0, 1000.0, 10000.0])
def test_a_function_of_time_is_one_instant_ahead_from_the_second_state_on(rate: float) -> None:
    node, period = Node(ahead=True), round(NANOSECONDS / rate)
    for step in range(50):
        node.state(stamp_of(step, rate))
        if step:
            assert node.sent[-1] == stamp_of(step + 1, rate) == node.answers.next_ns - period
    assert node.sent == node.computed == [stamp_of(step, rate) for step in range(51)]


@pytest.mark.parametrize("rate", [3.0, 7.0, 60.0, 300.0, 333.0])
def test_stamps_that_are_rounded_are_never_foreseen(rate: float) -> None:
    node = Node(ahead=True)
    stamps = [stamp_of(step, rate) for step in range(400)]
    for stamp in stamps:
        assert node.answers.period_ns == 0
        assert list(node.state(stamp)) == [stamp]
        assert (node.answers.next_ns is not None) is (stamp > 0)


def test_who_reads_a_state_answers_it_and_no_other() -> None:
    node = Node(ahead=False)
    stamps = [stamp_of(step, 100.0) for step in range(20)]
    assert [list(node.state(stamp)) for stamp in stamps] == [[stamp] for stamp in stamps]


def test_a_repeated_state_gets_the_same_answers_without_computing_anew() -> None:
    node = Node(ahead=True)
    for step in range(3):
        node.state(stamp_of(step, 100.0))
    assert node.state(stamp_of(2, 100.0), 0.2) == {20_000_000: 3, 30_000_000: 4}
    assert len(node.computed) == 4
    assert node.state(stamp_of(3, 100.0)) == {40_000_000: 5}


def test_a_stamp_that_stands_still_is_refused_when_the_numbers_change() -> None:
    """The old torque would act on the new state for ever, as on a rig that does not stamp."""
    node = Node(ahead=False)
    for stamp in (0, 10_000_000):
        node.state(stamp, 1.0)
        told = rf"attitude: stamp 0\.0{stamp // 10**7}0000 s comes again with other values"
        for step in range(1, 90):
            with pytest.raises(RefusedError, match=told):
                node.state(stamp, 1.0 + 0.01 * step + stamp, x=float(step))
    assert node.state(10_000_000, 5.0) == {10_000_000: 2}


def test_another_plant_that_waits_at_its_start_is_answered_anew() -> None:
    node = Node(ahead=True)
    assert [node.state(0, now, x=now) for now in (0.0, 1.0)] == [{0: 1}, {0: 2}]
    assert node.restarts == [0]


def test_after_lost_states_nothing_is_foreseen_until_the_rhythm_is_back() -> None:
    node = Node(ahead=True)
    for step in (0, 1, 5):
        node.state(stamp_of(step, 100.0))
    assert node.sent == [0, 10_000_000, 20_000_000, 50_000_000]
    assert list(node.state(stamp_of(6, 100.0))) == [60_000_000, 70_000_000]
    late = Node(ahead=True)  # the first step that it sees is a long one
    for step in (0, 5, 6):
        late.state(stamp_of(step, 100.0))
    assert late.sent == [0, 50_000_000, 100_000_000, 60_000_000, 70_000_000]


@pytest.mark.parametrize("ahead", [True, False])
def test_nobody_knows_the_next_state_after_a_step_that_is_longer_than_others(ahead: bool) -> None:
    """Of a bridge whose stamps jitter, or whose rate has changed, it would be told wrongly."""
    node = Node(ahead)
    assert node.answers.next_ns is None
    for stamp, known in ((0, False), (10, True), (20, True), (120, False), (220, False)):
        node.state(stamp * 1_000_000)
        assert (node.answers.next_ns is not None) is known


def test_time_that_begins_again_is_told_and_answered_anew() -> None:
    node = Node(ahead=True)
    for step in range(5):
        node.state(stamp_of(step, 100.0))
    assert list(node.state(0)) == [0]
    assert node.restarts == [0]
    assert node.answers.next_ns is None
    assert list(node.state(20_000_000)) == [20_000_000, 40_000_000]  # half as often as before


def test_a_stale_state_is_refused_and_answers_nothing() -> None:
    node = Node(ahead=True)
    node.state(50_000_000)
    with pytest.raises(RefusedError, match=r"attitude: stamp 0\.010000 s is out of order"):
        node.state(10_000_000)
    assert node.sent == [50_000_000]
