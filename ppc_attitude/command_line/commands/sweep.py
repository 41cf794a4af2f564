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

"""`ppc_attitude sweep`: how long a sudden disturbance may last, in one command and one figure."""

import argparse
from collections.abc import Sequence
from typing import NamedTuple

from ppc_attitude.analysis.envelopes import ATTITUDE, RATE
from ppc_attitude.analysis.hits import SweptHit, scheduled
from ppc_attitude.analysis.measure import Measured, metric_of
from ppc_attitude.analysis.requirements import Requirements, load_requirements
from ppc_attitude.analysis.verdict import MET, NOT_JUDGED, NOT_MET
from ppc_attitude.command_line.in_process import check_memory, see_that_it_is_bounded
from ppc_attitude.command_line.options import (
    POSITIVE,
    add_requirements_option,
    add_scenario_options,
    paragraph,
    print_json,
    scenario_of,
)
from ppc_attitude.command_line.paths import new_file
from ppc_attitude.command_line.proportions import actuator_torques
from ppc_attitude.command_line.stopping import stoppable
from ppc_attitude.contract.topics import INJECTOR, PLANT
from ppc_attitude.processes.exits import DONE
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import Scenario

HELP = "recovery time over the duration of a sudden disturbance"
DESCRIPTION = (
    "Simulates a run with one sudden disturbance (a hit), in place of the configured ones, for "
    "each duration, and reports the recovery. Options that are not given scale with the actuator "
    "and the settling deadline."
)
EXAMPLES = (
    "ppc_attitude sweep --torque 0.8 --at 80 --pulse-durations 0.05 0.1 0.2",
    "ppc_attitude sweep --figure sweep.png --json",
)
_PICTURES = ("PNG", "<!DOCTYPE svg", "%PDF")  # how each begins
# Options that are not given are in proportion to actuator and requirements. In the paper's case
# these are hits of 0.8 N·m at 80 s for 0.05 s to 1 s, and 300 s to recover.
_STRENGTH = 16.0  # times what the actuator gives
_SHARES = (1 / 1200, 1 / 600, 1 / 300, 1 / 120, 1 / 60)  # of the settling deadline
_AFTER = 5.0  # settling deadlines after the hit
_SYMBOLS = {ATTITUDE: "q_ev", RATE: "z2"}  # of the errors that the table always has


class Hits(NamedTuple):
    """The hits of a sweep, which differ in their duration only."""

    torque: float  # on every axis [N·m]
    at: float  # when each begins [s]
    durations: list[float]  # how long each acts [s], ascending
    length: float  # how long each run is [s]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_scenario_options(parser)
    add_requirements_option(parser)
    parser.add_argument(
        "--pulse-durations",
        metavar="S",
        type=POSITIVE,
        nargs="+",
        help="durations of the hit [s]; default 1/1200 to 1/60 of the settling deadline",
    )
    parser.add_argument(
        "--torque",
        metavar="NM",
        type=POSITIVE,
        help="torque of the hit on every axis [N·m]; default 16 times what the actuator gives",
    )
    parser.add_argument(
        "--at",
        metavar="T",
        type=POSITIVE,
        help="start of the hit [s]; default the settling deadline and a terminal window later",
    )
    picture = new_file(".png", ".svg", ".pdf", replaces=_PICTURES)
    parser.add_argument("--figure", metavar="FILE", type=picture, help="draw the sweep in FILE")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def execute(arguments: argparse.Namespace) -> int:
    """Simulate every duration, print a table, draw."""
    scenario, required = scenario_of(arguments), load_requirements(arguments.requirements)
    hits = _hits(arguments, scenario, required)
    if hits.at + hits.durations[-1] >= hits.length:
        raise ConfigurationError(
            f"--duration {hits.length:g} s; allowed: more than {hits.at + hits.durations[-1]:g} s, "
            "when the longest hit ends"
        )
    check_memory(scenario.with_values(PLANT, duration=hits.length))
    swept = [_swept(scenario, required, hits, duration) for duration in hits.durations]
    if arguments.json:
        listed = [
            {
                "duration_s": each.duration_s,
                "recovery_time_s": each.recovery_time_s,
                **{metric_of(envelope): None for envelope in _SYMBOLS},
                **{metric_of(envelope): time for envelope, time in each.outside.items()},
            }
            for each in swept
        ]
        print_json({"torque": hits.torque, "at_s": hits.at, "hits": listed})
    else:
        _print_table(swept, hits, required)
    if arguments.figure:
        from ppc_attitude.analysis.comparison import sweep_figure
        from ppc_attitude.analysis.drawing import save

        save(sweep_figure(swept, required), arguments.figure)
    return DONE


