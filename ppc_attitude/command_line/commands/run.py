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

"""`ppc_attitude run`: the five nodes as processes, recorded and judged."""

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

from tqdm import tqdm

from ppc_attitude.analysis.metrics import analyse, verdict_table
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.errors import RunError
from ppc_attitude.command_line.options import (
    add_report_option,
    add_scenario_options,
    exit_code,
    scenario_of,
)
from ppc_attitude.command_line.parameter_file import parameter_file
from ppc_attitude.command_line.stack import Stack, StackError, private_environment
from ppc_attitude.command_line.stopping import stop_on_signals
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import NODES, PLANT, RECORDER
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.closed_loop import warm_up
from ppc_attitude.simulation.scenario import Scenario


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "run",
        help="run the five nodes, record, and judge",
        description=(
            "Starts plant, reference, controller, injector and recorder as processes in "
            "lock-step, stops them all, and prints the verdict from the bag."
        ),
    )
    add_scenario_options(parser)
    parser.add_argument(
        "--bag", metavar="DIR", type=Path, help="folder of the bag; default a new, dated one"
    )
    parser.add_argument(
        "--realtime",
        action="store_true",
        help="free-running on the wall clock instead of lock-step",
    )
    add_report_option(parser)
    parser.set_defaults(execute=execute)


def execute(arguments: argparse.Namespace) -> int:
    """Run, record, judge."""
    bag = _bag_folder(arguments.bag)
    extra: dict[str, dict[str, Any]] = {
        PLANT: {"lockstep": not arguments.realtime, "wait_for_recorder": True},
        RECORDER: {"bag": str(bag)},
    }
    scenario = scenario_of(arguments, extra)
    warm_up(scenario)
    interrupted = _run_stack(arguments, scenario, bag)
    record = _read(bag)
    verdict = analyse(record)
    print(verdict_table(verdict))
    for warning in record.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if arguments.report:
        from ppc_attitude.analysis.report import write_report

        write_report([(record, verdict)], arguments.report)
        print(f"report: {arguments.report}")
    print(f"bag: {bag}")
    if record.missing_messages:
        lost = ", ".join(f"{count} of {name}" for name, count in record.missing.items())
        raise RunError(f"the bag lacks messages: {lost}")
    if interrupted:
        raise RunError("interrupted before the end; the bag holds what was run until then")
    return exit_code(verdict)


def _bag_folder(given: Path | None) -> Path:
    folder = given or Path("bags") / f"{datetime.now():%Y-%m-%d_%H-%M-%S}_{os.getpid()}"
    if folder.exists():
        raise ConfigurationError(f"bag folder {folder} exists already and is not overwritten")
    return folder.absolute() if given is None else folder


def _run_stack(arguments: argparse.Namespace, scenario: Scenario, bag: Path) -> bool:
    """Run all processes to the end; True if the user interrupted."""
    environment = private_environment()
    print(
        f"ROS domain {environment['ROS_DOMAIN_ID']}, "
        f"discovery {environment['ROS_AUTOMATIC_DISCOVERY_RANGE'].lower()}",
        file=sys.stderr,
    )
    duration = scenario.number(PLANT, "duration")
    with tempfile.TemporaryDirectory(prefix="ppc_attitude_") as folder:
        environment.setdefault("ROS_LOG_DIR", folder)
        overlay = Path(folder) / "run.yaml"
        overlay.write_text(parameter_file(scenario), encoding="utf-8")
        common = ["--ros-args", "--params-file", str(overlay)]
        command_lines = {name: list(common) for name in NODES}
        command_lines[PLANT] = ["--progress", *common]
        with _progress(duration) as show, stop_on_signals() as stop:
            stack = Stack(command_lines, environment, show)
            try:
                stack.start()
                stack.wait(stop)
            except StackError as error:
                _end_after_failure(stack)
                raise RunError(f"{error}\nbag: {bag}" if bag.exists() else str(error)) from None
            try:
                stack.stop()
            except StackError as error:
                raise RunError(f"{error}\nbag: {bag}") from None
            return stop.is_set()


def _end_after_failure(stack: Stack) -> None:
    # The first failure is the one to report; what stopping finds is its consequence.
    try:
        stack.stop()
    except StackError:
        return


@contextmanager
def _progress(duration: float) -> Iterator[Any]:
    """Progress bar over simulated time; gives the function that moves it."""
    form = "{l_bar}{bar}| {n:.1f}/{total:.1f} s [{elapsed}<{remaining}, {rate_fmt}{postfix}]"
    with tqdm(
        total=duration, desc="simulated", unit="s", bar_format=form, file=sys.stderr, leave=True
    ) as bar:
        yield lambda t: bar.update(max(t - bar.n, 0.0))


def _read(bag: Path) -> RunRecord:
    try:
        return read_run(bag)
    except BagError as error:
        raise RunError(str(error)) from None
