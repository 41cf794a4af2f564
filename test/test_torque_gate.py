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

"""The torque of a law is passed on while it is enabled, and its node says when it is not."""

import pytest

from ppc_attitude.contract.topics import TORQUE_COMMAND
from ppc_attitude.runtime.health import OK, STALE, WARN, Status
from ppc_attitude.runtime.torque_gate import TorqueGate
from ppc_attitude.science.stamps import nanoseconds

TORQUE = TORQUE_COMMAND.column
GIVEN = {TORQUE: (0.1, 0.0, -0.1), "unsaturated_torque": (0.3, 0.0, -0.1), "phase": (1.0,)}
KNOWN, UNKNOWN = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0)
NO_ATTITUDE = "attitude is all zeros, so the attitude is unknown: zero torque"
RUNNING = Status(OK, "running", {"steps": 3})


def test_a_torque_is_zero_while_it_is_disabled_and_all_else_is_as_the_law_gave_it() -> None:
    gate = TorqueGate()
    assert gate.passed(GIVEN, limit=0.1) == GIVEN
    assert gate.turn(False) == (False, "disabled: zero torque")
    assert gate.passed(GIVEN, limit=0.1) == {**GIVEN, TORQUE: (0.0, 0.0, 0.0)}
    assert gate.turn(True) == (True, "enabled: re-armed from the present error")
    assert gate.turn(True) == (False, "enabled already: the law goes on")
    assert gate.passed(GIVEN, limit=0.1) == GIVEN
    assert gate.saturated == 2, "only what the limit took off from a torque that was passed on"
    assert gate.passed({TORQUE: (0.2, 0.0, 0.0)}, limit=0.1)
    assert gate.passed(GIVEN, limit=0.3)
    assert gate.saturated == 2, "a law may have no limit, and one at its limit lacks nothing"


@pytest.mark.parametrize("turns", [[False], [False, False], [False, True, False], [False, True]])
def test_however_often_it_is_switched_within_a_step_it_is_told_once(turns: list[bool]) -> None:
    gate = TorqueGate()
    assert not gate.has_switched()
    for turn in turns:
        gate.turn(turn)
    assert gate.has_switched()
    assert gate.enabled == turns[-1]
    assert not gate.has_switched()
    gate.turn(turns[-1])
    assert not gate.has_switched(), "it was so already"


def test_an_attitude_that_is_lost_and_found_is_told_and_none_at_first_is_not() -> None:
    gate = TorqueGate()
    given = [UNKNOWN, UNKNOWN, KNOWN, KNOWN, UNKNOWN, UNKNOWN, KNOWN]
    told = [gate.look(nanoseconds(0.5 * k), each) for k, each in enumerate(given)]
    assert [[(each.text, each.warning) for each in news] for news in told if news] == [
        [
            (
                f"{NO_ATTITUDE} from t = 2.000 s on",
                True,
            )
        ],
        [("attitude is known again from t = 3.000 s on", False)],
    ]
    assert [bool(news) for news in told] == [k in (4, 6) for k in range(7)]


def test_a_status_says_that_the_torque_is_zero_unless_it_says_worse() -> None:
    gate = TorqueGate()
    unknown = Status(WARN, NO_ATTITUDE, {"steps": 3})
    outside, waiting = RUNNING._replace(level=WARN, summary="x"), RUNNING._replace(level=STALE)
    assert gate.status(RUNNING) == unknown
    assert gate.status(outside) == outside
    gate.look(0, KNOWN)
    assert gate.status(RUNNING) == RUNNING
    gate.turn(False)
    assert gate.status(outside) == Status(WARN, "disabled: zero torque", {"steps": 3})
    assert gate.status(waiting) == waiting
