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

"""What is written of a run, each sample once its state has come, and every gap that is told."""

import itertools
from collections.abc import Iterable
from random import Random

import pytest
from synthetic import SAMPLED

from ppc_attitude.contract.topics import ATTITUDE, DISTURBANCE, PLANT, TORQUE_COMMAND, Topic
from ppc_attitude.runtime.recording import Recording
from ppc_attitude.science.stamps import stamp_of

STATE, TORQUE, AHEAD = ATTITUDE.name, TORQUE_COMMAND.name, DISTURBANCE.name
ALL = (STATE, TORQUE, AHEAD)
SENT = [topic.name for topic in SAMPLED]
STEPS = 50


class Bag:
    """A recording, and what it has written."""

    def __init__(self) -> None:
        self.written: list[tuple[str, int, bytes]] = []
        self.recording = Recording(lambda *message: self.written.append(message))
        self._numbers = {name: itertools.count(1) for name in ALL}

    def take(self, name: str, step: int, data: bytes = b"") -> None:
        stamp = stamp_of(step, 100.0)
        number = next(self._numbers[name])
        now = step / 100.0  # by the wall clock [s], in real time
        self.recording.sample(name, stamp, data or b"%d" % step, number, now, name == AHEAD)

    def run(self, steps: range) -> None:
        for step in steps:
            self.take(STATE, step)
            self.take(TORQUE, step)
            for ahead in (step, step + 1) if step == 0 else (step + 1,):
                self.take(AHEAD, ahead)

    def steps(self, name: str) -> list[int]:
        return [int(data.split()[0]) for topic, _, data in self.written if topic == name]

    def gaps(self) -> list[str]:
        return self.recording.gaps(ALL)


def test_the_record_of_a_run_that_goes_on_ends_with_a_whole_instant() -> None:
    bag = Bag()
    bag.run(range(20))
    bag.take(STATE, 20)
    bag.recording.end()
    bag.take(TORQUE, 20)
    bag.run(range(21, 60))
    assert bag.steps(STATE) == bag.steps(TORQUE) == bag.steps(AHEAD) == [*range(21)]
    assert bag.gaps() == []


def test_what_was_sent_ahead_of_an_instant_that_never_came_is_in_no_record() -> None:
    """A plant of whole milliseconds is foreseen now and then, and comes otherwise."""
    before, after = Bag(), Bag()
    for step in (0, 8, 19, 27, 37):
        before.take(AHEAD, step)
        before.take(AHEAD, step + 8)
        for bag in (before, after):
            bag.take(STATE, step)
            bag.take(TORQUE, step)
    for step in (0, 8, 16, 19, 27, 35, 37):
        after.take(AHEAD, step)
    for bag in (before, after):
        assert sorted(bag.steps(AHEAD)) == [0, 8, 19, 27, 37]
        assert bag.gaps() == []
    for step in (0, 8, 16, 27):  # time begins again, and no state comes at 19
        after.take(STATE, step)
        after.take(TORQUE, step)
    for step in (0, 8, 16, 19, 27):
        after.take(AHEAD, step)
    assert after.steps(AHEAD)[5:] == [0, 8, 16, 27]
    assert after.gaps() == []


def test_what_is_sent_ahead_is_written_after_time_has_gone_back() -> None:
    """A rig that is started again, or whose clock is set back, need not begin at zero."""
    bag = Bag()
    for run in (range(0, 40, 2), range(11, 31, 2)):
        for step in run:
            bag.take(STATE, step)
            for ahead in (step, step + 2) if step == run[0] else (step + 2,):
                bag.take(AHEAD, ahead)
    assert bag.steps(AHEAD) == bag.steps(STATE) == [*range(0, 40, 2), *range(11, 31, 2)]


def test_what_was_sent_at_skipped_instants_is_written_in_the_order_of_time() -> None:
    """What is foreseen may be known before what answers earlier instants."""
    bag = Bag()
    bag.run(range(10))
    bag.take(AHEAD, 16)
    for step in range(10, 18):
        bag.take(TORQUE, step)
    for step in (15, 16, 17):
        bag.take(STATE, step)
    assert bag.steps(TORQUE) == [*range(18)]
    assert bag.recording.surplus() == {}
    bag.take(TORQUE, 12, b"12 late")
    bag.take(AHEAD, 12)
    assert (bag.steps(TORQUE)[18:], bag.steps(AHEAD)[10:]) == ([12], [16])


