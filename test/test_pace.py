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

"""The pace of the plant: lock-step and free-running with a clock and peers of the test's own."""

from random import Random

import pytest
from pace_helpers import COMMAND, DISTURBANCE, PERIOD, RULES, TORQUE, ZERO, Bench, steps

from ppc_attitude.contract.topics import RECORDED_TOPIC
from ppc_attitude.runtime.health import OK, STALE, WARN
from ppc_attitude.runtime.pace import FreeRunning, Lockstep, Pace
from ppc_attitude.runtime.stamps import RefusedError


def test_a_pace_that_is_slow_waits_for_the_clock_and_for_nobody() -> None:
    bench = Bench(Lockstep, factor=0.001)
    bench.answer()  # the next state is due after 10 s
    for _ in range(90):
        bench.passes(0.1)
        assert bench.now - bench.pace.waiting_since < 1.0
    assert bench.pace.status(bench.now) == (OK, "running")
    bench.passes(2.0)
    bench.passes(2.0)
    assert bench.shown[0] < bench.time * 1e9
    level, text = bench.pace.status(bench.now)
    assert (level, COMMAND in text) == (STALE, True)


def test_what_comes_one_instant_ahead_is_kept_for_it() -> None:
    bench = Bench(Lockstep)
    bench.give(DISTURBANCE, (0.0, 0.0, 0.0))
    for step in range(50):
        bench.give(DISTURBANCE, (0.0, step + 1.0, 0.0), ahead=1)
        bench.give(COMMAND, TORQUE)
    assert [given[DISTURBANCE][1] for _, given in bench.acted] == [float(k) for k in range(50)]
    assert bench.shown == steps(51)


@pytest.mark.parametrize("kind", [Lockstep, FreeRunning])
def test_of_several_answers_with_one_stamp_the_first_acts(kind: type[Pace]) -> None:
    """The same counts where the bag is read: what acted and what is on record agree."""
    bench = Bench(kind)
    for _ in range(20):
        for ahead in (0, 1):
            bench.give(DISTURBANCE, (bench.stamp + ahead * 10_000_000.0, 0.0, 0.0), ahead)
            bench.give(DISTURBANCE, TORQUE, ahead)
        bench.give(COMMAND, TORQUE)
        bench.passes(PERIOD)
    assert len(bench.acted) > 10
    assert all(given[DISTURBANCE][0] == stamp for stamp, given in bench.acted)


def test_what_is_further_ahead_or_behind_is_refused() -> None:
    bench = Bench(Lockstep)
    for _ in range(3):
        bench.answer()
    with pytest.raises(RefusedError, match=r"torque_command: stamp 0\.050000 s is in the future"):
        bench.give(COMMAND, TORQUE, ahead=2)
    with pytest.raises(RefusedError, match=r"torque_command: stamp 0\.010000 s is out of order"):
        bench.give(COMMAND, TORQUE, ahead=-2)
    bench.give(COMMAND, TORQUE, ahead=-1)  # a repeated answer


def test_a_second_answer_to_a_repeated_state_may_come_late() -> None:
    bench = Bench(Lockstep)
    bench.passes(0.3)
    for ahead in (0, 1):
        bench.give(DISTURBANCE, ZERO, ahead)
    for _ in range(3):
        bench.answer()
    for ahead in (-3, -2):  # the answers to the second state, of which one was sent ahead
        bench.give(DISTURBANCE, ZERO, ahead)
    assert bench.shown[-1] == steps(4)[-1]


def test_an_unanswered_state_is_repeated_less_and_less_often_and_told() -> None:
    bench = Bench(Lockstep)
    for _ in range(40):
        bench.passes(0.1)
    assert set(bench.shown) == {0}
    assert len(bench.shown) == pytest.approx(1 + 3 + 3, abs=1)  # 0.2, 0.4, 0.8, then each second
    bench.absent = {DISTURBANCE}
    level, text = bench.pace.status(bench.now)
    assert level == STALE
    assert text == (
        "waiting at t = 0.000 s for torque_command, disturbance/torque; "
        "nobody publishes disturbance/torque"
    )
    bench.answer()
    assert bench.pace.status(bench.now) == (OK, "running")
    bench.passes(0.25)
    assert bench.shown[-2:] == steps(2)[1:] * 2, "the next state is repeated as soon as the first"


