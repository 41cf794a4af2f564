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

from typing import Any

import pytest

from ppc_attitude.contract.topics import Topic
from ppc_attitude.runtime.fixes import Fixes
from ppc_attitude.runtime.stamps import RefusedError
from ppc_attitude.science.sensors.star_tracker import TOLERANCE, Slots
from ppc_attitude.science.sensors.star_tracker import slots as steps_of
from ppc_attitude.science.stamps import LARGEST_STEP, stamp_of

STEP = 10_000_000  # [ns] of 100 Hz
LATE = Topic("tracker/fix", "", column="fix", width=1)


def samples(*steps: int) -> list[tuple[str, int, float]]:
    """Samples of the steps of a range, each with the number of its step."""
    return [("gyro", k * STEP, float(k)) for k in range(*steps)]


def joined(fixes: Fixes, events: list[tuple[str, int, float]]) -> list[tuple[int, float, float]]:
    """Stamp, sample and first number of the fix of what became complete, in order."""
    found = []
    for kind, stamp, value in events:
        completed = fixes.take(kind, stamp, (value,), 0.0)
        for at, parts in completed:
            fix, _ = parts["fix"]  # its age
            found.append((at, *parts["gyro"], fix))
    return found


def slots_of(rate: float, latency: float, initial: bool) -> Slots:
    given = {"star_tracker.rate": rate, "star_tracker.latency": latency}
    return Slots({**given, "initial_fix": initial})


def new(**given: Any) -> Fixes:
    return Fixes(slots_of(10.0, 0.1, initial=True), LATE, ["gyro"], **given)


@pytest.mark.parametrize("rate", [50.0, 100.0, 90.0, 1000.0, 3000.0])
@pytest.mark.parametrize("latency", [0.0, 0.0166667, 0.1, 0.1000001, 0.100001, 0.1234])
@pytest.mark.parametrize("initial", [True, False])
def test_slots_arrive_where_the_sensors_send_them(
    rate: float, latency: float, initial: bool
) -> None:
    for tracker in (10.0, rate / 3.0, rate / 7.0):
        given = {"star_tracker.rate": tracker, "star_tracker.latency": latency}
        every, delay = steps_of(rate, given)
        slots, last, found = slots_of(tracker, latency, initial), None, {}
        for k in range(10 * every):
            stamp = stamp_of(k, rate)
            slot = slots.due(last, stamp)
            if slot is not None:
                found[k] = slot
            last = stamp
        expected = {k: stamp_of(k - delay, rate) for k in range(delay, 10 * every, every)}
        if initial:
            expected.pop(delay, None)
            expected[0] = 0
        assert found.keys() == expected.keys()
        assert all(abs(found[k] - expected[k]) <= TOLERANCE for k in found)
        assert all(slots.has(valid) for valid in expected.values())


def test_slots_of_a_clock_that_counts_from_1970_are_exact() -> None:
    slots, begin = slots_of(20.0, 0.02, initial=False), 1_700_000_000 * 10**9
    found = {}
    for k in range(1, 40):
        slot = slots.due(begin + (k - 1) * STEP, begin + k * STEP)
        if slot is not None:
            found[k] = slot
    assert found == {k: begin + (k - 2) * STEP for k in range(2, 40, 5)}


