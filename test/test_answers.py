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

"""What a node answers: each instant once, a repeated one alike, and ahead where time decides."""

import pytest

from ppc_attitude.contract.topics import ATTITUDE
from ppc_attitude.runtime.stamps import Answers, RefusedError
from ppc_attitude.science.stamps import NANOSECONDS, stamp_of


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
