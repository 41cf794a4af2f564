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

"""Reaction wheels and their drive electronics: from the commanded torque to motor torques.

A command is the torque on the body besides −ω × Jω. The drive knows rate and wheel speeds, so it
takes the wheels' gyroscopic torque and their friction away, and a law need not know of wheels:

    A u_net = −(τ_cmd + ω × Σ J_s Ω a),   u = u_net + f̂(Ω),   applied = −A (u − f) − ω × Σ J_s Ω a

A wheel that gives nothing of what it is asked for is dropped, and the others give all of it.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science import wheels
from ppc_attitude.science.allocation import (
    FLAT,
    WheelArray,
    allocate,
    certain_torque,
    largest_torque,
)
from ppc_attitude.science.component import MAX_WHEELS, Advice, Component
from ppc_attitude.science.faults import (
    FAULTS,
    OF_A_TORQUE,
    RECORD,
    Failure,
    How,
    acting,
    fails,
    faults_of,
    faulty,
    number_of,
)
from ppc_attitude.science.kernel import add, cross, kernel, scale, store, subtract, vector
from ppc_attitude.science.parameter import Parameter
from ppc_attitude.science.signals import APPLIED_TORQUE, TORQUE_COMMAND, TRUE_RATE
from ppc_attitude.science.stamps import nanoseconds
from ppc_attitude.science.wheels import WHEELS, friction, momentum, wheel_record

NULL_SPEED = Parameter(
    "wheels.null_speed",
    100.0,
    "speed of the fastest wheel when the wheels together have no momentum, for more than three",
    "rad/s",
    low=0.0,
)
NULL_GAIN = Parameter(
    "wheels.null_gain",
    0.02,
    "how fast the wheels go to these speeds, without a torque on the body",
    "1/s",
    low=0.0,
)
KNOWLEDGE = Parameter(
    "wheels.friction_knowledge",
    1.0,
    "share of the friction that the drive takes away; 0: none",
    low=0.0,
    high=2.0,
)
COMPENSATION = Parameter(
    "wheels.gyroscopic_compensation",
    True,
    "true: the drive takes the gyroscopic torque of the wheels away",
)
OVERLOAD = Parameter(
    "wheels.overload",
    "scale",
    "when too much is asked: scale the torque and keep its direction, or clip each wheel's",
    choices=("scale", "clip"),
)
DETECTION_DELAY = Parameter(
    "wheels.detection_delay",
    1.0,
    "after this the drive drops a wheel that gives nothing of what it is asked for",
    "s",
    low=0.0,
    high=1e6,
)
_SEIZING = 0.1  # [s] in which the speed of a wheel that seizes falls to 1/e
_HOW = (*OF_A_TORQUE, Failure(How.DRAG, 1, 1.0), Failure(How.SEIZED))
CONFIGURATION = np.dtype(
    [
        ("wheels", WHEELS),
        ("h", np.float64),  # [s] of a step
        ("null", np.float64, (MAX_WHEELS, MAX_WHEELS)),  # projection on what gives no torque
        ("null_gain", np.float64),  # [1/s]
        ("null_momentum", np.float64, (MAX_WHEELS,)),  # [N·m·s] h*
        ("knowledge", np.float64),
        ("compensation", np.float64),
        ("clips", np.float64),
        ("delay_ns", np.int64),  # [ns] from a wheel's loss to its being dropped
        ("faults", RECORD),
    ],
    align=True,
)
_TRACE = 1e-9  # share of its torque that a full wheel keeps, so that no load is infinite
_LEFT = (
    "none gives torque",
    "the others give torque in a line only",
    "the others give torque in a plane only",
)
STATE = np.dtype(
    [
        ("full", np.int64),  # wheel that first reached its largest speed, counted from 1; 0: none
        ("fastest", np.float64),  # largest share of its speed that a wheel has had
        ("since_ns", np.int64, (MAX_WHEELS,)),  # 1 + first instant [ns] of its loss; 0: none
        ("lost", np.float64, (MAX_WHEELS,)),  # 1 where it is dropped
        ("rank", np.int64),  # how many dimensions the others span
        ("news", np.int64),
        # What a step works with.
        ("low", np.float64, (MAX_WHEELS,)),
        ("high", np.float64, (MAX_WHEELS,)),
        ("given", np.float64, (MAX_WHEELS,)),
        ("net", np.float64, (MAX_WHEELS,)),
        ("null", np.float64, (MAX_WHEELS, MAX_WHEELS)),  # of the wheels that are not lost
    ],
    align=True,
)


def parts_of(values: Mapping[str, Any]) -> dict[str, tuple[Failure, ...]]:
    """Return each wheel by its name, and how it can fail."""
    return {f"wheel/{i}": _HOW for i in range(len(values[wheels.AXES.name]) // 3)}


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values.

    Raises
    ------
    ConfigurationError
        The wheels are impossible, or a fault is none, or friction that a step cannot follow.
    """
    record = np.zeros((), CONFIGURATION)[()]
    record["wheels"] = given = wheel_record(values)
    count = int(given["count"])
    axes = given["axes"][:count]
    free = np.linalg.svd(axes.T)[2][3:].T  # null space, a column each
    record["h"] = 1.0 / values["rate"]
    record["null"][:count, :count] = free @ free.T
    record["null_gain"] = values[NULL_GAIN.name]
    if free.size:
        pattern = free[:, 0] / free[np.argmax(np.abs(free[:, 0])), 0]
        speeds = values[NULL_SPEED.name] * pattern
        record["null_momentum"][:count] = given["inertia"][:count] * speeds
    record["knowledge"] = values[KNOWLEDGE.name]
    record["compensation"] = values[COMPENSATION.name]
    record["clips"] = values[OVERLOAD.name] == "clip"
    record["delay_ns"] = nanoseconds(values[DETECTION_DELAY.name])
    record["faults"] = faults_of(values, parts_of(values))
    for fault in record["faults"]["fault"][: record["faults"]["count"]]:
        if fault["kind"] == How.DRAG:
            wheels.see_that_a_step_follows(
                given, int(fault["part"]), 1.0 / values["rate"], float(fault["value"][0])
            )
    return record


