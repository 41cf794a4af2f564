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

"""What is written of a run: each sample, once its state has come."""

import itertools
from random import Random

import pytest

from ppc_attitude.contract.topics import (
    ATTITUDE,
    CLOCK_TOPIC,
    DISTURBANCE,
    GUIDANCE_STATUS,
    TORQUE_COMMAND,
    TRUE_ATTITUDE,
)
from ppc_attitude.runtime.recording import Drain, Recording
from ppc_attitude.science.stamps import NANOSECONDS, stamp_of

STATE, TORQUE, AHEAD = ATTITUDE.name, TORQUE_COMMAND.name, DISTURBANCE.name
TRUTH, CLOCK, STATUS = TRUE_ATTITUDE.name, CLOCK_TOPIC.name, GUIDANCE_STATUS.name
ALL = (STATE, TORQUE, AHEAD)


def stamp_ns(step: int) -> int:
    return stamp_of(step, 100.0)


class Bag:
    def __init__(self) -> None:
        self.written: list[tuple[str, int, bytes]] = []
        self.recording = Recording(lambda *message: self.written.append(message))
        self._numbers = {name: itertools.count(1) for name in (*ALL, TRUTH)}

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

    def with_state(self, name: str, stamp_ns: int | None, data: bytes) -> None:
        self.recording.event_with_state(name, stamp_ns, data, None, 0.0)

    def steps(self, name: str) -> list[int]:
        return [int(data.split()[0]) for topic, _, data in self.written if topic == name]

    def gaps(self) -> list[str]:
        return self.recording.gaps(ALL)


def test_the_record_of_a_run_that_goes_on_ends_with_a_whole_instant() -> None:
    bag = Bag()
    bag.run(range(20))
    bag.take(STATE, 20)
    bag.recording.end(0.2)
    bag.take(TORQUE, 20)
    bag.run(range(21, 60))
    assert bag.steps(STATE) == bag.steps(TORQUE) == bag.steps(AHEAD) == [*range(21)]
    assert bag.gaps() == []


@pytest.mark.parametrize(("ends", "goes_on"), [(0.5, True), (5.0, False)])
def test_what_waits_at_the_end_is_of_later_instants_unless_states_have_ceased(
    ends: float, goes_on: bool
) -> None:
    """On a busy machine one topic is read far ahead of another."""
    bag = Bag()
    bag.run(range(20))
    for step in range(20, 60):
        bag.take(TORQUE, step)
    bag.recording.end(ends)
    assert (bag.gaps() == []) == goes_on
    assert bag.steps(TORQUE) == [*range(20 if goes_on else 60)]


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


def test_what_is_sent_ahead_is_written_where_only_the_truth_has_the_instant() -> None:
    """An estimator that is stopped gives no states, and the environment goes on."""
    bag = Bag()
    for step in range(30):
        bag.take(TRUTH, step)
        if step < 10 or step == 29:
            bag.take(STATE, step)
        bag.take(AHEAD, step)
    assert bag.steps(AHEAD) == [*range(30)]


def test_what_is_sent_again_after_a_driver_began_anew_is_no_repetition() -> None:
    """Its clock need not begin at zero, and a torque may be the same at the same stamp again."""
    bag = Bag()
    for begin in (0, 3):
        for step in range(begin, 30):
            bag.take(STATE, step)
            bag.take(TORQUE, step)
    assert bag.steps(TORQUE) == [*range(30), *range(3, 30)]


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


@pytest.mark.parametrize("name", ALL)
def test_a_stamp_of_zero_before_a_repeated_message_ends_no_record(name: str) -> None:
    """A plant that waits repeats its state, and every peer its answers: also what is not new."""
    bag = Bag()
    bag.run(range(20))
    bag.take(name, 0, b"0 without a stamp")
    for repeated, step in ((STATE, 19), (TORQUE, 19), (AHEAD, 19), (AHEAD, 20)):
        bag.take(repeated, step)
    bag.run(range(20, 40))
    assert bag.gaps() == []
    others = {each: bag.steps(each) for each in ALL if each != name}
    assert all(steps == list(range(40)) for steps in others.values())
    assert {*bag.steps(name)} == {*range(40)}


