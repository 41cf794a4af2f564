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

"""Drive electronics of reaction wheels: from the commanded torque to motor torques.

A command is the torque on the body besides −ω × Jω. The drive knows rate and wheel speeds, so it
takes the wheels' gyroscopic torque and their friction away, and a law need not know of wheels:

    A u_net = −(τ_cmd + ω × Σ J_s Ω a),   u = u_net + f̂(Ω)

A wheel that does not follow its command at all is dropped, and the others give the whole torque.

The drive is part of the craft (`actuators.wheels`), or flight software of its own, in the node that
runs allocators; then its parameters say what it believes of the wheels, which may be wrong.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science import wheels
from ppc_attitude.science.allocation import FLAT, WheelArray, allocate, idle_speeds
from ppc_attitude.science.component import MAX_WHEELS, Component
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import FAULTS, RECORD, How, acting, faults_of, number_of
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kernel import Vector, add, copy, cross, kernel, scale, vector
from ppc_attitude.science.parameter import RATE, Parameter, filled, record_type
from ppc_attitude.science.signals import ANGULAR_VELOCITY, TORQUE_COMMAND
from ppc_attitude.science.stamps import ROUNDING, nanoseconds
from ppc_attitude.science.wheels import TRACE, WHEELS, friction, momentum, room, wheel_record

NULL_SPEED = Parameter(
    "wheels.null_speed",
    100.0,
    "speed of the fastest wheel when the wheels together have no momentum; for four or more wheels",
    "rad/s",
    low=0.0,
)
NULL_GAIN = Parameter(
    "wheels.null_gain",
    0.02,
    "gain of the null-space motion towards null_speed, which gives no torque on the body",
    "1/s",
    low=0.0,
)
KNOWLEDGE = Parameter(
    "wheels.friction_knowledge",
    1.0,
    "fraction of the friction that the drive compensates; 0: none",
    low=0.0,
    high=2.0,
)
COMPENSATION = Parameter(
    "wheels.gyroscopic_compensation",
    True,
    "true: the drive compensates the gyroscopic torque of the wheels",
)
OVERLOAD = Parameter(
    "wheels.overload",
    "scale",
    "when wheels saturate: scale the torque and keep its direction, or clip each wheel's torque",
    choices=("scale", "clip"),
)
DETECTION_DELAY = Parameter(
    "wheels.detection_delay",
    1.0,
    "time after which the drive drops a wheel that has lost its torque",
    "s",
    low=0.0,
    high=1e6,
)
OWN_PARAMETERS = (NULL_SPEED, NULL_GAIN, KNOWLEDGE, COMPENSATION, OVERLOAD, DETECTION_DELAY)
CONFIGURATION = record_type(
    ("wheels", WHEELS),
    ("null", np.float64, (MAX_WHEELS, MAX_WHEELS)),  # projection on what gives no torque
    ("null_momentum", np.float64, (MAX_WHEELS,)),  # [N·m·s] h*
    NULL_GAIN,
    KNOWLEDGE,
    COMPENSATION,
    ("clips", np.float64),
    ("delay_ns", np.int64),  # [ns] from a wheel's loss to its being dropped
    ("faults", RECORD),
)
_LEFT = (
    "no other wheel gives torque",
    "the others give torque along one line only",
    "the others give torque in one plane only",
)
STATE = record_type(
    ("since_ns", np.int64, (MAX_WHEELS,)),  # 1 + first instant [ns] of its loss; 0: none
    ("lost", np.float64, (MAX_WHEELS,)),  # 1 where it is dropped
    ("rank", np.int64),  # how many dimensions the others span
    ("news", np.int64),
    # Scratch memory of a step.
    ("resistance", np.float64, (MAX_WHEELS,)),  # [N·m] friction
    ("low", np.float64, (MAX_WHEELS,)),
    ("high", np.float64, (MAX_WHEELS,)),
    ("given", np.float64, (MAX_WHEELS,)),
    ("net", np.float64, (MAX_WHEELS,)),
    ("null", np.float64, (MAX_WHEELS, MAX_WHEELS)),  # of the wheels that are not lost
)


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values.

    Raises
    ------
    ConfigurationError
        The wheels are impossible, or a fault is invalid.
    """
    given = wheel_record(values)
    count = int(given["count"])
    free = np.linalg.svd(given["axes"][:count].T)[2][3:].T  # null space, a column each
    missing = (0, MAX_WHEELS - count)
    return filled(
        CONFIGURATION,
        values,
        "wheels.",
        wheels=given,
        null=np.pad(free @ free.T, missing),
        null_momentum=np.pad(_null_momentum(free, given, values[NULL_SPEED.name]), missing),
        clips=values[OVERLOAD.name] == "clip",
        delay_ns=nanoseconds(values[DETECTION_DELAY.name]) - ROUNDING,
        faults=faults_of(values, wheels.parts_of(values)),
    )


