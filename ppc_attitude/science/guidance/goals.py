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

"""Goals: from whatever moves now to rest at a goal, past the keep-out cones, or a reason why not.

A new plan is made beside the present one and takes its place only if it is found.
"""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import normalised, product, rotate
from ppc_attitude.science.guidance.frames import INERTIAL, LEAST_SINE, SKY, SPIN, frame_at
from ppc_attitude.science.guidance.plan import (
    LIMITS,
    LOOK,
    PLAN,
    copy_cursor,
    plan_motion,
    start_plan,
)
from ppc_attitude.science.guidance.rotation import Motion
from ppc_attitude.science.guidance.slew import (
    append_approach,
    append_brake,
    append_slew,
    end_attitude,
)
from ppc_attitude.science.keep_out import (
    CONES,
    FIXED,
    FOUND,
    GOAL_INSIDE,
    NO_CONE,
    SUN,
    angle_between,
    cones_around,
    rest_to_rest,
    route,
    violated,
)
from ppc_attitude.science.kernel import (
    Quaternion,
    Vector,
    kernel,
    norm,
    quaternion,
    scale,
    store,
    store_quaternion,
    vector,
)
from ppc_attitude.science.orbit import orbit_at
from ppc_attitude.science.sky import DAY, sun_direction
from ppc_attitude.science.stamps import seconds

GUIDANCE = np.dtype(
    [
        ("limits", LIMITS),
        ("sky", SKY),
        ("spin_axis", np.float64, (3,)),  # unit, body
        ("spin_rate", np.float64),  # [rad/s]
        ("cones", CONES),
        ("orders", np.int64),  # how many
        ("address", np.uint64),  # of the orders, dtype `ORDER`
    ],
    align=True,
)
STATE = np.dtype(
    [
        ("begun", np.bool_),
        ("begin", np.float64),  # [s]
        ("active", np.int64),  # which of the plans is followed
        ("plans", PLAN, (2,)),
        ("look", LOOK),
        ("obeyed", np.int64),  # orders so far
        ("outcome", np.int64),  # of the last one
        ("inside", np.int64),  # bits of the cones that it began in
        ("cone", np.int64),  # that the last goal was refused for; −1: none
        ("attitude", np.float64, (4,)),  # the last answer, whose sign the next one continues
    ],
    align=True,
)
(
    ACCEPTED,
    INSIDE_CONE,
    NO_WAY,
    CROSSES,
    NO_SLEW,
    ILL_DEFINED,
    SPIN_TOO_FAST,
    TOO_LATE,
    TOO_FAST,
) = range(9)
MOST_SPIN = 0.9  # of V
_SAMPLE = 0.5  # [s] between the samples of a plan whose cones or goal move
_ROUNDS = 5
_TOLERANCE = 1e-9  # [rad] that a sample of an exact plan may be inside by rounding
_NOTHING: Vector = (0.0, 0.0, 0.0)
_STRAIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)
_seconds = kernel(seconds)


@kernel
def directions_at(t: float, cones: Any, sky: Any, cursor: Any) -> Any:
    """Inertial directions of the cones at t [s], shape (count, 3)."""
    directions = np.empty((cones.count, 3))
    for i in range(cones.count):
        if cones.kind[i] == FIXED:
            store(directions[i], vector(cones.direction[i]))
        elif cones.kind[i] == SUN:
            store(directions[i], sun_direction(sky.days + t / DAY)[0])
        else:
            r = orbit_at(t, sky.orbit, cursor)[0]
            store(directions[i], scale(-1.0 / norm(r), r))
    return directions


@kernel
def closest_angles(stamps_ns: Any, attitudes: Any, guidance: Any, cursor: Any) -> Any:
    """Smallest angle [rad] to each cone's direction over a run, shape (count,).

    Parameters
    ----------
    stamps_ns, attitudes
        Instants [ns], shape (n,), and attitudes x y z w, shape (n, 4).
    guidance, cursor
        Record of dtype `GUIDANCE`, and a cursor of the orbit.
    """
    cones = guidance.cones
    smallest = np.full(cones.count, math.pi)
    for k in range(stamps_ns.size):
        directions = directions_at(_seconds(stamps_ns[k]), cones, guidance.sky, cursor)
        q = quaternion(attitudes[k])
        for i in range(cones.count):
            b = rotate(q, vector(cones.body_axis[i]))
            smallest[i] = min(smallest[i], angle_between(b, vector(directions[i])))
    return smallest


