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

"""`ppc_attitude check`: feasibility and the conditions on the parameters, each with its value."""

import argparse
from dataclasses import asdict

import numpy as np

from ppc_attitude.command_line.errors import DONE, REQUIREMENT_FAILED
from ppc_attitude.command_line.options import add_scenario_options, print_json, scenario_of
from ppc_attitude.contract.topics import CONTROLLER, PLANT, REFERENCE
from ppc_attitude.science.certificate import Condition, certificate, largest_desired_rate
from ppc_attitude.science.controllers.interface import Advice
from ppc_attitude.simulation.closed_loop import first_step
from ppc_attitude.simulation.scenario import Scenario

_EXAMPLES = """examples:
  ppc_attitude check --config config/paper.yaml
  ppc_attitude check --config config/paper.yaml --config config/any_start.yaml --json

exit codes: 0 every necessary condition holds; 1 one does not; 2 infeasible or wrong configuration
"""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "check",
        help="feasibility and conditions of a configuration",
        description="Feasibility of both envelopes, the conditions S1 to S5, and the start.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_scenario_options(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(execute=execute)


def execute(arguments: argparse.Namespace) -> int:
    """Check and print."""
    scenario = scenario_of(arguments)
    law = first_step(scenario)
    q_e, advice = law.given("attitude_error"), law.advice
    conditions = certificate(
        scenario.parameters[CONTROLLER],
        q_e[3],
        largest_desired_rate(scenario.parameters[REFERENCE]["amplitude"]),
    )
    if arguments.json:
        print_json(
            {
                "controller": scenario.controller.name,
                "conditions": [{**asdict(each), "holds": each.holds} for each in conditions],
                "start": {
                    "attitude_error": q_e,
                    "plan": advice.text,
                    "warning": advice.warning,
                },
            }
        )
    else:
        _print(scenario, conditions, q_e, advice)
    necessary = all(each.holds for each in conditions if each.necessary)
    return DONE if necessary else REQUIREMENT_FAILED


def _print(
    scenario: Scenario, conditions: tuple[Condition, ...], q_e: list[float], advice: Advice
) -> None:
    rows = [("condition", "value", "limit", "", "meaning")]
    rows += [
        (
            each.name,
            f"{each.value:.6g}",
            f"{each.relation} {each.limit:.6g} {each.unit}".rstrip(),
            _verdict(each),
            each.meaning,
        )
        for each in conditions
    ]
    widths = [max(len(row[k]) for row in rows) for k in range(4)]
    for row in rows:
        cells = [f"{cell:<{width}}" for cell, width in zip(row, widths, strict=False)]
        print("  ".join([*cells, row[4]]))
    rate = scenario.parameters[PLANT]["rate"]
    print(f"\ninitial attitude error x y z w: {np.array2string(np.asarray(q_e), precision=5)}")
    print(f"rate {rate:g} Hz, controller {scenario.controller.name}")
    if advice.text:
        print(f"{'warning: ' if advice.warning else ''}{advice.text}")


def _verdict(condition: Condition) -> str:
    if condition.holds:
        return "holds"
    return "VIOLATED" if condition.necessary else "violated (sufficient, not necessary)"
