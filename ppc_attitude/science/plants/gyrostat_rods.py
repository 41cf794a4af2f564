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

"""A craft with wheels, and magnetorquers in Earth's magnetic field.

The body is that of `plants.gyrostat`. It also gives the magnetic field at its position, which a
magnetometer measures, and in which the dipole m of its magnetorquers makes the torque m × B.
"""

from typing import Any

import numpy as np

from ppc_attitude.science import geomagnetic
from ppc_attitude.science.attitude import to_body
from ppc_attitude.science.geomagnetic import MAGNETIC_FIELD, ORBIT_FIELD, magnetic_field
from ppc_attitude.science.kernel import add, cross, kernel, store, vector
from ppc_attitude.science.magnetorquers import DIPOLE
from ppc_attitude.science.multibody import move_with_wheels
from ppc_attitude.science.orbit import CURSOR, orbit_at
from ppc_attitude.science.plants import gyrostat


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Carry the motion from the last stamp to this one, torques held since then."""
    turned = cross(vector(inputs.magnetorquer_dipole), vector(state.field))
    torque = add(vector(inputs.disturbance_torque), turned)
    move_with_wheels(inputs, torque, state, configuration, outputs)
    q = outputs.truth_attitude
    r, _ = orbit_at(inputs.t, configuration.field.orbit, state.cursor)
    b = to_body(magnetic_field(r, inputs.t, configuration.field), vector(q), q[3])
    store(state.field, b)
    store(outputs.magnetic_field, b)


COMPONENT = gyrostat.COMPONENT.extended(
    "gyrostat_rods",
    {"field": (ORBIT_FIELD, geomagnetic.orbit_field)},
    (("cursor", CURSOR), ("field", np.float64, (3,))),  # [T] body, at the last stamp
    parameters=geomagnetic.PARAMETERS,
    inputs=(DIPOLE,),
    outputs=(MAGNETIC_FIELD,),
    step=step,
)
