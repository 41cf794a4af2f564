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

"""Search for the numbers of the law: the least guaranteed settling time under the wishes.

Everything but k, κ and ℓ follows from the inequalities (`fixed_point`).
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

from ppc_attitude.science.guarantee.arithmetic import FLOATS
from ppc_attitude.science.guarantee.assumptions import Assumptions, Law
from ppc_attitude.science.guarantee.bounds import Bounds
from ppc_attitude.science.guarantee.cells import COARSE, FINE, Cells
from ppc_attitude.science.guarantee.certificate import Inequality
from ppc_attitude.science.guarantee.envelope import Envelope
from ppc_attitude.science.guarantee.fixed_point import TUMBLING, Gains, InfeasibleError, tuned

# κh, k/κ and ℓ of the search; and of the short one that looks for the nearest feasible number.
_KAPPA_H = (0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5, 0.8)
_K_SHARE = (0.02, 0.04, 0.067, 0.1)
_ELL = (0.05, 0.1, 0.2, 0.4, 1.0)
_SHORT = ((0.02, 0.07, 0.2, 0.4), (0.02, 0.05), (0.2, 1.0))
_FAR = (1.5, 3.0, 10.0, 100.0, 1000.0)  # by which one number may be changed to be feasible
# Numbers of which more or less helps, those of one group scaled alike; at last all of `_TOGETHER`.
_MORE_HELPS = (("max_torque",), ("Omega",))
_LESS_HELPS = (("d",), ("W", "W1", "W2"), ("e_S",), ("e_A", "e_W"), ("dead_band",), ("h",))
_TOGETHER = ("d", "e_S", "e_A", "e_W")
_FACTORS = ((1.4, 0.7), (1.15, 0.87))  # by which a search changes one gain, then by less
_ALMOST = 1.3  # times the final error: what is reached in a time that can be told
_WISHES = ("an accuracy", "a rate at the start", "a settling time", "a torque noise")  # as judged
_WORTHWHILE = 0.05  # [s] of settling time for which the search goes on


@dataclass(frozen=True)
class Wishes:
    """The user's wishes."""

    accuracy: float = 5e-3  # settled means |q_ev,i| below this; the tube must allow it for ever
    rate: float = math.radians(1.0)  # [rad/s] ‖ω_s‖ at the start for which the time is minimised
    time: float = math.inf  # [s] longest settling time
    torque_noise: float = math.inf  # [N·m] largest RMS on an axis from measurement noise
    attitude_noise: float = 0.0  # [rad] standard deviation of the measurement, per axis
    rate_noise: float = 0.0  # [rad/s] of the rate


@dataclass(frozen=True)
class Design:
    """A law and its guarantee, not yet proved."""

    law: Law
    settling: float  # [s] guaranteed settling time for the wished rate
    torque_noise: float  # [N·m] RMS on the worst axis from the measurement noise


class UnwishedError(ValueError):
    """Every inequality can be satisfied, but not a wish; the message says what comes nearest."""

    def __init__(self, wish: str, wanted: float, reached: float, unit: str) -> None:
        told = reached * (1.001 if reached > wanted else 0.999)  # so the printed digits suffice
        super().__init__(
            f"{wish} of {wanted:g} {unit}".rstrip()
            + f" cannot be guaranteed; the nearest that was found is {told:.4g} {unit}".rstrip()
        )
        # A law that fails a later wish is nearer; if both fail the same one, the less far off.
        self.distance = -_WISHES.index(wish), max(reached / wanted, wanted / reached)


def torque_noise(assumed: Assumptions, law: Law, wishes: Wishes) -> float:
    """RMS torque [N·m] of the worst axis: R κ √(ℓ/(2−ℓ)) √(σ_ω² + k² σ_a²)."""
    rows = (math.hypot(*assumed.inertia[3 * i : 3 * i + 3]) for i in range(3))
    noise = math.hypot(wishes.rate_noise, law.k * wishes.attitude_noise)
    return max(rows) * law.kappa * math.sqrt(law.ell / (2.0 - law.ell)) * noise


def design(assumed: Assumptions, wishes: Wishes, h: float) -> Design:
    """Find the law with the least guaranteed settling time.

    A coarse grid of gains decides whether anything is feasible; from its best law the gains are
    changed one by one for as long as that helps. The whole grid is tried for wishes alone.

    Raises
    ------
    InfeasibleError
        No gains satisfy every inequality; the message names the one that the best gains fail.
    UnwishedError
        The inequalities can be satisfied, but not a wish; the message says what comes nearest.
    """
    search = _Search(assumed, wishes, h)
    search.tries(_grid(assumed, h, short=True))
    if search.unwished and not search.found:
        search.tries(_grid(assumed, h))
    search.climbs()
    for best in sorted(search.found, key=lambda each: each.settling):
        law = best.law
        try:
            return designed(assumed, wishes, h, (law.k, law.kappa, law.ell))
        except UnwishedError as error:
            search.unwished.append(error)
        except InfeasibleError as error:
            search.failing.append(error.failing)
    if search.unwished:
        raise min(search.unwished, key=lambda each: each.distance)
    raise InfeasibleError(max(search.failing, key=lambda each: each.room))


