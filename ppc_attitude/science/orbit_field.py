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

"""Earth's magnetic field along the orbit."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.component import BODY, VECTOR, Column
from ppc_attitude.science.geomagnetic import FIELD, MOST_DEGREE, field_at, field_of
from ppc_attitude.science.kernel import Vector, kernel
from ppc_attitude.science.orbit import ORBIT
from ppc_attitude.science.orbit_elements import EPOCH, ORBIT_PARAMETERS, epoch_of, orbit_of
from ppc_attitude.science.parameter import Parameter
from ppc_attitude.science.sky import EARTH_RATE, earth_angle

_DEGREES = {"igrf": MOST_DEGREE, "dipole": 1}
MODEL = Parameter(
    "orbit.field",
    "igrf",
    "Earth's magnetic field: IGRF-14 to degree 13, or its first degree, which is up to 67 % off",
    choices=tuple(_DEGREES),
    agreed=True,
)
PARAMETERS = (*ORBIT_PARAMETERS, MODEL)
ORBIT_FIELD = np.dtype(
    [
        ("orbit", ORBIT),
        ("earth_angle", np.float64),  # Greenwich at t = 0 [rad]
        ("harmonics", FIELD),
    ],
    align=True,
)
MAGNETIC_FIELD = Column(
    "magnetic_field", "magnetic_field", VECTOR, BODY, "T", "Earth's magnetic field at the craft"
)


def orbit_field(values: Mapping[str, Any]) -> Any:
    """Record of dtype `ORBIT_FIELD` from checked parameter values.

    Raises
    ------
    ConfigurationError
        The orbit is impossible, or the date is outside the field's model.
    """
    record = np.zeros((), ORBIT_FIELD)[()]
    days = epoch_of(values)
    record["orbit"] = orbit_of(values)
    record["earth_angle"] = earth_angle(days)
    record["harmonics"] = field_of(EPOCH.name, days, _DEGREES[values[MODEL.name]])
    return record


@kernel
def magnetic_field(r: Vector, t: float, field: Any) -> Vector:
    """B [T] at r [m] and t [s], inertial axes; the field is a record of dtype `ORBIT_FIELD`."""
    angle = field.earth_angle + EARTH_RATE * t
    c, s = math.cos(angle), math.sin(angle)
    bx, by, bz = field_at((c * r[0] + s * r[1], c * r[1] - s * r[0], r[2]), field.harmonics)
    return (c * bx - s * by, s * bx + c * by, bz)