@kernel
def _room(speed: float, i: int, configuration: Any) -> tuple[float, float]:
    """Torques [N·m] that bring a wheel to its largest speed in a step, backwards and forwards."""
    craft = configuration.wheels
    faster = craft.inertia[i] * (craft.max_speed[i] - speed) / configuration.h
    slower = craft.inertia[i] * (craft.max_speed[i] + speed) / configuration.h
    return slower, faster


@kernel
def _taken_away(resistance: float, speed: float, i: int, configuration: Any) -> float:
    """Torque [N·m] of the drive against the friction that it knows of.

    Who believes in more friction than there is speeds the wheel up; not beyond its limits.
    """
    slower, faster = _room(speed, i, configuration)
    most, limit = resistance + max(faster, 0.0), configuration.wheels.max_torque[i]
    least = resistance - max(slower, 0.0)
    known = min(max(configuration.knowledge * resistance, least), most)
    return float(min(max(known, -limit), limit))


@kernel
def _limits(speeds: Any, configuration: Any, state: Any) -> None:
    """Net torque that each wheel can give: by its motor, and by the speed that is left to it."""
    craft = configuration.wheels
    for i in range(craft.count):
        resistance = friction(craft, i, speeds[i])
        slower, faster = _room(speeds[i], i, configuration)
        known = _taken_away(resistance, speeds[i], i, configuration)
        driven = known - resistance
        trace = _TRACE * craft.max_torque[i]
        most = min(craft.max_torque[i] - known, faster - max(driven, 0.0))
        least = max(-craft.max_torque[i] - known, -slower - min(driven, 0.0))
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
    for turn in range(2):  # first how much of it there is room for
        for i in range(craft.count):
            wish = 0.0
            for j in range(craft.count):
                excess = craft.inertia[j] * speeds[j] - configuration.null_momentum[j]
                wish -= configuration.null_gain * state.null[i, j] * excess
            if turn == 1:
                state.net[i] += share * wish
            elif wish > 0.0:
                share = min(share, (state.high[i] - state.net[i]) / wish)
            elif wish < 0.0:
                share = min(share, (state.low[i] - state.net[i]) / wish)
        share = max(share, 0.0)


@kernel
def _failed(motor: float, i: int, speed: float, stamp_ns: int, configuration: Any) -> float:
    """Motor torque [N·m] of a wheel that fails; what its bearing does is told as the motor's."""
    faults, craft = configuration.faults, configuration.wheels
    resistance, limit = friction(craft, i, speed), craft.max_torque[i]
    drag = number_of(faults, i, How.DRAG, stamp_ns, 1.0)
    net = faulty(motor, limit, faults, i, stamp_ns)
    if acting(faults, i, How.SEIZED, stamp_ns) >= 0:
        net = -craft.inertia[i] * speed / max(_SEIZING, configuration.h)
    elif acting(faults, i, How.STUCK, stamp_ns) < 0:  # what is stuck is so at the shaft
        net -= drag * resistance
    slower, faster = _room(speed, i, configuration)
    return float(resistance + min(max(net, -max(slower, 0.0)), max(faster, 0.0)))


