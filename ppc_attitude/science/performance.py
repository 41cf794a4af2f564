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

"""Prescribed performance functions: nominal part (eqs. 6, 7) and adaptive widening (eq. 24).

The nominal part falls exponentially to t1, by a parabola to t2, and stays at g∞. With
A = ρ_e0 − ρ_e∞, x = l (t2 − t1) and r = (g∞ − ρ_e∞) e^{l t2} / A, the smooth joint at t1 asks for
(1 − x/2) eˣ = r, that is x = 2 + W(−2 r e⁻²) with Lambert's W. The paper's second line of eq. 7
lacks a factor l and has the wrong sign: a1 = l A e^{−l t1} / (2 (t2 − t1)) makes the slopes meet.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import Vector, add, divide, kernel, scale
from ppc_attitude.science.parameter import LARGEST, filled, record_type

SHAPE = record_type(
    ("amplitude", np.float64),  # A
    ("asymptote", np.float64),  # ρ_e∞
    ("decay", np.float64),  # l [1/s]
    ("t1", np.float64),  # [s] joint of exponential and parabola
    ("t2", np.float64),  # [s]
    ("curvature", np.float64),  # a1 [1/s²] of the parabola a1 (t − t2)² + g∞
    ("terminal", np.float64),  # g∞
    ("r", np.float64),  # the feasibility number; at most e/2
)
LARGEST_INITIAL = 1e6  # what ρ_e0 may be
R_LIMIT = math.e / 2.0  # the largest r with a real root
# Computed tables may sit on the limit up to rounding (terminal = exponential_terminal: r = 0).
_ROUNDING = 1e-12
_NEGLIGIBLE = -40.0  # e to it adds nothing to 2
_NEWTON = 64  # steps: where the two roots meet, each only halves the error
_LARGEST_EXPONENT = 700.0  # e to it is still finite


@dataclass(frozen=True)
class EnvelopeTable:
    """The five numbers that the paper's tables give for one envelope."""

    initial: float  # ρ_e0, value at t = 0
    exponential_terminal: float  # ρ_e∞, where the exponential alone would end
    decay: float  # l [1/s]
    settling_time: float  # t2 [s], from here on the envelope is `terminal`
    terminal: float  # g∞


def solve_envelope(name: str, table: EnvelopeTable) -> Any:
    """Join exponential and parabola smoothly (eq. 7, corrected), as a record of dtype `SHAPE`.

    Parameters
    ----------
    name : str
        Prefix of the parameter names in an error, e.g. ``attitude_envelope``.
    table : EnvelopeTable
        The five numbers, finite and positive.

    Raises
    ------
    ConfigurationError
        Numbers are out of order, or no real t1 ≥ 0 exists; the message names r,
        its limit and the nearest feasible value of each number.
    """
    _check_order(name, table)
    x = _width(table)
    if x is None:
        raise ConfigurationError(_infeasible(name, table))
    latest = math.nextafter(table.settling_time, 0.0)  # the parabola has a length
    t1 = min(max(table.settling_time - x / table.decay, 0.0), latest)
    amplitude = table.initial - table.exponential_terminal
    fall = table.decay * amplitude * math.exp(-table.decay * t1)
    return filled(
        SHAPE,
        vars(table),
        amplitude=amplitude,
        asymptote=table.exponential_terminal,
        t1=t1,
        t2=table.settling_time,
        curvature=fall / (2.0 * (table.settling_time - t1)),
        r=feasibility(table),
    )


def feasibility(table: EnvelopeTable) -> float:
    """Number r = (g∞ − ρ_e∞) e^{l t2} / A; a real t1 exists if and only if r ≤ e/2."""
    growth = math.exp(min(table.decay * table.settling_time, _LARGEST_EXPONENT))
    gap = table.terminal - table.exponential_terminal
    return gap * growth / (table.initial - table.exponential_terminal)


