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

"""When the nominal envelopes begin and how slowly they fall: as tabulated, or planned.

The paper's envelope falls by its table whatever the error is, and with Table I only errors up to
about 0.30 on an axis can follow it. A plan places the tabulated envelope in time: it may begin
further down the table (a controller that starts in mid-flight is near the target already), wait
(`hold`) until the craft turns the right way and is clear of the inverted attitude, and fall
`stretch` times slower. Stretching changes l to l/s and t2 to s t2, so r, and with it feasibility,
stays the same.

Where the table as it stands can be followed, the plan is the table as it stands. Else it is the
one that settles first for a model of the turn: the craft turns about its eigenaxis at the virtual
control's speed, φ' = −k M_ω ρ tanh(β x/ρ) with x = sin(φ/2), after the time that the torque limit
needs to bring it to that speed from its present rate. When the hold ends the stretch is chosen
anew from the state that has been reached.

What the plan guarantees of the rate, with the norm form of the virtual control:
‖v‖ ≤ k M_ω max ρ_q ≤ k M_ω holds at every instant for every error, envelope and plan. As
ω_s = C_e ω_d + v + z2, always ‖ω_s‖ ≤ max‖ω_d‖ + k M_ω max ρ_q + ‖z2‖, and inside the rate envelope
‖z2‖ ≤ √3 max ρ_ω. So ‖ω_s‖ ≤ limit is certain from the instant on at which √3 max ρ_ω ≤ limit −
max‖ω_d‖ − k M_ω. Before that (the first seconds, and after a hit) z2 is as large as the initial
rate or the hit makes it, and only its decay is sure.
"""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import euler_step, kinematics, normalised, rotation_angle
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kernel import (
    ZERO,
    Quaternion,
    Vector,
    add,
    apply,
    dot,
    kernel,
    largest,
    matrix,
    norm,
    scale,
    subtract,
    vector,
)
from ppc_attitude.science.parameter import record_type
from ppc_attitude.science.performance import clock_at, nominal
from ppc_attitude.science.virtual_control import sign, virtual_control

PLAN = record_type(
    ("start", np.float64),  # [s] when the plan was made
    ("hold", np.float64),  # [s] how long the attitude envelope waits before it falls
    ("level", np.float64),  # share of the envelope that sin(φ/2) takes when the hold ends
    ("stretch", np.float64),  # how many times slower than the table it falls
    ("attitude_clock", np.float64),  # [s] where on its table the attitude envelope begins
    ("rate_clock", np.float64),  # [s] where on its table the rate envelope begins
    ("angle_deg", np.float64),  # [deg] error angle when the plan was made
    ("feasible", np.float64),  # 1 if the model stays inside
    ("waiting", np.float64),  # 1 until the hold has ended and the stretch is final
    ("auto", np.float64),  # 1 if it was made with ``envelope: auto``
    ("count", np.float64),  # plans and revisions made so far
)
MAX_STRETCH = 64.0
# A plan made in flight does not begin at the table's top, so it may also be faster than the table.
_MIN_STRETCH_IN_FLIGHT = 0.25
# A plan made in flight begins where the error, at its coming peak, takes this share of its ρ.
_SHARE = 0.4
# The model of the turn may take this share; the rest is for what the model leaves out.
_MODEL_SHARE = 0.85
# At t2 it may take this share: from there the rest dies out in seconds instead of crawling.
_END_SHARE = 0.3
# Shares at which the fall may begin. Near φ = π a turn hardly changes sin(φ/2), so none is near 1.
_LEVELS = (0.8, 0.6, 0.45, 0.35, 0.25, 0.15)
_MODEL_STEPS = 200
_BISECTIONS = 10
_TABLE_STEPS = 400
_HOLD_STEP = 0.1  # [s]
_LONGEST_HOLD = 3600.0  # [s]


@kernel
def _turn_rate(phi: float, rho: float, gains: Any) -> float:
    """φ' [rad/s] that the virtual control asks for."""
    return float(-gains.k * gains.M_omega * rho * math.tanh(gains.beta * math.sin(0.5 * phi) / rho))


