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

"""The environment of an orbit: each torque, their sum, and what it does to a craft."""

import math
from pathlib import Path

import numpy as np
import pytest
from conftest import Ask
from craft_helpers import configs
from estimation_helpers import angles_between
from guidance_helpers import mean_anomaly
from scipy.spatial.transform import Rotation
from truth_tables import columns, table

from ppc_attitude.campaign.declaration import campaign, scenario_of_run
from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, PLANT
from ppc_attitude.science.attitude import to_body
from ppc_attitude.science.environments import orbit
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.geomagnetic import field_at, field_of
from ppc_attitude.science.kernel import matrix
from ppc_attitude.science.orbit import MU, epoch_of, orbit_of
from ppc_attitude.science.parameter import resolved
from ppc_attitude.science.part import Part
from ppc_attitude.science.plants import rigid_body
from ppc_attitude.science.sky import EARTH_RADIUS, earth_angle, lit_fraction, sun_direction
from ppc_attitude.science.stamps import nanoseconds
from ppc_attitude.simulation.scenario import load

FILES = configs("paper", "orbit")
GRADIENT = table("gravity_gradient")
ATTITUDES = columns(GRADIENT, "qx", "qy", "qz", "qw")
POSITIONS = columns(GRADIENT, "rx", "ry", "rz")
TORQUES = columns(GRADIENT, "taux", "tauy", "tauz")
STRAIGHT = (0.0, 0.0, 0.0, 1.0)
INERTIA = np.diag([2.8, 2.5, 1.9])
PLATE = [0.35, 1.0, 0.0, 0.0, 0.24, 0.015, -0.03, 0.3, 0.2, 2.2]
BOX = [*PLATE, 0.35, -1.0, 0.0, 0.0, -0.26, 0.015, -0.03, 0.3, 0.2, 2.2]


def values(**chosen: object) -> dict[str, object]:
    """Parameters of the injector; names with _ for the dots."""
    named = {f"orbit.{name}": value for name, value in chosen.items()}
    return {**resolved(PARAMETERS[INJECTOR], named, INJECTOR), "environment": "orbit"}


def truth_orbit() -> dict[str, object]:
    """Orbit of the truth: true anomaly 10° at t = 0."""
    return values(
        altitude=7.2e6 - EARTH_RADIUS,
        eccentricity=0.05,
        inclination=math.radians(98.7),
        raan=math.radians(30.0),
        argument_of_perigee=math.radians(40.0),
        mean_anomaly=mean_anomaly(0.05, math.radians(10.0)),
    )


def test_gravity_gradient_is_the_truths_at_every_state() -> None:
    inertia = matrix(INERTIA)
    for q, r, truth in zip(ATTITUDES, POSITIONS, TORQUES, strict=True):
        torque = orbit.gravity_gradient(to_body(tuple(r), tuple(q[:3]), float(q[3])), inertia)
        assert np.abs(torque - truth).max() < 1e-15


def test_where_the_craft_is_told_is_where_the_truth_is() -> None:
    told = Part(orbit.COMPONENT, truth_orbit())
    for t, r in zip(GRADIENT["t"], POSITIONS, strict=True):
        told.step(nanoseconds(t), STRAIGHT)
        assert np.linalg.norm(told.output("orbit_position") - r) < 1e-5
    motion = []
    for t in (6000.0, 6000.5, 6001.0):
        told.step(nanoseconds(t), STRAIGHT)
        motion.append([np.array(told.output(f"orbit_{each}")) for each in ("position", "velocity")])
    assert np.linalg.norm(motion[2][0] - motion[0][0] - motion[1][1]) < 1e-3  # in 1 s