def _width(table: EnvelopeTable) -> float | None:
    """Width x = l (t2 − t1) of the larger t1 ≥ 0; None if there is none."""
    r = feasibility(table)
    if r > R_LIMIT * (1.0 + _ROUNDING):
        return None
    x = _root(table, min(r, R_LIMIT))
    largest = table.decay * table.settling_time * (1.0 + _ROUNDING)
    return x if 0.0 < x <= largest else None


def _root(table: EnvelopeTable, r: float) -> float:
    """Smaller positive root x of (1 − x/2) eˣ = r, by Newton's method.

    It is 2 + W(−2 r e⁻²), but SciPy's W is wrong where the two roots meet, at r = e/2, and takes
    0.3 s to import.
    """
    if r < 0.0:  # r may be beyond any float, so x = 2 + w is found from w + ln w = ln(−2 r e⁻²)
        gap = table.exponential_terminal - table.terminal
        ratio = math.log(2.0 * gap) - math.log(table.initial - table.exponential_terminal)
        sought = max(ratio + table.decay * table.settling_time - 2.0, _NEGLIGIBLE)
        w = math.exp(min(sought, 0.0)) * max(sought, 1.0)
        for _ in range(_NEWTON):
            w *= (1.0 + sought - math.log(w)) / (1.0 + w)
        return 2.0 + w
    x = 0.0 if r > 1.0 else 2.0  # from here no step passes the root
    for _ in range(_NEWTON):
        missing = r * math.exp(-x) - (1.0 - 0.5 * x)
        if missing <= 0.0 or x == 1.0:
            break
        x += 2.0 * missing / (1.0 - x)
    return x


def _check_order(name: str, table: EnvelopeTable) -> None:
    if table.initial <= table.terminal:
        raise ConfigurationError(
            f"{name}.initial = {table.initial} must be larger than {name}.terminal = "
            f"{table.terminal}"
        )
    if table.exponential_terminal >= table.initial:
        raise ConfigurationError(
            f"{name}.exponential_terminal = {table.exponential_terminal} must be smaller than "
            f"{name}.initial = {table.initial}"
        )


def _infeasible(name: str, table: EnvelopeTable) -> str:
    r = feasibility(table)
    head = (
        f"{name} is infeasible: r = (terminal − exponential_terminal) e^(decay·settling_time) / "
        f"(initial − exponential_terminal) = {r:.6g}"
    )
    if r > R_LIMIT:
        reason = f", but at most e/2 = {R_LIMIT:.6g} has a real t1"
    else:
        reason = f" gives t1 < 0 with decay·settling_time = {table.decay * table.settling_time:.6g}"
    listed = ", or ".join(f"{name}.{key} = {value:.6g}" for key, value in nearest(table).items())
    return (
        f"{head}{reason}. Nearest feasible value of one parameter, the others kept: "
        f"{listed or 'there is none'}"
    )


def nearest(table: EnvelopeTable) -> dict[str, float]:
    """Of an infeasible table, the nearest value of each number that alone makes it feasible.

    Values have six digits, rounded to the feasible side; a number that cannot help is left out.
    """
    lt2 = table.decay * table.settling_time
    growth = math.exp(min(lt2, _LARGEST_EXPONENT))
    amplitude = table.initial - table.exponential_terminal
    gap = table.terminal - table.exponential_terminal
    if feasibility(table) > R_LIMIT:
        limit = math.log(R_LIMIT * amplitude / gap)
        wanted = {
            "exponential_terminal": (table.terminal * growth - R_LIMIT * table.initial)
            / (growth - R_LIMIT),
            "terminal": table.exponential_terminal + R_LIMIT * amplitude / growth,
            "initial": table.exponential_terminal + gap * growth / R_LIMIT,
            "settling_time": limit / table.decay,
            "decay": limit / table.settling_time,
        }
    else:  # t1 = 0 where l t2 / 2 − 1 + gap/A = 0
        limit = 2.0 * (1.0 - gap / amplitude)
        wanted = {
            "terminal": table.exponential_terminal + amplitude * (1.0 - 0.5 * lt2),
            "settling_time": limit / table.decay,
            "decay": limit / table.settling_time,
        }
    rounded = {key: _rounded_to_feasible(table, key, value) for key, value in wanted.items()}
    return {key: value for key, value in rounded.items() if value is not None}


