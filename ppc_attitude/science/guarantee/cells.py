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

"""Suprema over what φ, V and a can be: the derivatives of f(φ; V, a) n on cells of that range.

On a cell every factor is bounded at the corner where it is largest: g, f and f_V rise with φ and
with a, g' rises with a and falls with φ, S' falls, ν is convex on [0, 2π]. docs/guarantee.md
derives the sums.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product

import numpy as np

from ppc_attitude.science.controllers.brake import BLEND, ORDER
from ppc_attitude.science.guarantee.arithmetic import Arithmetic, Number

FINE = (160, 4, 4)  # cells of φ, of V and of a
COARSE = (24, 1, 2)
LARGEST = 1.25  # [rad] beyond half a turn: what the cells cover
Cells = tuple[int, int, int]
_Range = tuple[float, float]


@dataclass(frozen=True)
class Speed:
    """The numbers that bound V, a and their derivatives, in one arithmetic."""

    k: Number  # [1/s] slope of the brake
    a: Number  # [rad/s²] its least deceleration
    a_most: Number  # [rad/s²] its largest deceleration
    Omega_e: Number  # [rad/s] largest commanded rate
    W: Number  # [rad/s] bounds of the reference
    W1: Number  # [rad/s²]
    W2: Number  # [rad/s³]
    z: Number  # [rad/s] z̄
    e_A: Number  # [rad] error of the attitude
    e_w: Number  # [rad/s] error of ω_e
    arithmetic: Arithmetic

    @cached_property
    def root(self) -> Number:
        """√(Ω_e² − W²), the least √(b² + Ω_e² − ‖ω_d‖²)."""
        return self.arithmetic.sqrt(self.Omega_e * self.Omega_e - self.W * self.W)

    @cached_property
    def gain(self) -> Number:
        """1 + W/Ω_e, the largest |∂V/∂b|."""
        return 1 + self.W / self.Omega_e

    def b_rate(self, nu: Number) -> Number:
        """Bound of |b'|, b = n·ω_d, where ν is the largest 1/(2 sin(φ/2))."""
        return self.W1 + nu * self.z * self.W

    def rate(self, nu: Number) -> Number:
        """V̄': bound of |V'|."""
        return self.gain * self.b_rate(nu) + self.W * self.W1 / self.root

    def rate_error(self, nu: Number, n_error: Number) -> Number:
        """Bound of the change of V' with the estimation errors, which change n' by `n_error`."""
        b_error = self.W * nu * self.e_A
        return (
            self.gain * (nu * self.e_A * self.W1 + self.W * n_error)
            + self.b_rate(nu) * b_error / self.root
            + self.W * self.W1 * self.W / self.Omega_e * b_error / (self.root * self.root)
        )

    def second_rate(self, nu: Number, n_second: Number) -> Number:
        """V̄'': bound of |V''|, with the bound of ‖n''‖."""
        b_rate = self.b_rate(nu)
        b_second = self.W2 + 2 * nu * self.z * self.W1 + n_second * self.W
        product_rate = self.W1 * self.W1 + self.W * self.W2
        root_rate = self.W / self.Omega_e * b_rate + self.W * self.W1 / self.root
        return (
            self.gain * b_second
            + b_rate * (b_rate + self.W / self.Omega_e * root_rate) / self.root
            + product_rate / self.root
            + self.W * self.W1 * root_rate / (self.root * self.root)
        )

    def brake_rate(self, a: Number, n_rate: Number) -> Number:
        """Bound of |a'| where n turns at n_rate: its gradient, without the part along n."""
        one, ratio = self.arithmetic.number(1.0), self.a / a
        across = self.arithmetic.largest(1 - ratio * ratio, one / ORDER)
        return a * a / self.a * self.arithmetic.sqrt(across) * n_rate

    def brake_second(self, a: Number, n_rate: Number, n_second: Number) -> Number:
        """Bound of |a''|: the Hessian of a p-norm is at most (p − 1)‖x'‖²/‖x‖."""
        curved = (ORDER + 1) * a * a * a * n_rate * n_rate / (self.a * self.a)
        return a * a * n_second / self.a + curved


@dataclass(frozen=True)
class Cell:
    """Largest values on one cell of φ, V and a (or on φ ≤ φ1)."""

    a: Number  # [rad/s²] the least deceleration of the brake
    a_most: Number  # [rad/s²] the largest one
    brake: Number  # f f_φ/a, at most 1: the fraction of the brake that acts
    drift: Number  # [rad/s²] f_φ z̄ + f_V V̄' + f_a ā': what tube and reference add to f'
    turn: Number  # [rad/s²] λ z̄
    speed: Number  # [rad/s] ‖ω_e‖
    second: Number  # [rad/s³] ‖v''‖ without A and ramps
    lever: Number  # [1/s] factor of A = sup ‖ω_e'‖ in ‖v''‖
    ramp: Number  # [rad/s²] ‖(f n)'‖
    lipschitz: Number  # [1/s] change of v with the attitude
    error: Number  # [rad/s²] change of v' with estimation errors

    def needed(self, row: Number, torque: Number, arithmetic: Arithmetic) -> Number:
        """Torque [N·m] on an axis for v' without ramps, where the brake itself has `torque`.

        With (Ĵn)_i = R_i c it is R_i times (α + δ) c + turn √(1 − c²), and a R_i c ≤ T_i.
        """
        along = (self.brake + self.drift / self.a) * self.a_most
        c = torque / (self.a_most * row)
        left = 1 - c * c
        if left > 0 and c * c * self.turn * self.turn <= along * along * left:
            return row * (along * c + self.turn * arithmetic.sqrt(left))
        return row * arithmetic.sqrt(along * along + self.turn * self.turn)


