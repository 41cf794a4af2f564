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

"""Goals as the reference: rest at the craft's first attitude, then slews to whatever is ordered.

The desired motion is continuous for ever, attitude, rate and acceleration: a new goal never throws
the error out of its envelope.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.attitude import normalised
from ppc_attitude.science.component import Advice, Component
from ppc_attitude.science.guidance.cones import CONE_PARAMETERS, cones_of, unit_vector
from ppc_attitude.science.guidance.frames import FRAME_NAMES
from ppc_attitude.science.guidance.goals import (
    ACCEPTED,
    CROSSES,
    GUIDANCE,
    ILL_DEFINED,
    INSIDE_CONE,
    NO_SLEW,
    NO_WAY,
    SPIN_TOO_FAST,
    STATE,
    TOO_FAST,
    TOO_LATE,
    begin,
    hold,
    motion_now,
    pursue,
)
from ppc_attitude.science.guidance.orders import (
    GOAL_PARAMETERS,
    HOLD,
    ORDER,
    PROFILE,
    scheduled_orders,
)
from ppc_attitude.science.guidance.trajectory import POINTS, follow
from ppc_attitude.science.keep_out import MOST_CONES
from ppc_attitude.science.kernel import array_at, kernel, quaternion, store, store_quaternion
from ppc_attitude.science.orbit import EARTH_RADIUS
from ppc_attitude.science.orbit_elements import ORBIT_PARAMETERS, epoch_of, orbit_of
from ppc_attitude.science.parameter import Parameter
from ppc_attitude.science.signals import ATTITUDE, DESIRED_MOTION
from ppc_attitude.science.sky import earth_angle
from ppc_attitude.science.stamps import seconds

MAX_RATE = Parameter(
    "guidance.max_rate", math.radians(2.0), "V, rate of a slew", "rad/s", above=0.0, high=10.0
)
MAX_ACCELERATION = Parameter(
    "guidance.max_acceleration",
    math.radians(0.4),
    "A, acceleration of a slew",
    "rad/s²",
    above=0.0,
    high=10.0,
)
MAX_JERK = Parameter(
    "guidance.max_jerk", math.radians(0.2), "K, jerk of a slew", "rad/s³", above=0.0, high=100.0
)
TORQUE_SHARE = Parameter(
    "guidance.torque_share",
    0.6,
    "share of the torque limit that `check` allows a slew",
    above=0.0,
    high=1.0,
)
LATITUDE = Parameter(
    "target.latitude",
    0.0,
    "latitude of the point that the frame `ground` looks at",
    "rad",
    low=-0.5 * math.pi,
    high=0.5 * math.pi,
    read_only=True,
)
LONGITUDE = Parameter(
    "target.longitude",
    0.0,
    "its longitude, east",
    "rad",
    low=-math.tau,
    high=math.tau,
    read_only=True,
)
SPIN_AXIS = Parameter(
    "spin.axis",
    [0.0, 0.0, 1.0],
    "axis that the frame `spin` turns about, body axes; normalised",
    length=3,
)
SPIN_RATE = Parameter(
    "spin.rate",
    math.radians(1.0),
    "rate of the frame `spin`; up to 0.9 guidance.max_rate",
    "rad/s",
    low=-10.0,
    high=10.0,
)

_REASONS = {
    INSIDE_CONE: "it is inside keep-out cone {cone}; give one outside of it",
    NO_WAY: "no way to it keeps all keep-out cones",
    CROSSES: "the way to it crosses keep-out cone {cone}, which moves meanwhile; try another time",
    NO_SLEW: "no slew to it is found within the limits; raise guidance.max_acceleration",
    ILL_DEFINED: "the two directions of its frame are parallel within 6° now; try another time",
    SPIN_TOO_FAST: "spin.rate is above 0.9 guidance.max_rate; lower it",
    TOO_LATE: "the slew to its first point ends too late; give later times",
    TOO_FAST: "it breaks guidance.max_rate or guidance.max_acceleration; give it more time",
}


def configure(values: Mapping[str, Any]) -> tuple[Any, NDArray[Any]]:
    """Build the kernel's record and the scheduled orders from checked parameter values.

    Raises
    ------
    ConfigurationError
        Lists of different lengths, an attitude that is not unit, a direction that is none, times
        that do not increase, an impossible orbit or date.
    """
    return configuration_of(values, scheduled_orders(values))


def configuration_of(values: Mapping[str, Any], orders: NDArray[Any]) -> tuple[Any, NDArray[Any]]:
    """Record for the step, and the orders that it refers to, which must be kept.

    Raises
    ------
    ConfigurationError
        As of `configure`.
    """
    record = np.zeros((), GUIDANCE)[()]
    record["limits"] = tuple(values[each.name] for each in (MAX_RATE, MAX_ACCELERATION, MAX_JERK))
    record["sky"]["orbit"] = orbit_of(values)
    days = epoch_of(values)
    record["sky"]["days"] = days
    record["sky"]["earth_angle"] = earth_angle(days)
    latitude, longitude = values[LATITUDE.name], values[LONGITUDE.name]
    record["sky"]["target"] = EARTH_RADIUS * np.array(
        [
            math.cos(latitude) * math.cos(longitude),
            math.cos(latitude) * math.sin(longitude),
            math.sin(latitude),
        ]
    )
    record["spin_axis"] = unit_vector(SPIN_AXIS.name, values[SPIN_AXIS.name])
    record["spin_rate"] = values[SPIN_RATE.name]
    record["cones"] = cones_of(values)
    record["orders"], record["address"] = orders.size, orders.ctypes.data
    return record, orders


_seconds = kernel(seconds)


@kernel
def obey(order: Any, guidance: Any, state: Any) -> None:
    """Take an order at its stamp, or at the begin if that was later."""
    t = max(_seconds(order.stamp_ns), state.begin)
    if order.frame == HOLD:
        hold(t, guidance, state)
    elif order.frame == PROFILE:
        follow(t, array_at(order.points, 1, POINTS)[0], guidance, state)
    else:
        pursue(t, order.frame, quaternion(order.attitude), guidance, state)


@kernel
def step(inputs: Any, state: Any, guidance: Any, outputs: Any) -> None:
    """Take the orders that have come, and give q_d, ω_d [rad/s] and ω_d' [rad/s²].

    Without an attitude (a zero quaternion) nothing has begun: there is no motion yet.
    """
    q = quaternion(inputs.attitude)
    if not state.begun and q != (0.0, 0.0, 0.0, 0.0):
        begin(inputs.t, normalised(q), state)
    if not state.begun:
        store_quaternion(outputs.reference_attitude, (0.0, 0.0, 0.0, 1.0))
        store(outputs.reference_angular_velocity, (0.0, 0.0, 0.0))
        store(outputs.reference_angular_acceleration, (0.0, 0.0, 0.0))
        return
    orders = array_at(guidance.address, guidance.orders, ORDER)
    while state.obeyed < guidance.orders and orders[state.obeyed].stamp_ns <= inputs.stamp_ns:
        state.obeyed += 1
        obey(orders[state.obeyed - 1], guidance, state)
    q_d, omega_d, acceleration_d = motion_now(inputs.t, guidance, state)
    last = quaternion(state.attitude)
    if q_d[0] * last[0] + q_d[1] * last[1] + q_d[2] * last[2] + q_d[3] * last[3] < 0.0:
        q_d = (-q_d[0], -q_d[1], -q_d[2], -q_d[3])
    store_quaternion(state.attitude, q_d)
    store_quaternion(outputs.reference_attitude, q_d)
    store(outputs.reference_angular_velocity, omega_d)
    store(outputs.reference_angular_acceleration, acceleration_d)


def advice(state: Any) -> Advice:
    """What came of the last order."""
    if state["obeyed"] == 0:
        return Advice("at rest at the first attitude; no goal yet", warning=False)
    outcome = int(state["outcome"])
    if outcome != ACCEPTED:
        reason = _REASONS[outcome].format(cone=int(state["cone"]))
        return Advice(f"order {int(state['obeyed'])} is refused: {reason}", warning=True)
    plan = state["plans"][state["active"]]
    legs = plan["legs"][: plan["count"]]
    turned = math.degrees(sum(float(leg["profile"][0]) for leg in legs if leg["axis"].any()))
    text = (
        f"order {int(state['obeyed'])} is followed: {FRAME_NAMES[plan['frame']]} frame, turns by "
        f"{turned:.2f}° in {len(legs)} legs, there at t = {float(plan['end']):.3f} s"
    )
    inside = [i for i in range(MOST_CONES) if int(state["inside"]) >> i & 1]
    if inside:
        text += f"; it begins inside keep-out cone {', '.join(map(str, inside))} and is led out"
    return Advice(text, warning=bool(inside))


def facts(state: Any) -> dict[str, Any]:
    """Numbers of the last order, for who reads them by machine."""
    plan = state["plans"][state["active"]]
    return {
        "order": int(state["obeyed"]),
        "outcome": int(state["outcome"]),
        "frame": FRAME_NAMES[plan["frame"]],
        "attitude": " ".join(repr(float(x)) for x in plan["attitude"]),
        "end [s]": repr(float(plan["end"])),
        "legs": int(plan["count"]),
    }


def advices(state: Any) -> int:
    """Return how many orders were obeyed."""
    return int(state["obeyed"])


COMPONENT = Component(
    name="goal",
    parameters=(
        MAX_RATE,
        MAX_ACCELERATION,
        MAX_JERK,
        TORQUE_SHARE,
        *ORBIT_PARAMETERS,
        LATITUDE,
        LONGITUDE,
        SPIN_AXIS,
        SPIN_RATE,
        *CONE_PARAMETERS,
        *GOAL_PARAMETERS,
    ),
    configure=configure,
    configuration=GUIDANCE,
    state=STATE,
    inputs=(ATTITUDE,),
    outputs=DESIRED_MOTION,
    step=step,
    advice=advice,
    advices=advices,
)
