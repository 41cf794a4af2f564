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

import math

import numpy as np
import pytest
from craft_helpers import orbit_record
from guidance_helpers import truth_orbit
from record_helpers import new_record
from scipy.integrate import solve_ivp
from truth_tables import columns, table

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.orbit import CURSOR, J2, MU, gravity, gravity_rate, orbit_at
from ppc_attitude.science.sky import EARTH_RADIUS

TRUTH = table("pointing")


def potential(r: np.ndarray) -> float:
    """Two bodies and J2, the textbook's potential: an independent source of the field."""
    radius = np.linalg.norm(r)
    sine = r[2] / radius
    return MU / radius * (1.0 - J2 * (EARTH_RADIUS / radius) ** 2 * (1.5 * sine**2 - 0.5))


def test_gravity_is_the_gradient_of_the_potential() -> None:
    r = np.array([4.2e6, 1.6e6, 5.25e6])
    h = 100.0
    expected = [
        (potential(r + h * axis) - potential(r - h * axis)) / (2.0 * h) for axis in np.eye(3)
    ]
    assert np.allclose(gravity(tuple(r)), expected, rtol=1e-8)


def test_gravity_rate_is_the_derivative_along_the_motion() -> None:
    r, v = np.array([4.2e6, 1.6e6, 5.25e6]), np.array([-4713.0, -3466.0, 4838.0])
    h = 0.5
    expected = (np.array(gravity(tuple(r + h * v))) - gravity(tuple(r - h * v))) / (2.0 * h)
    assert np.allclose(gravity_rate(tuple(r), tuple(v)), expected, rtol=1e-6)


def test_orbit_follows_an_independent_integration() -> None:
    orbit, cursor = truth_orbit(), new_record(CURSOR)
    end = 1800.5
    truth = solve_ivp(
        lambda _, y: (*y[3:], *gravity(tuple(y[:3]))),
        (0.0, end),
        np.concatenate([orbit["position"], orbit["velocity"]]),
        method="DOP853",
        rtol=1e-13,
        atol=1e-9,
    ).y[:3, -1]
    for t in np.arange(0.0, end, 0.7):
        orbit_at(t, orbit, cursor)
    assert np.linalg.norm(orbit_at(end, orbit, cursor)[0] - truth) < 5e-7


def test_orbit_of_the_truth_after_a_revolution() -> None:
    orbit, cursor = truth_orbit(), new_record(CURSOR)
    r = [orbit_at(t, orbit, cursor)[0] for t in TRUTH["t"]]
    assert np.abs(np.array(r) - columns(TRUTH, "rx", "ry", "rz")).max() < 1e-5


def test_orbit_is_a_function_of_time_alone() -> None:
    orbit, cursor = truth_orbit(), new_record(CURSOR)
    times = [0.0, 3.2, 3.7, 100.01, 20.0, 20.0]
    fresh = [orbit_at(t, orbit, new_record(CURSOR)) for t in times]
    assert [orbit_at(t, orbit, cursor) for t in times] == fresh


def test_perigee_below_ground_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"perigee is -.* m above"):
        orbit_record(7e6, 0.2, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("eccentricity", [0.0, 0.3, 0.9])
def test_elements_obey_keplers_equation_and_the_vis_viva(eccentricity: float) -> None:
    a = 8e7
    orbit = orbit_record(a, eccentricity, 1.0, 0.3, 0.2, 2.0)
    r, v = np.linalg.norm(orbit["position"]), np.linalg.norm(orbit["velocity"])
    assert v**2 == pytest.approx(MU * (2.0 / r - 1.0 / a), rel=1e-13)
    momentum = np.linalg.norm(np.cross(orbit["position"], orbit["velocity"]))
    assert momentum == pytest.approx(math.sqrt(MU * a * (1.0 - eccentricity**2)), rel=1e-13)
    radial = orbit["position"] @ orbit["velocity"]
    cosine, sine = 1.0 - r / a, radial / math.sqrt(MU * a)  # e cos E and e sin E
    mean = math.atan2(sine, cosine) - sine if eccentricity else 2.0
    assert mean == pytest.approx(2.0, rel=1e-12)