@kernel
def _present_turn(
    phi: float, q_e: Quaternion, omega_e: Vector, gains: Any
) -> tuple[float, float, float]:
    """φ' [rad/s] now; time [s] and |φ''| [rad/s²] with which the torque makes it the asked one."""
    q = vector(q_e)
    length, speed = norm(q), norm(omega_e)
    if phi > _HOLD_STEP * speed:
        axis = scale(sign(q_e[3]) / length, q)
    else:  # the error is about to be that which the rate makes, whatever its axis is now
        axis = scale(1.0 / speed, omega_e) if speed > 0.0 else ZERO
    rate = dot(axis, omega_e)
    asked = _turn_rate(phi, 1.0, gains)
    momentum = largest(apply(matrix(gains.inertia), subtract(scale(asked, axis), omega_e)))
    free_torque = max(gains.max_torque - gains.D_m, 0.1 * gains.max_torque)
    ready = momentum / free_torque + 1.0 / max(gains.K_omega, 1e-3)
    return rate, ready, abs(rate - asked) / ready


@kernel
def _advanced(
    phi: float, rate: float, rho: float, h: float, late: bool, brake: float, gains: Any
) -> tuple[float, float]:
    """φ and φ' of the model after h [s]; while the rate is `late` it changes by `brake`."""
    asked = _turn_rate(phi, rho, gains)
    if late:
        rate += min(max(asked - rate, -brake * h), brake * h)
    else:
        rate = _turn_rate(max(phi + 0.5 * h * asked, 0.0), rho, gains)
    phi += h * rate
    if phi > math.pi:  # through the inverted attitude: from here the other way is the short one
        return 2.0 * math.pi - phi, -rate
    return max(phi, 0.0), rate


@kernel
def _hold(
    phi: float, rate: float, rho: float, share: float, ready: float, brake: float, gains: Any
) -> tuple[float, float, float]:
    """Wait under ρ for the turn rate and for sin(φ/2) ≤ share ρ: seconds, φ then, peak φ."""
    enough = 2.0 * math.asin(share * rho)
    t, peak = 0.0, phi
    while t < _LONGEST_HOLD and (t < ready or phi > enough):
        phi, rate = _advanced(phi, rate, rho, _HOLD_STEP, t < ready, brake, gains)
        peak = max(peak, phi)
        t += _HOLD_STEP
    return t, phi, peak


@kernel
def _asked_rate(q_e: Quaternion, rho: float, gains: Any) -> Vector:
    """The virtual control v [rad/s] for an error under the same ρ on every axis."""
    q, rho_q = vector(q_e), (rho, rho, rho)
    speed, norm_form = gains.k * gains.M_omega, gains.norm_form != 0.0
    return virtual_control(q, q_e[3], ZERO, rho_q, ZERO, gains.beta, speed, norm_form)[0]


@kernel
def _follows_table(
    clock: float, q_e: Quaternion, omega_e: Vector, ready: float, gains: Any
) -> bool:
    """True if the error, turning with ω_e = v once it is `ready`, stays inside the given table."""
    shape = gains.attitude_shape
    h = (shape.t2 - clock) / _TABLE_STEPS
    for step in range(_TABLE_STEPS):
        if largest(vector(q_e)) > _MODEL_SHARE * nominal(clock, shape)[0]:
            return False
        rho = nominal(clock + 0.5 * h, shape)[0]
        omega = _asked_rate(q_e, rho, gains)
        omega = _asked_rate(euler_step(q_e, 0.5 * h, kinematics(q_e, omega)), rho, gains)
        part = min((step + 0.5) * h / ready, 1.0)
        omega = add(scale(1.0 - part, omega_e), scale(part, omega))
        middle = euler_step(q_e, 0.5 * h, kinematics(q_e, omega))
        q_e = normalised(euler_step(q_e, h, kinematics(middle, omega)))
        clock += h
    return bool(largest(vector(q_e)) <= _MODEL_SHARE * shape.terminal)