def nu_of(phi: Number, arithmetic: Arithmetic) -> Number:
    """ν = 1/(2 sin(φ/2))."""
    return 1 / (2 * arithmetic.sin(phi / 2))


def half_cotangent(phi: Number, arithmetic: Arithmetic) -> Number:
    """½ |cot(φ/2)|, with which ν changes: ν' = −½ cot(φ/2) ν."""
    return abs(arithmetic.cos(phi / 2) / arithmetic.sin(phi / 2)) / 2


def saturated(x: Number, arithmetic: Arithmetic) -> Number:
    """S(x) for x ≤ 1 + c."""
    below = arithmetic.largest(arithmetic.number(0.0), x - 1 + BLEND)
    return x - below * below / (4 * BLEND)


def axis_second(
    nu: Number, cotangent: Number, across: Number, speed: Number, acceleration: Number
) -> Number:
    """Bound of ‖n''‖ where ‖ω_⊥‖ ≤ across, ‖ω_e‖ ≤ speed and ‖ω_e'‖ ≤ acceleration."""
    return nu * acceleration + nu * _axis_second_rest(nu, cotangent, across, speed)


def _axis_second_rest(nu: Number, cotangent: Number, across: Number, speed: Number) -> Number:
    n_rate = nu * across
    return cotangent * speed * across + speed * across / 2 + 2 * n_rate * across + n_rate * speed


def axis_error(
    nu: Number, cotangent: Number, across: Number, speed: Number, e_A: Number, e_w: Number
) -> Number:
    """Bound of the change of n' with errors of attitude e_A and rate error e_w."""
    inside = cotangent * across + across / 2 + nu * (speed + 2 * across)
    return nu * (e_w + e_A * inside)


def first_cell(speed: Speed) -> Cell:
    """φ ≤ φ1, where v = −kθ with the rotation vector θ: finite at φ = 0, for φ1 ≤ 1."""
    k, a, z, arithmetic = speed.k, speed.a_most, speed.z, speed.arithmetic
    end = a / (k * k)
    gamma = end / 2 / arithmetic.sin(end / 2)
    rate = a / k + z
    most = arithmetic.number(0.51)
    return Cell(
        a=speed.a,
        a_most=a,
        brake=arithmetic.number(1.0),
        drift=k * z,
        turn=k * gamma * z,
        speed=rate,
        second=k * most * rate * rate,
        lever=k * gamma,
        ramp=k * gamma * rate,
        lipschitz=k * gamma,
        error=k * (gamma * speed.e_w + 2 * most * (rate + speed.e_w) * speed.e_A),
    )


def cells(speed: Speed, lowest: float, count: Cells) -> list[Cell]:
    """Cover φ ≤ π + `LARGEST`, V from the lowest [rad/s] to Ω_e + W, and every a of the brake."""
    arithmetic = speed.arithmetic
    _, high = arithmetic.outward(arithmetic.pi + LARGEST)
    _, top = arithmetic.outward(speed.Omega_e + speed.W)
    weak, _ = arithmetic.outward(speed.a)
    _, strong = arithmetic.outward(speed.a_most)
    brakes = [weak, *np.geomspace(weak, strong, count[2] + 1).tolist()[1:-1], strong]
    caps = [lowest, *np.linspace(lowest, top, count[1] + 1).tolist()[1:-1], top]
    found = [first_cell(speed)]
    for brake in pairwise(brakes):
        low, _ = arithmetic.outward(arithmetic.number(brake[0]) / (speed.k * speed.k))
        edges = [low, *np.geomspace(low, high, count[0] + 1).tolist()[1:-1], high]
        for phi, cap in product(pairwise(edges), pairwise(caps)):
            found.append(_cell(speed, phi, cap, brake))
    return found