@pytest.mark.parametrize("kind", [Lockstep, FreeRunning])
def test_the_stamp_of_what_came_last_is_told(kind: type[Pace]) -> None:
    """A controller that leaves the stamp at zero is heard, and waited for all the same."""
    bench = Bench(kind)
    for _ in range(80):
        bench.pace.take(COMMAND, 0, TORQUE, bench.now)
        bench.pace.take(DISTURBANCE, bench.stamp, ZERO, bench.now)
        bench.passes(PERIOD)
    said = [bench.pace.waiting()] if isinstance(bench.pace, Lockstep) else bench.said
    assert any(text.endswith("; the last torque_command has the stamp 0.000 s") for text in said)


@pytest.mark.parametrize("kind", [Lockstep, FreeRunning])
def test_who_is_woken_only_when_it_asks_for_it_keeps_the_pace(kind: type[Pace]) -> None:
    bench = Bench(kind, factor=1.0, waits=True)
    bench.pace.record(0, bench.now)
    begun, due = bench.now, bench.now + 0.1
    for _ in range(2000):
        if bench.shown[-1] == bench.stamp:
            for name in RULES["inputs"]:
                if bench.pace.take(name, bench.stamp, TORQUE, bench.now):
                    due = bench.now
        if bench.now >= due:
            due = bench.now + bench.wake()
        assert bench.now - begun - bench.time < 1.5 * PERIOD
        bench.now += 0.001
    assert bench.time == pytest.approx(2.0, abs=2.0 * PERIOD)


@pytest.mark.parametrize("before", [0.0, 0.1, 10.0])
def test_a_pace_that_is_chosen_in_flight_holds_from_then_on(before: float) -> None:
    bench = Bench(Lockstep, factor=before)
    bench.follows(1.0)
    bench.pace.rules.factor, begun = 2.0, bench.stamp
    bench.follows(3.0)
    assert bench.time - begun * 1e-9 == pytest.approx(2.0 * 3.0, abs=3.0 * PERIOD)


def test_what_lockstep_has_waited_for_others_is_not_caught_up() -> None:
    bench = Bench(Lockstep, factor=1.0)
    for begun in (0.0, 1.0):
        assert bench.time == pytest.approx(begun, abs=2.0 * PERIOD)
        bench.passes(20.0)
        bench.follows(1.0)


def test_a_state_whose_answers_came_before_it_was_due_waits_for_nobody_when_it_is() -> None:
    bench = Bench(Lockstep, factor=1.0)
    for name, values in ((COMMAND, TORQUE), (DISTURBANCE, ZERO)):
        bench.give(name, values, ahead=1)
    bench.answer()
    assert (bench.pace.step, bench.shown) == (1, steps(1))
    bench.now += 1.5 * PERIOD
    assert bench.wake() == 0.0, "when the next one is due is still to be asked"
    assert (bench.pace.step, bench.shown) == (2, steps(2))


def test_an_input_that_is_ahead_alone_drives_the_loop() -> None:
    bench = Bench(Lockstep, wait_for=(DISTURBANCE,))
    bench.give(DISTURBANCE, ZERO)
    for step in range(20):
        assert bench.stamp == steps(40)[step + 1]
        bench.give(DISTURBANCE, ZERO)
    assert bench.shown == steps(22)


def test_an_input_that_is_not_waited_for_acts_on_no_later_state() -> None:
    bench = Bench(Lockstep, wait_for=(COMMAND,))
    bench.give(COMMAND, TORQUE)
    bench.give(DISTURBANCE, TORQUE, ahead=-1)
    bench.give(COMMAND, TORQUE)
    assert bench.acted[-1][1] == {COMMAND: TORQUE, DISTURBANCE: ZERO}


def test_the_torque_of_an_injector_that_is_not_waited_for_does_not_act_for_ever() -> None:
    bench = Bench(Lockstep, wait_for=(COMMAND,))
    bench.give(DISTURBANCE, TORQUE)
    for _ in range(60):
        bench.give(COMMAND, TORQUE)
    acted = [given[DISTURBANCE] for _, given in bench.acted]
    assert acted == [TORQUE] * 51 + [ZERO] * 9, "0.5 s by simulated time"
    assert bench.pace.status(bench.now) == (WARN, f"no {DISTURBANCE}: zero torque")
    assert [text.partition(":")[0] for text in bench.said] == [f"no {DISTURBANCE} for 0.5 s"]


