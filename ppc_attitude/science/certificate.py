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

"""The certificate of a set of parameters: the paper's conditions, corrected, and what holds.

S1 to S5 make the composite Lyapunov function decrease. They are sufficient, not necessary: the
paper's own numbers violate S1, and its simulations converge all the same. What predicts
simulation is whether the error shrinks faster than its envelope falls over the whole fall:
(|q_e0|/2) k M_ω tanh(β ε)/ε against −ρ'/ρ. With the paper's Table I the envelope falls faster than
any error can shrink for some seconds before t2, so an error must come there with room to spare:
that limits the start.
"""

import math
import operator
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ppc_attitude.science.component import Component
from ppc_attitude.science.controllers import ppc
from ppc_attitude.science.controllers.common import (
    ATTITUDE_ENVELOPE,
    RATE_ENVELOPE,
    envelope_of,
    envelopes_of,
)
from ppc_attitude.science.envelope_plan import table_can_be_followed
from ppc_attitude.science.kernel import ZERO
from ppc_attitude.science.performance import R_LIMIT, Envelope

_SYMBOLS = {ATTITUDE_ENVELOPE.name: "ρ_q", RATE_ENVELOPE.name: "ρ_ω"}


@dataclass(frozen=True)
class Condition:
    """One condition.

    Attributes
    ----------
    name : str
        Short name, the paper's where it has one.
    value, limit : float
        What it is and what it is compared with.
    relation : str
        ``>``, ``≥`` or ``≤``: how value and limit must compare.
    unit : str
        Of both.
    necessary : bool
        False for a sufficient condition that may be violated, as the paper's numbers do.
    meaning : str
        What it says.
    """

    name: str
    value: float
    limit: float
    relation: str
    unit: str
    necessary: bool
    meaning: str

    @property
    def holds(self) -> bool:
        """True if the condition is met."""
        compared = {">": operator.gt, "≥": operator.ge, "≤": operator.le}[self.relation]
        return bool(compared(self.value, self.limit))


def steepest_fall(envelope: Envelope) -> float:
    """max(−ρ'/ρ) [1/s] of a nominal envelope, in closed form.

    On the exponential it is largest at t = 0, on the parabola where t2 − t = sqrt(g∞/a1).
    """
    table = envelope.table
    exponential = table.decay * (1.0 - table.exponential_terminal / table.initial)
    width = table.settling_time - envelope.t1
    u = min(math.sqrt(table.terminal / envelope.a1), width)
    parabola = 2.0 * envelope.a1 * u / (envelope.a1 * u * u + table.terminal)
    return max(exponential if envelope.t1 > 0.0 else 0.0, parabola)


def virtual_control_bound(values: Mapping[str, Any]) -> float:
    """Bound of ‖v‖ [rad/s] for ρ_q ≤ 1; the paper's k M_ω only holds for the norm form."""
    speed = float(values["k"] * values["M_omega"])
    return speed if values["virtual_control"] == "norm" else math.sqrt(3.0) * speed


def certificate(
    law: Component,
    values: Mapping[str, Any],
    q_e0: float,
    desired_rate: float | None,
    torque: float,
    environment: float,
    rate_limit: float | None,
) -> tuple[Condition, ...]:
    """Conditions on the parameters; S1 to S5 and the rate bound are those of the law `ppc`.

    Parameters
    ----------
    law : Component
        The law: only the envelopes that it has must be feasible.
    values : mapping
        Checked parameter values.
    q_e0 : float
        Scalar part of the initial attitude error.
    desired_rate : float or None
        Largest ‖ω_d‖ [rad/s]; None if nobody knows it.
    torque : float
        Torque on an axis [N·m] that the law asks for and the actuator gives.
    environment : float
        Largest norm of the environment torque [N·m].
    rate_limit : float or None
        Required bound of ‖ω_s‖ [deg/s]; None if nothing is asked for.

    Raises
    ------
    ConfigurationError
        An envelope is infeasible.
    """
    envelopes = {prefix: envelope_of(prefix, values) for prefix in envelopes_of(law)}
    found = [_feasibility(_SYMBOLS[prefix], each) for prefix, each in envelopes.items()]
    meaning = "the actuator is stronger than the configured environment's torque"
    found.append(Condition("torque authority", torque, environment, ">", "N·m", True, meaning))
    if law.name == ppc.COMPONENT.name:
        fall = steepest_fall(envelopes[ATTITUDE_ENVELOPE.name])
        found += _lyapunov(values, abs(q_e0), fall)
        found += _following(values, abs(q_e0), fall)
        found += _rates(values, desired_rate, envelopes[RATE_ENVELOPE.name], rate_limit)
    return tuple(found)