@kernel
def _look_for_losses(stamp_ns: int, configuration: Any, state: Any) -> None:
    """Drop each wheel that has given nothing of what it is asked for; take back what gives again.

    Torques of the others that cancel are those without its part: P − P e eᵀ P / eᵀ P e.
    """
    faults, null = configuration.faults, state.null
    null[:] = configuration.null
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
                    weight = null[j, i] / share
                    for k in range(MAX_WHEELS):
                        if j != i and k != i:
                            null[j, k] -= weight * null[i, k]
            null[i, :] = 0.0
            null[:, i] = 0.0
        if lost != state.lost[i]:
            state.news += 1
        state.lost[i] = lost


@kernel
def _watch(speeds: Any, configuration: Any, state: Any) -> None:
    """Note how fast the wheels are, and the first that cannot take up more momentum."""
    craft = configuration.wheels
    for i in range(craft.count):
        speed = abs(speeds[i])
        state.fastest = max(state.fastest, speed / craft.max_speed[i])
        if speed >= craft.full[i] and state.full == 0:
            state.full = i + 1
            state.news += 1


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Share the commanded torque among the wheels; tell what then acts on the body."""
    craft, speeds = configuration.wheels, inputs.wheel_speed
    gyroscopic = cross(vector(inputs.truth_angular_velocity), momentum(craft, speeds))
    asked = vector(inputs.torque_command)
    if configuration.compensation != 0.0:
        asked = add(asked, gyroscopic)
    _limits(speeds, configuration, state)
    _look_for_losses(inputs.stamp_ns, configuration, state)
    array = WheelArray(
        craft.axes, craft.count, state.low, state.high, state.lost, state.given, state.net
    )
    load, state.rank = allocate(scale(-1.0, asked), array)
    _within(configuration, state, load)
    _spread_momentum(speeds, configuration, state)
    applied = scale(-1.0, gyroscopic)
    for i in range(craft.count):
        resistance = friction(craft, i, speeds[i])
        motor = state.net[i] + _taken_away(resistance, speeds[i], i, configuration)
        if fails(configuration.faults, i, inputs.stamp_ns):
            motor = _failed(motor, i, speeds[i], inputs.stamp_ns, configuration)
        outputs.wheel_torque[i] = motor
        applied = subtract(applied, scale(motor - resistance, vector(craft.axes[i])))
    store(outputs.applied_torque, applied)
    _watch(speeds, configuration, state)


def advice(state: Any) -> Advice:
    """Warn of wheels that are lost, and of one that is as fast as it may be."""
    lost = np.flatnonzero(state["lost"]).tolist()
    named = f"wheel{'s' * (len(lost) > 1)} {', '.join(map(str, lost))} lost"
    failed = bool(lost) and int(state["rank"]) < 3
    texts = []
    if failed:
        texts.append(f"{named}: {_LEFT[int(state['rank'])]}")
    elif lost:
        texts.append(f"{named}: the others give the torque")
    if state["full"]:
        texts.append(
            f"wheel {int(state['full']) - 1} has reached its largest speed: it takes up no more "
            "momentum, and torque is lost"
        )
    told = "; ".join(texts) or ("no wheel is lost any more" if state["news"] else "")
    numbers = {
        "fastest wheel [share of its largest speed]": float(state["fastest"]),
        "wheels lost": len(lost),
    }
    return Advice(told, warning=bool(texts), failed=failed, numbers=numbers)


def torques(values: Mapping[str, Any]) -> tuple[float, float]:
    """Torque on an axis [N·m] that the wheels give in any direction, and at most."""
    axes = wheels.axes_of(values)
    limits = np.broadcast_to(values[wheels.MAX_TORQUE.name], len(axes))  # one is for all
    return certain_torque(axes, limits), largest_torque(axes, limits)


COMPONENT = Component(
    name="wheels",
    parameters=(
        *wheels.PARAMETERS,
        NULL_SPEED,
        NULL_GAIN,
        KNOWLEDGE,
        COMPENSATION,
        OVERLOAD,
        DETECTION_DELAY,
        FAULTS,
    ),
    configure=configure,
    configuration=CONFIGURATION,
    state=STATE,
    inputs=(TORQUE_COMMAND, TRUE_RATE, wheels.SPEED),
    outputs=(APPLIED_TORQUE, wheels.TORQUE),
    step=step,
    advice=advice,
    advices=lambda state: int(state["news"]),
    limits=(wheels.MAX_TORQUE.name,),
    torque=torques,
    faults=parts_of,
)
