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

"""`ppc_attitude check`: feasibility and the conditions on the parameters, each with its value.

The page has a section for each selected component that has something to say: the law's conditions
or its certificate, the slews and goals of the reference, and the noise of the sensors. It says what
the requirements need at best of craft and law, and warns of what is out of proportion.
"""

import argparse
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from itertools import chain
from typing import Any

from ppc_attitude.analysis.requirements import load_requirements
from ppc_attitude.command_line.environment_load import (
    environment_torque,
    loss_conditions,
    wheel_conditions,
)
from ppc_attitude.command_line.guarantee_view import Judgement
from ppc_attitude.command_line.options import (
    POSITIVE,
    add_requirements_option,
    add_scenario_options,
    paragraph,
    print_json,
    scenario_of,
    see_that_none_is_idle,
)
from ppc_attitude.command_line.proportions import actuator_torques, conditions_of
from ppc_attitude.command_line.stopping import stoppable
from ppc_attitude.contract.topics import (
    ATTITUDE,
    ESTIMATOR,
    PLANT,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    TRUE_ATTITUDE,
    TRUE_RATE,
)
from ppc_attitude.processes.exits import DONE, REQUIREMENT_FAILED
from ppc_attitude.science.attitude import attitude_error, rotation_angle
from ppc_attitude.science.conditions import Condition, advisable
from ppc_attitude.science.controllers.tube_parameters import LAWS
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import fault_texts
from ppc_attitude.science.guidance.rotation import relative_to
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kernel import ZERO, Quaternion, norm
from ppc_attitude.science.kinds import (
    ACTUATORS,
    CONTROLLERS,
    ENVIRONMENTS,
    ESTIMATORS,
    NONE,
    REFERENCES,
    SENSORS,
)
from ppc_attitude.science.part import Part
from ppc_attitude.simulation.closed_loop import first_instant
from ppc_attitude.simulation.loop_margin import loop_conditions
from ppc_attitude.simulation.news import Answer, goals_told
from ppc_attitude.simulation.scenario import Scenario, idle_parameters

