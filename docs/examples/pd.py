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

"""Proportional-derivative tracking: the smallest law that points a craft."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.component import Component
from ppc_attitude.science.controllers.common import INERTIA, MAX_TORQUE
from ppc_attitude.science.controllers.interface import INPUTS, OUTPUTS, error_state, store_command
from ppc_attitude.science.inertia import inertia_matrix
from ppc_attitude.science.kernel import add, apply, clamp, kernel, matrix, scale
from ppc_attitude.science.parameter import Parameter, filled, record_type
from ppc_attitude.science.virtual_control import sign

FREQUENCY = Parameter(
    "pd.frequency", 0.5, "natural frequency, critically damped", "rad/s", above=0.0
)
CONFIGURATION = record_type(FREQUENCY, MAX_TORQUE, ("inertia", np.float64, (3, 3)))


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values."""
    return filled(
        CONFIGURATION,
        values,
        "pd.",
        max_torque=values["max_torque"],
        inertia=inertia_matrix("inertia", values["inertia"]),
    )


@kernel
def step(measurement: Any, memory: Any, gains: Any, command: Any) -> None:
    """Compute u = −M0 − J (2 ω_n² s q_ev + 2 ω_n ω_e)."""
    inertia = matrix(gains.inertia)
    q_e, omega_e, m_0 = error_state(measurement, inertia)
    error = scale(sign(q_e[3]), (q_e[0], q_e[1], q_e[2]))
    stiffness, damping = 2.0 * gains.frequency**2, 2.0 * gains.frequency
    demand = apply(inertia, add(scale(stiffness, error), scale(damping, omega_e)))
    u = scale(-1.0, add(m_0, demand))
    store_command(command, q_e, omega_e, u, clamp(u, gains.max_torque))


COMPONENT = Component(
    name="pd",
    parameters=(INERTIA, MAX_TORQUE, FREQUENCY),
    configure=configure,
    configuration=CONFIGURATION,
    inputs=INPUTS,
    outputs=OUTPUTS,
    step=step,
)