def _null_momentum(free: Any, craft: Any, fastest: float) -> Any:
    """Momenta [N·m·s] that cancel, with the fastest wheel at a speed [rad/s] that it can have."""
    count = len(free)
    if not free.size:
        return np.zeros(count)
    inertia = craft["inertia"][:count]
    speeds = fastest * idle_speeds(free, inertia)
    for i in np.flatnonzero(np.abs(speeds) > craft["max_speed"][:count]):
        raise ConfigurationError(
            f"{NULL_SPEED.name} = {fastest:g} rad/s brings wheel {i} to {abs(speeds[i]):g} rad/s; "
            f"allowed: at most its {wheels.MAX_SPEED.name} = {craft['max_speed'][i]:g}"
        )
    return inertia * speeds


@kernel
def _taken_away(resistance: float, speed: float, i: int, configuration: Any) -> float:
    """Torque [N·m] of the drive against the friction that it knows of.

    A drive that assumes more friction than there is speeds the wheel up: the limits still hold.
    """
    slower, faster = room(configuration.wheels, i, speed)
    most, limit = resistance + max(faster, 0.0), configuration.wheels.max_torque[i]
    least = resistance - max(slower, 0.0)
    known = min(max(configuration.friction_knowledge * resistance, least), most)
    return float(min(max(known, -limit), limit))


@kernel
def _limits(speeds: Any, configuration: Any, state: Any) -> None:
    """Net torque that each wheel can give: by its motor, and by the speed that is left to it."""
    craft = configuration.wheels
    for i in range(craft.count):
        resistance = state.resistance[i] = friction(craft, i, speeds[i])
        slower, faster = room(craft, i, speeds[i])
        known = _taken_away(resistance, speeds[i], i, configuration)
        driven = known - resistance
        trace = TRACE * craft.max_torque[i]
        most = min(craft.max_torque[i] - known, faster - driven)
        least = max(-craft.max_torque[i] - known, -slower - driven)
        state.high[i] = max(most, trace)
        state.low[i] = min(least, -trace)


@kernel
def _within(configuration: Any, state: Any, load: float) -> None:
    """Bring the net torques within their limits."""
    for i in range(configuration.wheels.count):
        if configuration.clips != 0.0:
            state.net[i] = min(max(state.net[i], state.low[i]), state.high[i])
        elif load > 1.0:
            state.net[i] /= load


@kernel
def _spread_momentum(speeds: Any, configuration: Any, state: Any) -> None:
    """Lead the wheels' momenta to h* by torques that cancel, within what is left of the limits."""
    craft = configuration.wheels
    share = 1.0
    for sweep in range(2):  # the first finds the share that there is room for, the second adds it
        for i in range(craft.count):
            wish = 0.0
            for j in range(craft.count):
                excess = craft.inertia[j] * speeds[j] - configuration.null_momentum[j]
                wish -= configuration.null_gain * state.null[i, j] * excess
            if sweep == 1:
                state.net[i] += share * wish
            elif wish > 0.0:
                share = min(share, (state.high[i] - state.net[i]) / wish)
            elif wish < 0.0:
                share = min(share, (state.low[i] - state.net[i]) / wish)
        share = max(share, 0.0)


