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

Attitude, rate and acceleration of the desired motion are continuous at all times, so that a new
goal never throws the error out of its envelope.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.attitude import continued, normalised
from ppc_attitude.science.compiled_stamps import seconds
from ppc_attitude.science.component import Component
from ppc_attitude.science.conditions import Condition, Task, advisable
from ppc_attitude.science.guidance.cones import CONE_PARAMETERS, cones_of, unit_vector
from ppc_attitude.science.guidance.frames import FRAME_NAMES, INERTIAL, frame_bounds
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
    TOO_FAR,
    TOO_FAST,
    TOO_LATE,
    adopt_plan,
    begin,
    motion_now,
    plan_stop,
    plan_to,
)
from ppc_attitude.science.guidance.orders import (
    GOAL_FRAMES,
    GOAL_PARAMETERS,
    GOAL_TIMES,
    HOLD,
    ORDER,
    PROFILE,
    PROFILING,
    Orders,
    scheduled_orders,
)
from ppc_attitude.science.guidance.scene import scene_at, told
from ppc_attitude.science.guidance.sight import look_out, warnings_of
from ppc_attitude.science.guidance.slew import slew_bounds, slew_torque
from ppc_attitude.science.guidance.trajectory import POINTS, append_profile
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.keep_out import MOST_CONES
from ppc_attitude.science.kernel import (
    NO_ATTITUDE,
    STRAIGHT,
    ZERO,
    array_at,
    kernel,
    quaternion,
    store,
    store_quaternion,
)
from ppc_attitude.science.orbit import ORBIT_PARAMETERS, epoch_of, orbit_of
from ppc_attitude.science.parameter import Parameter, at_start
from ppc_attitude.science.plants.rigid_body import INERTIA
from ppc_attitude.science.signals import ATTITUDE, DESIRED_MOTION
from ppc_attitude.science.sky import EARTH_RADIUS, earth_angle

# At the lower bounds a slew takes days, and the search for cones steps along the whole of it.
MAX_RATE = Parameter(
    "guidance.max_rate", math.radians(2.0), "V, rate of a slew", "rad/s", low=1e-5, high=10.0
)
MAX_ACCELERATION = Parameter(
    "guidance.max_acceleration",
    math.radians(0.4),
    "A, acceleration of a slew",
    "rad/s²",
    low=1e-7,
    high=10.0,
)
MAX_JERK = Parameter(
    "guidance.max_jerk", math.radians(0.2), "K, jerk of a slew", "rad/s³", low=1e-12, high=100.0
)
TORQUE_SHARE = at_start(
    "guidance.torque_share",
    0.6,
    "share of the torque limit that `check` allows a slew",
    above=0.0,
    high=1.0,
)
LATITUDE = at_start(
    "target.latitude",
    0.0,
    "latitude of the point that the frame `ground` looks at",
    "rad",
    low=-0.5 * math.pi,
    high=0.5 * math.pi,
)
LONGITUDE = at_start(
    "target.longitude",
    0.0,
    "longitude of the point that `ground` looks at, east",
    "rad",
    low=-math.tau,
    high=math.tau,
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
    "rate of the frame `spin`; from -0.9 to 0.9 guidance.max_rate",
    "rad/s",
    low=-10.0,
    high=10.0,
)

_REASONS = {
    INSIDE_CONE: "the goal is inside keep-out cone {cone}, {measured:.2f}° from its direction; "
    "allowed: at least {allowed:.2f}°",
    NO_WAY: "no path to the goal is found that avoids all keep-out cones; the direct one crosses "
    "{barred}",
    CROSSES: "the path to the goal crosses keep-out cone {cone} at t = {measured:.1f} s; try "
    "another time or another path",
    NO_SLEW: "no slew to the goal is found that keeps guidance.max_rate = {allowed:.6g} rad/s "
    "while the goal's frame turns too; raise guidance.max_rate or guidance.max_acceleration",
    ILL_DEFINED: "the two directions of the frame are {measured:.2f}° from being parallel; "
    "allowed: at least {allowed:.2f}°; try another time",
    SPIN_TOO_FAST: "spin.rate = {measured:.6g} rad/s; allowed: -{allowed:.6g} to {allowed:.6g}, "
    "which is 0.9 guidance.max_rate",
    TOO_LATE: "the slew to the first point ends at t = {measured:.3f} s, after that point's "
    "{allowed:.3f} s; give later times",
    TOO_FAR: "the last point is at t = {measured:.3f} s; allowed with keep-out cones: up to "
    "{allowed:.3f} s, which is a day after the order",
    TOO_FAST: "the path on from the point at t = {allowed:.3f} s needs {measured:.4g} times "
    "guidance.max_rate or guidance.max_acceleration; allowed: 1; give it more time",
}


