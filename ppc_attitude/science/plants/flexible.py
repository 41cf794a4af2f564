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

"""A craft with flexible appendages; its actuator's torque acts on the body."""

from typing import Any

import numpy as np

from ppc_attitude.science.component import Component
from ppc_attitude.science.kernel import add, kernel, vector
from ppc_attitude.science.multibody import (
    CONFIGURATION,
    PARAMETERS,
    STATE,
    move,
    multibody_record,
    tell,
)
from ppc_attitude.science.signals import APPLIED_TORQUE, DISTURBANCE, TRUTH
from ppc_attitude.science.wheels import WHEELS


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Carry the motion from the last stamp to this one, both torques held since then."""
    torque = add(vector(inputs.applied_torque), vector(inputs.disturbance_torque))
    move(inputs.stamp_ns, torque, state, configuration)
    tell(state, outputs)


COMPONENT = Component(
    name="flexible",
    parameters=PARAMETERS,
    configure=lambda values: multibody_record(values, np.zeros((), WHEELS)),
    configuration=CONFIGURATION,
    state=STATE,
    inputs=(APPLIED_TORQUE, DISTURBANCE),
    outputs=TRUTH,
    step=step,
)
