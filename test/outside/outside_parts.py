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

"""Parts of a craft in a package of somebody else's: nothing of ours names them.

A plant with a state of its own (a fluid ring about each axis), sensors, an estimator, a reference,
a law with one more output than ours have, an environment that pushes by steps, and an actuator that
takes a command now and then.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import (
    euler_step,
    kinematics,
    normalised,
    product,
    unit_quaternion,
)
from ppc_attitude.science.component import (
    BODY,
    EFFORTS,
    INERTIAL,
    QUATERNION,
    VECTOR,
    Column,
    Component,
)
from ppc_attitude.science.conditions import advisable
from ppc_attitude.science.controllers.common import INERTIA, MAX_TORQUE
from ppc_attitude.science.controllers.interface import INPUTS, OUTPUTS, error_state, store_command
from ppc_attitude.science.inertia import inertia_matrix
from ppc_attitude.science.kernel import (
    add,
    apply,
    clamp,
    cross,
    kernel,
    matrix,
    quaternion,
    scale,
    store,
    store_quaternion,
    subtract,
    vector,
)
from ppc_attitude.science.parameter import Parameter, filled, record_type
from ppc_attitude.science.plants import rigid_body
from ppc_attitude.science.signals import (
    APPLIED_TORQUE,
    DESIRED_MOTION,
    DISTURBANCE,
    ENVIRONMENT_TORQUE,
    TOLD,
    TORQUE_COMMAND,
    TRUTH,
)
from ppc_attitude.science.stamps import seconds

_seconds = kernel(seconds)

# Plant: J ω' = τ − ω × (J ω + h) − d, h' = d, d = c (J_r ω − h): total momentum is conserved.
RING_MOMENTUM = Column(
    "ring_momentum",
    "ring/momentum",
    EFFORTS,
    BODY,
    "N·m·s",
    "momentum of each fluid ring",
    width=3,
    part="ring",
)
RING = Parameter("ring.damping", 0.05, "how fast the rings follow the body", "1/s", low=0.0)
_RING_INERTIA = 1e-3  # [kg·m²]
PLANT_CONFIGURATION = np.dtype([("body", rigid_body.CONFIGURATION), ("damping", np.float64)])
PLANT_STATE = np.dtype(
    [
        ("started", np.float64),
        ("stamp_ns", np.int64),
        ("attitude", np.float64, (4,)),
        ("rate", np.float64, (3,)),
        ("momentum", np.float64, (3,)),  # [N·m·s] of the rings relative to the body
    ],
    align=True,
)


def configure_plant(values: Mapping[str, Any]) -> Any:
    """Build the plant's record."""
    record = np.zeros((), PLANT_CONFIGURATION)[()]
    record["body"] = rigid_body.configure(values)
    record["damping"] = values["ring.damping"]
    return record


