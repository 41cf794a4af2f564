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

"""Every gap of a record is told, and what is no gap is not."""

import itertools
from collections.abc import Iterable

import pytest
from synthetic import SAMPLED
from test_recording import STATE, TORQUE, Bag

from ppc_attitude.contract.topics import ATTITUDE, DISTURBANCE, PLANT, TORQUE_COMMAND, Topic
from ppc_attitude.runtime.recording import Recording
from ppc_attitude.science.stamps import stamp_of

SENT = [topic.name for topic in SAMPLED]
STEPS = 50


def gaps_of(*events: tuple[Topic, int]) -> list[str]:
    recording = Recording(lambda *message: None)
    for topic, step in events:
        recording.sample(topic.name, stamp_of(step, 100.0), b"", None, 0.0)
    return recording.gaps(SENT)


def steps_of(steps: Iterable[int], *left_out: Topic) -> list[tuple[Topic, int]]:
    topics = [topic for topic in SAMPLED if topic not in left_out]
    return [(topic, step) for step, topic in itertools.product(steps, topics)]


def test_the_last_state_may_be_unanswered_and_no_state_is_no_complete_run() -> None:
    unanswered = [(topic, STEPS) for topic in SAMPLED if topic.source == PLANT]
    assert gaps_of(*steps_of(range(STEPS)), *unanswered) == []
    assert gaps_of((ATTITUDE, 0)) == []
    assert "torque_command never came" in gaps_of((ATTITUDE, 0), (ATTITUDE, 1))
    assert gaps_of() == gaps_of((TORQUE_COMMAND, 0)) == ["attitude never came"]


@pytest.mark.parametrize("lost", [0, 1, 20, STEPS - 2])
def test_a_lost_message_is_a_gap(lost: int) -> None:
    events = [event for event in steps_of(range(STEPS)) if event != (TORQUE_COMMAND, lost)]
    (gap,) = gaps_of(*events)
    assert gap.startswith(f"torque_command has {STEPS - 1} messages until 0.490000 s, attitude 50")


@pytest.mark.parametrize(
    ("steps", "end"),
    [
        ([18, 19, *range(21, 25)], 0.21),  # before the rhythm is known
        ([18, 19, *range(21, STEPS)], 0.21),
        ([*range(20), 21], 0.21),  # the last step
        ([0, *range(3, 20), *range(22, STEPS)], 0.22),  # after a first step that is longer
    ],
)
def test_a_lost_instant_is_a_gap(steps: list[int], end: float) -> None:
    *_, gap = gaps_of(*steps_of(steps))
    assert gap == f"attitude has a gap from 0.190000 s to {end:.6f} s"


def test_the_first_step_of_a_plant_may_be_shorter_than_others() -> None:
    """A bridge's first state is at zero, and the next one when its clock comes round."""
    for second in (1, 4, 9):
        first = [0, *range(second, 100, 10)]
        for steps in (first, [*first, *range(second + 100, 300, 10)]):
            assert gaps_of(*steps_of(steps)) == []
        (gap,) = gaps_of(*steps_of([*first, *range(second + 120, 300, 10)]))
        assert gap.startswith("attitude has a gap from 0.9")


@pytest.mark.parametrize(("every", "told_of"), [(3, False), (4, True)])
def test_a_rhythm_that_three_of_four_steps_keep_has_gaps(every: int, told_of: bool) -> None:
    """Of each `every` steps one is twice as long."""
    lengths = itertools.islice(itertools.cycle([*[1] * (every - 1), 2]), 12 * every)
    gaps = gaps_of(*steps_of([0, *itertools.accumulate(lengths)]))
    assert bool(gaps) == told_of


@pytest.mark.parametrize(("state", "step"), [(30, 16), (30, 19), (1, 16), (30, 4)])
def test_a_state_that_is_only_late_or_early_is_no_gap(state: int, step: int) -> None:
    """As for who reads the bag: the next step of a timer that was late is shorter."""
    ticks = [10 * k for k in range(50)]
    ticks[state] += step - 10
    assert gaps_of(*steps_of(ticks)) == []


def test_many_gaps_are_counted_and_only_the_first_are_told() -> None:
    gaps = gaps_of(*steps_of(step for step in range(1000) if step % 10))
    assert gaps[0] == "attitude has a gap from 0.090000 s to 0.110000 s"
    assert (len(gaps), gaps[-1]) == (6, "attitude has 94 more gaps")


def test_a_reset_within_the_first_step_makes_no_gap() -> None:
    """The torque that acts in a step is sent at the end of the step."""
    bag = Bag()
    for _ in range(3):
        bag.take(STATE, 0)
        bag.take(TORQUE, 0)
        bag.take(STATE, 1)
    bag.take(STATE, 0)
    for step in range(4):
        bag.take(TORQUE, step)
        bag.take(STATE, step + 1)
    assert bag.recording.gaps([]) == []
    assert bag.steps(STATE) == [0, 1, 0, 1, 0, 1, 0, 1, 2, 3, 4]
    assert bag.steps(TORQUE) == [0, 0, 0, 0, 1, 2, 3]


def test_each_side_of_a_reset_is_compared_by_itself() -> None:
    unanswered = [(TORQUE_COMMAND, step) for step in (31, 32)]  # whose states never came
    assert gaps_of(*steps_of(range(30)), *unanswered, *steps_of(range(20))) == []
    before = [event for event in steps_of(range(30)) if event != (DISTURBANCE, 7)]
    (gap,) = gaps_of(*before, *steps_of(range(20)))
    assert gap.startswith("disturbance/torque has 29 messages")
    (gap,) = gaps_of(*steps_of(range(30)), *steps_of(range(20), DISTURBANCE))
    assert gap == "disturbance/torque has 0 messages until 0.000000 s, attitude 20 until 0.190000 s"