def drift_from_the_truth(rate: float, end: float) -> float:
    """Largest attitude error [rad] of a free craft, stepped at a rate [Hz] up to an instant [s]."""
    first = {"initial_attitude": ATTITUDES[0], "initial_angular_velocity": [2e-4, -1.1e-3, 3e-4]}
    craft = Part(rigid_body.COMPONENT, {"inertia": INERTIA.ravel(), "rate": rate, **first})
    surroundings = Part(orbit.COMPONENT, truth_orbit())
    torque, worst = (0.0, 0.0, 0.0), 0.0
    compared = dict(zip(np.rint(GRADIENT["t"] * rate).astype(int), ATTITUDES, strict=True))
    for k in range(round(end * rate) + 1):
        stamp = nanoseconds(k / rate)
        motion = craft.step(stamp, (0.0, 0.0, 0.0, *torque))
        torque = surroundings.step(stamp, motion[:4])[:3]
        if k in compared:
            worst = max(worst, angles_between(np.array(motion[:4]), compared[k]))
    return worst


def test_a_free_craft_turns_as_in_the_truth() -> None:
    """The torque is held from step to step, so that ten times the rate leaves a tenth."""
    coarse, fine = drift_from_the_truth(1.0, 1800.0), drift_from_the_truth(10.0, 1800.0)
    assert fine < 2e-5
    assert coarse == pytest.approx(10.0 * fine, rel=0.02)


def test_the_sum_is_that_of_its_parts() -> None:
    """Composed again with rotations of SciPy, for a craft without plates."""
    moment = [0.3, -0.2, 0.5]
    given = values(raan=0.5, mean_anomaly=1.0, epoch="2025-03-20T10:00:00", residual_dipole=moment)
    first, days = orbit_of(given), epoch_of(given)
    attitude = Rotation.from_rotvec([0.4, -1.1, 2.0])
    r = first["position"]
    earth = Rotation.from_rotvec([0.0, 0.0, earth_angle(days)])
    b = earth.apply(field_at(tuple(earth.inv().apply(r)), field_of(days)))
    down = attitude.inv().apply(r) / np.linalg.norm(r)
    expected = np.cross(moment, attitude.inv().apply(b))
    expected += 3.0 * MU / np.linalg.norm(r) ** 3 * np.cross(down, INERTIA @ down)
    torque = Part(orbit.COMPONENT, given).step(0, attitude.as_quat())[:3]
    assert np.allclose(torque, expected, rtol=0.0, atol=1e-18)


def plates_alone(given: dict[str, object], attitude: Rotation) -> np.ndarray:
    """Torque of the plates [N·m] at t = 0: the whole less that of a craft without."""
    q = attitude.as_quat()
    bare = Part(orbit.COMPONENT, {**given, "orbit.plates": []}).step(0, q)
    return np.subtract(Part(orbit.COMPONENT, given).step(0, q), bare)[:3]


@pytest.mark.parametrize("density", [0.0, 1e-12])
def test_air_denser_than_any_in_an_orbit_is_refused(density: float) -> None:
    """Also where the exponential has no number: nothing times that is no number either."""
    given = {"air.density": density, "air.altitude": 1e7, "air.scale_height": 1e3}
    with pytest.raises(ConfigurationError, match=r"at the perigee; allowed: at most 1e-06"):
        orbit.configure(values(**given))