@kernel
def step_plant(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Carry body and rings to the stamp, by a hundred small steps."""
    body = configuration.body
    if state.started == 0.0:
        state.started = 1.0
        store_quaternion(state.attitude, quaternion(body.initial_attitude))
        store(state.rate, vector(body.initial_rate))
    else:
        inertia, inverse = matrix(body.inertia), matrix(body.inertia_inverse)
        torque = add(vector(inputs.applied_torque), vector(inputs.disturbance_torque))
        q, omega, h = quaternion(state.attitude), vector(state.rate), vector(state.momentum)
        dt = _seconds(inputs.stamp_ns - state.stamp_ns) / 100.0
        for _ in range(100):
            drag = scale(configuration.damping, subtract(scale(_RING_INERTIA, omega), h))
            momentum = add(apply(inertia, omega), h)
            push = subtract(subtract(torque, cross(omega, momentum)), drag)
            q = normalised(euler_step(q, dt, kinematics(q, omega)))
            omega = add(omega, scale(dt, apply(inverse, push)))
            h = add(h, scale(dt, drag))
        store_quaternion(state.attitude, q)
        store(state.rate, omega)
        store(state.momentum, h)
    state.stamp_ns = inputs.stamp_ns
    store_quaternion(outputs.truth_attitude, quaternion(state.attitude))
    store(outputs.truth_angular_velocity, vector(state.rate))
    store(outputs.ring_momentum, vector(state.momentum))


PLANT = Component(
    name="ringed",
    parameters=(*rigid_body.COMPONENT.parameters, RING),
    configure=configure_plant,
    configuration=PLANT_CONFIGURATION,
    state=PLANT_STATE,
    inputs=(APPLIED_TORQUE, DISTURBANCE),
    outputs=(*TRUTH, RING_MOMENTUM),
    step=step_plant,
)

# Sensors: attitude and rate, rounded.
ROUNDED_ATTITUDE = Column(
    "rounded_attitude", "rounded/attitude", QUATERNION, INERTIAL, "1", "attitude, rounded"
)
ROUNDED_RATE = Column(
    "rounded_rate", "rounded/angular_velocity", VECTOR, BODY, "rad/s", "rate, rounded"
)
_LAST_BIT = 1e-6


@kernel
def _rounded(value: float) -> float:
    return math.floor(value / _LAST_BIT + 0.5) * _LAST_BIT


@kernel
def step_sensors(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Round every number."""
    q, omega = inputs.truth_attitude, inputs.truth_angular_velocity
    rounded = (_rounded(q[0]), _rounded(q[1]), _rounded(q[2]), _rounded(q[3]))
    store_quaternion(outputs.rounded_attitude, normalised(rounded))
    store(outputs.rounded_rate, (_rounded(omega[0]), _rounded(omega[1]), _rounded(omega[2])))


SENSORS = Component(
    name="rounding", inputs=TRUTH, outputs=(ROUNDED_ATTITUDE, ROUNDED_RATE), step=step_sensors
)

# Estimator: the mean of the last two rates.
ESTIMATOR_STATE = np.dtype([("started", np.float64), ("rate", np.float64, (3,))], align=True)
RATE_CHANGE = Column(
    "rate_change", "estimator/rate_change", VECTOR, BODY, "rad/s", "change of the measured rate"
)


@kernel
def step_estimator(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Give the attitude as measured, and the mean of the last two rates."""
    rate = vector(inputs.rounded_rate)
    before = vector(state.rate) if state.started != 0.0 else rate
    state.started = 1.0
    store(state.rate, rate)
    store_quaternion(outputs.attitude, quaternion(inputs.rounded_attitude))
    store(outputs.angular_velocity, scale(0.5, add(rate, before)))
    store(outputs.rate_change, subtract(rate, before))


ESTIMATOR = Component(
    name="two_rates",
    state=ESTIMATOR_STATE,
    inputs=(ROUNDED_ATTITUDE, ROUNDED_RATE),
    outputs=(*TOLD, RATE_CHANGE),
    step=step_estimator,
    noise=lambda values, rate: (4.0 * _LAST_BIT**2 / 12.0, 0.0, 0.0),
)

# Reference: a steady turn about one axis.
TURN = Parameter("turn.rate", 0.005, "rate of the turn about z", "rad/s", low=-0.01, high=0.01)
START = Parameter(
    "turn.initial_attitude",
    [0.0, 0.0, 0.0, 1.0],
    "attitude at t = 0, x y z w",
    length=4,
    quaternion=True,
)
TURNED = Column(
    "turned", "turn/turned", VECTOR, BODY, "rad", "angle some time ago", width=2, late=True
)
_EVERY, _AGE = 500_000_000, 0.1  # [ns] between two angles, [s] to their arrival
_SINCE = 10_000_000  # [ns] their first one comes so much after a multiple of that
REFERENCE_CONFIGURATION = np.dtype([("rate", np.float64), ("start", np.float64, (4,))])


def configure_reference(values: Mapping[str, Any]) -> Any:
    """Build the reference's record."""
    record = np.zeros((), REFERENCE_CONFIGURATION)[()]
    record["rate"] = values["turn.rate"]
    record["start"] = unit_quaternion("turn.initial_attitude", values["turn.initial_attitude"])
    return record


@kernel
def step_reference(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Give the turn of an instant."""
    half = 0.5 * configuration.rate * inputs.t
    turn = (0.0, 0.0, math.sin(half), math.cos(half))
    store_quaternion(outputs.reference_attitude, product(quaternion(configuration.start), turn))
    store(outputs.reference_angular_velocity, (0.0, 0.0, configuration.rate))
    store(outputs.reference_angular_acceleration, (0.0, 0.0, 0.0))
    # The first one belongs to before the run.
    arrives = inputs.stamp_ns == 0 or inputs.stamp_ns % _EVERY == _SINCE
    outputs.turned[0] = configuration.rate * (inputs.t - _AGE) if arrives else 0.0
    outputs.turned[1] = _AGE if arrives else 0.0


REFERENCE = Component(
    name="turn",
    parameters=(TURN, START),
    configure=configure_reference,
    configuration=REFERENCE_CONFIGURATION,
    outputs=(*DESIRED_MOTION, TURNED),
    step=step_reference,
    motion_bounds=lambda values, duration: (abs(values["turn.rate"]), 0.0, 0.0),
)

# Law: proportional-derivative, with the share of the actuator that it uses.
USE = Column("torque_use", "control/torque_use", VECTOR, BODY, "1", "share of the limit", width=1)
LAW_CONFIGURATION = np.dtype([("max_torque", np.float64), ("inertia", np.float64, (3, 3))])


def configure_law(values: Mapping[str, Any]) -> Any:
    """Build the law's record."""
    record = np.zeros((), LAW_CONFIGURATION)[()]
    record["max_torque"] = values["max_torque"]
    record["inertia"] = inertia_matrix("inertia", values["inertia"])
    return record


@kernel
def step_law(inputs: Any, state: Any, gains: Any, outputs: Any) -> None:
    """Compute u = −M0 − J (0.02 q_ev + 0.2 ω_e)."""
    inertia = matrix(gains.inertia)
    q_e, omega_e, m_0 = error_state(inputs, inertia)
    sign = -1.0 if q_e[3] < 0.0 else 1.0
    error = scale(0.02 * sign, (q_e[0], q_e[1], q_e[2]))
    u = scale(-1.0, add(m_0, apply(inertia, add(error, scale(0.2, omega_e)))))
    store_command(outputs, q_e, omega_e, u, clamp(u, gains.max_torque))
    outputs.torque_use[0] = max(abs(u[0]), abs(u[1]), abs(u[2])) / gains.max_torque


LAW = Component(
    name="share",
    parameters=(INERTIA, MAX_TORQUE),
    configure=configure_law,
    configuration=LAW_CONFIGURATION,
    inputs=INPUTS,
    outputs=(*OUTPUTS, USE),
    step=step_law,
    conditions=lambda values, task: (
        advisable("room", values["max_torque"], task.actuator_torque, "N·m", "it is given in full"),
    ),
)


# Environment: a push for 30 ms of every half second, by four thrusters in turn.
PUSH = Parameter(
    "push.torques", [0.012] * 4, "torque of each about x", "N·m", low=0.0, high=0.02, length=4
)
PUSHES = record_type(PUSH)


@kernel
def step_environment(inputs: Any, state: Any, given: Any, outputs: Any) -> None:
    """Push, or not."""
    turn, since = divmod(inputs.stamp_ns, 500_000_000)
    push = given.torques[turn % 4] if since < 30_000_000 else 0.0
    store(outputs.environment_torque, (push, 0.0, 0.0))


ENVIRONMENT = Component(
    name="pushes",
    parameters=(PUSH,),
    configure=lambda values: filled(PUSHES, values, "push."),
    configuration=PUSHES,
    outputs=(ENVIRONMENT_TORQUE,),
    step=step_environment,
    bound=lambda values: max(values["push.torques"]),
)


# Actuator: takes a command now and then, and gives its torque until the next one.
HELD = Parameter("held.period", 0.4, "time from a command to the next", "s", low=0.1, high=10.0)
ACTUATOR_STATE = np.dtype([("begun", np.int64), ("torque", np.float64, (3,))], align=True)


@kernel
def step_actuator(inputs: Any, state: Any, held: Any, outputs: Any) -> None:
    """Take a command if its time has come."""
    if inputs.stamp_ns // held.period_ns + 1 != state.begun:
        state.begun = inputs.stamp_ns // held.period_ns + 1
        store(state.torque, vector(inputs.torque_command))
    store(outputs.applied_torque, vector(state.torque))


ACTUATOR = Component(
    name="held",
    parameters=(HELD,),
    configure=lambda values: np.array(
        (round(values["held.period"] * 1e9),), [("period_ns", np.int64)]
    )[()],
    configuration=np.dtype([("period_ns", np.int64)]),
    state=ACTUATOR_STATE,
    inputs=(TORQUE_COMMAND,),
    outputs=(APPLIED_TORQUE,),
    step=step_actuator,
    period=lambda values: float(values["held.period"]),
)
