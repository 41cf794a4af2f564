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

"""Air and sunlight on plates against the formulas and Basilisk."""

import re

import numpy as np
import pytest
from truth_tables import columns, notes, table

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.plates import (
    PLATES,
    air_force,
    largest_torques,
    plates_of,
    plates_torque,
    sunlight_force,
)

TRUTH = table("plates")
PRESSURE = 1361.0 / 299792458.0
NUMBER = r"-?[\d.]+(?:e-?\d+)?"
ROWS = [
    [float(number) for number in re.findall(NUMBER, re.sub(r"m\^2", "", note))]
    for note in notes("plates")
    if note.startswith("# plate:")
]
CRAFT = plates_of({PLATES.name: np.ravel(ROWS).tolist()})


@pytest.mark.parametrize("kind", ["air", "srp"])
def test_forces_and_torques_are_the_truths(kind: str) -> None:
    suns, winds = columns(TRUTH, "sunx", "suny", "sunz"), columns(TRUTH, "vx", "vy", "vz")
    forces = columns(TRUTH, *(f"{kind}_f{axis}" for axis in "xyz"))
    torques = columns(TRUTH, *(f"{kind}_t{axis}" for axis in "xyz"))
    for s, v, density, force, torque in zip(
        suns, winds, TRUTH["density"], forces, torques, strict=True
    ):
        density, pressure = (density, 0.0) if kind == "air" else (0.0, PRESSURE)
        each = [
            np.add(air_force(plate, tuple(v), density), sunlight_force(plate, tuple(s), pressure))
            for plate in CRAFT
        ]
        total = plates_torque(CRAFT, len(CRAFT), tuple(v), density, tuple(s), pressure)
        assert np.linalg.norm(np.sum(each, axis=0) - force) <= 1e-12 * np.linalg.norm(force)
        assert np.linalg.norm(total - torque) <= 1e-12 * np.linalg.norm(torque)
        air, light = largest_torques(CRAFT, float(np.linalg.norm(v)), density, pressure)
        assert np.linalg.norm(total) <= air + light


GOOD = [0.35, 1.0, 0.0, 0.0, 0.24, 0.0, 0.0, 0.3, 0.2, 2.2]


@pytest.mark.parametrize(
    ("place", "value", "told"),
    [
        (0, 0.0, "area = 0 m²"),
        (1, 0.9, "a normal of length 0.9; allowed: 1"),
        (7, 0.9, "mirrored 0.9 and scattered 0.2; allowed"),
        (9, -1.0, "C_d = -1"),
    ],
)
def test_an_impossible_plate_is_named(place: int, value: float, told: str) -> None:
    bad = [*GOOD]
    bad[place] = value
    with pytest.raises(ConfigurationError, match=rf"orbit\.plates: plate 1 has .*{told}"):
        plates_of({PLATES.name: [*GOOD, *bad]})


@pytest.mark.parametrize("surface", [[0.0, 1.0, 0.0], [1.0, 0.0, 2.2]])
def test_a_plate_that_only_scatters_or_mirrors_is_possible(surface: list[float]) -> None:
    (plate,) = plates_of({PLATES.name: [*GOOD[:7], *surface]})
    assert [plate[name] for name in ("specular", "diffuse", "drag")] == surface


def test_seventeen_plates_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="has 17 plates; allowed: up to 16"):
        plates_of({PLATES.name: 17 * GOOD})