@kernel
def begin(t: float, attitude: Quaternion, state: Any) -> None:
    """Start at rest at an attitude, at t [s]."""
    state.begun = True
    state.begin = t
    state.active = 0
    state.cone = -1
    start_plan(state.plans[0], INERTIAL, attitude, t)


@kernel
def motion_now(t: float, guidance: Any, state: Any) -> Motion:
    """q_d, ω_d [rad/s] and ω_d' [rad/s²] at t [s] of the plan that is followed."""
    plan = state.plans[state.active]
    return plan_motion(t, plan, guidance.sky, state.look.now)


@kernel
def first_crossing(plan: Any, t: float, free: float, exempt: int, guidance: Any, state: Any) -> int:
    """Index of the first cone that the samples of a plan are inside of, from t [s] on; −1: none.

    The cones in the bits of `exempt` do not count until `free` [s].
    """
    look, cones = state.look, guidance.cones
    copy_cursor(look.now, look.ahead)
    count = math.ceil((plan.end - t) / _SAMPLE)
    for k in range(count + 1):
        s = min(t + k * _SAMPLE, plan.end)
        q = plan_motion(s, plan, guidance.sky, look.ahead)[0]
        directions = directions_at(s, cones, guidance.sky, look.ahead)
        for i in range(cones.count):
            if exempt >> i & 1 and s < free:
                continue
            angle = angle_between(rotate(q, vector(cones.body_axis[i])), vector(directions[i]))
            if angle < cones.half_angle[i] - _TOLERANCE:
                return i
    return -1


@kernel
def _brake_to_stand(t: float, trial: Any, motion: Motion, guidance: Any, state: Any) -> bool:
    """Add a brake in inertial space, unless the present plan stands there already."""
    plan = state.plans[state.active]
    if plan.frame == INERTIAL and t >= plan.end:
        return True
    return append_brake(trial, INERTIAL, t, motion, guidance.limits, guidance.sky, state.look)


@kernel
def _standing_attitude(trial: Any, motion: Motion) -> Quaternion:
    return motion[0] if trial.count == 0 else end_attitude(trial)


@kernel
def _goal_at(t: float, trial: Any, guidance: Any, state: Any) -> Quaternion:
    """Inertial attitude of a plan's goal at t [s]."""
    look = state.look
    copy_cursor(look.now, look.ahead)
    frame = frame_at(t, trial.frame, trial.spinning, guidance.sky, look.ahead)[0]
    return normalised(product(frame[0], quaternion(trial.attitude)))


@kernel
def _aim(t: float, frame: int, attitude: Quaternion, trial: Any, guidance: Any, state: Any) -> int:
    """Empty a plan and give it a goal."""
    start_plan(trial, frame, attitude, t)
    if frame == SPIN:
        if abs(guidance.spin_rate) > MOST_SPIN * guidance.limits.max_rate:
            return SPIN_TOO_FAST
        store_quaternion(trial.attitude, _STRAIGHT)
        store_quaternion(trial.spinning.attitude, attitude)
        store(trial.spinning.axis, vector(guidance.spin_axis))
        trial.spinning.rate = guidance.spin_rate
        trial.spinning.begin = t
    copy_cursor(state.look.now, state.look.ahead)
    sine = frame_at(t, frame, trial.spinning, guidance.sky, state.look.ahead)[1]
    return ACCEPTED if sine >= LEAST_SINE else ILL_DEFINED


@kernel
def _approach(t: float, trial: Any, motion: Motion, guidance: Any, state: Any) -> int:
    """Fill a plan with brake and turn to its goal, past nothing."""
    plan = state.plans[state.active]
    at_rest = plan.frame == INERTIAL and trial.frame == INERTIAL and t >= plan.end
    found = append_approach(
        trial,
        trial.frame,
        quaternion(trial.attitude),
        t,
        motion,
        at_rest,
        guidance.limits,
        guidance.sky,
        state.look,
    )
    return ACCEPTED if found else NO_SLEW


