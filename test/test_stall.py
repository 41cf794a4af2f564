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

"""When a run is given up: nothing goes on, and that is no fault of a busy machine."""

from collections.abc import Iterable

from ppc_attitude.contract.topics import PLANT
from ppc_attitude.runtime.health import Stall

CONTROLLER_WAITS = "waiting for reference/attitude"


def reason(
    stall: Stall, now: float, starved: float = 0.0, hindrances: Iterable[str] = (CONTROLLER_WAITS,)
) -> str:
    return stall.reason(now, lambda: {"one": starved, "other": 0.0}, lambda: hindrances)


def test_a_run_without_a_step_is_given_up_with_what_its_nodes_wait_for() -> None:
    stall = Stall(100.0)
    assert reason(stall, 129.9) == ""
    assert reason(stall, 130.0) == f"no step for 30 s: {CONTROLLER_WAITS}"
    both = [CONTROLLER_WAITS, "", CONTROLLER_WAITS, "b"]
    assert reason(stall, 130.0, 0.0, both) == f"no step for 30 s: {CONTROLLER_WAITS}; b"
    stall.advance(130.0, {})
    assert reason(stall, 159.9) == ""


def test_a_run_whose_nodes_wait_for_the_processor_is_not_given_up() -> None:
    """On a busy machine the start of five processes has no end; nobody's fault."""
    stall = Stall(0.0)
    assert reason(stall, 3600.0, starved=3580.0) == ""
    stall.advance(3600.0, {"one": 3580.0, "other": 0.0})
    assert reason(stall, 3630.0, starved=3580.0), "it had starved before the last step"


def test_a_plant_that_tells_nothing_more_hangs_and_one_that_repeats_its_time_is_slow() -> None:
    """It is so amid a step or at its end, and nobody waits for it."""
    stall = Stall(0.0)
    assert reason(stall, 40.0, hindrances=()) == "", "it may be compiling, before the first step"
    stall.advance(40.0, {})
    for now in range(40, 80, 5):
        stall.hear(now)
        assert reason(stall, now, hindrances=()) == ""
    assert reason(stall, 104.9, hindrances=()) == ""
    assert reason(stall, 105.0, hindrances=()) == (
        f"no step for 30 s: {PLANT} neither goes on nor ends"
    )
    assert reason(stall, 105.0) == f"no step for 30 s: {CONTROLLER_WAITS}", "that is the cause"
    assert reason(stall, 105.0, 30.0, hindrances=()) == ""


def test_a_run_that_was_paused_with_who_looks_at_it_is_not_given_up_for_that() -> None:
    """It named a node that had just been let go on."""
    stall = Stall(100.0)
    for now in (100.1, 104.0, 204.0):
        stall.look(now)
    assert reason(stall, 229.9) == ""
    assert reason(stall, 230.0), "the look before the pause was the last that saw no step"
