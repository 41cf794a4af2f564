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

"""The torque of a low Earth orbit: gravity gradient, residual dipole, air and sunlight.

It is computed from the true attitude at the beginning of each step, and held until the next.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import to_body
from ppc_attitude.science.component import INERTIAL, POINT, VECTOR, Column, Component
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.geomagnetic import ORBIT_FIELD, largest_field, magnetic_field, orbit_field
from ppc_attitude.science.geomagnetic import PARAMETERS as FIELD_PARAMETERS
from ppc_attitude.science.inertia import gyroscopic_share, inertia_matrix
from ppc_attitude.science.kernel import (
    Matrix,
    Vector,
    add,
    apply,
    cross,
    kernel,
    matrix,
    norm,
    scale,
    store,
    subtract,
    vector,
)
from ppc_attitude.science.orbit import CURSOR, J2, MU, apsis_of, epoch_of, orbit_at
from ppc_attitude.science.parameter import Parameter, filled, record_type
from ppc_attitude.science.plants.rigid_body import INERTIA
from ppc_attitude.science.plates import (
    MOST_PLATES,
    PLATE,
    PLATES,
    largest_torques,
    plates_of,
    plates_torque,
)
from ppc_attitude.science.signals import ENVIRONMENT_TORQUE, TRUE_ATTITUDE
from ppc_attitude.science.sky import DAY, EARTH_RADIUS, EARTH_RATE, sun_distance, sun_from

PRESSURE = 1361.0 / 299792458.0  # P of sunlight at 1 au [N/m²]
_NEAREST_SUN = 0.983  # [au]
DIPOLE = Parameter(
    "orbit.residual_dipole",
    [0.0, 0.0, 0.0],
    "magnetic moment of the craft, body axes",
    "A·m²",
    length=3,
    low=-1e6,
    high=1e6,
)
DENSITY = Parameter(
    "orbit.air.density",
    6.967e-13,
    "density of the air at orbit.air.altitude; the Sun's activity changes it tenfold",
    "kg/m³",
    low=0.0,
    high=1e-6,
)
ALTITUDE = Parameter(
    "orbit.air.altitude",
    500e3,
    "altitude above Earth's equatorial radius to which the density belongs",
    "m",
    low=100e3,
    high=1e7,
)
SCALE_HEIGHT = Parameter(
    "orbit.air.scale_height",
    63.8e3,
    "height over which the density falls to 1/e",
    "m",
    low=1e3,
    high=1e7,
)
ORBIT_POSITION = Column(
    "orbit_position",
    "orbit/position",
    POINT,
    INERTIAL,
    "m",
    "position of the craft from Earth's centre",
)
ORBIT_VELOCITY = Column(
    "orbit_velocity", "orbit/velocity", VECTOR, INERTIAL, "m/s", "velocity of the craft"
)
SUN = Column(
    "sun",
    "sun",
    VECTOR,
    INERTIAL,
    "1",
    "towards the Sun; the length is the fraction of its disc that Earth does not hide",
)
CONFIGURATION = record_type(
    ("field", ORBIT_FIELD),
    ("days", np.float64),  # from J2000 to t = 0
    ("inertia", np.float64, (3, 3)),  # [kg·m²]
    ("dipole", np.float64, (3,)),  # [A·m²] body
    DENSITY,
    ALTITUDE,  # of this density
    SCALE_HEIGHT,
    ("plates", PLATE, (MOST_PLATES,)),
    ("count", np.int64),
)


def configure(values: Mapping[str, Any]) -> Any:
    """Build the kernel's record from checked parameter values.

    Raises
    ------
    ConfigurationError
        Orbit, inertia or a plate is impossible, the date is outside the field's model, or the air
        at the perigee is denser than any in an orbit.
    """
    plates = plates_of(values)
    record = filled(
        CONFIGURATION,
        values,
        "orbit.air.",
        field=orbit_field(values),
        days=epoch_of(values),
        inertia=inertia_matrix(INERTIA.name, values[INERTIA.name]),
        dipole=values[DIPOLE.name],
        plates=np.concatenate([plates, np.zeros(MOST_PLATES - plates.size, PLATE)]),
        count=plates.size,
    )
    density = air_density(_lowest(record)[0], record)
    if not density <= DENSITY.high:  # so written, it also refuses NaN
        raise ConfigurationError(
            f"{DENSITY.name} = {values[DENSITY.name]:g} kg/m³ at {ALTITUDE.name} = "
            f"{values[ALTITUDE.name]:g} m with {SCALE_HEIGHT.name} = "
            f"{values[SCALE_HEIGHT.name]:g} m gives {density:.3g} kg/m³ at the perigee; allowed: "
            f"at most {DENSITY.high:g}"
        )
    return record


def _lowest(craft: Any) -> tuple[float, float]:
    """Radius of the perigee, J2's short waves included, and semi-major axis [m]."""
    perigee, semi_major_axis = apsis_of(craft["field"]["orbit"])
    lower = 3.0 * J2 * (1.0 + J2) * EARTH_RADIUS**2 / perigee  # to the second order
    return perigee - lower, semi_major_axis