@pytest.mark.parametrize("silent", [range(10, 300), range(10, 500), range(300)])
def test_what_the_others_send_while_no_state_comes_is_written(silent: range) -> None:
    """An estimator that gives the states is late, is started again, or has died amid the run."""
    bag = Bag()
    for step in range(500):
        if step not in silent:
            bag.take(STATE, step)
        bag.take(TORQUE, step)
    assert bag.gaps() != []
    assert bag.steps(TORQUE) == list(range(500))


@pytest.mark.parametrize("seed", range(20))
def test_in_whatever_order_topics_are_read_the_record_is_the_same(seed: int) -> None:
    """Each topic keeps its order; how far each has been read at a time is chance."""
    random = Random(seed)
    states = [*range(30), *range(25)]
    sent = {STATE: states, TORQUE: states, AHEAD: [*range(31), *range(26)]}
    bag = Bag()
    left = {name: iter(steps) for name, steps in sent.items()}
    while left:
        name = random.choice(sorted(left))
        for _ in range(random.randint(1, 12)):
            step = next(left[name], None)
            if step is None:
                del left[name]
                break
            bag.take(name, step)
    for name in ALL:
        assert bag.steps(name) == states, name
        # Other tools read by these times: what came before time began again comes first.
        times = [time for topic, time, _ in bag.written if topic == name]
        assert times[:30] == [stamp_of(step, 100.0) for step in range(30)]
        assert times[30:] == [times[29] + 1 + stamp_of(step, 100.0) for step in range(25)]
    assert bag.gaps() == []


def test_repeated_states_and_answers_are_written_once() -> None:
    bag = Bag()
    bag.run(range(5))
    for name, step in ((STATE, 3), (STATE, 4), (TORQUE, 3), (TORQUE, 4), (AHEAD, 4), (AHEAD, 5)):
        bag.take(name, step)
    bag.run(range(5, 10))
    assert {name: bag.steps(name) for name in ALL} == {name: list(range(10)) for name in ALL}
    assert (bag.gaps(), bag.recording.surplus()) == ([], {})


def test_a_stranger_s_messages_are_told_apart_and_make_no_gap() -> None:
    bag = Bag()
    bag.run(range(10))
    for step in (3, 9, 400):
        bag.take(TORQUE, step, b"%d not ours" % step)
    bag.run(range(10, 20))
    assert bag.gaps() == []
    assert bag.recording.surplus() == {TORQUE: 2}
    assert 400 not in bag.steps(TORQUE)


@pytest.mark.parametrize("names", [(STATE,), (TORQUE,), (AHEAD,), (TORQUE, AHEAD)])
def test_strangers_who_send_no_stamp_end_no_record(names: tuple[str, ...]) -> None:
    """`ros2 topic pub` sends zero; a reset of the plant does so too."""
    bag = Bag()
    for epoch in range(2):
        for step in range(20):
            bag.run(range(step, step + 1))
            if step in (7, 8, 12):
                for name in names:
                    bag.take(name, 0, b"%d without a stamp" % step)
                    bag.take(name, 0, b"another without a stamp")
        assert bag.gaps() == []
        assert bag.recording.surplus() == dict.fromkeys(names, 6 * (epoch + 1))
        others = [step for _ in range(epoch + 1) for step in range(20)]
        assert all(bag.steps(each) == others for each in ALL if each not in names)


def test_who_joins_a_run_begins_with_the_first_state_that_it_hears() -> None:
    bag = Bag()
    bag.take(TORQUE, 6)
    bag.take(AHEAD, 7)
    bag.take(AHEAD, 8)
    bag.run(range(8, 20))
    assert {name: bag.steps(name) for name in ALL} == {name: list(range(8, 20)) for name in ALL}
    assert bag.gaps() == []


