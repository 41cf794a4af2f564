"""When the nominal envelopes begin and how slowly they fall: as tabulated, or planned.

The paper's envelope falls by its table whatever the error is, and with Table I only errors up to
about 0.44 per axis can follow it. A plan places the tabulated envelope in time: it may begin
further down the table (a controller that starts in mid-flight is near the target already), wait
(`hold`) until a nearly inverted craft has begun to turn, and fall `stretch` times slower. Stretching
changes l to l/s and t2 to s t2, so r, and with it feasibility, stays the same.

The plan is the fastest stretch ≥ 1 for which a model of the turn stays inside: the craft turns
about its eigenaxis at the virtual control's speed, φ' = −k M_ω ρ tanh(β x/ρ) with x = sin(φ/2), after
the time that the torque limit needs to reach that speed from the present rate.
"""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.kernel import (
    Vector,
    apply,
    dot,
    kernel,
    largest,
    matrix,
    norm,
    scale,
    subtract,
)
from ppc_attitude.science.performance import clock_at, nominal
from ppc_attitude.science.virtual_control import sign, virtual_control

PLAN = np.dtype(
    [
        ("start", np.float64),  # [s] when the plan was made
        ("hold", np.float64),  # [s] how long the attitude envelope waits before it falls
        ("stretch", np.float64),  # how many times slower than the table it falls
        ("attitude_clock", np.float64),  # [s] where on its table the attitude envelope begins
        ("rate_clock", np.float64),  # [s] where on its table the rate envelope begins
        ("angle_deg", np.float64),  # [deg] error angle when the plan was made
        ("feasible", np.float64),  # 1 if the model stays inside
        ("count", np.float64),  # plans made so far
    ],
    align=True,
)
MAX_STRETCH = 64.0
# A plan made in flight begins where the present error fills this part of the envelope.
_FILL = 0.4
# The model of the turn may fill this part; the rest is for what the model leaves out.
_MODEL_FILL = 0.85
# At t2 it may fill this part: from there the rest dies out in seconds instead of crawling.
_END_FILL = 0.3
# The envelope waits while sin(φ/2) is above this: near φ = π a turn hardly changes sin(φ/2).
_HOLD_ABOVE = 0.8
_MODEL_STEPS = 400
_BISECTIONS = 12


@kernel
def _turn_rate(phi: float, rho: float, gains: Any) -> float:
    """Speed [rad/s] at which the virtual control lets the error angle φ fall."""
    return float(gains.k * gains.M_omega * rho * math.tanh(gains.beta * math.sin(0.5 * phi) / rho))


@kernel
def _acquisition(q: Vector, q0: float, omega_e: Vector, gains: Any) -> tuple[float, float]:
    """Seconds until the commanded rate is reached, and the present outward rate [rad/s] of φ."""
    length = norm(q)
    if length < 1e-12:
        return 0.0, 0.0
    axis = scale(sign(q0) / length, q)
    speed = _turn_rate(2.0 * math.asin(min(length, 1.0)), 1.0, gains)
    change = subtract(scale(-speed, axis), omega_e)
    momentum = largest(apply(matrix(gains.inertia), change))
    free_torque = max(gains.max_torque - gains.D_m, 0.1 * gains.max_torque)
    return momentum / free_torque + 1.0 / max(gains.K_omega, 1e-3), dot(axis, omega_e)


@kernel
def _model_rate(
    t: float, phi: float, rho: float, ready: float, outward: float, gains: Any
) -> float:
    """φ' [rad/s] of the model: from the present outward rate to the turn rate in `ready` s."""
    turn = -_turn_rate(phi, rho, gains)
    if t >= ready:
        return turn
    part = t / ready
    return outward * (1.0 - part) + turn * part


@kernel
def _hold_time(phi: float, ready: float, outward: float, gains: Any) -> tuple[float, float]:
    """Seconds until the modelled turn is past the hold level under ρ = 1, and φ there."""
    limit = 2.0 * math.asin(_HOLD_ABOVE)
    t, h = 0.0, 0.1
    while t < 3600.0 and (phi > limit or (t < ready and _will_grow(t, ready, outward, phi, limit))):
        phi = min(max(phi + h * _model_rate(t, phi, 1.0, ready, outward, gains), 0.0), math.pi)
        t += h
    return t, phi


@kernel
def _will_grow(t: float, ready: float, outward: float, phi: float, limit: float) -> bool:
    # True if the present outward rate would still carry φ above the hold level.
    remaining = ready - t
    return outward > 0.0 and phi + 0.5 * outward * remaining > limit


