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

"""The certificate: the guarantee for the very numbers that a law runs with, and its reasons."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ppc_attitude.science.controllers.tube_parameters import digest_of
from ppc_attitude.science.guarantee.arithmetic import Arithmetic, balls
from ppc_attitude.science.guarantee.assumptions import assumptions_of, law_of
from ppc_attitude.science.guarantee.bounds import Bounds
from ppc_attitude.science.guarantee.envelope import Envelope
from ppc_attitude.science.guarantee.inequalities import Inequality, inequalities

RATES = (0.0, 1.0, 2.5, 5.0)  # [deg/s] ‖ω_s‖ at the start, for which times are printed
ACCURACY = 5e-3  # of |q_ev,i|


@dataclass(frozen=True)
class Promise:
    """One guaranteed settling time."""

    rate: float  # [deg/s] largest ‖ω_s‖ at the start for which it holds
    time: float  # [s] from which |q_ev,i| stays below the accuracy, for every initial attitude


@dataclass(frozen=True)
class Certificate:
    """Every inequality of the theorem, proved or not, and what follows."""

    digest: str  # `digest_of` the certified parameters
    accuracy: float  # settled means |q_ev,i| below this
    inequalities: tuple[Inequality, ...]  # C0 to C13
    promises: tuple[Promise, ...]  # empty if an inequality fails
    terminal_error: float  # final bound of |q_ev,i|, for any disturbance within its bound

    @property
    def holds(self) -> bool:
        """True if every inequality is proved."""
        return all(each.holds for each in self.inequalities)


def certify(
    values: Mapping[str, Any],
    accuracy: float = ACCURACY,
    rates: Sequence[float] = RATES,
    arithmetic: Arithmetic | None = None,
) -> Certificate:
    """Prove the inequalities for the controller's parameters, with outward rounding.

    Parameters
    ----------
    values : mapping
        Checked parameters of the controller.
    accuracy : float
        Settled means |q_ev,i| below this.
    rates : sequence of float
        Rates ‖ω_s‖ at the start [deg/s]; those beyond the law's omega0 are left out.
    arithmetic : Arithmetic, optional
        Balls by default.

    Raises
    ------
    ValueError
        python-flint is missing, or nothing can be evaluated; the message says which.
    """
    arithmetic = balls() if arithmetic is None else arithmetic
    assumed, law = assumptions_of(values), law_of(values)
    bounds = Bounds(assumed, law, arithmetic)
    judged = inequalities(bounds)
    envelope = Envelope(bounds)
    promises = []
    if all(each.holds for each in judged):
        for rate in rates:
            start = math.nextafter(assumed.W + math.radians(rate) * (1 + 1e-15), math.inf)
            if envelope.told(start) <= arithmetic.number(law.omega0):
                promises.append(Promise(rate, envelope.settling(start, accuracy)))
    return Certificate(digest_of(values), accuracy, judged, tuple(promises), envelope.terminal())


def differences(stored: Mapping[str, Any], certificate: Certificate) -> list[str]:
    """Tell which statements of a stored certificate are false, by the one that is proved anew."""
    if stored.get("digest") != certificate.digest:
        return ["it was issued for other numbers"]
    found = []
    if failing := [each.name for each in certificate.inequalities if not each.holds]:
        found.append(f"these inequalities do not hold: {', '.join(failing)}")
    for promise in stored.get("promises", ()):
        now = {each.rate: each.time for each in certificate.promises}.get(promise["rate"])
        if now is None or now > promise["time"] * (1 + 1e-12):
            found.append(
                f"it promises {promise['time']:.2f} s from {promise['rate']:g} deg/s, "
                + ("nothing can be promised" if now is None else f"{now:.2f} s can be promised")
            )
    least = certificate.terminal_error
    if stored["terminal_error"] < least * (1 - 1e-12):
        found.append(
            f"it promises {stored['terminal_error']:.3g} in the end, {least:.3g} can be promised"
        )
    told = {each["name"]: (*each["left"], *each["right"]) for each in stored["inequalities"]}
    proved = {each.name: (*each.left, *each.right) for each in certificate.inequalities}
    changed = [x for x in {**told, **proved} if not _alike(told.get(x, ()), proved.get(x, ()))]
    if changed:
        earlier = "; one of an earlier version needs a new `ppc_attitude design`"
        renamed = earlier if told.keys() != proved.keys() else ""
        named = ", ".join(changed)
        found.append(f"it has other numbers than those that are proved: {named}{renamed}")
    return found


def _alike(told: Sequence[float], proved: Sequence[float]) -> bool:
    """Tell whether an inequality's numbers are those of another, but for a library's rounding."""
    same = len(told) == len(proved)
    return same and bool(np.allclose(told, proved, rtol=1e-9, atol=1e-300))