def _rounded_to_feasible(table: EnvelopeTable, key: str, value: float) -> float | None:
    if not 0.0 < value <= (LARGEST_INITIAL if key == "initial" else LARGEST):
        return None
    unit = 10.0 ** (math.floor(math.log10(value)) - 5)
    for steps in (math.floor(value / unit), math.ceil(value / unit)):
        rounded = float(f"{steps * unit:.6g}")
        candidate = replace(table, **{key: rounded})
        ordered = 0.0 < max(candidate.terminal, candidate.exponential_terminal) < candidate.initial
        if rounded > 0.0 and ordered and _width(candidate) is not None:
            return rounded
    return None


@kernel
def nominal(t: float, shape: Any) -> tuple[float, float]:
    """ρ_n(t) and its rate ρ_n'(t) [1/s] at t [s] on the envelope's own clock (eq. 6)."""
    if t < shape.t1:
        exponential = shape.amplitude * math.exp(-shape.decay * t)
        return exponential + shape.asymptote, -shape.decay * exponential
    if t < shape.t2:
        remaining = t - shape.t2
        return (
            shape.curvature * remaining * remaining + shape.terminal,
            2.0 * shape.curvature * remaining,
        )
    return shape.terminal, 0.0


@kernel
def clock_at(value: float, shape: Any) -> float:
    """Clock time [s] at which the nominal envelope has come down to `value`."""
    if value >= shape.amplitude + shape.asymptote:
        return 0.0
    if value <= shape.terminal:
        return float(shape.t2)
    joint = shape.amplitude * math.exp(-shape.decay * shape.t1) + shape.asymptote
    if value >= joint:
        return float(math.log(shape.amplitude / (value - shape.asymptote)) / shape.decay)
    return float(shape.t2 - math.sqrt((value - shape.terminal) / shape.curvature))


@kernel
def _widened_rate_axis(
    delta: float, nominal_value: float, drive: float, decay: float, h: float
) -> float:
    # x (1 + h C) = Δρ + h drive / (ρ_n + x): a quadratic with one root x ≥ 0.
    a = 1.0 + h * decay
    b = a * nominal_value - delta
    c = delta * nominal_value + h * drive
    return (-b + math.sqrt(b * b + 4.0 * a * c)) / (2.0 * a)


@kernel
def widened_rate_envelope(
    delta: Vector, nominal_value: float, drive: Vector, decay: float, h: float
) -> Vector:
    """Δρ_ω [rad/s] after h [s] by the implicit Euler step of Δρ_ω' = −C_ω Δρ_ω + drive / ρ_ω.

    The law is stiff: ρ_ω = ρ_n + Δρ_ω is 3e-5 rad/s when a saturation begins, so ρ_ω at the end
    of the step divides. `drive` is B_τ |J⁻¹| |tanh Δτ|.
    """
    return (
        _widened_rate_axis(delta[0], nominal_value, drive[0], decay, h),
        _widened_rate_axis(delta[1], nominal_value, drive[1], decay, h),
        _widened_rate_axis(delta[2], nominal_value, drive[2], decay, h),
    )


@kernel
def widened_attitude_envelope(delta: Vector, drive: Vector, decay: float, h: float) -> Vector:
    """Δρ_q after h [s] by the implicit Euler step of Δρ_q' = −C_q Δρ_q + drive."""
    fall = 1.0 + h * decay
    return divide(add(delta, scale(h, drive)), (fall, fall, fall))
