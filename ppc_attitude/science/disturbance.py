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

"""External torques: the environment of the paper (eq. 34) and sudden pulses."""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.kernel import Vector, add, kernel, vector

PULSE = np.dtype(
    [
        ("start_ns", np.int64),  # first instant [ns] at which it acts
        ("end_ns", np.int64),  # first instant [ns] at which it no longer acts
        ("torque", np.float64, (3,)),  # [N·m] body
    ],
    align=True,
)
_OMEGA_P = 0.01  # ω_p [rad/s]
_NOTHING: Vector = (0.0, 0.0, 0.0)
ENVIRONMENT_BOUND = 4.374e-3  # [N·m] the environment torque's norm is never larger


@kernel
def environment_torque(t: float) -> Vector:
    """Environment torque d(t) [N·m], body axes, as printed in the paper."""
    p = _OMEGA_P * t
    return (
        1e-4 * (4.0 * math.sin(3.0 * p) + 3.0 * math.cos(10.0 * p) - 20.0),
        1e-4 * (-1.5 * math.sin(2.0 * p) + 3.0 * math.cos(5.0 * p) + 20.0),
        1e-4 * (3.0 * math.sin(10.0 * p) - 8.0 * math.cos(4.0 * p) + 20.0),
    )


@kernel
def external_torque(stamp_ns: int, t: float, environment: bool, pulses: Any) -> Vector:
    """All external torque [N·m], body axes, that acts from an instant on.

    Parameters
    ----------
    stamp_ns, t
        The instant in [ns] and [s]; pulses are compared in whole nanoseconds.
    environment
        True if the environment torque acts.
    pulses
        Array of dtype `PULSE`; overlapping pulses add up.
    """
    return with_pulses(stamp_ns, environment_torque(t) if environment else _NOTHING, pulses)


@kernel
def with_pulses(stamp_ns: int, total: Vector, pulses: Any) -> Vector:
    """Return a torque [N·m] and the pulses that act from an instant [ns] on."""
    for i in range(pulses.size):
        if pulses[i].start_ns <= stamp_ns < pulses[i].end_ns:
            total = add(total, vector(pulses[i].torque))
    return total
