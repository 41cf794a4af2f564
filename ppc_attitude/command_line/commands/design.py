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

"""`ppc_attitude design`: gains with a certificate, or the inequality that stands in the way.

For a law without a guarantee it searches gains over the loop in process (`gain_search`).
"""

import argparse
import json
import math
from dataclasses import asdict
from itertools import chain
from pathlib import Path

from ppc_attitude.analysis.guarantee import nodes_around
from ppc_attitude.campaign.tuning import GAINS
from ppc_attitude.command_line.gain_search import WRITTEN, search_gains
from ppc_attitude.command_line.guarantee_view import certificate_path, promise_lines
from ppc_attitude.command_line.options import (
    ACCURACY,
    NOT_NEGATIVE,
    POSITIVE,
    add_requirements_option,
    add_scenario_options,
    number,
    scenario_of,
    see_that_none_is_idle,
)
from ppc_attitude.command_line.parameter_file import overlay
from ppc_attitude.command_line.paths import new_file, see_that_it_may_go, some_path
from ppc_attitude.contract.parameter_files import read_files
from ppc_attitude.contract.topics import CONTROLLER, PLANT, REFERENCE
from ppc_attitude.contract.whole_file import write_whole
from ppc_attitude.processes.exits import DONE, REQUIREMENT_FAILED
from ppc_attitude.science.controllers import quaternion_feedback, tube_parameters
from ppc_attitude.science.controllers.tube_parameters import (
    ASSUMED,
    LAW,
    LAW_AHEAD,
    LAWS,
    PREFIX,
    digest_of,
)
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guarantee.assumptions import Assumptions, Law, parameters_of
from ppc_attitude.science.guarantee.certificate import RATES, Certificate, certify
from ppc_attitude.science.guarantee.design import (
    Design,
    UnwishedError,
    Wishes,
    design,
    designed,
    nearest,
)
from ppc_attitude.science.guarantee.fixed_point import InfeasibleError
from ppc_attitude.science.guarantee.surroundings import (
    TUBE,
    assumptions_from,
    broken_assumptions,
    broken_by_reference,
    suspensions,
    tube_of,
    white_noise,
)
from ppc_attitude.science.kinds import REFERENCES
from ppc_attitude.science.parameter import resolved
from ppc_attitude.science.references import paper, paper_ahead
from ppc_attitude.simulation.scenario import Scenario

HELP = "gains of the momentum-tube law with a certificate; of other laws by search"
DESCRIPTION = (
    "Finds gains for the configured craft, actuator, disturbance and reference, and writes a "
    "parameter file whose guarantee interval arithmetic proves. With --controller ppc or "
    "quaternion_feedback it searches gains over simulated runs, and counts how many fresh runs "
    "meet the requirements, which is no guarantee."
)
EXAMPLES = (
    "ppc_attitude design --config config/paper.yaml --output gains.yaml",
    "ppc_attitude design --config config/paper.yaml --assume e_S=0.1 --assume eta=0.8",
    "ppc_attitude design --attitude-noise 5e-5 --rate-noise 2e-5 --torque-noise 7e-4",
    "ppc_attitude design --config config/paper.yaml --gains 1 15 0.2",
)
_SEARCH = f"a search: --controller {' or '.join(GAINS)}"
_OF_THE_TUBE = (
    "gains",
    "assume",
    "accuracy",
    "time",
    "torque-noise",
    "attitude-noise",
    "rate-noise",
)
_DEFAULTS = {  # filled in after the options that were given, and would do nothing, are refused
    "seconds": 40.0,
    "accuracy": 5e-3,
    "rate": 1.0,
    "time": math.inf,
    "torque_noise": math.inf,
}
_TABLE = {each.name: each for each in tube_parameters.PARAMETERS}
# Every assumption, and the parameter of the law that holds it.
_ASSUMED = {
    **{name: _TABLE[f"{PREFIX}assumed.{name}"] for name in ASSUMED},
    **{name: _TABLE[PREFIX + name] for name in ("e_A", "lead")},
}
_MORE = 1.1  # times the rate error in the tube: it grows with what it adds to the disturbance


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    add_scenario_options(parser)
    add_requirements_option(parser)
    parser.add_argument(
        "--campaign",
        metavar="FILE",
        type=some_path,
        help="what varies in the runs of a search; default: attitude and rate at the start",
    )
    parser.add_argument(
        "--seconds",
        type=POSITIVE,
        help=f"time after which a search ends [s]; default {_DEFAULTS['seconds']:g}",
    )
    parser.add_argument(
        "--assume",
        metavar="NAME=VALUE",
        type=_assumption,
        action="append",
        default=[],
        help=f"an assumption in place of the configuration's: {', '.join(_ASSUMED)}",
    )
    parser.add_argument(
        "--accuracy",
        type=ACCURACY,
        help=f"settled means that every |q_ev,i| is below this; default {_DEFAULTS['accuracy']:g}",
    )
    parser.add_argument(
        "--rate",
        type=NOT_NEGATIVE,
        help="rate at the start for which the settling time is kept short [deg/s]; the certificate "
        f"has times for other rates, too; default {_DEFAULTS['rate']:g}",
    )
    parser.add_argument("--time", type=POSITIVE, help="longest settling time [s]; default any")
    parser.add_argument(
        "--torque-noise", type=POSITIVE, help="largest RMS torque noise [N·m]; default any"
    )
    for name, unit in (("attitude", "rad"), ("rate", "rad/s")):
        told = f"standard deviation of the measurement [{unit}]; default: that of the sensors"
        parser.add_argument(f"--{name}-noise", type=NOT_NEGATIVE, help=told)
    parser.add_argument(
        "--gains",
        nargs=3,
        type=POSITIVE,
        metavar=("K", "KAPPA", "ELL"),
        help="use these gains, without a search",
    )
    parser.add_argument("--output", metavar="FILE.yaml", type=_output, help="new parameter file")