def test_an_input_is_as_old_as_the_time_out_for_one_step_at_every_rate() -> None:
    for begin in range(6):
        bench = Bench(Lockstep, wait_for=(COMMAND,), rate=30.0, timeout_ns=33_333_333)
        for step in range(begin + 4):
            if step == begin:
                bench.give(DISTURBANCE, TORQUE)
            bench.give(COMMAND, TORQUE)
        acted = [given[DISTURBANCE] for _, given in bench.acted]
        assert acted == [ZERO] * begin + [TORQUE] * 2 + [ZERO] * 2


def test_the_last_step_tells_what_acts_and_ends() -> None:
    bench = Bench(Lockstep, last_step=5)
    while not bench.pace.finished:
        bench.answer()
    assert bench.shown == steps(6)
    assert [stamp for stamp, _ in bench.acted] == steps(6)
    assert (bench.stamp, bench.pace.step) == (bench.shown[-1], 5)


def test_lockstep_waits_for_a_recorder_that_lags_and_for_no_other() -> None:
    bench = Bench(Lockstep)
    for _ in range(6000):
        bench.answer()
    assert bench.pace.step == 6000, "nobody says that he records"
    bench.pace.record(bench.stamp, bench.now)
    for _ in range(4000):
        bench.answer()
    assert bench.pace.step == 6000 + 501
    assert bench.pace.waiting().endswith("for the recorder to follow")
    bench.pace.record(steps(7001)[-1], bench.now)
    for _ in range(4000):
        bench.answer()
    assert bench.pace.step == 7000 + 501
    bench.wake()
    assert bench.pace.step == 7000 + 501
    bench.absent.add(RECORDED_TOPIC.name)
    bench.wake()
    assert bench.pace.step == 7000 + 502, "the answers that have come are enough"
    assert bench.said == ["the recorder has gone: no wait for it from t = 75.010 s on"]
    for _ in range(4000):
        bench.answer()
    assert bench.pace.step > 11000


def test_lockstep_outruns_no_recorder_that_is_paused_before_it_says_how_far_it_is() -> None:
    bench = Bench(Lockstep, waits=True)
    for _ in range(2):
        bench.answer()
        assert bench.pace.step == 0
        assert bench.pace.waiting().endswith("for the recorder to follow")
        bench.pace.record(0, bench.now)
        assert bench.pace.step == 1, "the answers that have come are enough"
        for _ in range(6000):
            bench.answer()
        assert bench.pace.step == 501
        bench.pace.begin(bench.now)  # time begins again
        bench.wake()


@pytest.mark.parametrize("kind", [Lockstep, FreeRunning])
def test_who_has_shown_no_state_has_waited_for_no_answer(kind: type[Pace]) -> None:
    bench = Bench(kind, waits=True)
    bench.pace.begin(bench.now)
    bench.now += 20.0  # in which no recorder listened
    bench.wake()
    assert bench.pace.waiting_since == bench.now


def test_reset_begins_again_and_forgets_what_was_ahead() -> None:
    bench = Bench(Lockstep)
    for _ in range(5):
        bench.answer()
    bench.give(DISTURBANCE, TORQUE, ahead=1)
    bench.pace.begin(bench.now)
    bench.wake()
    assert bench.shown[-1] == 0
    bench.give(COMMAND, TORQUE)
    assert bench.pace.step == 0
    bench.give(DISTURBANCE, ZERO)
    assert bench.pace.step == 1


def test_time_does_not_drift_from_the_wall_clock() -> None:
    bench = Bench(FreeRunning)
    random = Random(0)
    for _ in range(5000):
        bench.passes(random.uniform(0.0, 1.9 * PERIOD))
        assert 0.0 <= bench.now - bench.begun - bench.time <= PERIOD + 1e-6
    assert bench.time > 40.0
    assert bench.shown == steps(len(bench.shown))


def test_a_step_that_is_late_is_caught_up_and_counted() -> None:
    bench = Bench(FreeRunning)
    bench.runs(0.1)
    bench.passes(0.5 * PERIOD)
    bench.passes(1.4 * PERIOD)
    assert bench.pace.overruns == 0, "less than a period late"
    bench.passes(2.2 * PERIOD)  # for steps that are 2.1, 1.1 and 0.1 periods late
    assert bench.pace.overruns == 2
    assert [text.partition(" is ")[2] for text in bench.said[-2:]] == [
        "21.0 ms late",
        "11.0 ms late",
    ]
    bench.passes(0.2)
    assert bench.time == pytest.approx(0.34, abs=PERIOD)


