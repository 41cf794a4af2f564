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

"""The momentum-tube law: convergence inside an envelope that is proved for its numbers.

The law commands the rate error v = p ω_res − r f(φ; V_e) n. The residual ω_res of the last event
fades with p; then the error φ falls along its axis n as fast as brake, torque and rate limit allow
(`brake`). Every change of p, σ and r is allocated within the torque that is left, so the momentum
error y = J (ω_e − v) never leaves its tube Y, and φ never passes Φ. Whether that holds for given
numbers is checked by `science.guarantee`; docs/guarantee.md has the theorem and its proof.
"""

import math
from typing import Any

from ppc_attitude.science.attitude import continued
from ppc_attitude.science.component import Component
from ppc_attitude.science.controllers.brake import (
    axis_rate,
    capped_brake,
    deceleration,
    error_axis,
    speed_limit,
)
from ppc_attitude.science.controllers.common import ATTITUDE_ENVELOPE
from ppc_attitude.science.controllers.interface import INPUTS, OUTPUTS, error_state, store_command
from ppc_attitude.science.controllers.tube_parameters import (
    CONFIGURATION,
    LAW,
    PARAMETERS,
    configure,
)
from ppc_attitude.science.controllers.tube_state import (
    LOSS_LASTS,
    MEMORY,
    MOMENTUM_ERROR,
    MOMENTUM_TUBE,
    PHASE,
    TURN,
    TURN_ENVELOPE,
    advice,
    hear,
    is_hit,
    phase,
    slip,
    tell,
    watch,
)
from ppc_attitude.science.kernel import (
    ZERO,
    Matrix,
    Quaternion,
    Vector,
    add,
    apply,
    clamp,
    dot,
    kernel,
    largest,
    matrix,
    norm,
    quaternion,
    scale,
    store,
    store_quaternion,
    subtract,
    vector,
)

_OBSERVER_RATE = 1.0  # L [1/s] of the disturbance estimate
_FEEDFORWARD = 0.15  # share of the torque B that feedforward needs, so that the brake cannot use it
LANDED = 1e-9  # a ramp this near its end is at its end: the time between stamps is rounded
_TUMBLING_ENDS = 0.95  # share of omega0 below which the tumbling mode ends


@kernel
def room(feedforward: Vector, direction: Vector, limit: Vector) -> float:
    """Largest m ≥ 0 with |F + m c| ≤ B [N·m] on all axes; infinite if c is zero."""
    most = math.inf
    for i in range(3):
        if direction[i] > 0.0:
            most = min(most, (limit[i] - feedforward[i]) / direction[i])
        elif direction[i] < 0.0:
            most = min(most, (limit[i] + feedforward[i]) / -direction[i])
    return max(most, 0.0)


@kernel
def _advance(memory: Any, gains: Any, h: float) -> None:
    """Carry ramps and envelope Φ over the h [s] since the last sample."""
    reach = max(memory.envelope - h * memory.cap, 0.0)
    whole = max(h, gains.h)  # in a shorter sample the errors of V and a are not smaller
    floor = max(memory.cap - whole * gains.V_rate, 0.0)
    a = max(memory.a - whole * gains.a_rate, 0.0)
    fall = memory.r * capped_brake(reach, gains.k, a, floor)[0]
    memory.envelope += h * (memory.p * norm(vector(memory.residual)) + gains.z_bar - fall)
    memory.p = max(memory.p + h * memory.p_rate, 0.0)
    memory.r = min(memory.r + h * memory.r_rate, 1.0)
    memory.sigma += h * memory.sigma_rate
    if memory.p < LANDED:
        memory.p = 0.0
    if memory.r > 1.0 - LANDED:
        memory.r = 1.0


@kernel
def _begin(memory: Any, gains: Any, n: Vector, phi: float, limit: float, omega_e: Vector) -> None:
    """Event: plan from the present state, which puts y at zero whatever the state is."""
    memory.events += 1.0
    tell(memory)
    memory.certified = gains.certified
    memory.p = 1.0
    memory.envelope = phi + gains.e_A
    if phi < gains.far or norm(omega_e) > gains.w_far:
        memory.r, memory.done, memory.sigma = 0.0, 1.0, 0.0
    else:
        memory.r, memory.done = 1.0, 0.0
        memory.sigma = min(max(-dot(n, omega_e), 0.0), limit)  # useful speed is kept
    store(memory.residual, add(omega_e, scale(memory.r * memory.sigma, n)))


@kernel
def _tumble(memory: Any, gains: Any, momentum: Vector) -> Vector:
    """Torque [N·m] that takes the craft's own momentum [N·m·s] away; nothing is tracked."""
    memory.tumbling = 1.0
    memory.phi, memory.envelope = math.pi, 2.0 * math.pi
    return scale(-gains.max_torque, clamp(scale(1.0 / gains.tumbling_momentum, momentum), 1.0))