def _output(text: str) -> Path:
    path = new_file(".yaml", ".yml", replaces=[WRITTEN])(text)
    see_that_it_may_go(certificate_path(path), '"digest"')
    return path


def _assumption(text: str) -> tuple[str, float]:
    name, equals, value = text.partition("=")
    if not equals or name not in _ASSUMED:
        raise argparse.ArgumentTypeError(
            f"{text}: allowed is NAME=VALUE with a NAME of {', '.join(_ASSUMED)}"
        )
    try:
        return name, number()(value)
    except argparse.ArgumentTypeError as error:
        raise argparse.ArgumentTypeError(f"{name} = {error}") from None


def execute(arguments: argparse.Namespace) -> int:
    """Search, prove, write and print."""
    certified, without = arguments.controller in (None, *LAWS), not arguments.campaign
    see_that_none_is_idle(arguments, not certified, _SEARCH, "requirements", "campaign", "seconds")
    see_that_none_is_idle(arguments, certified, "momentum_tube", *_OF_THE_TUBE)
    see_that_none_is_idle(arguments, certified or without, "a search without --campaign", "rate")
    for name, value in _DEFAULTS.items():
        if getattr(arguments, name) is None:
            setattr(arguments, name, value)
    if not certified:
        return search_gains(arguments, scenario_of(arguments))
    scenario = _craft_of(arguments)
    nodes = nodes_around(scenario.parameters)
    for name, value in zip(("k", "kappa", "ell"), arguments.gains or (), strict=False):
        _TABLE[PREFIX + name].checked(value)
    wishes = _wishes(arguments, white_noise(nodes))
    if (both := _design_for(scenario, arguments, wishes)) is None:
        return REQUIREMENT_FAILED
    assumed, found = both
    values = _values(assumed, found.law)
    certificate = certify(values, wishes.accuracy, sorted({*RATES, arguments.rate}))
    if not certificate.holds:
        failing = [each.name for each in certificate.inequalities if not each.holds]
        print(f"for the gains found, these inequalities cannot be proved: {', '.join(failing)}")
        return REQUIREMENT_FAILED
    _tell(found, certificate, assumed)
    duration = scenario.number(PLANT, "duration")
    of_reference = broken_by_reference(assumed, nodes, duration)
    for broken in chain(broken_assumptions(assumed, found.law, nodes), of_reference):
        print(f"warning: assumption not kept: {broken}")
    for suspension in suspensions(assumed, nodes, duration):
        print(f"warning: {suspension}")
    if arguments.output:
        law = str(scenario.parameters[CONTROLLER]["controller"])
        write_whole(arguments.output, _file(law, values, certificate, assumed))
        path = certificate_path(arguments.output)
        text = json.dumps(asdict(certificate), ensure_ascii=False, indent=1)
        write_whole(path, text + "\n")
        print(f"{arguments.output}, {path}")
    return DONE


def _wishes(arguments: argparse.Namespace, noise: tuple[float, float]) -> Wishes:
    """What the options ask of a law, and the noise of the sensors where they do not say."""
    attitude, rate = arguments.attitude_noise, arguments.rate_noise
    return Wishes(
        accuracy=arguments.accuracy,
        rate=math.radians(arguments.rate),
        time=arguments.time,
        torque_noise=arguments.torque_noise,
        attitude_noise=noise[0] if attitude is None else attitude,
        rate_noise=noise[1] if rate is None else rate,
    )