def test_a_sample_waits_for_its_fix_and_others_for_that_sample() -> None:
    fixes = new()
    events = [("fix", 0, 1.0), *samples(23)]
    assert [at // STEP for at, *_ in joined(fixes, events)] == list(range(20))
    assert fixes.missing() == ("fix",)
    late = joined(fixes, [("fix", 10 * STEP, 2.0)])
    assert late == [(20 * STEP, 20.0, 2.0), (21 * STEP, 21.0, 0.0), (22 * STEP, 22.0, 0.0)]
    assert (fixes.waiting(), fixes.missing()) == ("", ("gyro",))


def test_who_waits_for_a_fix_says_for_which_and_what_came_instead() -> None:
    fixes = new()
    joined(fixes, [("fix", 0, 1.0), *samples(20)])
    for now in (5.0, 6.0):
        assert not [*fixes.take("gyro", round(15 + now) * STEP, (0.0,), now)]
    assert fixes.waiting_since == 5.0
    awaited = "waiting at t = 0.200 s for tracker/fix with the stamp 0.100000 s, as the estimator's"
    assert fixes.waiting() == f"{awaited} parameters say"
    joined(fixes, [("fix", 9 * STEP, 1.0)])
    assert fixes.waiting() == f"{awaited} parameters say; fixes came with other stamps: 0.090000 s"


def test_a_fix_has_its_age() -> None:
    fixes = new()
    joined(fixes, [("fix", 0, 1.0), *samples(20)])
    joined(fixes, [("fix", 10 * STEP, 2.0)])
    ((_, parts),) = fixes.take("gyro", 20 * STEP, (0.0,), 0.0)
    assert parts["fix"] == (2.0, 10 * STEP * 1e-9)


def test_a_fix_that_nobody_waits_for_is_not_spent_on_a_repeated_sample() -> None:
    """Its answer is that of the first one, without the fix."""
    fixes = of_the_first_second()
    joined(fixes, samples(101, 150))
    late = [("fix", 111 * STEP, 5.0), ("gyro", 149 * STEP, 0.0), ("gyro", 150 * STEP, 0.0)]
    assert [fix for *_, fix in joined(fixes, late)] == [0.0, 5.0]


def test_time_that_begins_again_begins_with_slot_zero() -> None:
    """What waited, and a fix that lies ahead now, are of the time before."""
    fixes = new()
    joined(fixes, [("fix", 0, 1.0), *samples(22)])
    joined(fixes, [("fix", 25 * STEP, 9.0)])
    assert joined(fixes, [("gyro", 0, 0.0)]) == []
    assert joined(fixes, [("fix", 0, 3.0), ("fix", 10 * STEP, 4.0)]) == [(0, 0.0, 3.0)]
    found = joined(fixes, samples(1, 30))
    assert [(at // STEP, fix) for at, _, fix in found if fix] == [(20, 4.0)]
    assert joined(fixes, [("fix", 0, 5.0), ("gyro", 0, 0.0)]) == [(0, 0.0, 5.0)]  # in any order


def test_who_begins_in_the_middle_waits_for_no_fix_of_before() -> None:
    fixes = new()
    assert joined(fixes, [("gyro", 20 * STEP, 5.0)]) == [(20 * STEP, 5.0, 0.0)]


def of_the_first_second() -> Fixes:
    """Every slot until 1 s has been joined, the last one being that of 0.9 s."""
    fixes = new()
    events = [("fix", 0, 1.0)]
    for k in range(101):
        events.append(("gyro", k * STEP, float(k)))
        if k % 10 == 0 and k >= 20:
            events.append(("fix", (k - 10) * STEP, 1.0))
    assert len(joined(fixes, events)) == 101
    return fixes


@pytest.mark.parametrize("stamp", [50, 10_000, 10**9])
def test_a_sample_of_another_time_is_refused_and_holds_nobody_up(stamp: int) -> None:
    """In lock-step nothing would come after it that could free those who wait."""
    fixes = of_the_first_second()
    with pytest.raises(
        RefusedError, match=rf"imu/data_raw: stamp {stamp / 100:.6f} s is out of order"
    ):
        joined(fixes, [("gyro", stamp * STEP, 0.0)])
    assert joined(fixes, [("gyro", 101 * STEP, 7.0)]) == [(101 * STEP, 7.0, 0.0)]


def test_a_fix_of_the_future_is_refused() -> None:
    fixes = of_the_first_second()
    furthest = 100 * STEP + LARGEST_STEP
    joined(fixes, [("fix", furthest, 0.0)])
    with pytest.raises(RefusedError, match=r"tracker/fix: stamp .* s is out of order"):
        joined(fixes, [("fix", furthest + 1, 0.0)])


def test_no_more_than_a_hundred_fixes_are_kept_for_samples_to_come() -> None:
    fixes = of_the_first_second()
    joined(fixes, [("fix", 101 * STEP + k, 0.0) for k in range(150)])
    assert fixes.useless == 50


def test_fixes_of_the_past_are_counted_and_a_repeated_one_is_not() -> None:
    fixes = of_the_first_second()
    past = [("fix", at * STEP, 5.0) for at in (30, 85, 90)]
    assert {fix for *_, fix in joined(fixes, [*past, *samples(101, 111)])} == {0.0}
    assert fixes.useless == 0  # nobody knows yet that time has not begun again
    assert joined(fixes, [("fix", 100 * STEP, 3.0)]) == [(110 * STEP, 110.0, 3.0)]
    assert fixes.useless == 2


@pytest.mark.parametrize(
    ("first", "late"),
    [(0, 30), (0, 150), (3, 10), (7, 0), (7, 35)],  # later than it says, or of slots of its own
)
def test_a_fix_that_nobody_waits_for_is_used_with_the_sample_after_it(
    first: int, late: int
) -> None:
    fixes = Fixes(slots_of(10.0, 0.1, initial=False), LATE, ["gyro"], patience=0.04)
    found, sent = [], []
    for k in range(400):
        found += joined(fixes, [("gyro", k * STEP, 0.0)])
        valid = k - late
        if valid % 10 == first and valid >= 0:
            found += joined(fixes, [("fix", valid * STEP, float(valid + 1))])
            sent.append((k, valid + 1.0))
    used = [(at // STEP - 1, fix) for at, _, fix in found if fix]
    assert used[-10:] == sent[len(used) - 10 : len(used)]
    assert len(sent) - len(used) <= 1 and fixes.useless == 0


def test_a_fix_of_no_slot_is_used_with_no_sample_before_it() -> None:
    fixes = of_the_first_second()
    joined(fixes, [("fix", 105 * STEP, 5.0)])
    assert [at // STEP for at, _, fix in joined(fixes, samples(101, 109)) if fix] == [105]


def test_fixes_that_come_at_once_are_used_one_with_a_sample_and_in_their_order() -> None:
    fixes = of_the_first_second()
    joined(fixes, samples(101, 150))
    joined(fixes, [("fix", (k + 1) * STEP, float(k)) for k in (120, 110, 130)])
    found = joined(fixes, samples(150, 154))
    assert [fix for *_, fix in found if fix] == [110.0, 120.0, 130.0]


def test_a_fix_that_never_comes_is_given_up_and_nobody_waits_again_until_one_comes() -> None:
    fixes = new(patience=0.04)
    assert [len(joined(fixes, [each])) for each in samples(6)] == [0, 0, 0, 0, 0, 6]
    assert [len(joined(fixes, [each])) for each in samples(6, 45)] == [1] * 39
    assert fixes.lost == 4  # of 0, 0.1, 0.2 and 0.3 s
    assert joined(fixes, [("fix", 40 * STEP, 2.0)]) == []
    assert joined(fixes, samples(45, 51))[-1] == (50 * STEP, 50.0, 2.0)
    assert joined(fixes, samples(51, 61))[-1][0] == 59 * STEP
    assert fixes.missing() == ("fix",)


def test_a_new_beginning_waits_for_its_first_fix_whatever_was_lost_before() -> None:
    fixes = new(patience=0.0)
    joined(fixes, samples(30))
    assert fixes.lost == 2
    assert joined(fixes, [("gyro", 0, 0.0)]) == []
    assert joined(fixes, [("fix", 0, 3.0)]) == [(0, 0.0, 3.0)]


@pytest.mark.parametrize(("late", "lost"), [(0, 2), (3, 2), (5, 19)])
def test_after_a_lost_fix_a_tracker_is_waited_for_that_comes_within_the_patience(
    late: int, lost: int
) -> None:
    """Every fix comes so many steps after the sample that it is due with; that of 0.4 s does not.

    That of 0.5 s is lost too: with it the tracker is heard again, if that is in time.
    """
    fixes = new(patience=0.04)
    found = joined(fixes, [("fix", 0, 1.0)])
    for k in range(206):
        found += joined(fixes, [("gyro", k * STEP, 0.0)])
        valid = k - 10 - late
        if valid % 10 == 0 and valid > 0 and valid != 40:
            found += joined(fixes, [("fix", valid * STEP, 1.0)])
        assert k < 60 or lost == 2 or len(found) == k + 1  # whoever is too late holds nobody up
    assert len(found) == 206
    assert fixes.lost == lost