@kernel
def _look_for_losses(stamp_ns: int, configuration: Any, state: Any) -> None:
    """Drop each wheel that has not followed its command for a while; take it back if it does.

    The others' projection on torques that cancel is P − P e eᵀ P / eᵀ P e, with e of the wheel.
    """
    faults, null = configuration.faults, state.null
    for i in range(MAX_WHEELS):
        copy(null[i], configuration.null[i])
    for i in range(configuration.wheels.count):
        useless = (
            number_of(faults, i, How.EFFECTIVENESS, stamp_ns, 1.0) == 0.0
            or acting(faults, i, How.STUCK, stamp_ns) >= 0
            or acting(faults, i, How.SEIZED, stamp_ns) >= 0
        )
        if not useless:
            state.since_ns[i] = 0
        elif state.since_ns[i] == 0:
            state.since_ns[i] = stamp_ns + 1
        lost = 0.0
        if useless and stamp_ns + 1 - state.since_ns[i] >= configuration.delay_ns:
            lost = 1.0
            share = null[i, i]
            if share > FLAT * FLAT:
                for j in range(MAX_WHEELS):
                    if j != i:
                        weight = null[j, i] / share
                        for k in range(MAX_WHEELS):
                            null[j, k] -= weight * null[i, k]
            null[i, :] = 0.0
            null[:, i] = 0.0
        if lost != state.lost[i]:
            state.news += 1
        state.lost[i] = lost


@kernel
def share(inputs: Any, rate: Vector, state: Any, configuration: Any, motors: Any) -> None:
    """Share a commanded torque among the wheels.

    Parameters
    ----------
    inputs
        Record with the instant, the commanded torque τ_cmd [N·m] on the body besides −ω × Jω, body
        axes, and the speed of each wheel [rad/s].
    rate
        Angular velocity ω [rad/s] as the drive knows it, body axes.
    state, configuration
        Records of dtype `STATE` and `CONFIGURATION`.
    motors
        Where the motor torque u of each wheel [N·m] is written.
    """
    craft, speeds = configuration.wheels, inputs.wheel_speed
    asked = vector(inputs.torque_command)
    if configuration.gyroscopic_compensation != 0.0:
        asked = add(asked, cross(rate, momentum(craft, speeds)))
    _limits(speeds, configuration, state)
    _look_for_losses(inputs.stamp_ns, configuration, state)
    array = WheelArray(
        craft.axes, craft.count, state.low, state.high, state.lost, state.given, state.net
    )
    load, state.rank = allocate(scale(-1.0, asked), array)
    _within(configuration, state, load)
    _spread_momentum(speeds, configuration, state)
    for i in range(craft.count):
        motors[i] = state.net[i] + _taken_away(state.resistance[i], speeds[i], i, configuration)


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Share the commanded torque, with the angular velocity that the law is told, too."""
    rate = vector(inputs.angular_velocity)
    share(inputs, rate, state, configuration, outputs.wheel_torque_command)


def advice(state: Any) -> Advice:
    """Warn of wheels that are lost."""
    lost = np.flatnonzero(state["lost"]).tolist()
    named = f"wheel{'s' * (len(lost) > 1)} {', '.join(map(str, lost))} lost"
    failed = bool(lost) and int(state["rank"]) < 3
    told = "no wheel is lost any more" if state["news"] else ""
    if failed:
        told = f"{named}: {_LEFT[int(state['rank'])]}"
    elif lost:
        told = f"{named}: the others give the torque"
    return Advice(told, warning=bool(lost), failed=failed, numbers={"wheels lost": len(lost)})


COMPONENT = Component(
    name="wheel_drive",
    parameters=(*wheels.PARAMETERS, RATE, *OWN_PARAMETERS, FAULTS),
    configure=configure,
    configuration=CONFIGURATION,
    state=STATE,
    inputs=(TORQUE_COMMAND, ANGULAR_VELOCITY, wheels.SPEED),
    outputs=(wheels.COMMAND,),
    step=step,
    advice=advice,
    advices=lambda state: int(state["news"]),
    quiet=wheels.QUIET,
    faults=wheels.parts_of,
)
