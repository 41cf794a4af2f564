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

"""How fast the desired motion can be: bounds from the limits of slews and from how frames turn.

In a frame that turns with f a slew turns about e with θ' ≤ V, θ'' ≤ A and θ''' ≤ K:

ω_d = θ' e + f,  ω_d' = θ'' e + f' − θ' e × f,
ω_d'' = θ''' e + f'' − 2 θ' e × f' − θ'' e × f + θ'² e × (e × f).

An order during a slew begins with a brake from the present ω and α relative to the new frame. Its
time T is the largest of 1 s, 1.5 |ω|/A and 2 |α|/K, and longer by tenths until it keeps A, which it
does from 2.13 |ω|/A on. Its polynomial first goes on with α. So its rate reaches at most 1.2 |ω|,
or |ω| + 4/27 |α| 1 s if 1 s is enough; before it has V, a slew has α² ≤ 2 K V. Where frames change,
α has the terms of both frames. A brake that would reach more lasts less, but at least
√(1.5 |ω|/A 1 s), or is refused. So its jerk is at most 6 |ω|/T² + 4 |α|/T ≤ (4 A + 4 |α|)/1 s. That
the rate keeps its bound where frames change, too, is tested and not derived.
"""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.guidance.frames import SPINNING, frame_at
from ppc_attitude.science.guidance.slew import GOES_ON, LONGER, ROUNDING, SHORTEST_BRAKE
from ppc_attitude.science.kernel import Vector, kernel, norm, subtract
from ppc_attitude.science.orbit import CURSOR

_STEP = 1.0  # [s] of the grid on which a frame is sampled


@kernel
def _largest(frame: int, count: int, spinning: Any, sky: Any, cursor: Any) -> Vector:
    """Largest ‖f‖, ‖f'‖, and ‖Δf'‖ from point to point, at `count` points of the grid."""
    rate, first, change = 0.0, 0.0, 0.0
    before = frame_at(0.0, frame, spinning, sky, cursor)[0][2]
    for i in range(count):
        _, omega, alpha = frame_at(i * _STEP, frame, spinning, sky, cursor)[0]
        rate, first = max(rate, norm(omega)), max(first, norm(alpha))
        change = max(change, norm(subtract(alpha, before)))
        before = alpha
    return rate, first, change


def frame_bounds(frame: int, spin_rate: float, sky: Any, duration: float) -> Vector:
    """Bounds of ‖f‖ [rad/s], ‖f'‖ [rad/s²] and ‖f''‖ [rad/s³] of a frame for a time.

    They are searched on a grid, f'' by differences of f'. The possible growth of f and f' between
    two points is added.

    Parameters
    ----------
    frame : int
        Index into `FRAME_NAMES`.
    spin_rate : float
        Rate of the frame `spin` [rad/s].
    sky : record of dtype SKY
        Orbit, date and ground point.
    duration : float
        Time that the bounds cover [s].
    """
    spinning, cursor = np.zeros((), SPINNING)[()], np.zeros((), CURSOR)[()]
    spinning["axis"], spinning["rate"] = (0.0, 0.0, 1.0), spin_rate
    count = math.ceil(duration / _STEP) + 1
    rate, first, change = _largest(frame, count, spinning, sky, cursor)
    second = change / _STEP
    return rate + 0.5 * _STEP * first, first + 0.5 * _STEP * second, second


def slew_bounds(limits: Vector, frames: Vector) -> Vector:
    """Bounds of ‖ω_d‖ [rad/s], ‖ω_d'‖ [rad/s²] and ‖ω_d''‖ [rad/s³] of slews and brakes.

    Parameters
    ----------
    limits : tuple of 3 float
        V [rad/s], A [rad/s²] and K [rad/s³].
    frames : tuple of 3 float
        Largest `frame_bounds` of the frames of all goals.
    """
    V, A, K = limits
    f, first, second = frames
    turning = first + V * f
    bending = second + 2.0 * V * first + (A + V * V) * f
    W1 = ROUNDING * (A + 3.0 * turning)
    alpha = min(A, math.sqrt(2.0 * K * V)) + 3.0 * turning
    W = max(LONGER * V, V + GOES_ON * alpha * SHORTEST_BRAKE) + f
    W2 = max(K, 4.0 * (A + W1) / SHORTEST_BRAKE) + 3.0 * bending
    return W, W1, W2
