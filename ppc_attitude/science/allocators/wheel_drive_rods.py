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

"""Drive electronics of reaction wheels, and the law of magnetorquers that unload them.

The drive is that of `allocators.wheel_drive`. It is not told of the rods' torque: the attitude law
counteracts it like any disturbance, and the wheels lose their momentum by that.
"""

from typing import Any

from ppc_attitude.science import magnetorquers
from ppc_attitude.science.allocators import wheel_drive
from ppc_attitude.science.geomagnetic import MAGNETIC_FIELD
from ppc_attitude.science.kernel import kernel, store
from ppc_attitude.science.magnetorquers import HELD, MAGNETORQUERS, magnetorquer_record, unload


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Share the commanded torque among the wheels, and unload them."""
    wheel_drive.step(inputs, state, configuration, outputs)
    dipole = unload(inputs, configuration.wheels, state.held, configuration.rods)
    store(outputs.magnetorquer_dipole_command, dipole)


COMPONENT = wheel_drive.COMPONENT.extended(
    "wheel_drive_rods",
    {"rods": (MAGNETORQUERS, magnetorquer_record)},
    (("held", HELD),),
    parameters=magnetorquers.PARAMETERS,
    inputs=(MAGNETIC_FIELD,),
    outputs=(magnetorquers.COMMAND,),
    step=step,
    conditions=magnetorquers.conditions,
)
