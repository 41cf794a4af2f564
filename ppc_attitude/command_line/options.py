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

"""Options that several commands share, and how they print."""

import argparse
import json
import math
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from itertools import permutations
from typing import Any, TextIO

from ppc_attitude.analysis.metrics import Verdict
from ppc_attitude.analysis.requirements import Requirements, load_requirements
from ppc_attitude.bags.reader import read_run
from ppc_attitude.command_line.paths import new_bag, new_file, new_folder, some_path
from ppc_attitude.command_line.verdict_view import verdict_table
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import CONTROLLER, PLANT
from ppc_attitude.processes.exits import DONE, REQUIREMENT_FAILED
from ppc_attitude.science.disturbances.pulses import TIMES
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kinds import CONTROLLERS
from ppc_attitude.science.parameter import LARGEST, Parameter
from ppc_attitude.simulation.scenario import Scenario, load

REPORT = '<meta name="color-scheme" content="light">\n<title>'
"""What stands at the beginning of every report."""
PAPER_DURATION = 120.0  # [s] what a scenario without a duration of its own runs


def add_scenario_options(parser: argparse.ArgumentParser) -> None:
    """Add --config, --duration and --controller."""
    text = "ROS parameter file; may be given several times, later files win"
    _add_files(parser, "--config", text)
    parser.add_argument(
        "--duration",
        metavar="S",
        type=POSITIVE,
        help="simulated time [s]; default the plant's `duration`, or 120 if that is 0",
    )
    parser.add_argument(
        "--controller", choices=tuple(CONTROLLERS.components), help="the control law"
    )


def _add_files(parser: argparse.ArgumentParser, option: str, description: str) -> None:
    """Add an option that names a file and may be given several times."""
    parser.add_argument(
        option, metavar="FILE", type=some_path, action="append", default=[], help=description
    )


def add_namespace_option(parser: argparse.ArgumentParser) -> None:
    """Add --namespace, of a stack that runs."""
    parser.add_argument(
        "--namespace", metavar="NS", default="", help="namespace of the stack; default none"
    )


def add_stack_options(parser: argparse.ArgumentParser, event: str) -> None:
    """Add --at and --namespace, for commands that ask a running stack to do something."""
    at = number(0.0, TIMES.high, "s")
    parser.add_argument(
        "--at", metavar="T", type=at, help=f"simulated time [s] {event}; default now"
    )
    add_namespace_option(parser)