def test_a_long_pause_moves_the_time_base_and_leaves_no_gap() -> None:
    bench = Bench(FreeRunning)
    bench.runs(0.1)
    bench.passes(30.0)
    assert bench.pace.overruns == 1
    assert bench.time < 0.7, "half a minute is not caught up"
    bench.passes(1.0)
    assert bench.shown == steps(len(bench.shown))
    assert any("paused for" in text for text in bench.said)


def test_a_command_acts_a_sample_late_and_not_for_ever() -> None:
    bench = Bench(FreeRunning)
    bench.runs(0.05)
    assert bench.pace.late_commands == bench.pace.step > 0, "none has come at all"
    bench.runs(0.5)
    assert bench.pace.status(bench.now) == (WARN, f"no {COMMAND}: zero torque")
    bench.give(COMMAND, TORQUE)
    given_at = bench.time
    while bench.torque != TORQUE:
        bench.passes(PERIOD)
    assert bench.acted[-1][0] * 1e-9 == pytest.approx(given_at + PERIOD)
    while bench.torque == TORQUE:
        bench.passes(PERIOD)
    assert bench.torque == ZERO
    silent = bench.acted[-1][0] * 1e-9 - given_at
    assert silent == pytest.approx(0.5, abs=2.5 * PERIOD)
    assert bench.pace.status(bench.now) == (WARN, f"no {COMMAND}: zero torque")

    late = bench.pace.late_commands
    bench.give(COMMAND, TORQUE)
    bench.passes(PERIOD)
    assert bench.pace.late_commands == late
    bench.passes(3 * PERIOD)
    assert bench.torque == TORQUE
    assert bench.pace.status(bench.now) == (OK, "running")
    assert any(text.startswith(f"{COMMAND} is back at") for text in bench.said)


def test_a_disturbance_acts_at_its_own_instant_even_if_it_came_before() -> None:
    bench = Bench(FreeRunning)
    bench.passes(PERIOD)
    for _ in range(30):
        bench.give(DISTURBANCE, (bench.stamp + 10_000_000.0, 0.0, 0.0), ahead=1)
        bench.passes(PERIOD)
    later = [(stamp, given[DISTURBANCE][0]) for stamp, given in bench.acted[3:]]
    assert later
    assert all(torque == stamp for stamp, torque in later)


def test_the_torque_of_a_silent_injector_does_not_act_for_ever() -> None:
    bench = Bench(FreeRunning)
    bench.passes(PERIOD)
    bench.give(DISTURBANCE, TORQUE)
    bench.runs(2.0)
    acted = [stamp for stamp, given in bench.acted if given[DISTURBANCE] == TORQUE]
    assert len(acted) == pytest.approx(50, abs=2)
    assert DISTURBANCE in bench.pace.status(bench.now)[1]


@pytest.mark.parametrize("goes", [False, True])
def test_free_running_time_begins_with_the_first_answers_and_their_record(goes: bool) -> None:
    """A recorder that has gone before nobody waits for."""
    bench = Bench(FreeRunning, waits=True)
    for _ in range(20):
        bench.passes(0.1)
    assert set(bench.shown) == {0}
    waits = "waiting at t = 0.000 s for torque_command, disturbance/torque"
    assert bench.pace.status(bench.now) == (STALE, waits)
    bench.answer()
    assert bench.pace.waiting() == "waiting at t = 0.000 s for the recorder to follow"
    bench.runs(1.0)
    assert bench.pace.step == 0
    if goes:
        bench.absent.add(RECORDED_TOPIC.name)
    else:
        bench.pace.record(0, bench.now)
    bench.begun = bench.now
    bench.runs(1.0)
    assert bench.time == pytest.approx(1.0, abs=2.0 * PERIOD)
    bench.pace.record(bench.stamp, bench.now)
    bench.wake()
    assert not any("paused" in text for text in bench.said), "the wait is no pause"
    bench.absent.add(RECORDED_TOPIC.name)
    bench.runs(6.0)
    assert bench.time == pytest.approx(7.0, abs=2.0 * PERIOD), "later it may go, too"
