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

"""Earth's magnetic field against ppigrf and a sum of 40 digits."""

import numpy as np
import pytest
from truth_tables import rows

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.geomagnetic import field_at, field_of, largest_field
from ppc_attitude.science.sky import days_of

NAMES, ROWS = rows("magnetic")
TABLE = dict(zip(NAMES, ROWS.T, strict=True))
DAYS = [days_of("date", date) for date in TABLE["date"]]


def numbers(*names: str) -> np.ndarray:
    return np.stack([TABLE[name].astype(float) for name in names], axis=-1)


POSITIONS = [(float(x), float(y), float(z)) for x, y, z in numbers("rx", "ry", "rz")]


@pytest.mark.parametrize(("letter", "degree"), [("B", 13), ("D", 1)])
def test_the_field_is_the_truths(letter: str, degree: int) -> None:
    truth = numbers(*(f"{letter}{axis}" for axis in "xyz"))
    ours = [field_at(r, field_of(days, degree)) for r, days in zip(POSITIONS, DAYS, strict=True)]
    assert np.all(np.linalg.norm(ours - truth, axis=1) < 1e-12 * np.linalg.norm(truth, axis=1))


@pytest.mark.parametrize("degree", [1, 13])
def test_no_field_is_larger_than_its_bound(degree: int) -> None:
    field, radius = field_of(days_of("date", "2025-01-01"), degree), 6.7e6
    directions = np.random.default_rng(1).normal(size=(2000, 3))
    directions *= radius / np.linalg.norm(directions, axis=1, keepdims=True)
    largest = max(float(np.linalg.norm(field_at(tuple(r), field))) for r in directions)
    assert largest <= largest_field(radius, field) < 1.6 * largest


@pytest.mark.parametrize("date", ["1999-12-31", "2030-01-02"])
def test_a_date_outside_the_model_is_refused(date: str) -> None:
    with pytest.raises(ConfigurationError, match=r"allowed .*: from 2000-01-01 to 2030-01-01"):
        field_of(days_of("orbit.epoch", date))