def _design_for(
    scenario: Scenario, arguments: argparse.Namespace, wishes: Wishes
) -> tuple[Assumptions, Design] | None:
    """Find a design, and assumptions that hold with it; print why if there is none."""
    h, tube = 1.0 / scenario.number(PLANT, "rate"), TUBE
    assumed = _assumptions(scenario, arguments, tube)
    try:
        while True:
            if arguments.gains:
                found = designed(assumed, wishes, h, arguments.gains)
            else:
                found = design(assumed, wishes, h)
            needed = tube_of(assumed, found.law)
            if needed <= tube:
                return assumed, found
            tube = _MORE * needed  # with this law the craft may be faster than was assumed
            before, assumed = assumed, _assumptions(scenario, arguments, tube)
            if assumed == before:  # they do not depend on it
                return assumed, found
    except (InfeasibleError, UnwishedError) as error:
        print(error)
        if isinstance(error, InfeasibleError):
            print(_helps(nearest(assumed, wishes, h, arguments.gains), {**vars(assumed), "h": h}))
        return None


def _craft_of(arguments: argparse.Namespace) -> Scenario:
    """The scenario, with a law that is to be designed: the gains it has need not fit the craft."""
    configured = read_files(arguments.config).get(CONTROLLER, {})
    asked = arguments.controller or configured.get("controller")
    law, other = (asked, quaternion_feedback.COMPONENT.name) if asked in LAWS else (LAW, None)
    craft = argparse.Namespace(**{**vars(arguments), "controller": other})
    parameters = scenario_of(craft).parameters
    mode = parameters[REFERENCE][REFERENCES.selector]
    if law == LAW_AHEAD and mode not in (paper.COMPONENT.name, paper_ahead.COMPONENT.name):
        raise ConfigurationError(
            f"controller = {law} with {REFERENCES.selector} = {mode}, which publishes no turn of "
            f"the reference ahead of time; allowed: controller = {LAW}"
        )
    return Scenario({**parameters, CONTROLLER: {**parameters[CONTROLLER], "controller": law}})


def _assumptions(scenario: Scenario, arguments: argparse.Namespace, tube: float) -> Assumptions:
    """Assumptions from configuration and options, each within the range of its parameter."""
    nodes, chosen = nodes_around(scenario.parameters), dict(arguments.assume)
    assumed = assumptions_from(nodes, scenario.parameters[CONTROLLER], chosen, tube)
    for name, parameter in _ASSUMED.items():
        parameter.checked(getattr(assumed, name))
    return assumed


def _values(assumed: Assumptions, law: Law) -> dict[str, object]:
    chosen = parameters_of(assumed, law)
    values = resolved(tube_parameters.PARAMETERS, chosen, CONTROLLER)
    values[tube_parameters.CERTIFICATE.name] = digest_of(values)
    return dict(values)


def _helps(found: list[dict[str, float]], now: dict[str, float]) -> str:
    if not found:
        return "no single number helps, nor do d, e_S, e_A and e_W together: change several numbers"
    told = (", ".join(_written(*each, now[each[0]]) for each in values.items()) for values in found)
    return "\n  ".join(["feasible, each line alone, with all other numbers as they are:", *told])


def _written(name: str, value: float, now: float) -> str:
    if name == "h":
        return f"a rate of {1.0 / value:.4g} Hz (now {1.0 / now:.4g})"
    unit = (_ASSUMED.get(name) or _TABLE[name]).unit
    return f"{name} = {value:.4g} {unit}".rstrip() + f" (now {now:.4g})"


def _tell(found: Design, certificate: Certificate, assumed: Assumptions) -> None:
    law = found.law
    print(f"k = {law.k:g} 1/s, kappa = {law.kappa:g} 1/s, ell = {law.ell:g}")
    for line in promise_lines(certificate, assumed):
        print(line)
    if found.torque_noise > 0.0:
        print(f"torque noise of the worst axis: about {found.torque_noise:.3g} N·m RMS")
    least = min(certificate.inequalities, key=lambda each: each.room)
    print(f"{len(certificate.inequalities)} inequalities hold; {least.name} has the least margin")


def _file(
    law: str, values: dict[str, object], certificate: Certificate, assumed: Assumptions
) -> str:
    """Overlay of the law; the comment at its top says what it promises."""
    comment = [
        f"The momentum-tube law with a certificate: {WRITTEN}",
        *promise_lines(certificate, assumed),
        "`ppc_attitude check` proves it again; a changed number voids the certificate.",
    ]
    ahead = {REFERENCE: {REFERENCES.selector: paper_ahead.COMPONENT.name}}
    nodes = ahead if law == LAW_AHEAD else {}
    return overlay(comment, {**nodes, CONTROLLER: {"controller": law, **values}})