def add_reading_options(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    """Add --topic and, for one run, its bag and --namespace."""
    if not several:
        parser.add_argument("bag", metavar="BAG", type=some_path, help="folder of the bag")
        parser.add_argument(
            "--namespace", metavar="NS", help="namespace of the stack, if the bag has several"
        )
    parser.add_argument(
        "--topic",
        metavar="OURS=THEIRS",
        type=_pair,
        action="append",
        default=[],
        help="read THEIRS, a topic of the bag, for the topic OURS of a run; may be given "
        "several times",
    )


def _pair(text: str) -> tuple[str, str]:
    ours, equals, theirs = text.partition("=")
    if not (ours and equals and theirs):
        allowed = "OURS=THEIRS, as in attitude=/imu/data"
        raise argparse.ArgumentTypeError(f"{text}; allowed: {allowed}")
    return ours, theirs


def record_of(arguments: argparse.Namespace) -> RunRecord:
    """Read the run that the arguments name, and print the warnings about it.

    Raises
    ------
    BagError
        It cannot be read, or lacks what was asked for.
    """
    record = read_run(arguments.bag, arguments.namespace, topics=topics_of(arguments))
    for warning in record.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    return record


def topics_of(arguments: argparse.Namespace) -> dict[str, str]:
    """Map each topic of a run to the one of the bag that carries it.

    Raises
    ------
    ConfigurationError
        A topic of a run is given two topics of the bag.
    """
    told: dict[str, str] = {}
    for ours, theirs in arguments.topic:
        if told.setdefault(ours, theirs) != theirs:
            raise ConfigurationError(f"--topic {ours} = {told[ours]} and {theirs}; allowed: one")
    return told


def see_that_none_is_idle(
    arguments: argparse.Namespace, applies: object, purpose: str, *options: str
) -> None:
    """See that options, named without their first dashes, are given only where they do something.

    The default of each is None, False or empty.

    Raises
    ------
    ConfigurationError
        One would be ignored; says for which purpose they are.
    """
    for option in () if applies else options:
        value = getattr(arguments, option.replace("-", "_"))
        if value is not None and value is not False and value not in ([], ""):
            raise ConfigurationError(f"--{option} is for {purpose}; else it has no effect")


def add_requirements_option(parser: argparse.ArgumentParser) -> None:
    """Add --requirements."""
    text = "limits and deadlines that replace those of config/requirements.yaml; later files win"
    _add_files(parser, "--requirements", text)


def add_judging_options(parser: argparse.ArgumentParser) -> None:
    """Add --requirements, --report and --mission."""
    add_requirements_option(parser)
    parser.add_argument(
        "--report",
        metavar="FILE.html",
        type=new_file(".html", ".htm", replaces=[REPORT]),
        help="write a self-contained HTML report",
    )
    parser.add_argument("--mission", metavar="NAME", default="", help="title of the report")


def requirements_of(arguments: argparse.Namespace) -> Requirements:
    """Read the requirements, before any work, and refuse options that do not go together.

    Raises
    ------
    ConfigurationError
        A file or an option is wrong, there is a report's title without a report, or a file would
        stand where another output is or has its folder.
    """
    see_that_none_is_idle(arguments, arguments.report, "a report: --report FILE.html", "mission")
    _see_that_outputs_are_apart(arguments)
    return load_requirements(arguments.requirements)


def _see_that_outputs_are_apart(arguments: argparse.Namespace) -> None:
    outputs = ("bag", "out", "figures", "export", "report")
    given = {name: path for name in outputs if (path := getattr(arguments, name, None))}
    for file, other in permutations(given, 2):
        path, place = given[file].resolve(), given[other].resolve()
        if file in ("export", "report") and path in (place, *place.parents):
            allowed = f"allowed: another path than that of --{file}"
            raise ConfigurationError(f"{other} = {given[other]}; {allowed}")


def write_report_of(
    arguments: argparse.Namespace, judged: Sequence[Verdict], output: TextIO
) -> None:
    """Write the report that was asked for, and say so."""
    if arguments.report:
        from ppc_attitude.analysis.report import write_report

        now = f"{datetime.now():%Y-%m-%d %H:%M}"
        write_report(judged, arguments.report, mission=arguments.mission, date=now)
        print(f"report: {arguments.report}", file=output)


def add_figures_options(parser: argparse.ArgumentParser, what: str) -> None:
    """Add --figures and --figure-format."""
    parser.add_argument("--figures", metavar="DIR", type=new_folder, help=f"draw {what} there")
    parser.add_argument(
        "--figure-format",
        choices=("png", "svg", "pdf"),
        action="append",
        help="format of the figures; may be given several times; default png",
    )


def add_bag_option(
    parser: argparse.ArgumentParser, told: str = "folder of the bag; default a new, dated one"
) -> None:
    """Add --bag."""
    parser.add_argument("--bag", metavar="DIR", type=new_bag, help=told)


def number(
    low: float = -LARGEST,
    high: float = LARGEST,
    unit: str = "",
    *,
    above: float = -math.inf,
    whole: bool = False,
) -> Callable[[str], Any]:
    """Give a parser of numbers; it refuses those that a `Parameter` with these bounds refuses."""
    bounded = Parameter("", 0 if whole else 0.0, "", unit, low=low, high=high, above=above)

    def parsed(text: str) -> Any:
        try:
            return bounded.checked(int(text) if whole else float(text))
        except ValueError:
            allowed = f"{bounded.allowed} {unit}".rstrip()
            raise argparse.ArgumentTypeError(f"{text}; allowed: {allowed}") from None

    return parsed


ACCURACY = number(1e-9, 1.0)
"""Parser of a limit on a component of a unit quaternion."""
POSITIVE = number(above=0.0)
NOT_NEGATIVE = number(0.0)


def scenario_of(arguments: argparse.Namespace, **plant: float) -> Scenario:
    """Scenario from files, options and some parameters of the plant; the duration is never zero.

    Raises
    ------
    ConfigurationError
        A file or value is wrong.
    """
    if arguments.duration:
        plant["duration"] = arguments.duration
    law = {"controller": arguments.controller} if arguments.controller else {}
    scenario = load(arguments.config, {PLANT: plant, CONTROLLER: law})
    if scenario.parameters[PLANT]["duration"] == 0.0:
        return scenario.with_values(PLANT, duration=PAPER_DURATION)
    return scenario


def print_verdict(verdict: Verdict, *, as_json: bool, **more: object) -> None:
    """Print a verdict as a table, or as one JSON object with more facts about the run."""
    if as_json:
        print_json({**verdict.to_json(), **more})
    else:
        print(verdict_table(verdict))


def exit_code(verdict: Verdict) -> int:
    """1 if a requirement is not met, else 0; one that is not judged alone fails nothing."""
    return DONE if verdict.all_met else REQUIREMENT_FAILED


def print_json(content: object) -> None:
    """Print one JSON object; a number that is not finite, as a time that never comes, is null."""
    print(json.dumps(_finite(content), ensure_ascii=False, allow_nan=False))


def _finite(content: Any) -> Any:
    if isinstance(content, Mapping):
        return {name: _finite(each) for name, each in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(each) for each in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def paragraph(text: str, indent: str = "") -> str:
    """Fold a text into lines of 80 columns; no word and no number is broken."""
    return textwrap.fill(
        text,
        80,
        initial_indent=indent,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
