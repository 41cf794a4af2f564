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

"""The torque of air and sunlight on a craft of flat plates, none of which shades another."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import ZERO, Vector, add, cross, dot, kernel, scale, vector
from ppc_attitude.science.parameter import Parameter, record_type

PLATE = record_type(
    ("area", np.float64),  # [m²]
    ("normal", np.float64, (3,)),  # outward, unit, body axes
    ("centre", np.float64, (3,)),  # [m] from the centre of mass, body axes
    ("specular", np.float64),  # part of the light that it mirrors
    ("diffuse", np.float64),  # part of the light that it scatters
    ("drag", np.float64),  # C_d
)
MOST_PLATES = 16
_WIDTH = 10
PLATES = Parameter(
    "orbit.plates",
    [],
    "outer plates of the craft, ten numbers each: area [m²], outward normal, centre [m] from the "
    "centre of mass, parts of the light that are mirrored and scattered, drag coefficient",
    length=-_WIDTH,
    low=-1e6,
    high=1e6,
)


def plates_of(values: Mapping[str, Any]) -> NDArray[Any]:
    """Array of dtype `PLATE` from checked parameter values.

    Raises
    ------
    ConfigurationError
        Too many plates, or an impossible one; the message names it.
    """
    rows = np.reshape(values[PLATES.name], (-1, _WIDTH))
    if len(rows) > MOST_PLATES:
        raise ConfigurationError(
            f"{PLATES.name} has {len(rows)} plates; allowed: up to {MOST_PLATES}"
        )
    plates = np.zeros(len(rows), PLATE)
    for i, row in enumerate(rows):
        area, (specular, diffuse, drag) = row[0], row[7:]
        length = float(np.linalg.norm(row[1:4]))
        problem = ""
        if area <= 0.0 or drag < 0.0:
            problem = f"area = {area:g} m² and C_d = {drag:g}; allowed: > 0 and ≥ 0"
        elif abs(length - 1.0) > 1e-3:
            problem = f"a normal of length {length:g}; allowed: 1 within 1e-3"
        elif min(specular, diffuse) < 0.0 or specular + diffuse > 1.0:
            problem = f"mirrored {specular:g} and scattered {diffuse:g}; allowed: ≥ 0, together ≤ 1"
        if problem:
            raise ConfigurationError(f"{PLATES.name}: plate {i} has {problem}")
        plates[i] = (area, row[1:4] / length, row[4:7], specular, diffuse, drag)
    return plates


@kernel
def air_force(plate: Any, v: Vector, density: float) -> Vector:
    """Force [N] of the air: −½ ρ C_d A |v|² (n·v̂) v̂ where n·v̂ > 0; v [m/s] relative to the air."""
    against = dot(vector(plate.normal), v)
    if against <= 0.0:
        return ZERO
    return scale(-0.5 * density * plate.drag * plate.area * against, v)


@kernel
def sunlight_force(plate: Any, s: Vector, pressure: float) -> Vector:
    """Force [N] of sunlight: −P A c [(1 − ρ_s) s + 2 (ρ_s c + ρ_d/3) n] where c = n·s > 0.

    s is the unit vector to the Sun, the pressure P is in N/m².
    """
    n = vector(plate.normal)
    c = dot(n, s)
    if c <= 0.0:
        return ZERO
    along_n = 2.0 * (plate.specular * c + plate.diffuse / 3.0)
    return scale(-pressure * plate.area * c, add(scale(1.0 - plate.specular, s), scale(along_n, n)))


@kernel
def plates_torque(
    plates: Any, count: int, v: Vector, density: float, s: Vector, pressure: float
) -> Vector:
    """Σ r × F [N·m] of air and sunlight over the first `count` plates; all in body axes."""
    torque = ZERO
    for i in range(count):
        force = add(air_force(plates[i], v, density), sunlight_force(plates[i], s, pressure))
        torque = add(torque, cross(vector(plates[i].centre), force))
    return torque


def largest_torques(
    plates: NDArray[Any], speed: float, density: float, pressure: float
) -> tuple[float, float]:
    """Bounds of the torque [N·m] of air at a speed [m/s] and density, and of sunlight."""
    levers = plates["area"] * np.linalg.norm(plates["centre"], axis=1)
    air = 0.5 * density * speed**2 * float(np.sum(plates["drag"] * levers))
    push = 1.0 + plates["specular"] + 2.0 / 3.0 * plates["diffuse"]  # ≥ |F|/(P A)
    return air, pressure * float(np.sum(push * levers))
