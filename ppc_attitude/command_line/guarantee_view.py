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

"""How a certificate is told: its file beside the configuration, its promises, its inequalities."""

import math
from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from ppc_attitude.analysis.guarantee import nodes_around
from ppc_attitude.command_line.options import paragraph
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import CONTROLLER, PLANT, REFERENCE
from ppc_attitude.contract.yaml_file import LARGEST, parsed_json
from ppc_attitude.science.controllers.tube_parameters import CERTIFICATE, LAW_AHEAD, digest_of
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guarantee.arithmetic import balls
from ppc_attitude.science.guarantee.assumptions import Assumptions, assumptions_of, law_of
from ppc_attitude.science.guarantee.bounds import Bounds
from ppc_attitude.science.guarantee.certificate import (
    ACCURACY,
    RATES,
    Certificate,
    Inequality,
    certify,
    differences,
)
from ppc_attitude.science.guarantee.envelope import Envelope
from ppc_attitude.science.guarantee.known_reference import KnownReference
from ppc_attitude.science.guarantee.surroundings import (
    broken_assumptions,
    broken_by_reference,
    longer_ramps,
    suspensions,
)
from ppc_attitude.science.references import paper, paper_ahead
from ppc_attitude.science.sensors.star_tracker import INITIAL_FIX
from ppc_attitude.science.stamps import first_step, nanoseconds
from ppc_attitude.simulation.scenario import Scenario

_PROMISED = ("rate", "time")
_ROUNDING = 1e-12  # relative, of numbers that were computed with plain floats
_SIDES = ("left", "right")


def certificate_path(configuration: Path) -> Path:
    """Where the certificate of a parameter file lies."""
    return configuration.with_suffix(".certificate.json")


def stored_certificate(configurations: Sequence[Path]) -> dict[str, Any] | None:
    """Read what the certificate beside the last parameter file that has one says.

    Raises
    ------
    ConfigurationError
        It is no certificate; names the file.
    """
    for path in map(certificate_path, reversed(configurations)):
        if path.is_file():
            try:
                with path.open(encoding="utf-8") as file:
                    return _stated(parsed_json(file.read(LARGEST + 1)))
            except (ValueError, LookupError, TypeError, OverflowError) as error:
                raise ConfigurationError(f"{path} is no certificate: {error!r}") from None
    return None


def _stated(content: Any) -> dict[str, Any]:
    """Return what `differences` reads of a certificate, its numbers checked."""
    accuracy, terminal = float(content["accuracy"]), float(content["terminal_error"])
    promises = [{name: float(each[name]) for name in _PROMISED} for each in content["promises"]]
    inequalities = [
        {"name": str(each["name"]), **{side: [*map(float, each[side])] for side in _SIDES}}
        for each in content["inequalities"]
    ]
    numbers = [terminal, *(number for promise in promises for number in promise.values())]
    if not (0.0 < accuracy <= 1.0 and all(0.0 <= number < math.inf for number in numbers)):
        raise ValueError("a number is out of range; allowed: 0 < accuracy ≤ 1, others ≥ 0, finite")
    if not all(len(each[side]) == len(_SIDES) for each in inequalities for side in _SIDES):
        raise ValueError("each side of an inequality needs two numbers, lower and upper bound")
    return {
        "digest": content["digest"],
        "accuracy": accuracy,
        "promises": promises,
        "terminal_error": terminal,
        "inequalities": inequalities,
    }


def time_text(time: float) -> str:
    """Write a time [s] from which on something is guaranteed; rounded up, as it is no earlier."""
    return str(Decimal(time).quantize(Decimal("0.01"), ROUND_CEILING))


def _bound_text(bound: float, rounding: str = ROUND_CEILING) -> str:
    """Write what is never exceeded, with two digits, rounded up."""
    return f"{float(Context(2, rounding).create_decimal_from_float(bound)):g}"


