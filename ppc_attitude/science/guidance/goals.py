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

"""Goals: from the present motion to rest at a goal, clear of the keep-out cones, or a refusal.

A new plan is made beside the present one and takes its place only if it is found.
"""

from typing import Any

import numpy as np

from ppc_attitude.science.guidance.frames import INERTIAL, LEAST_SINE, SKY, SPIN, frame_at
from ppc_attitude.science.guidance.plan import LIMITS, LOOK, PLAN, plan_motion, start_plan
from ppc_attitude.science.guidance.rotation import Motion, standing, turn_between
from ppc_attitude.science.guidance.sight import WATCH, begin_watch, crossing, directions_at, goal_at
from ppc_attitude.science.guidance.slew import (
    append_approach,
    append_brake,
    append_slew,
    end_attitude,
)
from ppc_attitude.science.keep_out import (
    CONES,
    FOUND,
    GOAL_INSIDE,
    NO_CONE,
    cone_angle,
    cones_around,
    rest_to_rest,
    route,
    turn_is_clear,
    violated,
)
from ppc_attitude.science.keep_out import NADIR as EARTH
from ppc_attitude.science.kernel import (
    STRAIGHT,
    Quaternion,
    kernel,
    quaternion,
    store,
    store_quaternion,
    vector,
)
from ppc_attitude.science.parameter import record_type

GUIDANCE = record_type(
    ("limits", LIMITS),
    ("sky", SKY),
    ("spin_axis", np.float64, (3,)),  # unit, body
    ("spin_rate", np.float64),  # [rad/s]
    ("cones", CONES),
    ("orders", np.int64),  # how many
    ("address", np.uint64),  # of the orders, dtype `ORDER`
    ("profiles", np.int64),  # how many
    ("profiles_address", np.uint64),  # of the timed profiles, dtype `POINTS`
)
STATE = record_type(
    ("begun", np.bool_),
    ("begin", np.float64),  # [s]
    ("active", np.int64),  # which of the plans is followed
    ("plans", PLAN, (2,)),
    ("look", LOOK),
    ("obeyed", np.int64),  # orders so far
    ("refused", np.int64),  # of these
    ("open_ns", np.int64),  # orders before this instant have been obeyed
    ("outcome", np.int64),  # of the last one
    ("measured", np.float64),  # the number that the last order was refused for,
    ("allowed", np.float64),  # and the allowed number or the time, in units as of the reason
    ("inside", np.int64),  # bits of the cones that the last plan begins in
    ("barred", np.int64),  # bits of the cones that the direct way to the last goal crosses
    ("cone", np.int64),  # the cone that the last goal was refused for; −1: none
    ("watch", WATCH),
    ("attitude", np.float64, (4,)),  # the last answer, whose sign the next one continues
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
    TOO_FAR,
) = range(10)
MOST_SPIN = 0.9  # of V
_ROUNDS = 5  # fixed-point rounds for the time of arrival


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
def refused(outcome: int, measured: float, allowed: float, state: Any) -> int:
    """Remember the numbers of a refusal, in units as of its reason; return the outcome."""
    state.measured = measured
    state.allowed = allowed
    return outcome


@kernel
def no_slew(guidance: Any, state: Any) -> int:
    """Refuse because no brake or turn keeps the limits: mostly because a frame turns too fast."""
    V = guidance.limits.max_rate
    return refused(NO_SLEW, V, V, state)


@kernel
def kept_clear(trial: Any, t: float, free: float, exempt: int, guidance: Any, state: Any) -> int:
    """`ACCEPTED` if a plan keeps all cones from t [s] on, `CROSSES` if not; see `crossing`."""
    cone, when = crossing(trial, t, trial.end, free, exempt, guidance, state.look)
    state.cone = cone
    return ACCEPTED if cone < 0 else refused(CROSSES, when, t, state)


@kernel
def _bars(start: Quaternion, goal: Quaternion, cones: Any, directions: Any) -> int:
    """Bits of the cones that the direct turn crosses."""
    axis, angle = turn_between(start, goal)
    bits = 0
    for i in range(cones.count):
        if not turn_is_clear(start, axis, angle, cones, directions, ~(1 << i)):
            bits |= 1 << i
    return bits


@kernel
def _brake_to_stand(
    t: float, trial: Any, motion: Motion, guidance: Any, state: Any
) -> tuple[bool, Quaternion]:
    """Add a brake in inertial space, unless the present plan stands there already.

    Returns whether one is found, and the attitude at which the motion then stands.
    """
    plan = state.plans[state.active]
    if plan.frame == INERTIAL and t >= plan.end:
        return True, motion[0]
    found = append_brake(trial, INERTIAL, t, motion, guidance, state.look)
    return found, end_attitude(trial) if found else motion[0]


@kernel
def _aim(t: float, frame: int, attitude: Quaternion, trial: Any, guidance: Any, state: Any) -> int:
    """Empty a plan and give it a goal."""
    start_plan(trial, frame, attitude, t)
    if frame == SPIN:
        fastest = MOST_SPIN * guidance.limits.max_rate
        if abs(guidance.spin_rate) > fastest:
            return refused(SPIN_TOO_FAST, guidance.spin_rate, fastest, state)
        store_quaternion(trial.attitude, STRAIGHT)
        store_quaternion(trial.spinning.attitude, attitude)
        store(trial.spinning.axis, vector(guidance.spin_axis))
        trial.spinning.rate = guidance.spin_rate
        trial.spinning.begin = t
    state.look.ahead = state.look.now
    sine = frame_at(t, frame, trial.spinning, guidance.sky, state.look.ahead)[1]
    return ACCEPTED if sine >= LEAST_SINE else refused(ILL_DEFINED, sine, LEAST_SINE, state)


