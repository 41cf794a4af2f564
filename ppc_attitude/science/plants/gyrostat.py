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

"""A craft with reaction wheels, and with flexible appendages if it has modes.

The motor torques of its wheels turn it, so body and wheels exchange momentum and make none.
"""

from typing import Any

from ppc_attitude.science import multibody, wheels
from ppc_attitude.science.component import Component
from ppc_attitude.science.kernel import kernel, vector
from ppc_attitude.science.multibody import move_with_wheels, multibody_record
from ppc_attitude.science.signals import DISTURBANCE, TRUTH
from ppc_attitude.science.wheels import wheel_record


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Carry the motion from the last stamp to this one, torques held since then."""
    torque = vector(inputs.disturbance_torque)
    move_with_wheels(inputs, torque, state, configuration, outputs)


COMPONENT = Component(
    name="gyrostat",
    parameters=(*multibody.PARAMETERS, *wheels.PARAMETERS),
    configure=lambda values: multibody_record(values, wheel_record(values)),
    configuration=multibody.CONFIGURATION,
    state=multibody.STATE,
    inputs=(wheels.TORQUE, DISTURBANCE),
    outputs=(*TRUTH, wheels.SPEED),
    step=step,
    quiet=wheels.QUIET,
)