def _hits(arguments: argparse.Namespace, scenario: Scenario, required: Requirements) -> Hits:
    """The given numbers, and the rest in proportion."""
    deadline, rate = required.settling_deadline, scenario.number(PLANT, "rate")
    instants = sorted({max(round(share * deadline * rate), 1) for share in _SHARES})
    at = arguments.at or deadline + required.terminal_window
    return Hits(
        arguments.torque or float(f"{_STRENGTH * actuator_torques(scenario)[0]:.6g}"),
        at,
        sorted(arguments.pulse_durations or [count / rate for count in instants]),
        arguments.duration or at + max(_AFTER * deadline, required.recovery),
    )


def _swept(scenario: Scenario, required: Requirements, hits: Hits, duration: float) -> SweptHit:
    """Simulate one hit; the samples of all hits together may not fit into the memory."""
    pulse = {
        "pulse_times": [hits.at],
        "pulse_durations": [duration],
        "pulse_torques": [hits.torque] * 3,
    }
    hit = scenario.overlaid({INJECTOR: pulse, PLANT: {"duration": hits.length}})
    flown = stoppable(lambda: simulate(hit, hits.length))
    see_that_it_is_bounded(hit, flown)
    run = Measured(flown, required, tuple(scheduled(flown)))  # too weak a one would not be found
    found, settled = run.hits[0], bool(run.metrics.settled)
    return SweptHit(found.duration_s, found.recovery_time_s, run.outsides, settled)


def _print_table(swept: Sequence[SweptHit], hits: Hits, required: Requirements) -> None:
    print(
        paragraph(
            f"{hits.torque:g} N·m on every axis from {hits.at:g} s on; the craft has recovered if "
            f"its error stays below {required.settled}, required within {required.recovery:g} s."
        )
    )
    if not swept[0].settled:
        print("The craft has not settled when it is hit, so that the times include settling.")
    seen = round(hits.length - hits.at, 9)
    judged = seen >= required.recovery  # before, the error of a hit may still grow
    if not judged:
        print(
            paragraph(
                f"The runs end {seen:g} s after the hit begins, before the {required.recovery:g} s "
                "to recover are over, so that nothing is judged."
            )
        )
    # Each error has one column, whatever bounds it.
    symbols = {each.error: symbol for each, symbol in _SYMBOLS.items()}
    errors = symbols | {
        each.error: each.name for each in swept[0].outside if each.error not in symbols
    }
    heads = [f"{told} outside [s]" for told in errors.values()]
    print("\nhit [s]  recovered after [s]", *heads, "verdict", sep="  ")
    for each in swept:
        recovery = each.recovery_time_s
        after = f"not in {seen:g}" if recovery is None else f"{recovery:.2f}"
        outside = {envelope.error: time for envelope, time in each.outside.items()}
        times = [
            f"{_number(outside.get(error)):>{len(head)}}"
            for error, head in zip(errors, heads, strict=True)
        ]
        met = recovery is not None and recovery <= required.recovery
        verdict = NOT_JUDGED if not judged else MET if met else NOT_MET
        print(f"{each.duration_s:>7g}", f"{after:>19}", *times, verdict, sep="  ")


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
