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

"""Conditions of the law `ppc`: the paper's, corrected; a prediction; and proportions to the craft.

S1 to S5 make the composite Lyapunov function decrease (eq. 32). They are sufficient, not necessary:
the paper's own numbers violate S1, and its simulations converge all the same. What predicts
simulation is whether the error shrinks faster than its envelope falls over the whole fall:
(|q_e0|/2) k M_ω tanh(β ε)/ε against −ρ'/ρ. With the paper's Table I the envelope falls faster than
any error can shrink for some seconds before t2. So the error must reach these seconds well inside
its envelope, which limits the error at the start.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from ppc_attitude.science.actuators.ideal import MIN_TORQUE
from ppc_attitude.science.conditions import Condition, Task, advisable, promised
from ppc_attitude.science.controllers.common import ATTITUDE_ENVELOPE, envelope_of
from ppc_attitude.science.envelope_plan import least_settling_time, table_can_be_followed
from ppc_attitude.science.inertia import principal_moments
from ppc_attitude.science.kernel import ZERO
from ppc_attitude.science.performance import nominal
from ppc_attitude.science.stamps import instant

_NOISE_SIGMAS = 3.0  # the actuator should give the torque that this many σ of noise ask for


def steepest_fall(shape: Any) -> float:
    """max(−ρ'/ρ) [1/s] of a nominal envelope's record, in closed form.

    On the exponential it is largest at t = 0, on the parabola where t2 − t = sqrt(g∞/a1).
    """
    rho, rate = nominal(0.0, shape)
    t1, t2, a1, terminal = shape[["t1", "t2", "curvature", "terminal"]].tolist()
    u = t2 - t1
    if a1 * u * u > terminal:
        u = math.sqrt(terminal / a1)
    return float(max(-rate / rho, 2.0 * a1 * u / (a1 * u * u + terminal)))


def virtual_control_bound(values: Mapping[str, Any]) -> float:
    """Bound of ‖v‖ [rad/s] for ρ_q ≤ 1; the paper's k M_ω only holds for the norm form."""
    speed = float(values["k"] * values["M_omega"])
    return speed if values["virtual_control"] == "norm" else math.sqrt(3.0) * speed


def conditions(values: Mapping[str, Any], gains: Any, task: Task) -> Iterator[Condition]:
    """Conditions on the law, which is configured with `gains`, and in proportion to the craft."""
    q_e0 = abs(task.error[3])
    fall = steepest_fall(envelope_of(ATTITUDE_ENVELOPE.name, values))
    yield from _lyapunov(values, q_e0, fall)
    yield from _following(values, q_e0, fall, gains)
    needs = float(least_settling_time(task.error, *task.settled, gains))
    yield from task.settles("time of the law", needs, "at the rates of k, M_omega and beta")
    yield from _rates(values, task)
    yield from _actuation(values, task)


def _lyapunov(values: Mapping[str, Any], q_e0: float, fall: float) -> Iterator[Condition]:
    s1 = q_e0 * values["M_omega"] - 4.0 * fall
    papers = q_e0 * values["M_omega"] - 4.0 * values["attitude_envelope.decay"]
    s2 = 2.0 * values["K_omega"] - 2.0 * values["K_u"] - 2.0
    s3 = 2.0 * values["K_a"] - 1.0 - values["K_u"] * values["k2"]
    s4 = min(2.0 * values["C_q"] - values["C_tau"], 2.0 * values["C_omega"] - values["B_tau"])
    s5 = 2.0 * values["K_b"] - 1.0 - values["k2"] - values["C_tau"] - values["B_tau"]
    meaning = "|q_e0| M_ω − 4 max(−ρ_q'/ρ_q): V1 decreases by itself"
    yield promised("S1", s1, 0.0, ">", "", meaning)
    meaning = "|q_e0| M_ω − 4 l, with the paper's approximation max(−ρ_q'/ρ_q) ≈ l"
    yield promised("S1 of the paper", papers, 0.0, ">", "", meaning)
    yield Condition("S2", s2, 0.0, ">", "", True, "2 K_ω − 2 K_u − 2: V2 decreases")
    yield Condition("S3", s3, 0.0, ">", "", True, "2 K_a − 1 − K_u k2: V3 decreases")
    meaning = "min(2 C_q − C_τ, 2 C_ω − B_τ): V4 decreases"
    yield Condition("S4", s4, 0.0, ">", "", True, meaning)
    meaning = "2 K_b − 1 − k2 − C_τ − B_τ: the saturation term is dominated (the paper printed < 0)"
    yield Condition("S5", s5, 0.0, "≥", "", True, meaning)


def _following(
    values: Mapping[str, Any], q_e0: float, fall: float, gains: Any
) -> Iterator[Condition]:
    shrink = 0.5 * q_e0 * values["k"] * values["M_omega"]
    beta = values["beta"]
    meaning = "a small error falls at a larger relative rate than its envelope, max(−ρ_q'/ρ_q)"
    yield promised("small error follows", shrink * beta, fall, ">", "1/s", meaning)
    meaning = "the same for an error on its envelope: no error leaves it, whatever the start"
    yield promised("edge follows", shrink * math.tanh(beta), fall, ">", "1/s", meaning)
    meaning = "largest component of q_ev at a start from rest that stays in the nominal envelope; "
    meaning += "for a larger one use envelope: auto"
    yield Condition("largest start", largest_start(gains), 0.0, ">", "", False, meaning)


def _rates(values: Mapping[str, Any], task: Task) -> Iterator[Condition]:
    """The largest rates: in a turn, once settled, and in slews with the error's share."""
    bound, desired, limit = virtual_control_bound(values), task.desired_rate, task.rate_limit
    if limit is None:
        return
    speed = math.degrees(values["k"] * values["M_omega"])
    meaning = "k M_ω: at this rate the law turns the craft about one axis, from a large error"
    yield advisable("rate of the law", speed, limit, "deg/s", meaning)
    if desired is None:
        return
    total = math.degrees(bound + desired + math.sqrt(3.0) * values["rate_envelope.terminal"])
    meaning = "max‖v‖ + max‖ω_d‖ + √3 g∞ of ρ_ω: guaranteed once z2 is inside its envelope"
    meaning += "" if task.slews_from is None else ", unless a slew is broken off"
    yield promised("rate bound", total, limit, "≤", "deg/s", meaning)
    if task.slews_from is None:
        return
    shape = envelope_of(ATTITUDE_ENVELOPE.name, values)
    width, when = float(shape["terminal"]), "once settled"
    if task.slews_from < math.inf:
        width = min(nominal(task.slews_from, shape)[0], 1.0)
        when = f"of the first goal, t = {instant(task.slews_from)} s"
    yield promised(
        "slew rate",
        math.degrees(desired + bound * width),
        limit,
        "≤",
        "deg/s",
        f"V + max‖v‖ ρ_q, ρ_q = {width:.3g} {when}: rate in a slew with an error as large as its "
        "envelope",
    )


def _actuation(values: Mapping[str, Any], task: Task) -> Iterator[Condition]:
    """Compare what the law asks for with the actuator: D_m, at the envelope's edge, of noise."""
    meaning = "the law asks for up to D_m against the disturbance, which it is to bound: more than "
    meaning += "the actuator gives is the bound of another craft"
    yield advisable("D_m", values["D_m"], task.torque, "N·m", meaning)
    least, _, most = principal_moments(values["inertia"]).tolist()
    if MIN_TORQUE.name in task.craft:
        yield advisable(
            "min_torque in ρ_ω",
            task.craft[MIN_TORQUE.name],
            values["K_omega"] * least * values["rate_envelope.terminal"],
            "N·m",
            "K_ω J g∞: at the edge of the rate envelope the law asks for more than the dead zone, "
            "so that the actuator acts inside it",
        )
    if task.rate_sigma:
        yield advisable(
            "noise torque",
            _NOISE_SIGMAS * values["K_omega"] * most * task.rate_sigma,
            task.actuator_torque,
            "N·m",
            f"{_NOISE_SIGMAS:g}σ of K_ω J z2: the actuator gives what noise makes the law ask for",
        )


def largest_start(gains: Any) -> float:
    """Largest |q_ev,i|, the other components zero, that can follow the tabulated envelope.

    From rest, by bisection on the controller's own model of the turn; the least of the axes.
    """
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
