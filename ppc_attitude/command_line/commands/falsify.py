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

"""`ppc_attitude falsify`: an adversary looks for the worst start, disturbance and craft."""

import argparse
import math
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

from ppc_attitude.campaign.pools import (
    connected,
    cores,
    cut_off,
    see_that_it_is_connected,
    threads,
)
from ppc_attitude.campaign.rows import CampaignError
from ppc_attitude.command_line.environment_load import environment_torque
from ppc_attitude.command_line.in_process import check_memory
from ppc_attitude.command_line.options import (
    ACCURACY,
    NOT_NEGATIVE,
    POSITIVE,
    add_scenario_options,
    number,
    print_json,
    scenario_of,
    see_that_none_is_idle,
)
from ppc_attitude.command_line.parameter_file import overlay
from ppc_attitude.command_line.paths import new_folder, see_that_it_may_go
from ppc_attitude.command_line.progress import progress_bar
from ppc_attitude.command_line.stopping import stop_on_signals, stoppable
from ppc_attitude.contract.topics import CONTROLLER, PLANT
from ppc_attitude.contract.whole_file import write_whole
from ppc_attitude.falsify.goals import RATE, SETTLED, Goal, goal_of
from ppc_attitude.falsify.search import Found, Search
from ppc_attitude.falsify.space import Space
from ppc_attitude.processes.exits import DONE, REQUIREMENT_FAILED, RunError
from ppc_attitude.science.controllers.tube_parameters import PREFIX
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kinds import ENVIRONMENTS
from ppc_attitude.simulation.closed_loop import first_instant
from ppc_attitude.simulation.scenario import Scenario

HELP = "an adversary that looks for the worst case of a law"
DESCRIPTION = (
    "Searches start, disturbance, inertia and actuator within bounds for the worst case, by CMA-ES "
    "over simulated runs, and writes the worst case as a parameter file. The same command "
    "continues an earlier search in its folder."
)
EXAMPLES = (
    "ppc_attitude falsify --config config/paper.yaml --config config/guaranteed.yaml",
    "ppc_attitude falsify --controller ppc --goal attitude_error --seconds 60 --out search",
)
WORST = "worst.yaml"
_HEAD = "Overlay: the worst case of"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_scenario_options(parser)
    parser.add_argument(
        "--goal",
        default="settling",
        help="what to maximise: settling, terminal, rate, or a column that has a bound, such as "
        "attitude_error or momentum_error; default settling",
    )
    parser.add_argument(
        "--accuracy",
        type=ACCURACY,
        help=f"for settling and terminal: settled means an error below this; default {SETTLED:g}",
    )
    parser.add_argument(
        "--after", type=NOT_NEGATIVE, help="for other goals: first instant judged [s]; default 0"
    )
    for option, allowed, default, told in (
        ("--start-rate", number(0.0, 5000.0, "deg/s"), 1.0, "largest ‖ω_s‖ at the start [deg/s]"),
        (
            "--disturbance",
            number(0.0, unit="N·m"),
            None,
            "bound of the disturbance, per axis [N·m]; default: that of the environment",
        ),
        # CMA-ES takes memory as their square: 0.5 GB of 1000, 20 GB of 10 000.
        (
            "--pieces",
            number(0, 1e3, whole=True),
            40,
            "constant pieces of the disturbance torque; 0: as configured",
        ),
        ("--inertia-error", number(0.0, 0.5), 0.0, "largest inertia error e_S, such as 0.1"),
        ("--strength", number(1e-3, 1.0), 1.0, "least share η of the actuator's torque limit"),
        ("--begin", number(0.0, 1e9, "s"), 0.0, "latest time of the reference to start at [s]"),
    ):
        told += "" if default is None else f"; default {default:g}"
        parser.add_argument(option, type=allowed, default=default, help=told)
    parser.add_argument("--late", action="store_true", help="commands may act one sample late")
    parser.add_argument(
        "--runs",
        type=number(1, 1e9, whole=True),
        default=1000,
        help="runs in all, those of earlier sessions too, up to a whole generation; default 1000",
    )
    parser.add_argument(
        "--seconds", type=POSITIVE, default=math.inf, help="time limit of this session [s]"
    )
    told = "seed of the search; default 0"
    parser.add_argument("--seed", type=number(0, 1e15, whole=True), default=0, help=told)
    told = "run on the Dask cluster of the scheduler there"
    parser.add_argument("--scheduler", metavar="ADDRESS", help=told)
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=_folder,
        default="falsified",
        help="folder of the search; default falsified",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def _folder(text: str) -> Path:
    """Parse the folder of the search; a file that is no worst case is not overwritten."""
    folder = new_folder(text)
    see_that_it_may_go(folder / WORST, _HEAD)
    return folder


