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

"""What the parts of a run tell their user, and when: the nodes log the same."""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import PLANT, REFERENCE
from ppc_attitude.science.guidance.orders import GOAL_TIMES
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kinds import REFERENCES
from ppc_attitude.science.part import Part
from ppc_attitude.science.references import goal
from ppc_attitude.science.stamps import first_step, nanoseconds, seconds, stamp_of
from ppc_attitude.simulation.diagram import Diagram
from ppc_attitude.simulation.scenario import Scenario

_BLOCK = 4096  # instants after which the parts are asked
_PARTS = 16  # of a block with news: many, so rounds are few, as a step that plans a slew is slow
_MOST = 10  # advices of one part; nobody reads one every second of a day


def concerns(scenario: Scenario, stamps_ns: NDArray[np.int64]) -> Iterator[tuple[float, Advice]]:
    """Yield, with its time [s], each warning of a part over the stamps [ns], and that it is over.

    The loop runs once more for this, so that the run that counts need not ask its parts at every
    instant. Where a part has something new, the instants are divided until it is known when.
    """
    diagram = Diagram(scenario.parameters)
    samples = np.zeros((sum(column.width for column in diagram.columns), _BLOCK))
    listened = list(diagram.parts.values())
    warned: dict[int, list[bool]] = {id(part): [] for part in listened}
    # Most parts have something to say at the first instant, so it is a block of its own.
    starts = (0, *range(1, stamps_ns.size, _BLOCK), stamps_ns.size)
    for start, end in pairwise(starts):
        for time, part in _news(diagram, listened, stamps_ns[start:end], samples):
            part.told, advice, words = part.advices, part.advice, warned[id(part)]
            severe = advice.warning or advice.failed
            if severe or (words and words[-1]):
                words.append(severe)
                if len(words) == _MOST:
                    listened.remove(part)
                    left = f"{advice.text}; later advice of {part.component.name} is left out"
                    advice = advice._replace(text=left)
                yield time, advice


def _news(
    diagram: Diagram, parts: list[Part], stamps_ns: NDArray[np.int64], samples: Array
) -> Iterator[tuple[float, Part]]:
    """Yield each part that has something new, at the instant [s] at which it has."""
    before = diagram.snapshot()
    diagram.run(stamps_ns, samples)
    new = [part for part in parts if part.advices != part.told]
    if new and stamps_ns.size > 1:
        diagram.put_back(before)
        for fewer in np.array_split(stamps_ns, min(_PARTS, stamps_ns.size)):
            yield from _news(diagram, parts, fewer, samples)
    else:
        yield from ((seconds(int(stamp)), part) for stamp in stamps_ns for part in new)


class Answer(NamedTuple):
    """The answer to a goal, when [s] it came, and how many goals were refused then."""

    time: float
    advice: Advice
    refused: int
    arrives: float  # [s] the end of the plan that is followed from then on


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
            arrives = float(part.state[0]["plans"][part.state[0]["active"]]["end"])
            told.append(Answer(seconds(stamp_ns), part.advice, refused, arrives))
    return told
