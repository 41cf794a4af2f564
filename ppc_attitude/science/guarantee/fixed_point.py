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

"""The law that follows from k, κ and ℓ: a fixed point of the inequalities.

The tube makes z̄, z̄ the speed, the speed the load, the load the brake, and the variation of F the
tube.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NoReturn

from ppc_attitude.science.guarantee.arithmetic import FLOATS
from ppc_attitude.science.guarantee.assumptions import Assumptions, Law, Triple
from ppc_attitude.science.guarantee.bounds import Bounds
from ppc_attitude.science.guarantee.cells import COARSE, Cells
from ppc_attitude.science.guarantee.certificate import Inequality, inequalities

Gains = tuple[float, float, float]  # k [1/s], κ [1/s], ℓ
_ROOM = 1e-4  # relative, so that every inequality holds with room for rounding
_ROUNDS, _FINE_ROUNDS = 40, 15
_STEADY = 2e-5  # relative change of the tube at which the iteration ends
TUMBLING = (2.0, 1.5, 1.2, 1.0, 0.8, 0.6)  # omega0 / Ω, the largest that fits
_LONGEST_BRAKE = 0.95  # of the limits that C13 sets
_STRONGEST = 1.4  # largest deceleration of the brake over the least


class InfeasibleError(ValueError):
    """No numbers satisfy the inequality `failing`."""

    def __init__(self, failing: Inequality) -> None:
        super().__init__(
            f"nothing can be guaranteed: {failing.name} fails ({failing.meaning}): "
            f"{failing.left[1]:.4g} must not exceed {failing.right[0]:.4g} {failing.unit}".rstrip()
        )
        self.failing = failing


def tuned(
    assumed: Assumptions, h: float, gains: Gains, count: Cells, tumbling: Iterable[float] = TUMBLING
) -> Law:
    """Return the law that follows from gains, and the first omega0 / Ω that fits.

    Raises
    ------
    InfeasibleError
        An inequality fails.
    """
    failing: list[Inequality] = []
    for share in tumbling:
        omega0 = float(f"{share * assumed.Omega:.6g}")
        try:
            return _iterated(assumed, _first(assumed, h, gains, omega0), count)
        except InfeasibleError as error:
            failing.append(error.failing)
            # A lower omega0 helps the stop phase, and the inertia's error at its rates.
            if assumed.e_S == 0.0 and not error.failing.name.startswith(("C10", "C11", "C12")):
                break
    raise InfeasibleError(max(failing, key=lambda each: each.room))


def _first(assumed: Assumptions, h: float, gains: Gains, omega0: float) -> Law:
    """Begin the iteration with a tube that disturbance and estimate alone need."""
    k, kappa, ell = gains
    d_max = (1.3 if assumed.eta < 1.0 or assumed.e_S > 0.0 else 1.05) * assumed.d
    free = d_max + (assumed.d + assumed.dead_band) / assumed.eta
    tube = free / kappa * (1.0 + kappa * h * (1.0 - ell) / ell)
    B = 0.8 * (assumed.eta * assumed.max_torque - assumed.d)
    if B <= 0.0:
        most = assumed.eta * assumed.max_torque
        _refuse("C2", assumed.d, most, "N·m", "the torque exceeds the disturbance")
    least = min(assumed.inertia[0], assumed.inertia[4], assumed.inertia[8])
    speed = 0.9 * assumed.Omega
    if speed <= assumed.W:
        _refuse("C7", assumed.W, speed, "rad/s", "the reference leaves speed to turn with")
    return Law(
        h=h,
        k=k,
        kappa=kappa,
        ell=ell,
        brake=(0.5 * B, 0.5 * B, 0.5 * B),
        a_most=_brake_limit(0.5 * B / max(assumed.inertia), k, speed - assumed.W),
        a_rate=0.0,
        Omega_e=speed,
        Y=(tube, tube, tube),
        B=(B, B, B),
        B_ramp=0.0,
        z_bar=tube / least,
        V_rate=2.0 * assumed.W1,
        far=0.5,
        w_far=0.5 * (speed - assumed.W),
        omega0=omega0,
        d_max=d_max,
        N=(0.0, 0.0, 0.0),
    )


def _brake_limit(a: float, k: float, slowest: float) -> float:
    """Keep the linear part of the brake below the cap and below 1 rad (C13)."""
    return min(a, _LONGEST_BRAKE * k * 0.75 * slowest, _LONGEST_BRAKE * k * k)


def _refuse(name: str, left: float, right: float, unit: str, meaning: str) -> NoReturn:
    raise InfeasibleError(Inequality(name, (left, left), (right, right), unit, False, meaning))


def _iterated(assumed: Assumptions, law: Law, count: Cells) -> Law:
    stages = ((_ROUNDS, COARSE),) if count == COARSE else ((_ROUNDS, COARSE), (_FINE_ROUNDS, count))
    for rounds, cells in stages:
        bounds = _evaluated(assumed, law, cells)
        for _ in range(rounds):
            before = law
            law = _next(bounds)
            bounds = _evaluated(assumed, law, cells)
            if _steady(law, before):
                break
    law = _roomy(bounds)
    bounds = _evaluated(assumed, law, count)
    failing = _failing(bounds)
    if [each.name for each in failing] == ["C9"]:  # the rounded numbers ask for a larger `far`
        law = replace(law, far=_roomy_far(bounds))
        failing = _failing(_evaluated(assumed, law, count))
    if failing:
        raise InfeasibleError(min(failing, key=lambda each: each.room))
    return law


def _steady(law: Law, before: Law) -> bool:
    pairs = zip(
        (*law.Y, *law.B, *law.brake, law.a_most),
        (*before.Y, *before.B, *before.brake, before.a_most),
        strict=True,
    )
    return all(math.isclose(x, y, rel_tol=_STEADY) for x, y in pairs)


def _evaluated(assumed: Assumptions, law: Law, count: Cells) -> Bounds:
    try:
        return Bounds(assumed, law, FLOATS, count)
    except ValueError as error:
        _refuse("C1", math.inf, 0.0, "N·m·s", str(error))


def _next(bounds: Bounds) -> Law:
    """Take half a step from a law towards what its bounds ask for."""
    assumed, law = bounds.assumed, bounds.law
    Y, B = _halfway(law.Y, bounds.Y), _halfway(law.B, bounds.B)
    if min(B) <= 0.0:
        i = B.index(min(B))
        most = assumed.max_torque * assumed.eta
        meaning = "torque is left beside disturbance, variation and errors"
        _refuse("C2", most - bounds.B[i], most, "N·m", meaning)
    if not math.isfinite(sum(Y)):
        _refuse("C1", math.inf, 0.0, "N·m·s", "the tube is finite")
    z = bounds.body.box(Y)
    speed = assumed.Omega - z - bounds.e_w - 2.0 * law.h * bounds.V_rate
    if not speed > assumed.W or not math.isfinite(bounds.V_rate):
        meaning = "the rate limit leaves speed beside tube and reference"
        need = assumed.W + z + bounds.e_w + 2.0 * law.h * bounds.V_rate
        _refuse("C7", need, assumed.Omega, "rad/s", meaning)
    # An axis of which the largest deceleration needs less has no bound of its own.
    brake = _triple(map(min, _halfway(law.brake, bounds.brake), B))
    if min(brake) <= 0.0:
        i = max(range(3), key=lambda axis: bounds.load[axis] - law.B[axis])
        meaning = "feedforward and tube leave torque to brake with"
        _refuse("C3", bounds.load[i], law.B[i], "N·m", meaning)
    return replace(
        law,
        Y=Y,
        B=B,
        B_ramp=_ramp_torque(assumed, law, Y, B),
        z_bar=z,
        Omega_e=speed,
        brake=brake,
        a_most=_strongest(bounds, brake, law.k, speed - assumed.W),
        a_rate=bounds.a_rate,
        V_rate=bounds.V_rate,
        N=_triple(bounds.noise),
        w_far=0.945 * (speed - assumed.W) - bounds.e_w,
        far=min(max(_far(bounds), 1e-3), 3.0),
    )


def _halfway(a: Iterable[float], b: Iterable[float]) -> Triple:
    return _triple(0.5 * (x + y) for x, y in zip(a, b, strict=True))


def _strongest(bounds: Bounds, brake: Triple, k: float, slowest: float) -> float:
    """Largest deceleration [rad/s²] that the torque of the brake gives about some axis."""
    least = min(torque / row for torque, row in zip(brake, bounds.body.row, strict=True))
    most = min(bounds.body.box(brake), _STRONGEST * least)
    return _brake_limit(float(most), k, slowest)


def _ramp_torque(assumed: Assumptions, law: Law, Y: Triple, B: Triple) -> float:
    """Torque that ramps may use while y is small [N·m]; 0, and so B, if less may come, or late.

    What the actuator does not give of it would be a disturbance, and widen the tube (C1). Nor is
    there more than B where y is not known to half its tube.
    """
    inside = [y / 2.0 - n for y, n in zip(Y, law.N, strict=True)]
    if assumed.eta < 1.0 or assumed.late > 0.0 or min(inside) < 0.0:
        return 0.0
    most = min(b + each / law.h for b, each in zip(B, inside, strict=True))
    return min(assumed.max_torque, _rounded(most * (1 - 10 * _ROOM)))


def _failing(bounds: Bounds) -> list[Inequality]:
    return [each for each in inequalities(bounds) if not each.holds]


def _roomy_far(bounds: Bounds) -> float:
    return _rounded(min(_far(bounds) * (1 + 60 * _ROOM), 3.1))


def _far(bounds: Bounds) -> float:
    """Error that C9 asks for [rad], or more than any if it asks for none."""
    start = bounds.cruise_start()
    return math.pi if start is None else float(start)


def _roomy(bounds: Bounds) -> Law:
    """Round a law so that every inequality keeps room, and that a file can hold the numbers."""
    assumed, law = bounds.assumed, bounds.law
    Y = _triple(_rounded(max(x, y) * (1 + 3 * _ROOM)) for x, y in zip(law.Y, bounds.Y, strict=True))
    z = _rounded(bounds.body.box(Y) * (1 + 1e-6))
    V_rate = _rounded(bounds.V_rate * (1 + 50 * _ROOM))
    B = _triple(_rounded(min(x, y) * (1 - _ROOM)) for x, y in zip(law.B, bounds.B, strict=True))
    return replace(
        law,
        Y=Y,
        B=B,
        z_bar=z,
        V_rate=V_rate,
        Omega_e=_rounded((assumed.Omega - z - bounds.e_w - law.h * V_rate) * (1 - _ROOM / 10)),
        brake=_triple(
            _rounded(min(x, y) * (1 - 10 * _ROOM))
            for x, y in zip(law.brake, bounds.brake, strict=True)
        ),
        a_most=_rounded(law.a_most),
        a_rate=_rounded(bounds.a_rate * (1 + 500 * _ROOM)),
        N=_triple(_rounded(x * (1 + 10 * _ROOM)) for x in bounds.noise),
        w_far=_rounded(law.w_far),
        far=_roomy_far(bounds),
        d_max=_rounded(law.d_max),
    )


def _rounded(value: float) -> float:
    return float(f"{value:.9g}")


def _triple(values: Iterable[float]) -> Triple:
    x, y, z = (float(each) for each in values)
    return x, y, z