@kernel
def _detour(t: float, arrival: float, trial: Any, motion: Motion, guidance: Any, state: Any) -> int:
    """Fill a plan with a brake to a stand, stops beside the cones, and the way to its goal.

    A goal in a moving frame is planned to where it is at arrival, found by fixed-point rounds from
    a first guess [s].
    """
    limits, sky, look, cones = guidance.limits, guidance.sky, state.look, guidance.cones
    moving = trial.frame != INERTIAL
    directions = directions_at(t, cones, sky, look.now)
    inside = cones_around(motion[0], cones, directions)
    state.inside = inside
    if not _brake_to_stand(t, trial, motion, guidance, state):
        return NO_SLEW
    braked = trial.count
    begin_turns = trial.end
    stand = _standing_attitude(trial, motion)
    goal = quaternion(trial.attitude)
    for _ in range(_ROUNDS if moving else 1):
        if moving:
            goal = _goal_at(arrival, trial, guidance, state)
        outcome, attitudes, axes, angles = route(stand, goal, cones, directions, limits)
        if outcome == GOAL_INSIDE:
            state.cone = violated(goal, cones, directions, 0.0)
            return INSIDE_CONE
        if outcome != FOUND:
            return NO_WAY
        arrival = begin_turns
        for k in range(len(angles)):
            arrival += rest_to_rest(angles[k], limits)
    for k in range(len(angles) - 1 if moving else len(angles)):
        start, axis = quaternion(attitudes[k]), vector(axes[k])
        if not append_slew(trial, INERTIAL, trial.end, start, axis, angles[k], limits, sky, look):
            return NO_SLEW
    free = trial.end
    if trial.count > braked:
        free = trial.legs[braked].begin + trial.legs[braked].duration
    if moving:
        last = quaternion(attitudes[len(angles) - 1])
        still = (last, _NOTHING, _NOTHING)
        goal = quaternion(trial.attitude)
        if not append_approach(
            trial, trial.frame, goal, trial.end, still, False, limits, sky, look
        ):
            return NO_SLEW
    state.cone = first_crossing(trial, t, free, inside, guidance, state)
    return ACCEPTED if state.cone < 0 else CROSSES


@kernel
def plan_to(t: float, frame: int, attitude: Quaternion, guidance: Any, state: Any) -> int:
    """Fill the plan that is not followed with the way to a goal; returns the outcome.

    Parameters
    ----------
    t
        When the goal comes [s], not before the last call's.
    frame, attitude
        The goal: a frame's number and the attitude relative to it, x y z w.
    guidance, state
        Records of dtype `GUIDANCE` and `STATE`.
    """
    motion = motion_now(t, guidance, state)
    trial = state.plans[1 - state.active]
    state.cone = -1
    state.inside = 0
    outcome = _aim(t, frame, attitude, trial, guidance, state)
    if outcome != ACCEPTED or guidance.cones.count == 0:
        return outcome if outcome != ACCEPTED else _approach(t, trial, motion, guidance, state)
    directions = directions_at(t, guidance.cones, guidance.sky, state.look.now)
    arrival = t
    if frame != INERTIAL and cones_around(motion[0], guidance.cones, directions) == 0:
        outcome = _approach(t, trial, motion, guidance, state)
        if outcome == ACCEPTED and first_crossing(trial, t, t, NO_CONE, guidance, state) < 0:
            return ACCEPTED
        arrival = trial.end
        _aim(t, frame, attitude, trial, guidance, state)
    return _detour(t, arrival, trial, motion, guidance, state)


@kernel
def adopt_plan(outcome: int, state: Any) -> int:
    """Follow the new plan if it was found, and remember the outcome."""
    state.outcome = outcome
    if outcome == ACCEPTED:
        state.active = 1 - state.active
    return outcome


@kernel
def pursue(t: float, frame: int, attitude: Quaternion, guidance: Any, state: Any) -> int:
    """Take a goal at t [s] and follow it, or go on as before; see `plan_to`."""
    return adopt_plan(plan_to(t, frame, attitude, guidance, state), state)


@kernel
def hold(t: float, guidance: Any, state: Any) -> int:
    """Brake in inertial space at t [s] and stay there."""
    motion = motion_now(t, guidance, state)
    trial = state.plans[1 - state.active]
    start_plan(trial, INERTIAL, motion[0], t)
    state.cone = -1
    state.inside = 0
    if not _brake_to_stand(t, trial, motion, guidance, state):
        return adopt_plan(NO_SLEW, state)
    stand = _standing_attitude(trial, motion)
    store_quaternion(trial.attitude, stand)
    return adopt_plan(ACCEPTED, state)
