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

"""The sight of a plan: where goal and cones are, when it enters one, and what is warned of."""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import normalised, product
from ppc_attitude.science.compiled_stamps import seconds
from ppc_attitude.science.guidance.frames import GROUND, LEAST_SINE, elevation_sine, frame_at
from ppc_attitude.science.guidance.plan import plan_motion
from ppc_attitude.science.keep_out import CONES, FIXED, MOST_CONES, SUN, cone_angle, cones_around
from ppc_attitude.science.kernel import Quaternion, kernel, norm, quaternion, scale, store, vector
from ppc_attitude.science.orbit import orbit_at
from ppc_attitude.science.parameter import record_type
from ppc_attitude.science.sky import DAY, sun_direction

_COARSE, _FINE = 0.5, 0.01  # [s] largest and smallest step along a plan
_FASTER = 1.1  # times V, or the present rate if larger: taken for the rate until the next step
_DRIFT = 2e-3  # [rad/s] no direction moves faster: Earth's turns by 1.2e-3 in the lowest orbit
_TOLERANCE = 1e-9  # [rad] that a sample of an exact plan may be inside by rounding
HORIZON = 60.0  # [s] ahead: a cone that is entered within this time is warned of
_PERIOD = 1.0  # [s]
_BELOW, _SKEWED = 1 << MOST_CONES, 2 << MOST_CONES  # bits beyond those of the cones
WATCH = record_type(
    ("time", np.float64),  # [s] of the last look
    ("next", np.float64),  # [s] of the next one
    ("seen", np.float64),  # [s] until here no other cone is entered
    ("bits", np.int64),  # what is warned of now
    ("when", np.float64, (MOST_CONES,)),  # [s] when a cone that is warned of is entered
    ("changes", np.int64),  # of `bits` so far
    ("said", np.int64),  # of these, those that are told with the last order
    ("cones", CONES),  # that were looked for
)


@kernel
def directions_at(t: float, guidance: Any, cursor: Any) -> Any:
    """Inertial directions of the cones at t [s], shape (count, 3)."""
    cones, sky = guidance.cones, guidance.sky
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
def goal_at(t: float, plan: Any, sky: Any, cursor: Any) -> Quaternion:
    """Inertial attitude x y z w of a plan's goal at t [s]."""
    frame = frame_at(t, plan.frame, plan.spinning, sky, cursor)[0]
    return normalised(product(frame[0], quaternion(plan.attitude)))


@kernel
def cone_angles(stamps_ns: Any, attitudes: Any, guidance: Any, cursor: Any) -> Any:
    """Angle [rad] between body axis and direction of each cone over a run, shape (n, count).

    Parameters
    ----------
    stamps_ns, attitudes
        Instants [ns], shape (n,), and attitudes x y z w, shape (n, 4).
    guidance, cursor
        Record of dtype `GUIDANCE`, and a cursor of the orbit.
    """
    cones = guidance.cones
    angles = np.empty((stamps_ns.size, cones.count))
    for k in range(stamps_ns.size):
        directions = directions_at(seconds(stamps_ns[k]), guidance, cursor)
        q = quaternion(attitudes[k])
        for i in range(cones.count):
            angles[k, i] = cone_angle(i, q, cones, directions)
    return angles


@kernel
def crossing(
    plan: Any, begin: float, end: float, free: float, exempt: int, guidance: Any, look: Any
) -> tuple[int, float]:
    """First cone that a plan is inside of between two times [s], and when; −1: none.

    No step along the plan is longer than the craft needs to the nearest cone.

    Parameters
    ----------
    plan
        Record of dtype `PLAN`.
    begin, end
        Times between which to look [s]; the first is not before the cursor `look.now`.
    free, exempt
        Cones in the bits of `exempt` are ignored until `free` [s].
    guidance, look
        Records of dtype `GUIDANCE` and `LOOK`.
    """
    cones = guidance.cones
    if cones.count == 0:
        return -1, end
    look.ahead = look.now
    s = begin
    while True:
        q, omega, _ = plan_motion(s, plan, guidance.sky, look.ahead)
        directions = directions_at(s, guidance, look.ahead)
        room = math.pi
        for i in range(cones.count):
            if exempt >> i & 1 and s < free:
                continue
            angle = cone_angle(i, q, cones, directions)
            if angle < cones.half_angle[i] - _TOLERANCE:
                return i, s
            room = min(room, angle - cones.half_angle[i])
        if s >= end:
            return -1, end
        rate = _FASTER * max(norm(omega), guidance.limits.max_rate) + _DRIFT
        ahead = s + min(max(room / rate, _FINE), _COARSE)
        s = min(ahead, free, end) if s < free else min(ahead, end)