@kernel
def gravity_gradient(r: Vector, inertia: Matrix) -> Vector:
    """Torque [N·m] 3μ/r³ r̂ × J r̂; r [m] from Earth's centre in body axes, J [kg·m²]."""
    radius = norm(r)
    u = scale(1.0 / radius, r)
    return scale(3.0 * MU / (radius * radius * radius), cross(u, apply(inertia, u)))


@kernel
def air_density(radius: float, craft: Any) -> float:
    """ρ = ρ0 e^{−(altitude − altitude0)/H} [kg/m³] at a distance [m] from Earth's centre."""
    above = radius - EARTH_RADIUS - craft.altitude
    return float(craft.density * math.exp(-above / craft.scale_height))


@kernel
def step(inputs: Any, state: Any, craft: Any, outputs: Any) -> None:
    """Sum up the torques at an instant; write them, and where the craft and the Sun are."""
    attitude = inputs.truth_attitude
    q, q0 = vector(attitude), attitude[3]
    r, v = orbit_at(inputs.t, craft.field.orbit, state)
    torque = gravity_gradient(to_body(r, q, q0), matrix(craft.inertia))
    b = magnetic_field(r, inputs.t, craft.field)
    torque = add(torque, cross(vector(craft.dipole), to_body(b, q, q0)))
    days = craft.days + inputs.t / DAY
    towards, lit = sun_from(r, days)
    if craft.count:
        distance = sun_distance(days)  # [au]
        pressure = PRESSURE / (distance * distance) * lit
        s = to_body(towards, q, q0)
        turning = cross((0.0, 0.0, EARTH_RATE), r)  # [m/s] of the air, which turns with Earth
        wind = to_body(subtract(v, turning), q, q0)
        density = air_density(norm(r), craft)
        torque = add(torque, plates_torque(craft.plates, craft.count, wind, density, s, pressure))
    store(outputs.environment_torque, torque)
    store(outputs.orbit_position, r)
    store(outputs.orbit_velocity, v)
    store(outputs.sun, scale(lit, towards))


def bound(values: Mapping[str, Any]) -> float:
    """Bound of the torque's norm [N·m].

    Each part is taken at the perigee, J2's short waves included, and in its worst direction.

    Raises
    ------
    ConfigurationError
        As of `configure`.
    """
    craft = configure(values)
    lowest, semi_major_axis = _lowest(craft)
    gradient = 3.0 * MU / lowest**3 * gyroscopic_share(craft["inertia"])
    field = largest_field(lowest, craft["field"]["harmonics"])
    magnetic = float(np.linalg.norm(craft["dipole"])) * field
    speed = math.sqrt(MU * (2.0 / lowest - 1.0 / semi_major_axis)) + EARTH_RATE * lowest
    air, light = largest_torques(
        craft["plates"][: craft["count"]],
        speed,
        air_density(lowest, craft),
        PRESSURE / _NEAREST_SUN**2,
    )
    return gradient + magnetic + air + light


COMPONENT = Component(
    name="orbit",
    parameters=(INERTIA, *FIELD_PARAMETERS, DIPOLE, DENSITY, ALTITUDE, SCALE_HEIGHT, PLATES),
    configure=configure,
    configuration=CONFIGURATION,
    state=CURSOR,
    inputs=(TRUE_ATTITUDE,),
    outputs=(ENVIRONMENT_TORQUE, ORBIT_POSITION, ORBIT_VELOCITY, SUN),
    step=step,
    bound=bound,
)
