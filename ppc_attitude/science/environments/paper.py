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

"""The paper's environment torque (eq. 34)."""

import math
from typing import Any

from ppc_attitude.science.component import Component
from ppc_attitude.science.kernel import Vector, kernel, store
from ppc_attitude.science.signals import ENVIRONMENT_TORQUE

_OMEGA_P = 0.01  # ω_p [rad/s]
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
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Give d(t) of an instant."""
    store(outputs.environment_torque, environment_torque(inputs.t))


COMPONENT = Component(
    name="paper", outputs=(ENVIRONMENT_TORQUE,), step=step, bound=lambda _: ENVIRONMENT_BOUND
)
