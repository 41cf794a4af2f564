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

"""Two publishers of one topic are told from one, from a restarted one, and from bad messages."""

from collections.abc import Iterator

import pytest

from ppc_attitude.runtime.publishers import Publishers

PERIOD = 10_000_000  # [ns]
BOTH = {1: "/ppc_controller", 2: "/ppc_controller"}


def numbers(begin: int) -> Iterator[tuple[int, int]]:
    return ((begin + step, step * PERIOD) for step in range(10_000))


def judged(*messages: tuple[int, int]) -> bool:
    publishers = Publishers()
    for number, stamp in messages:
        publishers.hear(number, stamp, 0.0)
    assert publishers.lasts(0.0) == publishers.several
    return publishers.several


def alternating(*begin: int) -> list[tuple[int, int]]:
    turns = zip(*map(numbers, begin), strict=True)
    return [message for turn in turns for message in turn][: 30 * len(begin)]


def proved(publishers: Publishers, now: float, begin: int = 1) -> None:
    for number, stamp in alternating(begin, begin):
        publishers.hear(number, stamp, now)


def test_one_that_loses_messages_is_one() -> None:
    assert not judged(*((number, stamp) for number, stamp in numbers(1) if number % 7))


def test_a_restarted_one_is_one_again_and_again() -> None:
    lives = list(numbers(1))
    assert not judged(*(lives[:500] * 20))
    assert not judged(*lives[:100], *lives[:50], lives[100])  # what the one before sent comes late


def test_messages_whose_numbers_the_middleware_does_not_tell_prove_nothing() -> None:
    publishers = Publishers()
    for _, stamp in alternating(1, 1):
        publishers.hear(None, stamp, 0.0)
    assert publishers.unnumbered
    assert not publishers.several


def test_three_in_turns_are_several() -> None:
    assert judged(*alternating(1, 400, 300))


@pytest.mark.parametrize(
    ("ours", "theirs", "each"), [(13, 5, 1), (1, 40, 1), (100, 100, 1), (1, 40, 3)]
)
def test_two_that_speak_in_bursts_are_two(ours: int, theirs: int, each: int) -> None:
    """Also where each third message alone is not lost."""
    first, second = numbers(5000), numbers(1)
    messages = []
    for _ in range(12):
        messages += [next(first) for _ in range(ours)]
        messages += [next(second) for _ in range(theirs)][::each]
    assert judged(*messages)


def test_bad_messages_and_single_ones_make_no_publisher() -> None:
    ours, messages = numbers(1), []
    for number in range(1, 2000):
        messages += [next(ours), (number, -1)]  # what cannot be used, in a flood
    assert not judged(*messages)
    ours, messages = numbers(1), []
    for number in range(1, 9):
        messages += [next(ours) for _ in range(50)] + [(number, number * 50 * PERIOD)]
    assert not judged(*messages)


@pytest.mark.parametrize(
    ("first", "step", "pause", "expected"),
    [
        pytest.param(5, 0, 1.0, True, id="as a plant in lock-step whose peers follow another"),
        pytest.param(5, 0, 0.01, False, id="a flood of copies"),
        pytest.param(5, 100, 0.01, True, id="at 1 Hz"),
        pytest.param(5, 101, 0.01, False, id="stamps that leap"),
        pytest.param(40, -1, 1.0, False, id="stamps that go back"),
        pytest.param(-1, 0, 1.0, False, id="messages that cannot be used"),
    ],
)
def test_who_repeats_an_unanswered_state_lives(
    first: int, step: int, pause: float, expected: bool
) -> None:
    publishers, ours = Publishers(), numbers(1)
    for k in range(1, 30):
        theirs = (k, (first + k * step) * PERIOD)
        for number, stamp in (*(next(ours) for _ in range(100)), theirs):
            publishers.hear(number, stamp, 1000.0 + k * pause)
    assert publishers.several == expected


def test_who_has_ended_is_forgotten_but_what_was_is_not() -> None:
    publishers = Publishers()
    for now, begin in ((1001.0, 1), (1008.0, 31)):
        proved(publishers, now, begin)
        assert publishers.lasts(now + 4.0)
    assert not publishers.lasts(1017.0)
    assert publishers.several


def test_both_are_named_though_one_has_left_and_though_the_graph_knew_no_name_at_first() -> None:
    publishers = Publishers()
    publishers.see({1: "/ppc_controller", 2: ""}, 1.0)
    assert publishers.nodes == "/ppc_controller, a node without a name"
    publishers.see(BOTH, 2.0)
    publishers.see({**BOTH, 1: ""}, 2.0)
    proved(publishers, 2.0)
    publishers.see({2: "/ppc_controller"}, 3.0)
    assert publishers.nodes == "/ppc_controller, /ppc_controller"


@pytest.mark.parametrize(
    ("born", "proved_at", "newer"),
    [
        pytest.param(0.0, 21.0, False, id="the older one goes on"),
        pytest.param(18.0, 21.0, True, id="the newer one ends"),
        pytest.param(9.5, 21.0, False, id="none was new at 20 s"),
        pytest.param(10.5, 21.0, True, id="one was"),
        pytest.param(18.0, 60.0, True, id="however long the proof takes on a busy machine"),
    ],
)
def test_who_gives_way_is_judged_by_the_time_when_the_graph_showed_both(
    born: float, proved_at: float, newer: bool
) -> None:
    publishers = Publishers()
    for now in range(20, int(proved_at)):  # the graph is looked at once a second
        publishers.see(BOTH, float(now))
        assert not publishers.gives_way(born, float(now)), "the graph is no proof"
    for begin in (1, 31):
        proved(publishers, proved_at + 2.0 * (begin > 1), begin)
        assert not publishers.gives_way(born, proved_at + 2.9), (
            "who else listens has not heard enough"
        )
    publishers.see({2: "/ppc_controller"}, proved_at + 2.0)  # who gives way has gone, or seems so
    assert publishers.gives_way(born, proved_at + 3.0) == newer


def test_one_that_was_killed_before_makes_nobody_the_newer_one() -> None:
    publishers = Publishers()
    publishers.see(BOTH, 1.0)  # of which one was killed, and is forgotten by the graph
    publishers.see({2: "/ppc_controller"}, 20.0)
    publishers.see(BOTH, 100.0)
    proved(publishers, 101.0)
    assert not publishers.gives_way(0.0, 105.0)
