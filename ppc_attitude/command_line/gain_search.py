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

"""`ppc_attitude design` for a law without a guarantee: gains by search, and how sure they are."""

import argparse
import math
from dataclasses import replace

from ppc_attitude.analysis.requirements import load_requirements
from ppc_attitude.campaign.declaration import Campaign, campaign, load_campaign
from ppc_attitude.campaign.pools import cores, threads
from ppc_attitude.campaign.tuning import Tuned, tuned
from ppc_attitude.command_line.in_process import check_memory
from ppc_attitude.command_line.parameter_file import overlay
from ppc_attitude.command_line.progress import progress_bar
from ppc_attitude.command_line.proportions import actuator_torques
from ppc_attitude.command_line.stopping import stoppable
from ppc_attitude.contract.topics import CONTROLLER
from ppc_attitude.contract.whole_file import write_whole
from ppc_attitude.processes.exits import DONE, REQUIREMENT_FAILED
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.loop_margin import loop_conditions
from ppc_attitude.simulation.scenario import Scenario

WRITTEN = "`ppc_attitude design` wrote this file."
"""Mark in the first line of a parameter file: a later design may replace a file that has it."""


def search_gains(arguments: argparse.Namespace, scenario: Scenario) -> int:
    """Search, judge, print and write; `REQUIREMENT_FAILED` if a fresh run misses a requirement."""
    check_memory(scenario, cores())
    varied = _campaign(arguments, scenario)
    if varied.duration < varied.required.settling_deadline:
        raise ConfigurationError(
            f"duration = {varied.duration:g} s; allowed: ≥ {varied.required.settling_deadline:g} "
            "s, the settling deadline, because shorter runs cannot be judged"
        )
    stoppable(lambda: warm_up(scenario))
    with threads() as executor, progress_bar(unit=" candidates") as bar:

        def show(count: int, least: float) -> None:
            bar.set_postfix_str(f"cost {least:.3g}", refresh=False)
            bar.update(count - bar.n)

        found = tuned(varied, arguments.seconds, executor, progress=show)
    best = scenario.with_values(CONTROLLER, **found.gains)
    deadline, (_, torque) = varied.required.settling_deadline, actuator_torques(best)
    loop = stoppable(lambda: [*loop_conditions(best, deadline, torque)])
    lines = _told(found, scenario.controller.name, [each.name for each in loop if not each.holds])
    for line in lines:
        print(line)
    if arguments.output:
        write_whole(arguments.output, _file(found, scenario, lines))
        print(arguments.output)
    return DONE if found.fraction.met == found.fraction.judged else REQUIREMENT_FAILED


def _campaign(arguments: argparse.Namespace, scenario: Scenario) -> Campaign:
    """Campaign as declared, or over every attitude with rates up to the one of the options."""
    if arguments.campaign:
        varied = load_campaign(arguments.campaign, scenario, seed=0)
    else:
        rate = {"distribution": "uniform", "low": 0.0, "high": math.radians(arguments.rate)}
        declaration = {
            "initial_attitude": {"distribution": "so3"},
            "initial_rate": {"magnitude": rate, "direction": "sphere"},
        }
        varied = campaign(declaration, scenario, seed=0)
    return replace(varied, required=load_requirements(arguments.requirements))


def _told(found: Tuned, law: str, violated: list[str]) -> list[str]:
    median, worst = found.settling
    times = f"median {median:.1f} s, worst {worst:.1f} s" if math.isfinite(worst) else "not always"
    gains = ", ".join(f"{name} = {gain!r}" for name, gain in found.gains.items())
    return [
        f"{law}: the best of {found.candidates} sets of gains: {gains}",
        f"Monte Carlo: {found.fraction.met} of {found.fraction.judged} fresh runs meet every "
        f"requirement that they are judged by: {found.fraction} with 95 % confidence",
        f"settled: {times}",
        *(f"missed in {count} runs: {name}" for name, count in found.missed.items()),
        *(f"no gains met, in any run of the search: {name}" for name in found.never_met),
        *([f"warning: check warns of these gains: {', '.join(violated)}"] if violated else []),
        "this is an estimate and no guarantee: momentum_tube is the law that has one",
    ]


def _file(found: Tuned, scenario: Scenario, lines: list[str]) -> str:
    """Overlay with the gains; the comment at its top says how they were judged."""
    law = {"controller": scenario.controller.name, **found.gains}
    return overlay([f"Gains by search: {WRITTEN}", *lines], {CONTROLLER: law})
