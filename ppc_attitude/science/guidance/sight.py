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

"""The sight of a plan: where its goal and the keep-out cones are, and when it enters one."""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import normalised, product
from ppc_attitude.science.compiled_stamps import seconds
from ppc_attitude.science.guidance.frames import frame_at
from ppc_attitude.science.guidance.plan import plan_motion
from ppc_attitude.science.keep_out import FIXED, SUN, cone_angle
from ppc_attitude.science.kernel import Quaternion, kernel, norm, quaternion, scale, store, vector
from ppc_attitude.science.orbit import orbit_at
from ppc_attitude.science.sky import DAY, sun_direction

_COARSE, _FINE = 0.5, 0.01  # [s] largest and smallest step along a plan
_FASTER = 1.1  # times V, or the present rate if larger: taken for the rate until the next step
_DRIFT = 2e-3  # [rad/s] no direction moves faster: Earth's turns by 1.2e-3 in the lowest orbit
_TOLERANCE = 1e-9  # [rad] that a sample of an exact plan may be inside by rounding


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
