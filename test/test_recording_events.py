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

"""What is written of a run besides its samples: clocks, orders, what estimators send."""

import itertools

import pytest
from test_recording import STATE, TORQUE, Bag, stamp_ns

CLOCK = "/clock"


def test_what_is_no_sample_is_written_at_its_time_or_at_that_of_the_newest_state() -> None:
    """A message of a sample's topic without a stamp is none; it counts for nothing."""
    bag = Bag()
    bag.recording.event("/diagnostics", None, b"early")
    bag.run(range(3))
    bag.recording.event("/diagnostics", None, b"late")
    bag.recording.event("disturbance/inject", 0, b"from now on")
    bag.recording.event("disturbance/inject", 7, b"then")
    bag.with_state("/clock", 0, b"first")
    bag.with_state("/clock", 5, b"clock")
    for stamp in (None, -1):
        bag.recording.sample(TORQUE, stamp, b"?", 4, 0.02)
    assert bag.written[0] == ("/diagnostics", 0, b"early")
    assert bag.written[-7:] == [
        ("/diagnostics", 20_000_000, b"late"),
        ("disturbance/inject", 20_000_000, b"from now on"),
        ("disturbance/inject", 7, b"then"),
        ("/clock", 0, b"first"),
        ("/clock", 5, b"clock"),
        *[(TORQUE, 20_000_000, b"?")] * 2,
    ]
    bag.run(range(3, 6))
    assert (bag.gaps(), bag.recording.surplus()) == ([], {})


def test_what_comes_again_with_a_repeated_state_is_written_once() -> None:
    """A clock, or a fix that belongs to an instant before; what others send twice are two.

    After a reset it is another one, though it is that of before.
    """
    bag = Bag()
    for repetition in range(4):
        if repetition % 2 == 0:
            bag.run(range(2))
        bag.with_state("/clock", 10_000_000, b"10 ms")
        bag.with_state("star_tracker/attitude", 0, b"fix")
        bag.with_state("battery", None, b"full")
        bag.recording.event("disturbance/inject", 0, b"hit")
    events = [name for name, _, data in bag.written if data in (b"10 ms", b"fix", b"full", b"hit")]
    twice = ["battery", "disturbance/inject"]
    assert sorted(events) == sorted(2 * ["/clock", "star_tracker/attitude", *twice, *twice])


def test_what_is_sent_ahead_and_comes_again_with_a_repeated_state_is_written_once() -> None:
    bag = Bag()
    for step in (0, 1, 1, 2):
        bag.take(STATE, step)
        for ahead in (step, step + 1):
            bag.with_state("reference/turn_ahead", stamp_ns(ahead), b"%d" % ahead)
    assert bag.steps("reference/turn_ahead") == [0, 1, 2, 3]


def test_a_sample_that_is_sent_twice_long_before_its_state_is_written_once() -> None:
    bag = Bag()
    assert bag.recording.progress() is None, "no state has come"
    bag.take(STATE, 0)
    for step in (1, 2, 3, 1):
        bag.take(TORQUE, step)
    for step in (1, 2, 3):
        bag.take(STATE, step)
    assert bag.steps(TORQUE) == [1, 2, 3]
    assert bag.recording.surplus() == {}


@pytest.mark.parametrize("again", [True, False])
def test_a_clock_that_comes_before_or_after_the_state_of_a_reset_keeps_to_its_own_time(
    again: bool,
) -> None:
    """Tools read by these times: they must not mix what came before and after."""
    bag = Bag()
    for first in (True, False):
        bag.run(range(4))
        for step in range(3):
            bag.with_state(CLOCK, stamp_ns(step), b"%d" % step)
        if first:
            bag.with_state(CLOCK, stamp_ns(3), b"3")
            bag.with_state(CLOCK, 0, b"0")  # and then the state with which time begins again
            bag.with_state(CLOCK, 0, b"0")
    if again:
        bag.with_state(CLOCK, stamp_ns(3), b"3")
    bag.take(STATE, 0)
    for step in (3, 0, 0, 1):  # of before, too
        bag.with_state(CLOCK, stamp_ns(step), b"%d" % step)
    steps = [0, 1, 2, 3, 0, 1, 2, 3, 0, 1]
    begins = [0] * 4 + [stamp_ns(3) + 1] * 4 + [2 * (stamp_ns(3) + 1)] * 2
    clock = [(time, int(data)) for name, time, data in bag.written if name == CLOCK]
    assert clock == [
        (begin + stamp_ns(step), step) for begin, step in zip(begins, steps, strict=True)
    ]


def test_a_clock_whose_zero_was_lost_follows_the_states_into_their_new_time() -> None:
    """Also if it is ahead of them."""
    bag = Bag()
    bag.run(range(4))
    bag.with_state(CLOCK, stamp_ns(3), b"3")
    bag.take(STATE, 0)
    bag.with_state(CLOCK, stamp_ns(1), b"1")
    assert bag.written[-1] == (CLOCK, stamp_ns(3) + 1 + stamp_ns(1), b"1")


def test_a_clock_of_zero_that_no_state_follows_begins_nothing() -> None:
    bag = Bag()
    bag.run(range(4))
    for step in (2, 0, 3):
        bag.with_state(CLOCK, stamp_ns(step), b"%d" % step)
    bag.run(range(4, 6))
    bag.run(range(1))
    assert [(time, data) for name, time, data in bag.written if name == CLOCK] == [
        (stamp_ns(2), b"2"),
        (stamp_ns(3), b"3"),
    ]


def test_a_topic_that_first_comes_after_resets_has_no_part_in_the_times_before() -> None:
    """As of a node that was started late: it lacks messages there, and not afterwards."""
    bag = Bag()
    for _ in range(2):
        for step in range(10):
            bag.take(STATE, step)
    for step in range(5):
        bag.take(STATE, step)
        bag.take(TORQUE, step)
    times = [time for name, time, _ in bag.written if name == TORQUE]
    assert times == [2 * (stamp_ns(9) + 1) + stamp_ns(step) for step in range(5)]
    lacks = f"{TORQUE} has 0 messages until 0.000000 s, {STATE} 10 until 0.090000 s"
    assert bag.recording.gaps([]) == [lacks, lacks]


def test_what_a_node_sends_without_stamps_stands_at_the_state_with_which_it_came() -> None:
    bag = Bag()
    for step, data in enumerate((b"on", b"off", b"off", b"on")):
        bag.run(range(step, step + 1))
        bag.with_state("mode", 0, data)
    assert [(time, data) for name, time, data in bag.written if name == "mode"] == [
        (stamp_ns(0), b"on"),
        (stamp_ns(1), b"off"),
        (stamp_ns(3), b"on"),
    ]


def test_when_a_restarted_node_began_is_told_of_its_topics_that_are_no_samples_too() -> None:
    """And it is zero once time has begun again: the node has its values from there on."""
    bag = Bag()
    numbers = itertools.count(1)
    for step in range(40):
        bag.run(range(step, step + 1))
        if step == 20:
            numbers = itertools.count(1)  # started again
        bag.recording.event_with_state(
            "estimator/state", stamp_ns(step), b"%d" % step, next(numbers), step / 100.0
        )
    assert bag.recording.began(["estimator/state"], 0.15) == stamp_ns(20)
    assert bag.recording.began(["estimator/state"], 0.3) is None
    bag.recording.sample(STATE, 0, b"0 again", 41, 0.5)
    assert bag.recording.began(["estimator/state"], 0.15) == 0
