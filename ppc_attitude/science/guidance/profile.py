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

"""Time-optimal turn about one axis, rest to rest, within rate, acceleration and jerk.

Seven phases: jerk up, hold the acceleration, jerk down, cruise, and the same mirrored.
"""

import math
from typing import TypeAlias

from ppc_attitude.science.kernel import kernel

# Angle φ [rad], and the times t_j, t_a, t_v [s] of a jerk phase, an acceleration phase, the cruise.
Profile: TypeAlias = tuple[float, float, float, float]


@kernel
def profile(angle: float, rate: float, acceleration: float, jerk: float) -> Profile:
    """Profile that turns an angle φ ≥ 0 [rad] within V [rad/s], A [rad/s²] and K [rad/s³]."""
    jerk_alone = (0.5 * angle / jerk) ** (1.0 / 3.0)
    if rate * jerk >= acceleration * acceleration:
        ramp = acceleration / jerk
        if angle >= rate * (rate / acceleration + ramp):
            return (
                angle,
                ramp,
                rate / acceleration - ramp,
                angle / rate - rate / acceleration - ramp,
            )
        if angle >= 2.0 * acceleration * ramp * ramp:
            peak = 0.5 * acceleration * (math.sqrt(ramp * ramp + 4.0 * angle / acceleration) - ramp)
            return angle, ramp, peak / acceleration - ramp, 0.0
        return angle, jerk_alone, 0.0, 0.0
    ramp = math.sqrt(rate / jerk)
    if angle >= 2.0 * rate * ramp:
        return angle, ramp, 0.0, angle / rate - 2.0 * ramp
    return angle, jerk_alone, 0.0, 0.0


@kernel
def duration(profile: Profile) -> float:
    """T = 4 t_j + 2 t_a + t_v [s]."""
    return 4.0 * profile[1] + 2.0 * profile[2] + profile[3]


@kernel
def _rising(t: float, profile: Profile, jerk: float) -> tuple[float, float, float]:
    """θ, θ' and θ'' before the middle of the profile."""
    _, t_j, t_a, _ = profile
    if t <= t_j:
        return jerk * t**3 / 6.0, 0.5 * jerk * t * t, jerk * t
    acceleration = jerk * t_j
    t -= t_j
    angle, rate = jerk * t_j**3 / 6.0, 0.5 * jerk * t_j * t_j
    if t <= t_a:
        return (
            angle + rate * t + 0.5 * acceleration * t * t,
            rate + acceleration * t,
            acceleration,
        )
    t -= t_a
    angle += rate * t_a + 0.5 * acceleration * t_a * t_a
    rate += acceleration * t_a
    if t <= t_j:
        return (
            angle + rate * t + 0.5 * acceleration * t * t - jerk * t**3 / 6.0,
            rate + acceleration * t - 0.5 * jerk * t * t,
            acceleration - jerk * t,
        )
    t -= t_j
    angle += rate * t_j + 0.5 * acceleration * t_j * t_j - jerk * t_j**3 / 6.0
    rate += 0.5 * acceleration * t_j
    return angle + rate * t, rate, 0.0


@kernel
def turned(t: float, profile: Profile, jerk: float) -> tuple[float, float, float]:
    """Angle θ [rad], θ' [rad/s] and θ'' [rad/s²] at t [s] from the start, 0 ≤ t ≤ T."""
    total = duration(profile)
    if t <= 0.5 * total:
        return _rising(t, profile, jerk)
    angle, rate, acceleration = _rising(max(total - t, 0.0), profile, jerk)
    return profile[0] - angle, rate, -acceleration