@kernel
def begin_watch(t: float, inside: int, watch: Any) -> None:
    """Watch a new plan from t [s] on, which begins inside the cones of some bits."""
    watch.next = watch.seen = t
    watch.bits = inside
    for i in range(MOST_CONES):
        watch.when[i] = t


@kernel
def _are_equal(a: Any, b: Any) -> bool:
    """True if two sets of cones are the same."""
    if a.count != b.count:
        return False
    for i in range(a.count):
        if (
            a.kind[i] != b.kind[i]
            or a.half_angle[i] != b.half_angle[i]
            or vector(a.body_axis[i]) != vector(b.body_axis[i])
            or vector(a.direction[i]) != vector(b.direction[i])
        ):
            return False
    return True


@kernel
def _known(t: float, cones: Any, watch: Any) -> int:
    """Bits of the cones that are warned of; what was seen of cones that have changed is forgotten.

    They change in flight with their parameters.
    """
    if _are_equal(watch.cones, cones):
        return int(watch.bits & (_BELOW - 1))
    watch.cones = cones
    watch.seen = t
    return 0


@kernel
def _cones_ahead(t: float, plan: Any, guidance: Any, look: Any, watch: Any) -> int:
    """Bits of the cones that the plan is inside of, or enters within the horizon."""
    cones = guidance.cones
    q = plan_motion(t, plan, guidance.sky, look.now)[0]
    around = cones_around(q, cones, directions_at(t, guidance, look.now))
    bits = _known(t, cones, watch)
    s, end = max(watch.seen, t), t + HORIZON
    for i in range(cones.count):
        if bits >> i & 1 and not around >> i & 1 and t >= watch.when[i]:
            bits &= ~(1 << i)
            s = t  # whether the plan comes back to it was not looked at
    found = 0
    while found >= 0:
        found, s = crossing(plan, s, end, math.inf, bits, guidance, look)
        if found >= 0:
            bits |= 1 << found
            watch.when[found] = s
    watch.seen = end
    return bits


@kernel
def look_out(t: float, plan: Any, guidance: Any, look: Any, watch: Any) -> None:
    """Check once a second for warnings at t [s].

    Parameters
    ----------
    plan, guidance
        Records of dtype `PLAN`, the one that is followed, and `GUIDANCE`.
    look, watch
        Records of dtype `LOOK` and `WATCH`.
    """
    if t < watch.next:
        return
    watch.time = t
    watch.next = math.floor(t / _PERIOD + 1.0) * _PERIOD
    bits = _cones_ahead(t, plan, guidance, look, watch) if guidance.cones.count else 0
    if plan.frame == GROUND and elevation_sine(t, guidance.sky, look.now) < 0.0:
        bits |= _BELOW
    if frame_at(t, plan.frame, plan.spinning, guidance.sky, look.now)[1] < LEAST_SINE:
        bits |= _SKEWED
    watch.changes += bits != watch.bits
    watch.bits = bits


def warnings_of(watch: Any) -> list[str]:
    """The present warnings, in words."""
    bits, time = int(watch["bits"]), float(watch["time"])
    told = []
    for i in range(MOST_CONES):
        when = float(watch["when"][i])
        if bits >> i & 1:
            told.append(
                f"is inside keep-out cone {i}"
                if when <= time
                else f"enters keep-out cone {i} at t = {when:.1f} s"
            )
    if bits & _BELOW:
        told.append("looks at a ground point below the horizon")
    if bits & _SKEWED:
        told.append("is in a frame whose two directions are parallel within 6°")
    return told
