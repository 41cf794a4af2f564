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

"""The inequalities C1 to C13 under which the theorem of docs/guarantee.md holds."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from ppc_attitude.science.guarantee.arithmetic import Arithmetic, Number
from ppc_attitude.science.guarantee.bounds import Bounds
from ppc_attitude.science.guarantee.cells import LARGEST

AXES = "xyz"
# κh that leaves every sample's correction without overshoot, without and with a late command.
_STEP, _STEP_LATE = 0.9, 0.4


@dataclass(frozen=True)
class Inequality:
    """One inequality: left ≤ right, or left < right where `strict`.

    Attributes
    ----------
    name : str
        C1 to C13, with the axis where there is one for each.
    left, right : tuple of 2 float
        Both sides, from below and from above.
    unit : str
        Of both.
    holds : bool
        True if it is certain in the arithmetic that evaluated it.
    meaning : str
        What it says.
    """

    name: str
    left: tuple[float, float]
    right: tuple[float, float]
    unit: str
    holds: bool
    meaning: str

    @property
    def room(self) -> float:
        """The margin, as a share of the right side; negative if the inequality fails."""
        scale = max(abs(self.right[0]), abs(self.left[1]))
        if math.isinf(scale):
            return -1.0
        return (self.right[0] - self.left[1]) / scale if scale > 1e-300 else 1.0


def inequalities(bounds: Bounds) -> tuple[Inequality, ...]:
    """Evaluate all of them, those that hold and those that do not."""
    return (*_tube(bounds), *_rates(bounds), *_phases(bounds))


def _told(
    arithmetic: Arithmetic,
    name: str,
    left: Number,
    right: Number,
    unit: str,
    meaning: str,
    strict: bool = False,
) -> Inequality:
    certain = bool(left < right) if strict else bool(left <= right)
    outward = arithmetic.outward
    return Inequality(name, outward(left), outward(right), unit, certain, meaning)


def _tube(bounds: Bounds) -> Iterator[Inequality]:
    number, told = bounds.arithmetic.number, partial(_told, bounds.arithmetic)
    assumed, law, body = bounds.assumed, bounds.law, bounds.body
    least = number(0.0) if body.proved else number(float("inf"))
    yield told("C0", least, body.least, "kg·m²", "the moments of inertia are certain", True)
    for i, axis in enumerate(AXES):
        meaning = "no disturbance within its bound leads out of the tube"
        yield told(f"C1 {axis}", bounds.Y[i], number(law.Y[i]), "N·m·s", meaning)
    for i, axis in enumerate(AXES):
        meaning = "a saturated axis is pushed back all the same"
        yield told(f"C2 {axis}", number(law.B[i]), bounds.B[i], "N·m", meaning)
    late = number(1.0) + number(assumed.late)
    for i, axis in enumerate(AXES):
        more = number(law.B_ramp) - number(law.B[i])
        drift = number(0.0) if more <= 0 else number(law.N[i]) + number(law.h) * late * more
        meaning = "what a ramp may use beyond B leads out of half the tube in no sample"
        yield told(f"C2 ramp {axis}", drift, number(law.Y[i]) / 2, "N·m·s", meaning)
    for i, axis in enumerate(AXES):
        meaning = "feedforward, reference and brake never lack torque"
        yield told(f"C3 {axis}", bounds.load[i], number(law.B[i]), "N·m", meaning)
    for i, axis in enumerate(AXES):
        meaning = "the law knows what estimation errors make of y"
        yield told(f"C1 N {axis}", bounds.noise[i], number(law.N[i]), "N·m·s", meaning)
    meaning = "z̄ is the largest rate error in the tube"
    yield told("C1 z", bounds.z, number(law.z_bar), "rad/s", meaning)


def _rates(bounds: Bounds) -> Iterator[Inequality]:
    number, told = bounds.arithmetic.number, partial(_told, bounds.arithmetic)
    assumed, law, zero = bounds.assumed, bounds.law, number(0.0)
    Omega_e, z, k = number(law.Omega_e), number(law.z_bar), number(law.k)
    W, h = number(assumed.W), number(law.h)
    slowest = Omega_e - W
    meaning = "‖ω_s‖ stays below the rate limit after the stop phase"
    total = Omega_e + z + bounds.e_w + h * bounds.V_rate
    yield told("C4", total, number(assumed.Omega), "rad/s", meaning)
    meaning = "Φ allows for what V may lose"
    yield told("C4 V'", bounds.V_rate, number(law.V_rate), "rad/s²", meaning)
    meaning = "Φ allows for what the brake may lose when its axis turns"
    yield told("C4 a'", bounds.a_rate, number(law.a_rate), "rad/s³", meaning)
    limit = number(_STEP_LATE if assumed.late > 0.0 else _STEP)
    meaning = "κh: one sample's correction does not overshoot"
    yield told("C5", number(law.kappa) * h, limit, "", meaning)
    meaning = "the tube lies within the linear part of the brake"
    yield told("C6", z, bounds.a / k, "rad/s", meaning)
    yield told("C7", zero, slowest, "rad/s", "the reference leaves speed to turn with", True)
    least = bounds.arithmetic.least(*map(number, law.Y))
    meaning = "the disturbance estimate alone does not lead out of the tube"
    yield told("C8", number(law.d_max), number(law.kappa) * least, "N·m", meaning)
    meaning = "the estimate may be as large as the disturbance"
    yield told("C8 d", number(assumed.d), number(law.d_max), "N·m", meaning)


def _phases(bounds: Bounds) -> Iterator[Inequality]:
    number, told = bounds.arithmetic.number, partial(_told, bounds.arithmetic)
    assumed, law, pi = bounds.assumed, bounds.law, bounds.arithmetic.pi
    z, k, W = number(law.z_bar), number(law.k), number(assumed.W)
    a, h = bounds.a_most, number(law.h)
    slowest = number(law.Omega_e) - W
    reserve, never = bounds.reserve, number(float("inf"))
    w_far, omega0 = number(law.w_far) + bounds.e_w, number(law.omega0) + bounds.e_w

    start = bounds.cruise_start()
    meaning = "a cruise reaches its speed before it has to brake"
    yield told("C9", never if start is None else start, number(law.far), "rad", meaning)
    yield told("C9 w", w_far, slowest, "rad/s", "a cruise begins below its least speed")

    time = bounds.stop_time(number(law.w_far))
    turned = never if time is None else bounds.nu_stop * w_far * (time + h)
    meaning = "the axis turns too little in the stop phase to add up the rates"
    yield told("C9 n", turned, number(1.0), "rad", meaning)

    fast = omega0 + W + z
    feedforward = bounds.feedforward(fast)
    for i, axis in enumerate(AXES):
        meaning = "torque is left to stop from every rate up to omega0"
        yield told(f"C10 {axis}", feedforward[i], number(law.B[i]), "N·m", meaning, True)
    stop = bounds.stop_time(number(law.omega0))
    for i, axis in enumerate(AXES):
        meaning = "F varies no more within a sample of the stop phase than later"
        at_stop, later = bounds.variation_at_stop[i], bounds.variation[i]
        yield told(f"C11 {axis}", at_stop, later, "N·m", meaning)
    overshoot = never
    if stop is not None and reserve > 0:
        overshoot = pi + number(assumed.lead) + number(assumed.e_A)
        overshoot = overshoot + omega0 * (stop + h) / 2 + z * (stop + 2 * h + z / reserve)
    meaning = "the largest turn and the stop stay in the range of cells"
    yield told("C12", overshoot, pi + LARGEST, "rad", meaning)
    meaning = "the cap of the speed does not act where the brake is linear"
    limit = number(0.75) * slowest - 2 * h * number(law.V_rate)
    yield told("C13", a / k, limit, "rad/s", meaning)
    meaning = "the linear part of the brake ends below 1 rad"
    yield told("C13 φ1", a / (k * k), number(1.0), "rad", meaning)