def _feasibility(name: str, envelope: Envelope) -> Condition:
    joint = f"t1 = {envelope.t1:.9g} s, a1 = {envelope.a1:.12g} 1/s²"
    meaning = f"the envelope has a smooth joint: {joint}"
    return Condition(f"r of {name}", envelope.r, R_LIMIT, "≤", "", True, meaning)


def _lyapunov(values: Mapping[str, Any], q_e0: float, fall: float) -> Iterator[Condition]:
    s1 = q_e0 * values["M_omega"] - 4.0 * fall
    papers = q_e0 * values["M_omega"] - 4.0 * values["attitude_envelope.decay"]
    s2 = 2.0 * values["K_omega"] - 2.0 * values["K_u"] - 2.0
    s3 = 2.0 * values["K_a"] - 1.0 - values["K_u"] * values["k2"]
    s4 = min(2.0 * values["C_q"] - values["C_tau"], 2.0 * values["C_omega"] - values["B_tau"])
    s5 = 2.0 * values["K_b"] - 1.0 - values["k2"] - values["C_tau"] - values["B_tau"]
    meaning = "|q_e0| M_ω − 4 max(−ρ_q'/ρ_q): V1 decreases by itself"
    yield Condition("S1", s1, 0.0, ">", "", False, meaning)
    meaning = "|q_e0| M_ω − 4 l, with the paper's approximation max(−ρ_q'/ρ_q) ≈ l"
    yield Condition("S1 of the paper", papers, 0.0, ">", "", False, meaning)
    yield Condition("S2", s2, 0.0, ">", "", True, "2 K_ω − 2 K_u − 2: V2 decreases")
    yield Condition("S3", s3, 0.0, ">", "", True, "2 K_a − 1 − K_u k2: V3 decreases")
    meaning = "min(2 C_q − C_τ, 2 C_ω − B_τ): V4 decreases"
    yield Condition("S4", s4, 0.0, ">", "", True, meaning)
    meaning = "2 K_b − 1 − k2 − C_τ − B_τ: the saturation term is dominated (the paper printed < 0)"
    yield Condition("S5", s5, 0.0, "≥", "", True, meaning)


def _following(values: Mapping[str, Any], q_e0: float, fall: float) -> Iterator[Condition]:
    shrink = 0.5 * q_e0 * values["k"] * values["M_omega"]
    beta = values["beta"]
    meaning = (
        "relative rate of a small error against max(−ρ_q'/ρ_q): no error gains on its envelope"
    )
    yield Condition("small error follows", shrink * beta, fall, ">", "1/s", False, meaning)
    meaning = "the same of an error on its envelope: none can leave, whatever the start"
    yield Condition("edge follows", shrink * math.tanh(beta), fall, ">", "1/s", False, meaning)
    meaning = "largest single component of q_ev that follows the table from rest, with reserve; "
    meaning += "beyond, use envelope: auto"
    yield Condition("largest start", largest_start(values), 0.0, ">", "", False, meaning)


def _rates(
    values: Mapping[str, Any], desired_rate: float | None, rate: Envelope, limit: float | None
) -> Iterator[Condition]:
    bound = virtual_control_bound(values)
    speed = math.degrees(values["k"] * values["M_omega"])
    meaning = "max‖v‖ is k M_ω, as the paper claims of its form; true of virtual_control: norm only"
    yield Condition("bound of v", math.degrees(bound), speed, "≤", "deg/s", False, meaning)
    if limit is not None and desired_rate is not None:
        total = math.degrees(bound + desired_rate + math.sqrt(3.0) * rate.table.terminal)
        meaning = "max‖v‖ + max‖ω_d‖ + √3 g∞ of ρ_ω: guaranteed once z2 has come in"
        yield Condition("rate bound", total, limit, "≤", "deg/s", False, meaning)


def largest_start(values: Mapping[str, Any]) -> float:
    """Largest |q_ev,i|, the other components zero, that can follow the tabulated envelope.

    From rest, by bisection on the controller's own model of the turn; the least of the axes.

    Raises
    ------
    ConfigurationError
        An envelope or the inertia is impossible.
    """
    gains = ppc.configure(values)
    return min(_largest_component(axis, gains) for axis in range(3))


def _largest_component(axis: int, gains: Any) -> float:
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        x, y, z = (middle if axis == i else 0.0 for i in range(3))
        error = (x, y, z, math.sqrt(1.0 - middle * middle))
        if table_can_be_followed(error, ZERO, gains):
            low = middle
        else:
            high = middle
    return low


def largest_desired_rate(amplitude: Any) -> float:
    """Bound of ‖ω_d‖ [rad/s] from the amplitudes of its three components."""
    return float(np.linalg.norm(amplitude))
