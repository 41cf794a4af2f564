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

"""A body with wheels and flexible appendages: its equations of motion, and their integration.

    (J − Σ J_s a aᵀ − δᵀδ) ω' = τ − ω × H − Σ (u − f) a + δᵀ (2ζΩη' + Ω²η)
    J_s (Ω_w' + aᵀω')         = u − f
    η'' + 2ζΩη' + Ω²η + δω'   = 0

J is the inertia of the whole, wheels locked and appendages undeformed, and H = J ω + Σ J_s Ω_w a +
δᵀη' its momentum (Hughes, *Spacecraft Attitude Dynamics*; Likins's hybrid coordinates, without
forces on appendages, and changes of J, that are of second order in ω, η and η').
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.attitude import kinematics, normalised
from ppc_attitude.science.compiled_stamps import seconds
from ppc_attitude.science.component import MAX_WHEELS
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import (
    Vector,
    add,
    apply,
    copy,
    cross,
    dot,
    kernel,
    matrix,
    norm,
    quaternion,
    scale,
    store,
    store_quaternion,
    subtract,
    vector,
)
from ppc_attitude.science.parameter import at_start, filled, record_type
from ppc_attitude.science.plants import rigid_body
from ppc_attitude.science.wheels import WHEELS, friction, momentum, steepest

MAX_MODES = 6
_MAX_PHASE = 0.3  # [rad] by which the fastest mode may turn in a step
_PHASE = 0.07  # [rad] in a part of a step; there Runge-Kutta is off by 3e-9 rad after a minute
# Times a speed over which friction bends: where it is smooth again, and what a part may cross.
_SMOOTH, _CROSSED = 10.0, 0.5
FREQUENCY = at_start(
    "flexible.frequency",
    [],
    f"frequency of each mode while the body may move but not turn, up to {MAX_MODES} modes",
    "Hz",
    above=0.0,
)
DAMPING = at_start("flexible.damping", [], "damping ratio of each mode", low=0.0, high=0.99)
COUPLING = at_start(
    "flexible.coupling",
    [],
    "coupling δ of each mode with the body's rotation about the craft's centre of mass, three "
    "numbers a mode, body axes",
    "kg^½·m",
    length=-3,
)
PARAMETERS = (*rigid_body.COMPONENT.parameters, FREQUENCY, DAMPING, COUPLING)
_MODES = record_type(
    ("count", np.int64),
    ("frequency", np.float64, (MAX_MODES,)),  # Ω [rad/s] while the body does not turn
    ("damping", np.float64, (MAX_MODES,)),  # ζ
    ("coupling", np.float64, (MAX_MODES, 3)),  # δ [kg^½·m] body
    ("fastest", np.float64),  # [rad/s] of the craft that is free, damping included
)
CONFIGURATION = record_type(
    ("body", rigid_body.CONFIGURATION),  # its inverse: of J − Σ J_s a aᵀ − δᵀδ
    ("wheels", WHEELS),
    ("modes", _MODES),
)
# Where each part of the motion begins: q, ω, Ω_w, η, η'.
_RATE = 4
_SPEED = _RATE + 3
BEND = _SPEED + MAX_WHEELS
BEND_RATE = BEND + MAX_MODES
_SIZE = BEND_RATE + MAX_MODES
STATE = record_type(
    ("started", np.float64),
    ("stamp_ns", np.int64),  # of the motion below
    ("motor", np.float64, (MAX_WHEELS,)),  # [N·m] u, held over the step
    ("motion", np.float64, (_SIZE,)),
    # Scratch memory of the integration.
    ("between", np.float64, (_SIZE,)),
    ("slopes", np.float64, (_SIZE,)),
    ("sum", np.float64, (_SIZE,)),
)


def multibody_record(values: Mapping[str, Any], wheels: Any) -> Any:
    """Record of dtype `CONFIGURATION` from checked parameter values and a record of the wheels.

    Raises
    ------
    ConfigurationError
        Lists of different lengths, wheels or modes with more inertia than the craft, a mode too
        fast for the steps, or damped too fast, or friction that the steps cannot follow.
    """
    body, modes = rigid_body.configure(values), _modes(values)
    record = filled(CONFIGURATION, values, body=body, wheels=wheels, modes=modes)
    inertia = body["inertia"]
    spin = wheels["axes"].T * wheels["inertia"] @ wheels["axes"]
    rest = inertia - spin - modes["coupling"].T @ modes["coupling"]
    if np.linalg.eigvalsh(rest)[0] <= 0.0:
        raise ConfigurationError(
            f"inertia = {inertia.tolist()} kg·m²; allowed: more than that of the wheels, "
            f"{spin.tolist()}, and the modes, {(inertia - spin - rest).tolist()}, together"
        )
    record["body"]["inertia_inverse"] = np.linalg.inv(rest)
    _see_that_steps_follow(record)
    record["modes"]["fastest"] = _fastest(values, modes, inertia - spin)
    return record


def _see_that_steps_follow(craft: Any) -> None:
    """Refuse friction that would reverse the wheels within a step.

    Friction also turns the craft after its wheels. If these hold much of the craft's inertia, their
    relative speed falls the faster.
    """
    wheels, turning = craft["wheels"], slice(craft["wheels"]["count"])
    axes, inertia = wheels["axes"][turning], wheels["inertia"][turning]
    answer = np.diag(1.0 / inertia) + axes @ craft["body"]["inertia_inverse"] @ axes.T
    rates = np.linalg.eigvals(steepest(wheels, turning)[:, None] * answer).real  # [1/s]
    decay = float(wheels["h"] * max(rates, default=0.0))
    if decay > 1.0:
        raise ConfigurationError(
            f"wheels.inertia = {inertia.tolist()} kg·m²: in a step of {wheels['h']:g} s friction "
            f"takes {decay:.6g} times the speed of such wheels on a craft of inertia = "
            f"{craft['body']['inertia'].tolist()} kg·m²; allowed: at most 1, by less friction, a "
            "larger wheels.transition_speed, or rate"
        )


def _modes(values: Mapping[str, Any]) -> Any:
    record = np.zeros((), _MODES)[()]
    frequency, damping = values[FREQUENCY.name], values[DAMPING.name]
    coupling = np.reshape(values[COUPLING.name], (-1, 3))
    count = len(frequency)
    if count > MAX_MODES or not len(damping) == len(coupling) == count:
        raise ConfigurationError(
            f"{FREQUENCY.name} has {count} modes, {DAMPING.name} {len(damping)}, {COUPLING.name} "
            f"{len(coupling)}; allowed: as many of each, at most {MAX_MODES}"
        )
    record["count"] = count
    record["frequency"][:count] = np.multiply(2.0 * math.pi, frequency)
    record["damping"][:count] = damping
    record["coupling"][:count] = coupling
    return record


def _fastest(values: Mapping[str, Any], modes: Any, inertia: NDArray[np.float64]) -> float:
    """Largest frequency of a mode, or rate of its damping, with the body free [rad/s].

    With the body free both are larger than with the body held. A mode that turns too far in a step,
    or that damping would reverse in a step, is refused.
    """
    delta, rate = modes["coupling"], float(values["rate"])
    mass = np.eye(MAX_MODES) - delta @ np.linalg.solve(inertia, delta.T)
    squares = np.linalg.eigvals(np.linalg.solve(mass, np.diag(modes["frequency"] ** 2)))
    free = math.sqrt(max(squares.real)) / (2.0 * math.pi)  # [Hz]
    fastest = _MAX_PHASE * rate / (2.0 * math.pi)
    if free > fastest:
        raise ConfigurationError(
            f"{FREQUENCY.name} = {values[FREQUENCY.name]} Hz: the fastest mode swings with "
            f"{free:.3g} Hz; allowed at rate = {rate:g} Hz: up to {fastest:.3g}"
        )
    damping = np.diag(2.0 * modes["damping"] * modes["frequency"])
    decay = float(max(np.linalg.eigvals(np.linalg.solve(mass, damping)).real)) / rate
    if decay > 1.0:
        raise ConfigurationError(
            f"{DAMPING.name} = {values[DAMPING.name]}: in a step of {1.0 / rate:g} s it takes "
            f"{decay:.3g} times the speed of a mode; allowed: at most 1, by less damping, less "
            f"{COUPLING.name}, or a larger rate"
        )
    return max(2.0 * math.pi * free, decay * rate)


@kernel
def _slopes(y: Any, motor: Any, torque: Vector, craft: Any, slopes: Any) -> None:
    """Derivative of the motion y; the external torque [N·m] is in body axes."""
    wheels, modes = craft.wheels, craft.modes
    omega = vector(y[_RATE:])
    H = add(apply(matrix(craft.body.inertia), omega), momentum(wheels, y[_SPEED:]))  # [N·m·s]
    for i in range(wheels.count):
        net = motor[i] - friction(wheels, i, y[_SPEED + i])
        slopes[_SPEED + i] = net / wheels.inertia[i]
        torque = subtract(torque, scale(net, vector(wheels.axes[i])))
    for i in range(modes.count):
        coupling, swing = vector(modes.coupling[i]), modes.frequency[i]
        H = add(H, scale(y[BEND_RATE + i], coupling))
        restoring = 2.0 * modes.damping[i] * swing * y[BEND_RATE + i] + swing * swing * y[BEND + i]
        slopes[BEND + i] = y[BEND_RATE + i]
        slopes[BEND_RATE + i] = -restoring
        torque = add(torque, scale(restoring, coupling))
    torque = subtract(torque, cross(omega, H))
    acceleration = apply(matrix(craft.body.inertia_inverse), torque)
    store_quaternion(slopes, kinematics(quaternion(y), omega))
    store(slopes[_RATE:], acceleration)
    for i in range(wheels.count):
        slopes[_SPEED + i] -= dot(vector(wheels.axes[i]), acceleration)
    for i in range(modes.count):
        slopes[BEND_RATE + i] -= dot(vector(modes.coupling[i]), acceleration)


@kernel
def _nutation(speeds: Any, craft: Any) -> float:
    """Rate λ [rad/s] at which the momentum h of the wheels makes the body nutate.

    Of ω' = −N (ω × h), N = (J − Σ J_s a aᵀ − δᵀδ)⁻¹, the eigenvalues are 0 and ±iλ, and λ² is
    hᵀ adj(N) h. The adjugate of the symmetric N has the columns N2 × N3, N3 × N1 and N1 × N2.
    """
    h, (x, y, z) = momentum(craft.wheels, speeds), matrix(craft.body.inertia_inverse)
    turned = add(add(scale(h[0], cross(y, z)), scale(h[1], cross(z, x))), scale(h[2], cross(x, y)))
    return math.sqrt(max(dot(h, turned), 0.0))


@kernel
def _parts(state: Any, craft: Any, h: float) -> int:
    """Number of parts into which a step of h [s] is divided.

    While a wheel crosses zero, its friction changes its sign within the transition speed, which a
    motor crosses in less than a step; undivided, one crossing at full torque puts a wheel off by
    1e-3 rad/s. A small wheel may cross the Stribeck speed in a step, too. A hit can spin a small
    craft fast, and wheels can make it nutate by more than a radian in a slow step; undivided, that
    would be damped within seconds, or grow. Undivided, a mode that swings by 0.3 rad in a step puts
    the rate off by 1e-5 rad/s.
    """
    wheels, rate = craft.wheels, norm(vector(state.motion[_RATE:]))
    swung = h * float(craft.modes.fastest) / _PHASE
    turned = h * max(rate, _nutation(state.motion[_SPEED:], craft)) / rigid_body.TURNED
    most = max(1.0, swung, turned)
    for i in range(wheels.count):
        if wheels.static[i] == 0.0:
            continue
        change = h * (abs(state.motor[i]) + wheels.static[i]) / wheels.inertia[i]  # [rad/s]
        for bend in (wheels.transition_speed[i], wheels.stribeck_speed[i]):
            if abs(state.motion[_SPEED + i]) < change + _SMOOTH * bend:
                most = max(most, change / (_CROSSED * bend))
    return math.ceil(min(most, rigid_body.MOST_PARTS))


@kernel
def _integrate(state: Any, torque: Vector, craft: Any, h: float) -> None:
    """Carry the motion over h [s], torques held: classical Runge-Kutta."""
    motion, between, slopes, total = state.motion, state.between, state.slopes, state.sum
    copy(between, motion)
    total[:] = 0.0
    for stage in range(4):
        _slopes(between, state.motor, torque, craft, slopes)
        weight = 2.0 if stage in (1, 2) else 1.0  # a tuple: a set would be built each time
        ahead = h if stage == 2 else 0.5 * h
        for k in range(_SIZE):
            total[k] += weight * slopes[k]
            between[k] = motion[k] + ahead * slopes[k]
    for k in range(_SIZE):
        motion[k] += h / 6.0 * total[k]
    store_quaternion(motion, normalised(quaternion(motion)))


@kernel
def move(stamp_ns: int, torque: Vector, state: Any, craft: Any) -> None:
    """Carry the motion to a stamp [ns] under an external torque [N·m] held since the last one."""
    if state.started == 0.0:
        state.started = 1.0
        store_quaternion(state.motion, quaternion(craft.body.initial_attitude))
        store(state.motion[_RATE:], vector(craft.body.initial_rate))
        copy(state.motion[_SPEED:BEND], craft.wheels.initial_speed)
    elif stamp_ns > state.stamp_ns:
        h = seconds(stamp_ns - state.stamp_ns)
        parts = _parts(state, craft, h)
        for _ in range(parts):
            _integrate(state, torque, craft, h / parts)
    state.stamp_ns = stamp_ns


@kernel
def tell(state: Any, outputs: Any) -> None:
    """Write the true attitude, x y z w, and rate [rad/s] to the outputs."""
    store_quaternion(outputs.truth_attitude, quaternion(state.motion))
    store(outputs.truth_angular_velocity, vector(state.motion[_RATE:]))


@kernel
def move_with_wheels(inputs: Any, torque: Vector, state: Any, craft: Any, outputs: Any) -> None:
    """Carry the motion as `move` does, with motor torques; write it and the wheels' speeds."""
    copy(state.motor, inputs.wheel_torque)
    move(inputs.stamp_ns, torque, state, craft)
    tell(state, outputs)
    copy(outputs.wheel_speed, state.motion[_SPEED:BEND])