def test_only_so_many_messages_wait_for_their_states(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ppc_attitude.runtime.recording._MOST_AHEAD", 100)
    bag = Bag()
    bag.run(range(150))
    bag.take(TORQUE, 0, b"0 without a stamp")
    bag.run(range(150, 200))
    for step in range(200, 299):  # what was sent ahead for 200 waits as well
        bag.take(TORQUE, step)
    assert bag.steps(TORQUE)[-1] == 199
    bag.take(TORQUE, 299)
    assert bag.steps(TORQUE)[-1] == 298


def test_two_publishers_of_a_topic_are_seen_and_one_after_the_other_are_not() -> None:
    bag = Bag()
    bag.run(range(40))
    bag._numbers[TORQUE] = itertools.count(1)  # restarted
    bag.run(range(40, 80))
    assert bag.gaps() == []
    other = itertools.count(1)
    for step in range(80, 120):
        bag.run(range(step, step + 1))
        bag.recording.sample(TORQUE, stamp_of(step, 100.0), b"other", next(other), 0.0)
    told = f"{TORQUE} came from several nodes:"
    assert bag.gaps() == [f"{told} nodes that have ended"]
    bag.recording.see(TORQUE, {1: "/one", 2: "/other"}, 0.0)
    assert bag.gaps() == [f"{told} /one, /other"]


def test_progress_is_told_now_and_then_and_to_a_plant_that_repeats_its_state() -> None:
    bag = Bag()
    told = []
    for step in range(2000):
        bag.take(STATE, step)
        told.append(bag.recording.progress())
    told = [stamp for stamp in told if stamp is not None]
    assert told == [stamp_of(step, 100.0) for step in range(0, 2000, 100)]
    for name, progress in ((TORQUE, None), (TORQUE, None), (STATE, stamp_of(1999, 100.0))):
        bag.take(name, 1999)
        assert bag.recording.progress() == progress
        assert bag.recording.progress() is None


def test_what_is_no_sample_is_written_at_its_time_or_at_that_of_the_newest_state() -> None:
    """A message of a sample's topic without a stamp is none; it counts for nothing."""
    bag = Bag()
    bag.recording.event("/diagnostics", None, b"early")
    bag.run(range(3))
    bag.recording.event("/diagnostics", None, b"late")
    bag.recording.event("disturbance/inject", 0, b"from now on")
    bag.recording.event("disturbance/inject", 7, b"then")
    bag.recording.event("/clock", 0, b"first", with_state=True)
    bag.recording.event("/clock", 5, b"clock", with_state=True)
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
        bag.recording.event("/clock", 10_000_000, b"10 ms", with_state=True)
        bag.recording.event("star_tracker/attitude", 0, b"fix", with_state=True)
        bag.recording.event("battery", None, b"full", with_state=True)
        bag.recording.event("disturbance/inject", 0, b"hit")
    events = [name for name, _, data in bag.written if data in (b"10 ms", b"fix", b"full", b"hit")]
    twice = ["battery", "disturbance/inject"]
    assert sorted(events) == sorted(2 * ["/clock", "star_tracker/attitude", *twice, *twice])


# What is missing


def gaps_of(*events: tuple[Topic, int], expected: list[str] = SENT) -> list[str]:
    recording = Recording(lambda *message: None)
    for topic, step in events:
        recording.sample(topic.name, stamp_of(step, 100.0), b"", None, 0.0)
    return recording.gaps(expected)


def steps_of(steps: Iterable[int], *left_out: Topic) -> list[tuple[Topic, int]]:
    topics = [topic for topic in SAMPLED if topic not in left_out]
    return [(topic, step) for step, topic in itertools.product(steps, topics)]


@pytest.mark.parametrize("topic", [t for t in SAMPLED if t is not ATTITUDE], ids=lambda t: t.name)
def test_a_topic_that_never_came_is_a_gap(topic: Topic) -> None:
    assert gaps_of(*steps_of(range(STEPS), topic)) == [f"{topic.name} never came"]
    others = [name for name in SENT if name != topic.name]
    assert gaps_of(*steps_of(range(STEPS), topic), expected=others) == []


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


@pytest.mark.parametrize("late", [16, 19])
def test_a_state_that_is_only_late_is_no_gap(late: int) -> None:
    """As for who reads the bag: the next step of a timer that was late is shorter."""
    ticks = [10 * k for k in range(50)]
    ticks[30] += late - 10
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