def promise_lines(certificate: Certificate, assumed: Assumptions) -> list[str]:
    """Say what is guaranteed, one line a rate; a craft with wheels has a bound of its momentum."""
    momentum = assumed.momentum
    lines = [
        f"guaranteed: |q_ev,i| < {certificate.accuracy:g} from t = {time_text(promise.time)} s on, "
        f"for every attitude and every start with ‖ω_s‖ ≤ {promise.rate:g} deg/s"
        for promise in certificate.promises
    ]
    if certificate.promises:
        lines.append(f"guaranteed: |q_ev,i| ≤ {_bound_text(certificate.terminal_error)} in the end")
    if certificate.promises and momentum:
        most = float(np.linalg.eigvalsh(np.reshape(assumed.inertia, (3, 3)))[-1])
        lines.append(
            f"while the momentum ‖Jω + h‖ of craft and wheels is at most {momentum:g} N·m·s (the "
            f"craft alone may have more above {math.degrees(momentum / most):.3g} deg/s; "
            "a hit or magnetorquers may add to it) "
            "and no wheel can reach its largest speed within a sample"
        )
    return lines


class Judgement:
    """The statement of the certificate of a scenario with the momentum-tube law, proved anew.

    The configurations are its parameter files; the stored certificate may lie beside one of them.

    Raises
    ------
    ValueError
        python-flint is missing, or the stored certificate cannot be read.
    """

    def __init__(self, scenario: Scenario, configurations: Sequence[Path]) -> None:
        self._scenario = scenario
        values = scenario.parameters[CONTROLLER]
        stored = stored_certificate(configurations)
        accuracy = stored["accuracy"] if stored else ACCURACY
        promised = [each["rate"] for each in stored["promises"]] if stored else []
        self.doubts, arithmetic = list[str](), balls()
        try:
            rates = sorted({*RATES, *promised})
            self.certificate = certify(values, accuracy, rates, arithmetic)
        except ValueError as error:  # the law flies with these numbers; only nothing is promised
            self.certificate = Certificate(digest_of(values), accuracy, (), (), math.inf)
            self.doubts.append(str(error))
        self._assumed, self._law = assumptions_of(values), law_of(values)
        nodes = nodes_around(scenario.parameters)
        duration = scenario.number(PLANT, "duration")
        self.broken = [
            *broken_assumptions(self._assumed, self._law, nodes),
            *broken_by_reference(self._assumed, nodes, duration),
        ]
        self.suspensions = [
            *longer_ramps(self._law, nodes),
            *suspensions(self._assumed, nodes, duration),
        ]
        self.doubts += differences(stored, self.certificate) if stored else []
        digest = values[CERTIFICATE.name]
        if digest and digest != self.certificate.digest:
            self.doubts.append(f"{CERTIFICATE.name} is the digest of other parameter values")

    def of_start(self, turn: float, rate: float) -> list[str]:
        """Say from when on the craft is settled after the scenario's own start.

        That has an error of angle `turn` [rad] and a `rate` ‖ω_e‖ [rad/s]. Nothing is said where
        the certificate does not hold, the law begins later than the craft, or the start is faster
        than any that it is for.
        """
        if not self.holds or not self._scenario.parameters[PLANT].get(INITIAL_FIX.name, True):
            return []
        envelope, accuracy = self._envelope(), self.certificate.accuracy
        try:
            time = envelope.settling((1.0 + _ROUNDING) * rate, accuracy, (1.0 + _ROUNDING) * turn)
        except ValueError:
            return []
        return [
            f"guaranteed: |q_ev,i| < {accuracy:g} from t = {time_text(time)} s on, for this start: "
            f"{math.degrees(turn):.2f}° from the reference, turning at "
            f"{math.degrees(rate):.3g} deg/s relative to it"
        ]

    def _envelope(self) -> Envelope:
        return Envelope(Bounds(self._assumed, self._law, balls()))

    def of_hit(self, torque: float, duration: float) -> str:
        """Say when a craft within its final bound has recovered from a hit.

        Raises
        ------
        ValueError
            Nothing is promised after this hit.
        """
        if not self.holds:
            raise ConfigurationError("--hit: no certificate holds, so no recovery is guaranteed")
        if nodes_around(self._scenario.parameters).estimated:
            raise ConfigurationError(
                "--hit: the gyro gives the mean rate of a step, which a hit makes lag by more than "
                f"e_W = {self._assumed.e_W:.4g} rad/s, so no recovery is guaranteed"
            )
        # It acts from state to state, so for up to the next whole number of samples.
        rate = self._scenario.number(PLANT, "rate")
        acts = max(first_step(nanoseconds(duration), rate) / rate, duration)
        time = self._envelope().recovery(torque, acts, self.certificate.accuracy)
        bound = _bound_text(math.sin(self.certificate.terminal_error), ROUND_FLOOR)
        return (
            f"guaranteed: |q_ev,i| < {self.certificate.accuracy:g} again {time_text(time)} s after "
            f"the start of a hit whose largest component is {torque:g} N·m, for {duration:g} s, of "
            f"a craft that follows its brake (phase 3) within its final bound, ‖q_ev‖ ≤ {bound}"
        )

    def of_reference(self, rates: Sequence[float]) -> list[str]:
        """Say what is guaranteed for the scenario's own reference, from t = 0.

        Raises
        ------
        ConfigurationError
            No certificate holds, or the reference is not the paper's, or begins before the law.
        """
        if not self.holds:
            why = "no certificate holds, so no time is guaranteed"
            raise ConfigurationError(f"--known-reference: {why}")
        reference = self._scenario.parameters[REFERENCE]
        known = {each.name: each for each in (paper.COMPONENT, paper_ahead.COMPONENT)}
        component = known.get(str(reference["mode"]))
        if component is None:
            raise ConfigurationError(
                f"mode = {reference['mode']}; allowed with --known-reference: {', '.join(known)}"
            )
        if not self._scenario.parameters[PLANT].get(INITIAL_FIX.name, True):
            raise ConfigurationError(
                f"{INITIAL_FIX.name} = false; allowed with --known-reference: true, because else "
                "the law begins later than the reference"
            )
        record = component.configure(reference)
        told = self._scenario.controller.name == LAW_AHEAD
        ahead = paper_ahead.turn_ahead(0.0, record) if told else (0.0, 0.0, 0.0)

        def rate_at(times: Array) -> Array:
            return np.array([paper.desired_rate(t, record) for t in times])

        bound = KnownReference(self._assumed, self._law, rate_at, np.array(ahead))
        accuracy = self.certificate.accuracy
        return [
            f"guaranteed for this reference: |q_ev,i| < {accuracy:g} from "
            f"t = {time_text(bound.time(math.radians(rate), accuracy))} s on, for every attitude "
            f"and every ‖ω_s(0)‖ ≤ {rate:g} deg/s"
            for rate in rates
        ]

    @property
    def holds(self) -> bool:
        """True if everything is proved and the scenario keeps the assumptions."""
        return self.certificate.holds and not self.broken and not self.doubts

    def lines(self) -> list[str]:
        """Inequalities, then what is guaranteed or why nothing is; 80 columns."""
        lines: list[str] = []
        for meaning, alike in groupby(self.certificate.inequalities, lambda each: each.meaning):
            lines += [_inequality_line(each) for each in alike]
            lines.append(paragraph(meaning, "    "))
        reasons = [f"the certificate does not apply: {each}" for each in self.doubts]
        reasons += [f"assumption not kept: {each}" for each in self.broken]
        if not self.certificate.holds:
            failing = (each.name for each in self.certificate.inequalities if not each.holds)
            reasons.append(f"not proved: {', '.join(failing)}")
        told = ["nothing is guaranteed:", *(f"  {each}" for each in reasons)]
        if not reasons:
            told = promise_lines(self.certificate, self._assumed)
            told += [f"warning: {each}" for each in self.suspensions]
        return [*lines, "", *map(paragraph, told)]


def _inequality_line(each: Inequality) -> str:
    # Ball arithmetic bounds a zero by the smallest numbers there are.
    left, right = (0.0 if abs(x) < 1e-300 else x for x in (each.left[1], each.right[0]))
    sides = f"{left:.6g} ≤ {right:.6g} {each.unit}".rstrip()
    proved = f"proved, margin {100.0 * each.room:.3g} %" if each.holds else "FAILS"
    return f"{each.name:<8}  {sides:<34}  {proved}"
