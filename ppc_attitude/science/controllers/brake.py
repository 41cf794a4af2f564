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

"""How fast the error may fall: a brake at constant deceleration under a cap of the speed.

The brake is g = kφ for φ ≤ φ1 = a/k² and √(2aφ − a²/k²) beyond: once differentiable, g g' ≤ a. The
cap is f(φ; V) = V S(g/V) with S(x) = x below 1 − c, 1 above 1 + c, and a parabola between.
"""

import math

from ppc_attitude.science.kernel import kernel

BLEND = 0.25  # c, half the width of the parabola


@kernel
def brake(phi: float, k: float, a: float) -> tuple[float, float]:
    """Speed g [rad/s] from which a deceleration a [rad/s²] stops in φ [rad], and g' [1/s]."""
    if phi * k * k <= a:
        return k * phi, k
    g = math.sqrt(2.0 * a * phi - a * a / (k * k))
    return g, a / g


@kernel
def capped_brake(phi: float, k: float, a: float, cap: float) -> tuple[float, float, float]:
    """f(φ; V) [rad/s], f_φ [1/s] and f_V for a cap V ≥ 0 [rad/s]."""
    g, g_phi = brake(phi, k, a)
    if g >= (1.0 + BLEND) * cap:
        return cap, 0.0, 1.0
    if g <= (1.0 - BLEND) * cap:
        return g, g_phi, 0.0
    x = g / cap
    below = x - 1.0 + BLEND
    s, s_x = x - below * below / (4.0 * BLEND), 1.0 - below / (2.0 * BLEND)
    return cap * s, s_x * g_phi, s - x * s_x