def _cell(speed: Speed, phi: _Range, cap: _Range, brake: _Range) -> Cell:
    arithmetic, k, z, e_A, e_w = speed.arithmetic, speed.k, speed.z, speed.e_A, speed.e_w
    number, largest, least = arithmetic.number, arithmetic.largest, arithmetic.least
    start, end = number(phi[0]), number(phi[1])
    slow, fast = number(cap[0]), number(cap[1])
    weak, a = number(brake[0]), number(brake[1])
    c, one = number(BLEND), number(1.0)

    nu = largest(nu_of(start, arithmetic), nu_of(end, arithmetic))
    cotangent = largest(half_cotangent(start, arithmetic), half_cotangent(end, arithmetic))
    g_low = arithmetic.sqrt(2 * weak * start - weak * weak / (k * k))
    g_high, g_slope = k * end, k
    if end * k * k > a:  # else even the strongest brake is linear in the whole cell
        g_high = least(g_high, arithmetic.sqrt(2 * a * end - a * a / (k * k)))
    if start * k * k > a:
        g_slope = least(k, a / arithmetic.sqrt(2 * a * start - a * a / (k * k)))
    g_a = (end - weak / (k * k)) / g_low

    x_low = g_low / fast
    x_cap = least(g_high / slow, 1 + c)  # S is constant beyond
    s_slope = least(one, largest(number(0.0), (1 + c - x_low) / (2 * c)))
    f = fast * saturated(least(g_high / fast, 1 + c), arithmetic)
    slope_cap = least(one, largest(number(0.0), (1 + c - x_cap) / (2 * c)))
    f_cap = saturated(x_cap, arithmetic) - x_cap * slope_cap
    f_phi = s_slope * g_slope
    blends = not (g_high / slow <= 1 - c or x_low >= 1 + c)
    curve = 1 / (2 * c * slow) if blends else number(0.0)
    f_phi_phi = s_slope * g_slope * g_slope / g_low + curve * g_slope * g_slope
    f_phi_cap = curve * x_cap * g_slope
    f_cap_cap = curve * x_cap * x_cap
    f_a = s_slope * g_a
    f_a_a = s_slope * (1 / (k * k) + g_a * g_a) / g_low + curve * g_a * g_a
    f_phi_a = s_slope * a * end / (g_low * g_low * g_low) + curve * g_slope * g_a
    f_a_cap = curve * x_cap * g_a

    lam = f * nu
    rate = f + z
    n_rate = nu * z
    capped = not g_high / slow <= 1 - c
    cap_rate = speed.rate(nu) if capped else number(0.0)
    n_second = nu * _axis_second_rest(nu, cotangent, z, rate)  # `lever` has what A adds
    cap_second = speed.second_rate(nu, n_second) if capped else number(0.0)
    a_rate = speed.brake_rate(a, n_rate)
    a_second = speed.brake_second(a, n_rate, n_second)
    f_rate = f_phi * rate + f_cap * cap_rate + f_a * a_rate
    second = (
        f_phi_phi * rate * rate
        + 2 * (f_phi_a * rate + f_a_cap * cap_rate) * a_rate
        + f_a_a * a_rate * a_rate
        + f_a * a_second
        + 2 * f_phi_cap * rate * cap_rate
        + f_cap_cap * cap_rate * cap_rate
        + f_phi * n_rate * z
        + f_cap * cap_second
        + 2 * f_rate * n_rate
        + f * n_second
    )
    # How f changes with n, through V and through a.
    by_cap, by_a = f_cap * speed.gain * speed.W * nu, f_a * speed.brake_rate(a, nu)
    e_cap = speed.gain * speed.W * nu * e_A
    e_a = speed.brake_rate(a, nu * e_A)
    n_error = axis_error(nu, cotangent, z, rate + e_w, e_A, e_w)
    e_a_rate = speed.brake_rate(a, n_error)
    e_a_rate = e_a_rate + (ORDER + 1) * a * e_a * n_rate / speed.a
    return Cell(
        a=weak,
        a_most=a,
        brake=least(one, f * s_slope / g_low),
        drift=f_phi * z + f_cap * cap_rate + f_a * a_rate,
        turn=lam * z,
        speed=rate,
        second=second,
        lever=_largest_gain(f_phi, by_a, lam, arithmetic) + by_cap,
        ramp=arithmetic.sqrt(f_rate * f_rate + lam * z * lam * z),
        lipschitz=largest(f_phi, lam) + by_cap + by_a,
        error=f_phi * e_w
        + e_A * (f_phi_phi * rate + nu * f_phi * (rate + 2 * z))
        + f * n_error
        + e_a * (f_phi_a * rate + f_a * n_rate + f_a_a * a_rate + f_a_cap * cap_rate)
        + e_A * a_rate * (f_phi_a + f_a * nu)
        + e_cap * f_a_cap * a_rate
        + f_a * e_a_rate
        + e_cap * (f_phi_cap * rate + f_cap * n_rate + f_cap_cap * cap_rate)
        + e_A * cap_rate * (f_phi_cap + f_cap * nu)
        + f_cap * speed.rate_error(nu, n_error),
    )


def _largest_gain(p: Number, q: Number, r: Number, arithmetic: Arithmetic) -> Number:
    """Largest singular value of the matrix with the rows p, q and 0, r; none is negative."""
    total = p * p + q * q + r * r
    gap = (p * p - r * r) * (p * p - r * r) + q * q * (q * q + 2 * p * p + 2 * r * r)
    root = arithmetic.sqrt(arithmetic.largest(gap, arithmetic.number(0.0)))
    return arithmetic.sqrt((total + root) / 2)