class _Search:
    """Laws on coarse cells that a search has found, and what stood in the way of the others."""

    def __init__(self, assumed: Assumptions, wishes: Wishes, h: float) -> None:
        self._assumed, self._wishes, self._h = assumed, wishes, h
        self._tried: set[Gains] = set()
        self.found: list[Design] = []
        self.unwished: list[UnwishedError] = []
        self.failing: list[Inequality] = []

    def tries(self, gains: Iterable[Gains]) -> None:
        """Try each k, κ and ℓ that was not tried before."""
        for each in gains:
            if each in self._tried:
                continue
            self._tried.add(each)
            try:
                self.found.append(designed(self._assumed, self._wishes, self._h, each, COARSE))
            except InfeasibleError as error:
                self.failing.append(error.failing)
            except UnwishedError as error:
                self.unwished.append(error)

    def climbs(self) -> None:
        """Change the gains of the best law one by one, for as long as that is worthwhile."""
        for factors in _FACTORS:
            before = math.inf
            while (best := self._best()) and best.settling < before - _WORTHWHILE:
                before, law = best.settling, best.law
                self.tries(
                    (float(f"{k:.3g}"), float(f"{kappa:.4g}"), float(f"{ell:.3g}"))
                    for factor in factors
                    for k, kappa, ell in (
                        (law.k * factor, law.kappa, law.ell),
                        (law.k, law.kappa * factor, law.ell),
                        (law.k, law.kappa, law.ell * factor),
                    )
                    if ell <= 1.0 and kappa * self._h <= 0.9
                )

    def _best(self) -> Design | None:
        return min(self.found, key=lambda each: each.settling, default=None)


def designed(
    assumed: Assumptions, wishes: Wishes, h: float, gains: Gains, count: Cells | None = None
) -> Design:
    """Design with given gains, judged on so many cells, by default on fine ones.

    Raises
    ------
    InfeasibleError
        An inequality fails; the message names it.
    UnwishedError
        The inequalities hold, but not a wish.
    """
    count = count or FINE
    law = tuned(assumed, h, gains, count)
    bounds = Bounds(assumed, law, FLOATS, count)
    envelope = Envelope(bounds)
    terminal, fastest = _ALMOST * envelope.terminal(), law.omega0 - assumed.W - bounds.e_w
    if terminal >= wishes.accuracy:
        raise UnwishedError("an accuracy", wishes.accuracy, terminal, "")
    if wishes.rate > fastest:
        degrees = math.degrees(wishes.rate), math.degrees(fastest)
        raise UnwishedError("a rate at the start", *degrees, "deg/s")
    settling = envelope.settling(assumed.W + wishes.rate, wishes.accuracy)
    if settling > wishes.time:
        raise UnwishedError("a settling time", wishes.time, settling, "s")
    noise = torque_noise(assumed, law, wishes)
    if noise > wishes.torque_noise:
        raise UnwishedError("a torque noise", wishes.torque_noise, noise, "N·m")
    return Design(law, settling, noise)


def nearest(
    assumed: Assumptions, wishes: Wishes, h: float, gains: Gains | None = None
) -> list[dict[str, float]]:
    """Nearest values with which a design gives what is wished, by bisection.

    Returns
    -------
    list of dict of str to float
        Each one suffices alone, within a factor of 1000, with all other numbers and given gains
        unchanged: a single number, W with W1 and W2, or e_A with e_W. If none does, the disturbance
        and all errors are changed by a common factor.
    """
    found: list[dict[str, float]] = []
    for names in (*_MORE_HELPS, *_LESS_HELPS, _TOGETHER):
        if found and names == _TOGETHER:
            break
        told = {name: h if name == "h" else getattr(assumed, name) for name in names}
        given = {name: value for name, value in told.items() if value}
        factor = _nearest_factor(assumed, wishes, h, gains, given) if given else None
        if factor is not None:
            found.append({name: factor * value for name, value in given.items()})
    return found


def _nearest_factor(
    assumed: Assumptions, wishes: Wishes, h: float, gains: Gains | None, given: dict[str, float]
) -> float | None:
    """Nearest factor of given numbers with which a design succeeds; None if no factor helps."""
    first = 0  # index of the gains with which the last feasible factor was found

    def helps(logarithm: float) -> bool:
        nonlocal first
        changed: dict[str, Any] = {x: math.exp(logarithm) * value for x, value in given.items()}
        step = changed.pop("h", h)
        scaled = replace(assumed, **changed)
        tried = [gains] if gains else [*_grid(scaled, step, short=True)]
        for i in sorted(range(len(tried)), key=lambda i: i != first):
            if _succeeds(scaled, wishes, step, tried[i]):
                first = i
                return True
        return False

    # Not only a factor too near to 1 fails: one far too large or too small may fail as well.
    low, high = 0.0, 0.0  # infeasible, feasible: logarithms of a factor
    for most in _FAR:
        low, high = high, math.log(most if (*given,) in _MORE_HELPS else 1.0 / most)
        if helps(high):
            break
    else:
        return None
    while abs(high - low) > 0.05:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if helps(middle) else (middle, high)
    return math.exp(high)


def _succeeds(assumed: Assumptions, wishes: Wishes, h: float, gains: Gains) -> bool:
    """Tell whether gains satisfy every inequality, and the wishes."""
    try:
        tuned(assumed, h, gains, COARSE, TUMBLING[-1:])  # the last demands least
        designed(assumed, wishes, h, gains, COARSE)
    except (InfeasibleError, UnwishedError):
        return False
    return True


def _grid(assumed: Assumptions, h: float, *, short: bool = False) -> Iterator[Gains]:
    """k, κ and ℓ to try."""
    steps, shares, ells = _SHORT if short else (_KAPPA_H, _K_SHARE, _ELL)
    late = assumed.late > 0.0
    for step, share, ell in product(steps, shares, ells):
        if step <= (0.4 if late else 0.9) and (ell == 1.0 or not late):
            kappa = float(f"{step / h:.4g}")
            yield float(f"{share * kappa:.3g}"), kappa, ell