@pytest.mark.parametrize("seed", range(20))
def test_whatever_stamps_come_the_record_goes_on(seed: int) -> None:
    """Of two plants, or of strangers: zeros, repeated ones, and others back and ahead."""
    random, bag = Random(seed), Bag()
    steps = dict.fromkeys((*ALL, TRUTH), 0)
    for _ in range(300):
        name = random.choice(sorted(steps))
        step = steps[name]
        steps[name] = random.choice((*[step + 1] * 5, step, 0, max(step - 4, 0), step + 9))
        bag.take(name, steps[name], b"%d %d" % (steps[name], random.randint(0, 2)))
    written = len(bag.written)
    latest = max(steps.values())
    bag.run(range(latest + 1, latest + 40))
    assert len(bag.written) >= written + 39  # the states at least
    assert bag.gaps() != []


def test_who_joins_a_run_begins_with_the_first_state_that_it_hears() -> None:
    bag = Bag()
    bag.take(TORQUE, 6)
    bag.take(AHEAD, 7)
    bag.take(AHEAD, 8)
    bag.run(range(8, 10))
    bag.take(TORQUE, 7)  # one topic is read after the other
    bag.run(range(10, 20))
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


def test_two_publishers_of_what_belongs_to_one_node_are_seen_though_it_is_no_sample() -> None:
    bag = Bag()
    bag.run(range(1))
    for second in range(40):
        for number, topic in ((second, CLOCK), (second, STATUS), (second + 500, STATUS)):
            bag.recording.hear(topic, second * NANOSECONDS, number, float(second))
    assert bag.gaps() == [f"{STATUS} came from several nodes: nodes that have ended"]
    bag.recording.see(STATUS, {1: "/one", 2: "/other"}, 40.0)
    assert bag.gaps() == [f"{STATUS} came from several nodes: /one, /other"]


def test_who_publishes_beside_another_for_long_is_seen_though_few_messages_come() -> None:
    """For so long only a node that lives is in the graph; samples come often enough to prove it."""
    bag = Bag()
    bag.run(range(1))
    bag.recording.hear(STATUS, 0, 1, 0.0)
    for topic in (STATUS, TORQUE):
        for now, other in ((0.0, "killed"), (20.0, "started again"), (49.9, "started again")):
            bag.recording.see(topic, {"one": "/one", other: "/other"}, now)
    assert bag.gaps() == []
    for topic in (STATUS, TORQUE):
        bag.recording.see(topic, {"one": "/one", "started again": "/other"}, 50.0)
    assert bag.gaps() == [f"{STATUS} came from several nodes: /one, /other"]


def test_a_topic_of_the_user_s_may_have_many_publishers() -> None:
    """As transforms and joint states have, though one of them is a node of the run."""
    bag = Bag()
    bag.run(range(1))
    for second in range(40):
        bag.recording.see("tf", {"plant": "/plant", "arm": "/arm"}, float(second))
        for number in (second, second + 500):
            stamp = second * NANOSECONDS
            bag.recording.event_with_state("tf", stamp, b"%d" % number, number, float(second))
    assert bag.gaps() == []


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


def test_a_record_ends_when_nothing_has_come_for_a_while() -> None:
    drain = Drain(10.0, wall_ns=0)
    assert drain.goes_on(10.29, heard=9.0)
    assert not drain.goes_on(10.31, heard=9.0)
    assert drain.goes_on(10.79, heard=10.5)
    assert not drain.runs_on(10.79, sent_ns=NANOSECONDS), "it may have been on its way"
    assert not drain.goes_on(10.81, heard=10.5)


def test_a_record_of_a_stack_that_runs_on_ends_all_the_same() -> None:
    drain = Drain(10.0, wall_ns=5 * NANOSECONDS)
    assert drain.runs_on(11.1, sent_ns=6 * NANOSECONDS + 1)
    assert not drain.runs_on(11.2, sent_ns=7 * NANOSECONDS), "that is told once"
    assert drain.goes_on(11.39, heard=11.39)
    assert not drain.goes_on(11.41, heard=11.41)
