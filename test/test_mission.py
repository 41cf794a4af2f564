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

"""What slews need, as `check` tells it, and the mission that is shipped."""

import math
from typing import Any

import pytest
from craft_helpers import case, conditions
from guidance_helpers import STRAIGHT
from synthetic import requirement
from test_goal_reference import flight

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.contract.topics import CONTROLLER, PLANT
from ppc_attitude.science.conditions import Condition
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.news import goals_told


def needed(**reference: Any) -> dict[str, Condition]:
    scenario = flight(**reference).with_values(PLANT, duration=120.0)
    return conditions(scenario)


def test_check_says_what_a_slew_needs_of_torque_and_rate() -> None:
    torque = needed()["slew torque"]
    assert (torque.value, torque.limit) == pytest.approx((0.0201, 0.03), abs=5e-5)
    assert torque.holds
    assert not needed(guidance__max_acceleration=math.radians(0.7))["slew torque"].holds
    assert not needed(guidance__torque_share=0.4)["slew torque"].holds
    derated = flight().with_values(CONTROLLER, max_torque=0.02)
    assert not conditions(derated)["slew torque"].holds
    spin = {"goals__frames": ["spin"], "spin__rate": 0.03}
    crossed = 2.8 * math.radians(2.0) * 0.03
    assert needed(**spin)["slew torque"].value == pytest.approx(torque.value + crossed, rel=1e-9)
    goals = {"goals__attitudes": [*STRAIGHT, *STRAIGHT]}
    assert needed(goals__times=[70.0, 120.0], **goals)["last goal"].holds
    assert not needed(goals__times=[70.0, 121.0], **goals)["last goal"].holds
    late, early, settled = (
        needed(goals__times=times, goals__attitudes=[*STRAIGHT] * len(times))["slew rate"]
        for times in ([70.0], [5.0, 70.0], [])
    )
    # With errors within 5e-3 the law adds little to the slew's 2 deg/s.
    assert late.value == settled.value == pytest.approx(2.0, abs=0.03)
    assert late.holds
    assert not early.holds
    assert early.value > 5.0  # [deg/s] for an error on the envelope at 5 s


def test_shipped_mission_is_flown_and_meets_every_requirement() -> None:
    mission = case("mission")
    told = goals_told(mission)
    assert [each.time for each in told] == pytest.approx([10.0, 120.0, 330.0, 480.0])
    assert not any(each.advice.warning for each in told)
    verdict = Verdict(simulate(mission, mission.number("spacecraft_plant", "duration")))
    assert verdict.all_met
    assert requirement(verdict, "keep_out").met