def test_wind_comes_from_ahead_and_is_that_of_the_turning_air() -> None:
    given = values(plates=PLATE, mean_anomaly=1.0, **{"air.density": 1e-9})
    first = orbit_of(given)
    r, v = first["position"], first["velocity"]
    wind = v - np.cross([0.0, 0.0, 7.292115e-5], r)
    speed = np.linalg.norm(wind)
    facing, _ = Rotation.align_vectors([wind / speed, r], [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    density = 1e-9 * math.exp(-(np.linalg.norm(r) - EARTH_RADIUS - 500e3) / 63.8e3)
    force = np.array([-0.5 * density * 2.2 * 0.35 * speed**2, 0.0, 0.0])
    expected = np.cross([0.24, 0.015, -0.03], force)
    assert np.allclose(plates_alone(given, facing), expected, rtol=1e-3)  # the Sun adds a little
    astern = facing * Rotation.from_rotvec([0.0, 0.0, math.pi])
    assert np.linalg.norm(plates_alone(given, astern)) < 1e-3 * np.linalg.norm(expected)


def test_the_sun_pushes_unless_earth_hides_it() -> None:
    """At both ends of an orbit in the plane of the Sun, without air."""
    epoch = {"epoch": "2025-03-20T10:00:00", "air.density": 0.0, "plates": PLATE}
    pushes = {}
    for anomaly in (0.0, math.pi):  # the Sun is at the equinox that day, where the orbit begins
        given = values(mean_anomaly=anomaly, **epoch)
        sun = np.array(sun_direction(epoch_of(given))[0])
        r = orbit_of(given)["position"]
        facing, _ = Rotation.align_vectors([sun, [0.0, 0.0, 1.0]], [[1.0, 0, 0], [0, 0, 1.0]])
        pushes[anomaly] = np.linalg.norm(plates_alone(given, facing))
        assert lit_fraction(tuple(r), tuple(1.496e11 * sun)) == (anomaly == 0.0)
        told = Part(orbit.COMPONENT, given)
        told.step(0, STRAIGHT)
        assert np.allclose(told.output("sun"), sun * (anomaly == 0.0), rtol=0.0, atol=1e-4)
    pressure = 1361.0 / 299792458.0 / 0.9959**2  # in March
    force = pressure * 0.35 * (0.7 + 2.0 * (0.3 + 0.2 / 3.0))
    assert pushes[0.0] == pytest.approx(force * math.hypot(0.015, 0.03), rel=2e-3)
    assert pushes[math.pi] < 1e-20


@pytest.mark.parametrize("eccentricity", [0.0, 0.02])
def test_no_torque_is_larger_than_its_bound(eccentricity: float) -> None:
    given = values(plates=BOX, eccentricity=eccentricity, residual_dipole=[0.05, -0.08, 0.1])
    bound = orbit.bound(given)
    part, random = Part(orbit.COMPONENT, given), np.random.default_rng(2)
    times = nanoseconds(1.0) * np.sort(random.integers(0, 12_000, 3000))
    turns = Rotation.random(3000, random_state=random).as_quat()
    torques = [part.step(int(t), q)[:3] for t, q in zip(times, turns, strict=True)]
    assert 0.15 * bound < np.linalg.norm(torques, axis=1).max() < bound


def test_gravity_gradient_above_the_equator_is_no_larger_than_its_bound() -> None:
    """There J2 takes a craft lowest: it is sampled at 45° to the vertical, where the torque is."""
    given = values(inclination=0.0, eccentricity=0.0)
    bound, part = orbit.bound(given), Part(orbit.COMPONENT, given)
    torques = []
    for t in range(2850, 3051):  # the first perigee is half a revolution after the start
        part.step(nanoseconds(t), STRAIGHT)
        x, y, _ = part.output("orbit_position")
        q = Rotation.from_euler("yz", [math.pi / 4.0, math.atan2(y, x)]).as_quat()
        torques.append(np.linalg.norm(part.step(nanoseconds(t), q)[:3]))
    assert bound * (1.0 - 1e-5) < max(torques) < bound


def test_what_a_campaign_draws_of_the_craft_is_what_gravity_acts_on() -> None:
    drawn = campaign({"inertia_error": 0.1}, load(FILES, {PLANT: {"duration": 1.0}}), 1)
    of = scenario_of_run(drawn, 0).parameters
    assert of[INJECTOR]["inertia"] == of[PLANT]["inertia"] != of[CONTROLLER]["inertia"]


@pytest.mark.usefixtures("coarse")
def test_a_guarantee_takes_the_torques_bound(tmp_path: Path, ask: Ask) -> None:
    files, gains = [f"--config={path}" for path in FILES], tmp_path / "gains.yaml"
    ask("design", *files, "--gains", 1, 15.4, 0.2, "--output", gains)  # a search would take longer
    bound = orbit.bound(load(FILES).parameters[INJECTOR])
    assert load([gains]).parameters[CONTROLLER]["momentum_tube.assumed.d"] == bound
