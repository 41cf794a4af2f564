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

"""What the recorder says of its bag while it grows: every gap, and no gap that is none."""

import itertools
import json

import pytest
from synthetic import SAMPLED

from ppc_attitude.command_line.parameter_file import run_info
from ppc_attitude.contract import declared
from ppc_attitude.contract.declared import ATTITUDE_ERROR, BY_COLUMN, BY_NAME, promised
from ppc_attitude.contract.topics import (
    ATTITUDE,
    CONTROLLER,
    DISTURBANCE,
    ESTIMATOR,
    INJECTOR,
    PLANT,
    REFERENCE,
    TORQUE_COMMAND,
    TRUE_ATTITUDE,
    Topic,
)
from ppc_attitude.runtime.recording import Recording
from ppc_attitude.science.stamps import stamp_of

ALL = [topic.name for topic in SAMPLED]
STEPS = 50


def told(*events: tuple[Topic, int], expected: list[str] = ALL) -> list[str]:
    recording = Recording(lambda *message: None)
    for topic, step in events:
        recording.sample(topic.name, stamp_of(step, 100.0), b"", None, 0.0)
    return recording.gaps(expected)


def run(steps: range, *left_out: Topic) -> list[tuple[Topic, int]]:
    topics = [topic for topic in SAMPLED if topic not in left_out]
    return [(topic, step) for step, topic in itertools.product(steps, topics)]


def test_a_whole_run_has_no_gap() -> None:
    assert told(*run(range(STEPS))) == []


@pytest.mark.parametrize("topic", [t for t in SAMPLED if t is not ATTITUDE], ids=lambda t: t.name)
def test_a_topic_that_never_came_is_a_gap(topic: Topic) -> None:
    assert told(*run(range(STEPS), topic)) == [f"{topic.name} never came"]
    others = [name for name in ALL if name != topic.name]
    assert told(*run(range(STEPS), topic), expected=others) == []


def test_nothing_at_all_is_no_complete_run() -> None:
    assert told() == ["attitude never came"]
    assert told((TORQUE_COMMAND, 0)) == ["attitude never came"]


def test_the_last_state_may_be_unanswered() -> None:
    unanswered = [(topic, STEPS) for topic in SAMPLED if topic.source == PLANT]
    assert told(*run(range(STEPS)), *unanswered) == []
    assert told((ATTITUDE, 0)) == []
    assert "torque_command never came" in told((ATTITUDE, 0), (ATTITUDE, 1))


@pytest.mark.parametrize("lost", [0, 1, 20, STEPS - 2])
def test_a_lost_message_is_a_gap(lost: int) -> None:
    events = [event for event in run(range(STEPS)) if event != (TORQUE_COMMAND, lost)]
    (gap,) = told(*events)
    assert gap.startswith(f"torque_command has {STEPS - 1} messages until 0.490000 s, attitude 50")


def test_a_lost_instant_is_a_gap() -> None:
    (gap,) = told(*run(range(20)), *run(range(21, STEPS)))
    assert gap == "attitude jumps from 0.190000 s to 0.210000 s"


def test_the_first_step_of_a_plant_may_be_shorter_than_others() -> None:
    """A bridge's first state is at zero, and the next one when its clock comes round."""
    for second in (1, 4, 9):
        first = [*run(range(1)), *run(range(second, 100, 10))]
        assert told(*first) == told(*first, *run(range(second + 100, 300, 10))) == []
        (gap,) = told(*first, *run(range(second + 120, 300, 10)))
        assert gap.startswith("attitude jumps from 0.9")


def test_a_first_step_that_is_longer_hides_no_gap() -> None:
    gaps = told(*run(range(1)), *run(range(3, 20)), *run(range(22, STEPS)))
    assert gaps[1:] == ["attitude jumps from 0.190000 s to 0.220000 s"]


def test_a_rhythm_that_changes_has_no_gaps() -> None:
    lengths = itertools.cycle((12, 3, 17, 8, 5))
    steps = list(itertools.accumulate(itertools.islice(lengths, 43)))
    events = [event for step in steps for event in run(range(step, step + 1))]
    assert told(*events) == []
    assert told(*(each for each in events if each != (TORQUE_COMMAND, steps[-1]))) == []


def test_many_gaps_are_counted_and_only_the_first_are_told() -> None:
    steps = [step for step in range(1000) if step % 10]
    gaps = told(*(event for step in steps for event in run(range(step, step + 1))))
    assert gaps[0] == "attitude jumps from 0.090000 s to 0.110000 s"
    assert (len(gaps), gaps[-1]) == (6, "attitude jumps 94 times more")


def test_each_side_of_a_reset_is_compared_by_itself() -> None:
    assert told(*run(range(30)), *run(range(20))) == []
    before = [event for event in run(range(30)) if event != (DISTURBANCE, 7)]
    (gap,) = told(*before, *run(range(20)))
    assert gap.startswith("disturbance/torque has 29 messages")
    (gap,) = told(*run(range(30)), *run(range(20), DISTURBANCE))
    assert gap == "disturbance/torque has 0 messages until 0.000000 s, attitude 20 until 0.190000 s"


def names(parameters: dict[str, dict[str, str]]) -> set[str]:
    return {topic.name for topic in promised(parameters)}


def test_who_took_part_promises_what_it_sends() -> None:
    everyone = {name: {} for name in (PLANT, REFERENCE, INJECTOR)}
    ours = {**everyone, CONTROLLER: {"controller": "ppc"}}
    assert names(ours) == set(ALL)
    another = {**ours, CONTROLLER: {"controller": "log_barrier"}}
    assert BY_COLUMN["auxiliary_state"].name not in names(another)
    assert names(everyone) == {topic.name for topic in SAMPLED if topic.source != CONTROLLER}
    assert DISTURBANCE.name not in names({PLANT: {}, CONTROLLER: {"controller": "ppc"}})


def test_a_recorder_is_told_what_comes_at_each_instant_and_what_does_not() -> None:
    chosen = {
        PLANT: {"sensors": True},
        ESTIMATOR: {"estimator": "mekf"},
        CONTROLLER: {"controller": "log_barrier"},
    }
    told = run_info({f"/craft/{name}": values for name, values in chosen.items()})
    samples = json.loads(told)["samples"]
    sent = {BY_NAME[name] for names in samples.values() for name in names}
    assert {ATTITUDE_ERROR, TORQUE_COMMAND, TRUE_ATTITUDE} <= sent
    assert BY_COLUMN["auxiliary_state"] not in sent
    assert not [topic for topic in sent if topic.late]
    assert {topic.source for topic in declared.SAMPLED if topic.late} == {PLANT, ESTIMATOR}


def test_a_recorder_is_told_what_a_node_of_the_user_s_has_to_send() -> None:
    """Its name is unknown, so the recorder did not listen to it, and the plant waited for that."""
    told = run_info({f"/craft/{PLANT}": {"actuator": "wheel_motors"}})
    samples = json.loads(told)["samples"][f"/craft/{PLANT}"]
    assert BY_COLUMN["wheel_torque_command"].name in samples
    assert not {TORQUE_COMMAND.name, DISTURBANCE.name} & set(samples)


def test_nodes_of_the_users_own_promise_nothing() -> None:
    law = names({CONTROLLER: {"controller": "ppc"}})
    assert law == {topic.name for topic in SAMPLED if topic.source == CONTROLLER}
    assert names({}) == set()