@kernel
def ramp_torque(memory: Any, gains: Any, y: Vector) -> Vector:
    """Torque [N·m] that F may use while a ramp moves: B from half the tube on, B_ramp near y = 0.

    B keeps y inside its tube whatever the disturbance does, which only matters near the edge.
    """
    if memory.loss > 0.0:
        return scale(1.0 - memory.loss, vector(gains.B))
    most = (0.0, 0.0, 0.0)
    for i in range(3):
        inside = min(max(2.0 - 4.0 * abs(y[i]) / gains.Y[i], 0.0), 1.0)
        more = gains.B[i] + inside * max(gains.B_ramp - gains.B[i], 0.0)
        most = (most[1], most[2], more)  # after three turns x, y and z are in order
    return most


@kernel
def _allocated(
    memory: Any,
    gains: Any,
    feedforward: Vector,
    inertia: Matrix,
    n: Vector,
    fall: Vector,
    y: Vector,
) -> Vector:
    """Set the rates of p, σ and r to what the torque allows; F = M0 − J v' [N·m] with them.

    `fall` has f [rad/s], f_V and V [rad/s].
    """
    f, f_cap, limit = fall
    memory.p_rate, memory.r_rate, memory.sigma_rate = 0.0, 0.0, 0.0
    bound = ramp_torque(memory, gains, y)
    if memory.p > 0.0:
        direction = apply(inertia, vector(memory.residual))
        change = min(room(feedforward, direction, bound), memory.p / gains.h)
        memory.p_rate = -change
    elif memory.done == 0.0:
        direction = scale(f_cap, apply(inertia, n))
        change = min(room(feedforward, direction, bound), (limit - memory.sigma) / gains.h)
        memory.sigma_rate = change
    elif memory.r < 1.0:
        direction = scale(f, apply(inertia, n))
        change = min(min(room(feedforward, direction, bound), gains.k), (1.0 - memory.r) / gains.h)
        memory.r_rate = change
    else:
        return feedforward
    return add(feedforward, scale(change, direction))


@kernel
def _observe(memory: Any, gains: Any, y: Vector, unexplained: Vector, h: float) -> None:
    """Momentum observer ŷ and disturbance estimate d̂ from the sample before."""
    d_hat = vector(memory.d_hat)
    pushed = add(add(vector(memory.feedforward), vector(memory.torque)), d_hat)
    expected = add(vector(memory.y_hat), scale(h, pushed))
    store(memory.y_hat, add(expected, scale(gains.ell, subtract(y, expected))))
    correction = scale(_OBSERVER_RATE * h, subtract(unexplained, d_hat))
    store(memory.d_hat, clamp(add(d_hat, correction), gains.d_max))


@kernel
def step(measurement: Any, memory: Any, gains: Any, command: Any) -> None:
    """Compute one sample of the law: reads `measurement`, updates `memory`, fills `command`."""
    inertia = matrix(gains.inertia)
    q_e, omega_e, m_0 = error_state(measurement, inertia)
    # The sign of q_e tells the way round, so a sign that a sensor or estimator flips is undone.
    q_e = continued(q_e, quaternion(memory.error))
    store_quaternion(memory.error, q_e)
    begins = memory.numbers != gains.numbers  # at the first sample, and when numbers have changed
    h = 0.0 if begins else measurement.t - memory.t
    if h > 0.0 and memory.tumbling == 0.0:
        _advance(memory, gains, h)
    if begins:
        memory.numbers, memory.events, memory.told_at = gains.numbers, 0.0, -math.inf
    event = begins
    memory.t = measurement.t
    if memory.tumbling != 0.0:
        event = norm(omega_e) <= _TUMBLING_ENDS * gains.omega0
    if memory.tumbling == 0.0 or event:
        _track(measurement, memory, gains, command, q_e, omega_e, m_0, event, h)
    if memory.tumbling != 0.0:
        momentum = apply(inertia, vector(measurement.angular_velocity))
        torque = _tumble(memory, gains, momentum)
        store(memory.y, ZERO)
        store_command(command, q_e, omega_e, torque, torque)
    bound = math.sin(0.5 * min(memory.envelope, math.pi))
    store(command.attitude_envelope, (bound, bound, bound))
    store(command.momentum_error, vector(memory.y))
    store(command.momentum_tube, add(vector(gains.Y), vector(gains.N)))
    command.turn[0] = memory.phi
    command.turn_envelope[0] = memory.envelope
    command.phase[0] = phase(memory)
    command.phase[1] = memory.events