def execute(arguments: argparse.Namespace) -> int:
    """Search, write the worst case, and print."""
    scenario = scenario_of(arguments)
    if not arguments.scheduler:  # the runs of a cluster take the memory of others
        check_memory(scenario, cores())
    goal, space = _goal_of(arguments, scenario), _space_of(arguments, scenario)
    found, interrupted = _searched(arguments, Search(space, goal, arguments.out, arguments.seed))
    worst = arguments.out / WORST
    write_whole(worst, _file(space, goal, found, arguments.controller))
    broken = found.value > goal.limit
    limit = float(f"{goal.limit:.12g}")  # what was 3 deg/s in a certificate has other last digits
    text = goal.text(found.value, space.duration)
    if arguments.json:
        print_json(
            {
                "controller": scenario.controller.name,
                "goal": goal.name,
                "runs": found.runs,
                "largest": found.value,
                "told": text,
                "limit": limit,
                "passes_limit": broken,
                "worst": str(worst),
            }
        )
    else:
        told = f", limit {limit:g}" if math.isfinite(limit) else ""
        print(f"largest {goal.name} of {found.runs} runs: {text}{told}")
        print(f"worst case: {worst}")
    if interrupted and found.runs < arguments.runs:
        raise RunError(
            f"interrupted after {found.runs} of {arguments.runs} runs; the same command continues"
        )
    return REQUIREMENT_FAILED if broken else DONE


def _goal_of(arguments: argparse.Namespace, scenario: Scenario) -> Goal:
    """What is maximised, as asked for."""
    duration, after = scenario.number(PLANT, "duration"), arguments.after or 0.0
    if after >= duration:
        raise ConfigurationError(
            f"--after {after:g} s; allowed: less than the run of {duration:g} s"
        )
    fastest = f"{PREFIX}assumed.Omega"  # [rad/s] of the certificate, where the law has one
    known = fastest in scenario.parameters[CONTROLLER]
    goal = goal_of(
        arguments.goal,
        scenario,
        arguments.accuracy or SETTLED,
        after,
        math.degrees(scenario.number(CONTROLLER, fastest)) if known else RATE,
    )
    error, others = "the goals settling and terminal", "the goal rate and those with a bound"
    see_that_none_is_idle(arguments, goal.has_accuracy, error, "accuracy")
    see_that_none_is_idle(arguments, not goal.has_accuracy, others, "after")
    return goal


def _space_of(arguments: argparse.Namespace, scenario: Scenario) -> Space:
    """What is searched, as asked for."""
    pieces = "a disturbance in pieces, without --pieces 0"
    see_that_none_is_idle(arguments, arguments.pieces, pieces, "disturbance")
    return Space(
        base=scenario,
        rate=math.radians(arguments.start_rate),
        disturbance=_disturbance(arguments, scenario),
        pieces=arguments.pieces,
        e_S=arguments.inertia_error,
        eta=arguments.strength,
        begin=arguments.begin,
        late=arguments.late,
    )


def _searched(arguments: argparse.Namespace, search: Search) -> tuple[Found, bool]:
    """Worst case so far after this session's runs, and whether a signal ended the session."""
    found: Found | None = None
    with (
        _executor(arguments.scheduler) as (executor, check),
        stop_on_signals() as stop,
        progress_bar(total=arguments.runs, unit=" runs") as bar,
    ):
        for found in search.run(arguments.runs, arguments.seconds, executor, stop, check):
            told = search.goal.text(found.value, search.space.duration)
            bar.set_postfix_str(told, refresh=False)
            bar.update(found.runs - bar.n)
    if found is None and stop.is_set():
        raise RunError("interrupted before the first generation of runs was complete")
    if found is None:
        least = "allowed: enough for one generation of runs"
        raise ConfigurationError(f"--seconds {arguments.seconds:g}; {least}")
    return found, stop.is_set()


def _disturbance(arguments: argparse.Namespace, scenario: Scenario) -> float:
    """Bound of the disturbance [N·m]: as asked for, or else that of the configured environment."""
    if arguments.disturbance is not None:
        return float(arguments.disturbance)
    return stoppable(
        lambda: environment_torque(scenario, first_instant(scenario)[ENVIRONMENTS.name])
    )


def _file(space: Space, goal: Goal, found: Found, controller: str | None) -> str:
    """Overlay of the worst case, with the law if an option chose it."""
    text = goal.text(found.value, space.duration)
    law = {CONTROLLER: {"controller": controller}} if controller else {}
    told = f"{_HEAD} {found.runs} runs, {goal.name}: {text}."
    return overlay([told], {**space.choice(found.x), **law})


@contextmanager
def _executor(scheduler: str | None) -> Iterator[tuple[Executor, Callable[[], None]]]:
    """Threads of this process, or a Dask cluster, and what raises CampaignError if it is lost.

    Raises
    ------
    RunError
        The cluster was lost, however that was told first.
    """
    if scheduler is None:
        with threads() as executor:
            yield executor, lambda: None
        return
    with closing(connected(scheduler)) as client:
        lost: tuple[type[BaseException], ...] = (CampaignError, *cut_off())
        try:
            yield client.get_executor(), partial(see_that_it_is_connected, client, scheduler)
        except lost:
            told = f"the scheduler {scheduler} was lost; the same command continues"
            raise RunError(told) from None