@kernel
def _approach(t: float, trial: Any, motion: Motion, guidance: Any, state: Any) -> int:
    """Fill a plan with brake and turn to its goal, whatever cones are in the way."""
    plan = state.plans[state.active]
    at_rest = plan.frame == INERTIAL and trial.frame == INERTIAL and t >= plan.end
    found = append_approach(trial, t, motion, at_rest, guidance, state.look)
    return ACCEPTED if found else no_slew(guidance, state)


@kernel
def _detour(
    t: float, arrival: float, ahead: bool, trial: Any, motion: Motion, guidance: Any, state: Any
) -> int:
    """Fill a plan with a brake to a stand, stops beside the cones, and the way to its goal.

    A goal in a moving frame is planned to where it is at arrival. The cones are taken where they
    are now, or `ahead`, at arrival. Both are found by fixed-point rounds from a first guess [s].
    """
    limits, cones, look = guidance.limits, guidance.cones, state.look
    moving = trial.frame != INERTIAL
    directions = directions_at(t, guidance, look.now)
    inside = cones_around(motion[0], cones, directions)
    state.inside = inside
    found, stand = _brake_to_stand(t, trial, motion, guidance, state)
    if not found:
        return no_slew(guidance, state)
    braked = trial.count
    begin_turns = trial.end
    leaving = cones_around(stand, cones, directions)
    goal = quaternion(trial.attitude)
    for _ in range(_ROUNDS if moving or ahead else 1):
        if moving:
            look.ahead = look.now
            goal = goal_at(arrival, trial, guidance.sky, look.ahead)
        if ahead:
            directions = directions_at(arrival, guidance, look.ahead)
        outcome, attitudes, axes, angles = route(stand, goal, cones, directions, limits, leaving)
        if outcome == GOAL_INSIDE:
            i = violated(goal, cones, directions, 0.0)
            state.cone = i
            angle = cone_angle(i, goal, cones, directions)
            return refused(INSIDE_CONE, angle, cones.half_angle[i], state)
        if outcome != FOUND:
            state.barred = _bars(stand, goal, cones, directions)
            return NO_WAY
        arrival = begin_turns
        for k in range(len(angles)):
            arrival += rest_to_rest(angles[k], limits)
    for k in range(len(angles) - 1 if moving else len(angles)):
        start, axis = quaternion(attitudes[k]), vector(axes[k])
        if not append_slew(trial, INERTIAL, trial.end, start, axis, angles[k], guidance, look):
            return no_slew(guidance, state)
    free = trial.end
    if trial.count > braked:
        free = trial.legs[braked].begin + trial.legs[braked].duration
    if moving:
        still = standing(quaternion(attitudes[len(angles) - 1]))
        if not append_approach(trial, trial.end, still, False, guidance, look):
            return no_slew(guidance, state)
        if leaving and len(angles) == 1:  # the approach itself leads out
            free = trial.end
    return kept_clear(trial, t, free, inside, guidance, state)


@kernel
def plan_to(t: float, frame: int, attitude: Quaternion, guidance: Any, state: Any) -> int:
    """Fill the plan that is not followed with the way to a goal; returns the outcome.

    Parameters
    ----------
    t
        Time of the goal [s], not before that of the last call.
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
    if outcome != ACCEPTED:
        return outcome
    if guidance.cones.count == 0:
        return _approach(t, trial, motion, guidance, state)
    arrival = t
    if frame != INERTIAL:
        outcome = _approach(t, trial, motion, guidance, state)
        if outcome == ACCEPTED:
            outcome = kept_clear(trial, t, t, NO_CONE, guidance, state)
        if outcome == ACCEPTED:
            return ACCEPTED
        arrival = trial.end
    changes = frame != INERTIAL
    for i in range(guidance.cones.count):
        changes |= guidance.cones.kind[i] == EARTH  # the Sun hardly moves
    for ahead in (False, True):
        _aim(t, frame, attitude, trial, guidance, state)
        outcome = _detour(t, arrival, ahead, trial, motion, guidance, state)
        if outcome == ACCEPTED or not changes:
            break
    return outcome


@kernel
def adopt_plan(t: float, outcome: int, state: Any) -> None:
    """Follow the new plan from t [s] on if it was found, and remember the outcome."""
    state.outcome = outcome
    if outcome == ACCEPTED:
        state.active = 1 - state.active
        begin_watch(t, state.inside, state.watch)
    else:
        state.refused += 1


@kernel
def plan_stop(t: float, guidance: Any, state: Any) -> int:
    """Fill the plan that is not followed with a brake to a stand in inertial space at t [s]."""
    motion = motion_now(t, guidance, state)
    trial = state.plans[1 - state.active]
    start_plan(trial, INERTIAL, motion[0], t)
    state.cone = -1
    state.inside = 0
    found, stand = _brake_to_stand(t, trial, motion, guidance, state)
    store_quaternion(trial.attitude, stand)
    return ACCEPTED if found else no_slew(guidance, state)
