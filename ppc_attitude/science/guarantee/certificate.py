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

"""The certificate: the guarantee for the very numbers that a law runs with, and its reasons.

These are the inequalities C0 to C13 under which the theorem of docs/guarantee.md holds.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ppc_attitude.science.controllers.tube_parameters import digest_of
from ppc_attitude.science.guarantee.arithmetic import Arithmetic, Number, balls
from ppc_attitude.science.guarantee.assumptions import assumptions_of, law_of
from ppc_attitude.science.guarantee.bounds import Bounds
from ppc_attitude.science.guarantee.cells import LARGEST
from ppc_attitude.science.guarantee.envelope import Envelope

RATES = (0.0, 1.0, 2.5, 5.0)  # [deg/s] ‖ω_s‖ at the start, for which times are printed
ACCURACY = 5e-3  # of |q_ev,i|
# κh that leaves every sample's correction without overshoot, without and with a late command.
_STEP, _STEP_LATE = 0.9, 0.4
_Claim = tuple[Any, ...]
"""Name, left and right side, unit, meaning; and True at last if left < right is needed."""


@dataclass(frozen=True)
class Inequality:
    """One inequality: left ≤ right, or left < right where `strict`."""

    name: str  # C0 to C13, with the axis where there is one for each axis
    left: tuple[float, float]  # from below and from above
    right: tuple[float, float]
    unit: str  # of both sides
    holds: bool  # whether it is certain in the arithmetic that evaluated it
    meaning: str  # for the user

    @property
    def room(self) -> float:
        """The margin, as a fraction of the right side; negative if the inequality fails."""
        scale = max(abs(self.right[0]), abs(self.left[1]))
        if math.isinf(scale):
            return -1.0
        return (self.right[0] - self.left[1]) / scale if scale > 1e-300 else 1.0


def inequalities(bounds: Bounds) -> tuple[Inequality, ...]:
    """Evaluate all inequalities, whether they hold or not."""
    claims = (*_tube(bounds), *_rates(bounds), *_phases(bounds))
    return tuple(_judged(bounds.arithmetic, *each) for each in claims)


def _judged(
    arithmetic: Arithmetic,
    name: str,
    left: Number,
    right: Number,
    unit: str,
    meaning: str,
    strict: bool = False,
) -> Inequality:
    left, right = arithmetic.number(left), arithmetic.number(right)
    certain = bool(left < right) if strict else bool(left <= right)
    outward = arithmetic.outward
    return Inequality(name, outward(left), outward(right), unit, certain, meaning)


def _by_axis(name: str, left: Any, right: Any, *rest: Any) -> Iterator[_Claim]:
    for axis, low, high in zip("xyz", left, right, strict=True):
        yield f"{name} {axis}", low, high, *rest


def _tube(bounds: Bounds) -> Iterator[_Claim]:
    law, body = bounds.law, bounds.body
    least = 0.0 if body.proved else math.inf
    yield "C0", least, body.least, "kg·m²", "the moments of inertia are certain", True
    meaning = "no disturbance within its bound leads out of the tube"
    yield from _by_axis("C1", bounds.Y, law.Y, "N·m·s", meaning)
    meaning = "a saturated axis still drives its momentum error back"
    yield from _by_axis("C2", law.B, bounds.B, "N·m", meaning)
    late = 1 + bounds.assumed.late
    more = [law.B_ramp - each for each in law.B]
    drift = [
        0.0 if each <= 0 else n + law.h * late * each for each, n in zip(more, law.N, strict=True)
    ]
    meaning = "with a ramp's torque beyond B, y moves by less than half the tube in a sample"
    yield from _by_axis("C2 ramp", drift, [y / 2 for y in law.Y], "N·m·s", meaning)
    meaning = "feedforward, reference and brake never lack torque"
    yield from _by_axis("C3", bounds.load, law.B, "N·m", meaning)
    meaning = "N bounds the error of y that estimation errors cause"
    yield from _by_axis("C1 N", bounds.noise, law.N, "N·m·s", meaning)
    meaning = "z̄ is the largest rate error in the tube"
    yield "C1 ‖z‖", bounds.z, law.z_bar, "rad/s", meaning


def _rates(bounds: Bounds) -> Iterator[_Claim]:
    assumed, law = bounds.assumed, bounds.law
    meaning = "‖ω_s‖ stays below the rate limit after the stop phase"
    fastest = law.Omega_e + law.z_bar + bounds.e_w + law.h * bounds.V_rate
    yield "C4", fastest, assumed.Omega, "rad/s", meaning
    meaning = "Φ allows for the largest decrease of V"
    yield "C4 V'", bounds.V_rate, law.V_rate, "rad/s²", meaning
    meaning = "Φ allows for the largest decrease of a when the brake's axis turns"
    yield "C4 a'", bounds.a_rate, law.a_rate, "rad/s³", meaning
    limit = _STEP_LATE if assumed.late > 0.0 else _STEP
    meaning = "κh: one sample's correction does not overshoot"
    yield "C5", law.kappa * law.h, limit, "", meaning
    if assumed.late > 0.0:
        meaning = "ℓ = 1: the momentum observer is not proved with late commands"
        yield "C5 ℓ", 1.0, law.ell, "", meaning
    meaning = "the tube lies within the linear part of the brake"
    yield "C6", law.z_bar, bounds.a / law.k, "rad/s", meaning
    meaning = "the reference leaves speed to turn with"
    yield "C7", 0.0, law.Omega_e - assumed.W, "rad/s", meaning, True
    meaning = "the disturbance estimate alone does not lead out of the tube"
    yield "C8", law.d_max, law.kappa * min(law.Y), "N·m", meaning
    meaning = "the estimate may be as large as the disturbance"
    yield "C8 d", assumed.d, law.d_max, "N·m", meaning


def _phases(bounds: Bounds) -> Iterator[_Claim]:
    assumed, law, pi = bounds.assumed, bounds.law, bounds.arithmetic.pi
    a, h, k, z = bounds.a_most, law.h, law.k, law.z_bar
    slowest = law.Omega_e - assumed.W
    w_far, omega0 = law.w_far + bounds.e_w, law.omega0 + bounds.e_w

    start = bounds.cruise_start()
    meaning = "a cruise reaches its speed before it has to brake"
    yield "C9", math.inf if start is None else start, law.far, "rad", meaning
    yield "C9 w", w_far, slowest, "rad/s", "a cruise begins below its least speed"

    time = bounds.stop_time(law.w_far)
    turned = math.inf if time is None else bounds.nu_stop * w_far * (time + h)
    meaning = "the axis turns so little in the stop phase that rates do not add up"
    yield "C9 n", turned, 1.0, "rad", meaning

    meaning = "torque is left to stop from every rate up to omega0"
    needed = bounds.feedforward(omega0 + assumed.W + z)
    yield from _by_axis("C10", needed, law.B, "N·m", meaning, True)
    meaning = "F varies no more within a sample of the stop phase than later"
    yield from _by_axis("C11", bounds.variation_at_stop, bounds.variation, "N·m", meaning)
    stop = bounds.stop_time(law.omega0)
    overshoot = math.inf
    if stop is not None and bounds.reserve > 0:
        overshoot = pi + assumed.lead + assumed.e_A
        overshoot = overshoot + omega0 * (stop + h) / 2 + z * (stop + 2 * h + z / bounds.reserve)
    meaning = "the largest turn and the stop stay in the range of cells"
    yield "C12", overshoot, pi + LARGEST, "rad", meaning
    meaning = "the cap of the speed does not act where the brake is linear"
    yield "C13", a / k, 0.75 * slowest - 2 * h * law.V_rate, "rad/s", meaning
    meaning = "the linear part of the brake ends below 1 rad"
    yield "C13 φ1", a / (k * k), 1.0, "rad", meaning


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