@kernel
def _stays_inside(
    stretch: float, clock: float, t: float, phi: float, ready: float, outward: float, gains: Any
) -> bool:
    """True if the modelled turn from φ at t stays inside the envelope stretched so."""
    shape = gains.attitude_shape
    h_clock = (shape.t2 - clock) / _MODEL_STEPS
    h = h_clock * stretch
    for _ in range(_MODEL_STEPS):
        rho = nominal(clock, shape)[0]
        if math.sin(0.5 * phi) > _MODEL_FILL * rho:
            return False
        half = phi + 0.5 * h * _model_rate(t, phi, rho, ready, outward, gains)
        half = min(max(half, 0.0), math.pi)
        middle = nominal(clock + 0.5 * h_clock, shape)[0]
        phi += h * _model_rate(t + 0.5 * h, half, middle, ready, outward, gains)
        phi = min(max(phi, 0.0), math.pi)
        t += h
        clock += h_clock
    return bool(math.sin(0.5 * phi) <= _END_FILL * shape.terminal)


@kernel
def _plan_stretch(plan: Any, phi: float, q: Vector, q0: float, omega_e: Vector, gains: Any) -> None:
    """Set hold and the fastest stretch by bisection on the model of the turn."""
    ready, outward = _acquisition(q, q0, omega_e, gains)
    plan.hold, phi = _hold_time(phi, ready, outward, gains)
    slow, fast = MAX_STRETCH, 1.0
    clock = plan.attitude_clock
    plan.feasible = 1.0
    if _stays_inside(fast, clock, plan.hold, phi, ready, outward, gains):
        plan.stretch = fast
        return
    if not _stays_inside(slow, clock, plan.hold, phi, ready, outward, gains):
        plan.feasible = 0.0
        plan.stretch = slow
        return
    for _ in range(_BISECTIONS):
        middle = math.sqrt(slow * fast)
        if _stays_inside(middle, clock, plan.hold, phi, ready, outward, gains):
            slow = middle
        else:
            fast = middle
    plan.stretch = slow


@kernel
def _rate_clock(q: Vector, q0: float, omega_e: Vector, rho: float, gains: Any) -> float:
    """Where on its table the rate envelope must begin to hold the present z2."""
    v, _ = virtual_control(
        q,
        q0,
        omega_e,
        (rho, rho, rho),
        (0.0, 0.0, 0.0),
        gains.beta,
        gains.k * gains.M_omega,
        gains.norm_form != 0.0,
    )
    return clock_at(largest(subtract(omega_e, v)) / _FILL, gains.rate_shape)


@kernel
def plan_envelopes(plan: Any, t: float, q: Vector, q0: float, omega_e: Vector, gains: Any) -> None:
    """Place both envelopes in time at t [s] for the present error.

    At t = 0 the envelopes begin at the top of their tables, as in the paper; a plan made later
    begins where the present errors fill a part `_FILL` of them. With ``envelope: nominal`` the
    stretch is 1 and nothing waits.
    """
    plan.start = t
    plan.hold = 0.0
    plan.stretch = 1.0
    plan.attitude_clock = 0.0
    plan.rate_clock = 0.0
    if t > 0.0:
        plan.attitude_clock = clock_at(largest(q) / _FILL, gains.attitude_shape)
        rho = nominal(plan.attitude_clock, gains.attitude_shape)[0]
        plan.rate_clock = _rate_clock(q, q0, omega_e, rho, gains)
    phi = 2.0 * math.asin(min(norm(q), 1.0))
    plan.angle_deg = math.degrees(phi)
    if gains.auto != 0.0:
        _plan_stretch(plan, phi, q, q0, omega_e, gains)
    else:
        ready, outward = _acquisition(q, q0, omega_e, gains)
        inside = _stays_inside(1.0, plan.attitude_clock, 0.0, phi, ready, outward, gains)
        plan.feasible = 1.0 if inside else 0.0
    plan.count += 1.0


@kernel
def carry_on(plan: Any, t: float, gains: Any) -> tuple[tuple[float, float], tuple[float, float]]:
    """(ρ_ω0, ρ_ω0') and (ρ_q0, ρ_q0') of the plan at t [s]."""
    since = t - plan.start
    falling = since - plan.hold
    clock = plan.attitude_clock + max(falling, 0.0) / plan.stretch
    rho_q, slope = nominal(clock, gains.attitude_shape)
    rho_q_rate = slope / plan.stretch if falling >= 0.0 else 0.0
    return nominal(plan.rate_clock + since, gains.rate_shape), (rho_q, rho_q_rate)