def configure(values: Mapping[str, Any]) -> tuple[Any, NDArray[Any], NDArray[Any]]:
    """Build the kernel's record and the scheduled orders from checked parameter values.

    Raises
    ------
    ConfigurationError
        Lists of different lengths, an attitude that is not unit, a direction without length, times
        that do not increase, an impossible orbit or date.
    """
    return configuration_of(values, scheduled_orders(values))


def configuration_of(
    values: Mapping[str, Any], orders: Orders
) -> tuple[Any, NDArray[Any], NDArray[Any]]:
    """Record for the step, and the orders and profiles that it refers to, which must be kept.

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
    c, s = math.cos(latitude), math.sin(latitude)
    target = np.array([c * math.cos(longitude), c * math.sin(longitude), s])
    record["sky"]["target"] = EARTH_RADIUS * target
    record["spin_axis"] = unit_vector(SPIN_AXIS.name, values[SPIN_AXIS.name])
    record["spin_rate"] = values[SPIN_RATE.name]
    record["cones"] = cones_of(values)
    listed, profiles = orders
    record["orders"], record["address"] = listed.size, listed.ctypes.data
    record["profiles"], record["profiles_address"] = profiles.size, profiles.ctypes.data
    return record, listed, profiles


@kernel
def obey(order: Any, guidance: Any, state: Any) -> None:
    """Take an order at its stamp, or when the reference began if that was later."""
    t = max(seconds(order.stamp_ns), state.begin)
    if order.frame == HOLD:
        outcome = plan_stop(t, guidance, state)
    elif order.frame == PROFILE:
        profiles = array_at(guidance.profiles_address, guidance.profiles, POINTS)
        points = profiles[order.profile]
        outcome = plan_to(t, INERTIAL, quaternion(points.attitude[0]), guidance, state)
        if outcome == ACCEPTED:
            outcome = append_profile(t, points, guidance, state)
    else:
        outcome = plan_to(t, order.frame, quaternion(order.attitude), guidance, state)
    adopt_plan(t, outcome, state)


@kernel
def _before(stamp_ns: int, orders: Any) -> int:
    """Count the orders before an instant [ns]; they are sorted by time.

    With `np.searchsorted` every process that loads the kernel would import Numba's linear algebra.
    """
    low, high = 0, orders.size
    while low < high:
        middle = (low + high) // 2
        if orders[middle].stamp_ns < stamp_ns:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def step(inputs: Any, state: Any, guidance: Any, outputs: Any) -> None:
    """Take the orders that have come, and give q_d, ω_d [rad/s] and ω_d' [rad/s²].

    Without an attitude (a zero quaternion) nothing has begun: there is no motion yet.
    """
    q = quaternion(inputs.attitude)
    if not state.begun and q != NO_ATTITUDE:
        begin(inputs.t, normalised(q), state)
    if not state.begun:
        store_quaternion(outputs.reference_attitude, STRAIGHT)
        store(outputs.reference_angular_velocity, ZERO)
        store(outputs.reference_angular_acceleration, ZERO)
        return
    orders = array_at(guidance.address, guidance.orders, ORDER)
    first = _before(state.open_ns, orders)
    due = _before(inputs.stamp_ns + 1, orders)
    for i in range(first, due):
        obey(orders[i], guidance, state)
    state.obeyed += due - first
    state.open_ns = inputs.stamp_ns + 1
    look_out(inputs.t, state.plans[state.active], guidance, state.look, state.watch)
    if due > first:
        state.watch.said = state.watch.changes
    q_d, omega_d, acceleration_d = motion_now(inputs.t, guidance, state)
    q_d = continued(q_d, quaternion(state.attitude))
    store_quaternion(state.attitude, q_d)
    store_quaternion(outputs.reference_attitude, q_d)
    store(outputs.reference_angular_velocity, omega_d)
    store(outputs.reference_angular_acceleration, acceleration_d)


def advice(state: Any) -> Advice:
    """The outcome of the last order, or a warning that has come or gone since."""
    watch = state["watch"]
    warnings = warnings_of(watch)
    concern = f"the desired motion {' and '.join(warnings)}" if warnings else ""
    if watch["changes"] > watch["said"]:
        return Advice(concern or "the cause of the last warning is over", warning=bool(warnings))
    if state["obeyed"] == 0:
        return Advice("at rest at the first attitude; no goal yet", warning=False)
    outcome, number = int(state["outcome"]), int(state["obeyed"])
    if outcome != ACCEPTED:
        measured, allowed = float(state["measured"]), float(state["allowed"])
        if outcome == ILL_DEFINED:
            measured, allowed = math.asin(measured), math.asin(allowed)
        degrees = outcome in (INSIDE_CONE, ILL_DEFINED)
        reason = _REASONS[outcome].format(
            cone=int(state["cone"]),
            barred=_named(int(state["barred"])),
            measured=math.degrees(measured) if degrees else measured,
            allowed=math.degrees(allowed) if degrees else allowed,
        )
        text = f"order {number} is refused: {reason}"
        return Advice(f"{text}; {concern}" if concern else text, warning=True)
    plan = state["plans"][state["active"]]
    legs = plan["legs"][: plan["count"]]
    turned = math.degrees(sum(float(leg["profile"][0]) for leg in legs if leg["axis"].any()))
    text = (
        f"order {number} is followed: {FRAME_NAMES[plan['frame']]} frame, turns by "
        f"{turned:.2f}° in {len(legs)} leg{'s' * (len(legs) > 1)}, arrives at t = "
        f"{float(plan['end']):.3f} s"
    )
    inside = int(state["inside"])
    if inside:
        text += f"; it begins inside {_named(inside)} and is led out"
    text += f"; {concern}" if concern and not inside else ""
    return Advice(text, warning=bool(inside or warnings))


def _named(bits: int) -> str:
    """Words for the keep-out cones whose bits are set."""
    numbers = [str(i) for i in range(MOST_CONES) if bits >> i & 1]
    return f"keep-out cone{'s' if len(numbers) > 1 else ''} {', '.join(numbers)}"


def facts(t: float, guidance: Any, state: Any) -> dict[str, Any]:
    """Numbers of the last order and of the scene at t [s], in the form that programs read."""
    plan = state["plans"][state["active"]]
    return {
        "order": int(state["obeyed"]),
        "outcome": int(state["outcome"]),
        "frame": FRAME_NAMES[plan["frame"]],
        "attitude": " ".join(repr(float(x)) for x in plan["attitude"]),
        "end [s]": repr(float(plan["end"])),
        "legs": int(plan["count"]),
        **told(scene_at(t, guidance, state)),
    }


def motion_bounds(values: Mapping[str, Any], duration: float) -> tuple[float, float, float]:
    """Bounds of ‖ω_d‖ [rad/s], ‖ω_d'‖ [rad/s²] and ‖ω_d''‖ [rad/s³] with the scheduled frames.

    They hold whatever is ordered in these frames, and when. A timed profile keeps V and A, but no
    limit of the jerk.
    """
    guidance, names = configure(values)[0], values[GOAL_FRAMES.name]
    each = [
        frame_bounds(number, values[SPIN_RATE.name], guidance["sky"], duration)
        for number, name in enumerate(FRAME_NAMES)
        if name in names
    ]
    V, A, K = (float(values[limit.name]) for limit in (MAX_RATE, MAX_ACCELERATION, MAX_JERK))
    W, W1, W2 = slew_bounds((V, A, K), tuple(map(max, ZERO, ZERO, *each)))
    return W, W1, math.inf if PROFILING in names else W2


def conditions(values: Mapping[str, Any], task: Task) -> Iterator[Condition]:
    """The torque that slews need, and the time in which the goals come."""
    V, A, share = (values[each.name] for each in (MAX_RATE, MAX_ACCELERATION, TORQUE_SHARE))
    spins = "spin" in values[GOAL_FRAMES.name]
    # In a frame that turns by ω_f a slew is accelerated by ω × ω_f too; a spin may be nearly as
    # fast as V.
    crossed = V * abs(values[SPIN_RATE.name]) if spins else 0.0
    if INERTIA.name in task.craft:
        yield advisable(
            "slew torque",
            slew_torque(np.reshape(task.craft[INERTIA.name], (3, 3)), V, A + crossed),
            share * task.torque,
            "N·m",
            f"max‖J e‖ {'(A + V |spin.rate|)' if spins else 'A'} + max‖ω × J ω‖ leaves the law its "
            "margin (guidance.torque_share)",
        )
    times = values[GOAL_TIMES.name]
    if times and task.duration:
        meaning = "all goals begin before the run ends"
        yield advisable("last goal", max(times), task.duration, "s", meaning)


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
    quiet={each.name: each.default for each in GOAL_PARAMETERS},
    advice=advice,
    advices=lambda state: int(state["obeyed"] + state["watch"]["changes"]),
    motion_bounds=motion_bounds,
    conditions=conditions,
)