HELP = "feasibility and conditions of a configuration"
DESCRIPTION = (
    "Checks whether the envelopes are feasible, the conditions S1 to S5, the least time that the "
    "requirements need, the gain and phase that the loop bears, parameters out of proportion to "
    "the craft, and the start. For the momentum-tube law it proves the certificate anew. A "
    "condition that is violated with a warning is advisable, not necessary. What is not promised "
    "may hold all the same: its condition is sufficient, not necessary."
)
EXAMPLES = (
    "ppc_attitude check --config config/paper.yaml --json",
    "ppc_attitude check --config config/paper.yaml --config config/guaranteed.yaml",
)
_CERTIFIED = f"a law with a certificate: {' or '.join(LAWS)}"
_LARGEST_KNOWN_RATE = 1.0  # [deg/s] at the start


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_scenario_options(parser)
    add_requirements_option(parser)
    parser.add_argument(
        "--known-reference",
        action="store_true",
        help="momentum_tube: also the guaranteed times with the paper's reference; takes 30 s",
    )
    parser.add_argument(
        "--hit",
        nargs=2,
        type=POSITIVE,
        action="append",
        default=[],
        metavar=("TORQUE", "SECONDS"),
        help="momentum_tube: also the guaranteed time of a craft within its final bound to recover "
        "from a hit of TORQUE [N·m] for SECONDS [s]",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def execute(arguments: argparse.Namespace) -> int:
    """Check and print."""
    scenario = scenario_of(arguments)
    required = load_requirements(arguments.requirements)
    certified = scenario.controller.name in LAWS
    see_that_none_is_idle(arguments, certified, _CERTIFIED, "hit", "known-reference")
    guarantee = Judgement(scenario, arguments.config) if certified else None
    parts = stoppable(lambda: _at_start(scenario))
    law = parts[CONTROLLERS.name]
    told, true, desired = (
        _given(parts, each.column) for each in (ATTITUDE, TRUE_ATTITUDE, REFERENCE_ATTITUDE)
    )
    q_e = attitude_error(told if any(told) else true, desired)
    promised = _promised(guarantee, arguments, parts) if guarantee else {}
    # From here on reference and environment go on to the end of the run.
    surroundings, reference = parts[ENVIRONMENTS.name], parts[REFERENCES.name]
    environment = stoppable(lambda: environment_torque(scenario, surroundings))
    wheels = stoppable(lambda: [*wheel_conditions(scenario, reference, surroundings)])
    wheels += loss_conditions(scenario, environment)
    goals, (_, torque) = goals_told(scenario), actuator_torques(scenario)
    deadline = required.settling_deadline
    conditions = (
        *conditions_of(scenario, required, q_e, environment),
        *stoppable(lambda: [*loop_conditions(scenario, deadline, torque)]),
        *wheels,
        *_goal_conditions(goals, scenario.number(PLANT, "duration")),
    )
    idle = idle_parameters(arguments.config, scenario)
    if arguments.json:
        page = _json(scenario, conditions, q_e, law.advice, goals) | {"idle_parameters": idle}
        if guarantee:
            page |= {
                "guaranteed": guarantee.holds,
                "doubts": guarantee.doubts,
                "broken_assumptions": guarantee.broken,
                "suspensions": guarantee.suspensions,
                **promised,
                **asdict(guarantee.certificate),
            }
        print_json(page)
    else:
        starts = (law, parts[SENSORS.name], parts[ACTUATORS.name])
        advices = [*(part.advice for part in starts), *(told.advice for told in goals)]
        if idle:
            text = f"no selected component has {', '.join(idle)}, so a file sets it in vain"
            advices.append(Advice(text, warning=True))
        _print(scenario, conditions, q_e, advices)
        if guarantee:
            further = map(paragraph, chain.from_iterable(promised.values()))
            print("\n".join(["", *guarantee.lines(), *further]))
    holds = all(each.holds for each in conditions if each.necessary)
    return DONE if holds and (not guarantee or guarantee.holds) else REQUIREMENT_FAILED


def _promised(
    guarantee: Judgement, arguments: argparse.Namespace, parts: Mapping[str, Part]
) -> dict[str, list[str]]:
    """What is guaranteed of the start, of the scenario's reference and of hits."""
    desired, true = (
        (_given(parts, q.column), _given(parts, omega.column), ZERO)
        for q, omega in ((REFERENCE_ATTITUDE, REFERENCE_RATE), (TRUE_ATTITUDE, TRUE_RATE))
    )
    error, omega_e, _ = relative_to(desired, true)
    rates = [each.rate for each in guarantee.certificate.promises]
    known = [each for each in rates if each <= _LARGEST_KNOWN_RATE]
    return {
        "own_start": guarantee.of_start(rotation_angle(error), norm(omega_e)),
        "known_reference": guarantee.of_reference(known) if arguments.known_reference else [],
        "hits": [guarantee.of_hit(*hit) for hit in arguments.hit],
    }


def _goal_conditions(goals: list[Answer], end: float) -> Iterator[Condition]:
    """Yield the conditions that all goals are followed, and that the last is reached by the end."""
    if goals and end:
        meaning = "the desired motion comes to where the goals lead before the run ends, if the "
        meaning += "attitude is known from the start on"
        yield advisable("last arrival", goals[-1].arrives, end, "s", meaning)
    if goals:
        meaning = "the guidance follows every scheduled goal"
        refused = sum(told.refused for told in goals)
        yield Condition("refused goals", refused, 0.0, "≤", "", True, meaning)


def _json(
    scenario: Scenario,
    conditions: tuple[Condition, ...],
    q_e: Quaternion,
    start: Advice,
    goals: list[Answer],
) -> dict[str, Any]:
    return {
        "controller": scenario.controller.name,
        "conditions": [{**asdict(each), "holds": each.holds} for each in conditions],
        "start": {"attitude_error": q_e, "plan": start.text, "warning": start.warning},
        "goals": [
            {"time": told.time, "told": told.advice.text, "warning": told.advice.warning}
            for told in goals
        ],
        "faults": fault_texts(scenario.parameters[PLANT]),
    }


def _print(
    scenario: Scenario, conditions: tuple[Condition, ...], q_e: Quaternion, advices: list[Advice]
) -> None:
    rate = scenario.number(PLANT, "rate")
    print(f"controller {scenario.controller.name}, {rate:g} Hz")
    for each in conditions:
        limit = f"{each.relation} {each.limit:.6g} {each.unit}".rstrip()
        print(f"\n{each.name}  {each.value:.6g} {limit}  {_verdict(each)}")
        print(paragraph(each.meaning, "    "))
    error = ", ".join(f"{number:.5f}" for number in q_e)
    print(f"\ninitial attitude error x y z w: {error}")
    for fault in fault_texts(scenario.parameters[PLANT]):
        print(paragraph(f"fault: {fault}"))
    for advice in advices:
        if advice.text:
            print(paragraph(f"{'warning: ' if advice.warning else ''}{advice.text}"))


def _at_start(scenario: Scenario) -> dict[str, Part]:
    """Every part after its first step; if there is no estimate by then, with exact sensing.

    A law that reads more of its estimator than attitude and rate cannot step with exact sensing.
    """
    parts = first_instant(scenario)
    if any(_given(parts, ATTITUDE.column)):
        return parts
    exact = {PLANT: {SENSORS.selector: "direct"}, ESTIMATOR: {ESTIMATORS.selector: NONE}}
    try:
        return first_instant(scenario.overlaid(exact))
    except ConfigurationError:
        return parts


def _given(parts: Mapping[str, Part], column: str) -> tuple[Any, ...]:
    """Numbers of a column that one of the parts gave."""
    return next(each for each in parts.values() if column in each.places).output(column)


def _verdict(condition: Condition) -> str:
    if condition.holds:
        return "holds"
    if condition.necessary:
        return "VIOLATED"
    return "not promised" if condition.sufficient else "warning: violated"
