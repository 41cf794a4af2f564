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

from ppc_attitude.analysis.comparison import save_sweep
from ppc_attitude.analysis.metrics import analyse
from ppc_attitude.analysis.verdict import Metrics
from ppc_attitude.command_line.errors import DONE
from ppc_attitude.command_line.memory import check_memory
from ppc_attitude.command_line.options import (
    add_scenario_options,
    positive,
    print_json,
    scenario_of,
)
from ppc_attitude.command_line.paths import new_file
from ppc_attitude.contract.topics import INJECTOR, PLANT
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import Scenario

_DURATIONS = (0.05, 0.1, 0.2, 0.5, 1.0)
_AFTER = 300.0  # [s] of simulated time after the hit, unless --duration says otherwise


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "sweep",
        help="recovery over the duration of a hit",
        description="Simulates one hit for every duration and reports how each is recovered.",
    )
    add_scenario_options(parser)
    parser.add_argument(
        "--pulse-durations",
        metavar="S",
        type=positive,
        nargs="+",
        default=list(_DURATIONS),
        help="durations of the hit [s]",
    )
    parser.add_argument(
        "--torque", metavar="NM", type=positive, default=0.8, help="on every axis [N·m]"
    )
    parser.add_argument("--at", metavar="T", type=positive, default=80.0, help="start [s]")
    parser.add_argument("--figure", metavar="FILE", type=new_file, help="draw the sweep there")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.set_defaults(execute=execute)


def execute(arguments: argparse.Namespace) -> int:
    """Simulate every duration, print a table, draw."""
    scenario = scenario_of(arguments)
    length = arguments.duration or arguments.at + _AFTER
    check_memory(scenario.with_values(PLANT, duration=length))
    rows = [
        (duration, _metrics(scenario, arguments, duration, length))
        for duration in sorted(arguments.pulse_durations)
    ]
    if arguments.json:
        print_json({"torque": arguments.torque, "at_s": arguments.at, "hits": _listed(rows)})
    else:
        _print_table(rows, length - arguments.at)
    if arguments.figure:
        save_sweep(
            [duration for duration, _ in rows],
            [_recovery(metrics) for _, metrics in rows],
            [metrics.time_outside_rate_envelope_s or 0.0 for _, metrics in rows],
            arguments.figure,
        )
    return DONE


def _metrics(
    scenario: Scenario, arguments: argparse.Namespace, duration: float, length: float
) -> Metrics:
    hit = scenario.with_values(
        INJECTOR,
        pulse_times=[arguments.at],
        pulse_durations=[duration],
        pulse_torques=[arguments.torque] * 3,
    ).with_values(PLANT, duration=length)
    return analyse(simulate(hit, length)).metrics


def _recovery(metrics: Metrics) -> float | None:
    return metrics.disturbances[0].recovery_time_s if metrics.disturbances else None


def _listed(rows: Sequence[tuple[float, Metrics]]) -> list[dict[str, float | None]]:
    return [
        {
            "duration_s": duration,
            "recovery_time_s": _recovery(metrics),
            "time_outside_attitude_envelope_s": metrics.time_outside_attitude_envelope_s,
            "time_outside_rate_envelope_s": metrics.time_outside_rate_envelope_s,
        }
        for duration, metrics in rows
    ]


def _print_table(rows: Sequence[tuple[float, Metrics]], after: float) -> None:
    head = ("hit [s]", "recovered after [s]", "q_ev outside [s]", "z2 outside [s]")
    print(f"{head[0]:>8} {head[1]:>20} {head[2]:>17} {head[3]:>15}")
    for duration, metrics in rows:
        recovery = _recovery(metrics)
        shown = f"not in {after:g}" if recovery is None else f"{recovery:.2f}"
        outside_q = metrics.time_outside_attitude_envelope_s
        outside_z = metrics.time_outside_rate_envelope_s
        print(f"{duration:>8g} {shown:>20} {_number(outside_q):>17} {_number(outside_z):>15}")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