@kernel
def table_can_be_followed(q_e: Quaternion, omega_e: Vector, gains: Any) -> bool:
    """True if the error at t = 0 stays inside the attitude envelope as it is tabulated."""
    ready = _present_turn(rotation_angle(q_e), q_e, omega_e, gains)[1]
    return _follows_table(0.0, q_e, omega_e, ready, gains)


@kernel
def least_settling_time(q_e: Quaternion, component: float, whole: float, gains: Any) -> float:
    """Time [s] in which an error settles if the craft turns with ω_e = v under ρ = 1.

    A narrower envelope only makes v smaller, so no run is faster unless its rate overshoots v.

    Parameters
    ----------
    q_e : tuple of 4 float
        Error x y z w at the start.
    component, whole : float
        Limits for the largest |q_ev,i| and for ‖q_ev‖.
    gains : record
        Configuration of the law `ppc`.

    Returns
    -------
    float
        Infinite after `_LONGEST_HOLD`.
    """
    t = 0.0
    while t < _LONGEST_HOLD:
        error = vector(q_e)
        if largest(error) <= component and norm(error) <= whole:
            return t
        omega = _asked_rate(q_e, 1.0, gains)
        middle = euler_step(q_e, 0.5 * _HOLD_STEP, kinematics(q_e, omega))
        omega = _asked_rate(middle, 1.0, gains)
        q_e = normalised(euler_step(q_e, _HOLD_STEP, kinematics(middle, omega)))
        t += _HOLD_STEP
    return math.inf


@kernel
def _stays_inside(stretch: float, clock: float, phi: float, gains: Any) -> bool:
    """True if the modelled turn stays inside the envelope that falls from `clock`, stretched."""
    shape = gains.attitude_shape
    h_clock = (shape.t2 - clock) / _MODEL_STEPS
    h = h_clock * stretch
    for _ in range(_MODEL_STEPS):
        if math.sin(0.5 * phi) > _MODEL_SHARE * nominal(clock, shape)[0]:
            return False
        rho = nominal(clock + 0.5 * h_clock, shape)[0]
        phi, _ = _advanced(phi, 0.0, rho, h, False, 0.0, gains)
        clock += h_clock
    return bool(math.sin(0.5 * phi) <= _END_SHARE * shape.terminal)


@kernel
def _fastest_stretch(start: float, clock: float, phi: float, gains: Any) -> tuple[float, bool]:
    """Smallest stretch that the turn from φ can follow, and whether there is one."""
    fast = _MIN_STRETCH_IN_FLIGHT if start > 0.0 else 1.0
    slow = MAX_STRETCH
    if _stays_inside(fast, clock, phi, gains):
        return fast, True
    if not _stays_inside(slow, clock, phi, gains):
        return slow, False
    for _ in range(_BISECTIONS):
        middle = math.sqrt(slow * fast)
        if _stays_inside(middle, clock, phi, gains):
            slow = middle
        else:
            fast = middle
    return slow, True


@kernel
def _plan_fall(plan: Any, phi: float, rate: float, ready: float, brake: float, gains: Any) -> bool:
    """Choose hold and stretch for the least settling time; True if the model then stays inside.

    Waiting turns the craft at full speed, the fall slows it with ρ: mostly it pays to wait longer
    and to fall faster.
    """
    clock = plan.attitude_clock
    rho = min(nominal(clock, gains.attitude_shape)[0], 1.0)
    fall = gains.attitude_shape.t2 - clock
    best, feasible = math.inf, False
    for level in _LEVELS:
        hold, phi_then, _ = _hold(phi, rate, rho, level, ready, brake, gains)
        stretch, inside = _fastest_stretch(plan.start, clock, phi_then, gains)
        settled = hold + stretch * fall
        if settled < best:
            best, feasible = settled, inside
            plan.hold, plan.stretch, plan.level = hold, stretch, level
    return feasible


