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

"""The fate of a scenario's goals: the reference alone, run over the instants of its orders."""

from typing import NamedTuple

from ppc_attitude.contract.topics import PLANT, REFERENCE
from ppc_attitude.science.guidance.orders import GOAL_TIMES
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kinds import REFERENCES
from ppc_attitude.science.part import Part
from ppc_attitude.science.references import goal
from ppc_attitude.science.stamps import first_step, nanoseconds, seconds, stamp_of
from ppc_attitude.simulation.scenario import Scenario


class Answer(NamedTuple):
    """The answer to a goal, when [s] it came, and how many goals were refused then."""

    time: float
    advice: Advice
    refused: int


def goals_told(scenario: Scenario) -> list[Answer]:
    """The reference's answer to each scheduled goal at the step that takes it.

    The reference follows nothing but its orders and the craft's first attitude, so this needs no
    run of the loop. Of several goals within one step only the last one has an answer. A reference
    that knows no goals gives none.

    Raises
    ------
    ConfigurationError
        A parameter of the reference is infeasible.
    """
    values = scenario.parameters[REFERENCE]
    if REFERENCES.selected(values) is not goal.COMPONENT:
        return []
    rate = scenario.number(PLANT, "rate")
    craft = scenario.parameters[PLANT]
    part = Part(goal.COMPONENT, values)
    told = []
    steps = {first_step(nanoseconds(time), rate) for time in values[GOAL_TIMES.name]}
    for stamp_ns in [0, *(stamp_of(step, rate) for step in sorted(steps))]:
        before, refused = part.advices, int(part.state[0]["refused"])
        part.step(stamp_ns, craft["initial_attitude"])
        if part.advices > before:
            refused = int(part.state[0]["refused"]) - refused
            told.append(Answer(seconds(stamp_ns), part.advice, refused))
    return told