@kernel
def _track(
    measurement: Any,
    memory: Any,
    gains: Any,
    command: Any,
    q_e: Quaternion,
    omega_e: Vector,
    m_0: Vector,
    event: bool,
    h: float,
) -> None:
    """One sample outside the tumbling mode, which it enters at an event with too high a rate."""
    inertia = matrix(gains.inertia)
    unexplained = ZERO
    y = ZERO
    if not event:
        done = memory.done
        n, phi, limit, brake, turn, v = _commanded(measurement, memory, gains, q_e, omega_e)
        y = apply(inertia, subtract(omega_e, v))
        if h > 0.0:
            pushed = add(vector(memory.feedforward), vector(memory.torque))
            unexplained = subtract(scale(1.0 / h, subtract(y, vector(memory.y))), pushed)
            hear(memory, gains, unexplained, h)
            event = is_hit(y, unexplained, memory, gains, h)
            if event and largest(unexplained) <= gains.max_torque:
                slip(memory)  # a weak actuator explains it: no torque from outside is needed
            elif memory.slips > 0.0 and memory.t - memory.slipped_at > LOSS_LASTS:
                memory.slips, memory.loss = 0.0, 0.0
            # In the sample where the cap changes from σ to V, y jumps without torque, as C1 allows.
            if not event and memory.done == done:
                watch(memory, gains, unexplained, h)
            store(memory.unexplained, unexplained)
    if event:
        memory.tumbling = 1.0 if norm(omega_e) > gains.omega0 else 0.0
        if memory.tumbling != 0.0:
            return
        memory.way = 1.0
        n, phi = error_axis(q_e, memory.way)
        lead = min(max(dot(n, vector(memory.ahead)), -gains.lead), gains.lead)
        if phi > math.pi + lead:
            memory.way = -1.0
            n, phi = error_axis(q_e, memory.way)
        limit = _limit(measurement, gains, n, ZERO)[0]
        _begin(memory, gains, n, phi, limit, omega_e)
        n, phi, limit, brake, turn, v = _commanded(measurement, memory, gains, q_e, omega_e)
        y = ZERO
        store(memory.y_hat, ZERO)
        store(memory.d_hat, clamp(vector(memory.d_hat), gains.d_max))  # d_max may have changed
    elif h > 0.0:
        _observe(memory, gains, y, unexplained, h)
    f, f_rate, f_cap = brake
    steepness = f / (2.0 * math.sin(0.5 * phi)) if phi > 0.0 else gains.k  # λ = f ν
    braking = add(scale(f_rate, n), scale(steepness, turn))
    feedforward = add(m_0, scale(memory.r, apply(inertia, braking)))
    feedforward = _allocated(memory, gains, feedforward, inertia, n, (f, f_cap, limit), y)
    # u = −F − κ ŷ − d̂ [N·m], see docs/guarantee.md.
    u = scale(
        -1.0, add(feedforward, add(scale(gains.kappa, vector(memory.y_hat)), vector(memory.d_hat)))
    )
    torque = clamp(u, gains.max_torque)
    store(memory.y, y)
    store(memory.feedforward, feedforward)
    store(memory.torque_before, vector(memory.torque))
    store(memory.torque, torque)
    memory.phi = phi
    store_command(command, q_e, omega_e, u, torque)


@kernel
def _limit(measurement: Any, gains: Any, n: Vector, n_rate: Vector) -> tuple[float, float]:
    """V [rad/s] and V' [rad/s²] for the reference that is measured."""
    omega_d = vector(measurement.reference_angular_velocity)
    acceleration_d = vector(measurement.reference_angular_acceleration)
    return speed_limit(n, n_rate, omega_d, acceleration_d, gains.Omega_e)


@kernel
def _commanded(
    measurement: Any, memory: Any, gains: Any, q_e: Quaternion, omega_e: Vector
) -> tuple[Vector, float, float, Vector, Vector, Vector]:
    """n, φ, V, (f, f', f_V), 2 sin(φ/2) n' and v with the memory's way and ramps; sets V_e, a."""
    n, phi = error_axis(q_e, memory.way)
    turn = axis_rate(n, phi, omega_e)
    n_rate = scale(0.5 / math.sin(0.5 * phi), turn) if n != ZERO else ZERO
    limit, limit_rate = _limit(measurement, gains, n, n_rate)
    if memory.sigma >= limit:
        memory.done = 1.0
    memory.cap = limit if memory.done != 0.0 else memory.sigma
    torque = scale(1.0 - memory.loss / (1.0 - _FEEDFORWARD), vector(gains.brake))
    a, a_rate = deceleration(n, n_rate, matrix(gains.inertia), torque, gains.a_most)
    memory.a = a
    f, f_phi, f_cap, f_a = capped_brake(phi, gains.k, a, memory.cap)
    f_rate = f_phi * dot(n, omega_e) + memory.done * f_cap * limit_rate
    if f_a > 0.0:  # where the brake is linear it has no part in f, however fast n turns
        f_rate += f_a * a_rate
    v = subtract(scale(memory.p, vector(memory.residual)), scale(memory.r * f, n))
    return n, phi, limit, (f, f_rate, f_cap), turn, v


COMPONENT = Component(
    name=LAW,
    parameters=PARAMETERS,
    configure=configure,
    configuration=CONFIGURATION,
    state=MEMORY,
    inputs=INPUTS,
    outputs=(
        *OUTPUTS,
        ATTITUDE_ENVELOPE,
        MOMENTUM_ERROR,
        MOMENTUM_TUBE,
        TURN,
        TURN_ENVELOPE,
        PHASE,
    ),
    step=step,
    advice=advice,
    advices=lambda memory: int(memory["told"]),
    observes=True,
)