@kernel
def plan_envelopes(plan: Any, t: float, q_e: Quaternion, omega_e: Vector, gains: Any) -> None:
    """Place both envelopes in time at t [s] for the present error.

    At t = 0 the envelopes begin at the top of their tables, as in the paper; a plan made later
    begins where the errors take the share `_SHARE` of them. With ``envelope: nominal`` nothing
    waits and the stretch is 1, so a later plan begins at the top as well if the model would not
    stay inside further down; `feasible` says whether it does.
    """
    shape = gains.attitude_shape
    phi = rotation_angle(q_e)
    rate, ready, brake = _present_turn(phi, q_e, omega_e, gains)
    plan.start = t
    plan.hold = 0.0
    plan.stretch = 1.0
    plan.attitude_clock = 0.0
    plan.rate_clock = 0.0
    plan.angle_deg = math.degrees(phi)
    plan.waiting = 0.0
    plan.auto = gains.auto
    plan.count += 1.0
    if t > 0.0:
        reach = largest(vector(q_e))
        if gains.auto != 0.0:
            peak = _hold(phi, rate, 1.0, 1.0, ready, brake, gains)[2]
            reach = max(reach, math.sin(0.5 * peak))
        plan.attitude_clock = clock_at(reach / _SHARE, shape)
    inside = _follows_table(plan.attitude_clock, q_e, omega_e, ready, gains)
    if gains.auto == 0.0 and not inside:
        plan.attitude_clock = 0.0
        inside = _follows_table(0.0, q_e, omega_e, ready, gains)
    if t > 0.0:
        rho = nominal(plan.attitude_clock, shape)[0]
        z2 = subtract(omega_e, _asked_rate(q_e, rho, gains))
        plan.rate_clock = clock_at(largest(z2) / _SHARE, gains.rate_shape)
    if gains.auto != 0.0 and (t > 0.0 or not inside):
        inside = _plan_fall(plan, phi, rate, ready, brake, gains)
        plan.waiting = 1.0
    plan.feasible = 1.0 if inside else 0.0


@kernel
def revise_plan(plan: Any, t: float, q_e: Quaternion, omega_e: Vector, gains: Any) -> None:
    """When the hold has ended: wait on if the craft is not yet on its way, else fix the stretch."""
    phi = rotation_angle(q_e)
    rate, ready, brake = _present_turn(phi, q_e, omega_e, gains)
    rho = min(nominal(plan.attitude_clock, gains.attitude_shape)[0], 1.0)
    plan.hold = t - plan.start
    if rate > 0.0 or math.sin(0.5 * phi) > plan.level * rho:
        more, phi, _ = _hold(phi, rate, rho, plan.level, ready, brake, gains)
        plan.hold += more
    else:
        plan.waiting = 0.0
    plan.stretch, inside = _fastest_stretch(plan.start, plan.attitude_clock, phi, gains)
    plan.feasible = 1.0 if inside else 0.0
    plan.count += 1.0


@kernel
def carry_on(plan: Any, t: float, gains: Any) -> tuple[tuple[float, float], tuple[float, float]]:
    """Nominal ρ_ω [rad/s] and nominal ρ_q of the plan at t [s], each with its rate."""
    since = t - plan.start
    falling = since - plan.hold
    clock = plan.attitude_clock + max(falling, 0.0) / plan.stretch
    rho_q, slope = nominal(clock, gains.attitude_shape)
    rho_q_rate = slope / plan.stretch if falling >= 0.0 else 0.0
    return nominal(plan.rate_clock + since, gains.rate_shape), (rho_q, rho_q_rate)


def plan_advice(plan: Any) -> Advice:
    """Describe a plan; if its envelopes cannot be kept, warn with what to change."""
    text = (
        f"envelope plan from t = {plan['start']:.3f} s: attitude error {plan['angle_deg']:.2f}°, "
        f"hold {plan['hold']:.2f} s, stretch {plan['stretch']:.3f}, begins "
        f"where the nominal envelope is after {plan['attitude_clock']:.2f} s"
    )
    if plan["feasible"] == 1.0:
        return Advice(text, warning=False)
    if plan["stretch"] == MAX_STRETCH:
        text += "; even so slow an envelope cannot be followed: raise k, M_omega or beta"
    else:
        text += (
            "; the error is not expected to stay inside its envelope: use envelope: auto, which "
            "stretches the envelope, or a longer attitude_envelope.settling_time"
        )
    return Advice(text, warning=True)
