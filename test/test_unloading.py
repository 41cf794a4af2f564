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

"""Magnetorquers that unload wheels: the law, the field, and what becomes of the momentum."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import truth_tables
from craft_helpers import case, conditions, configs, orbit_record, part_of
from estimation_helpers import STEP_NS, Array
from guidance_helpers import mean_anomaly
from record_helpers import new_record
from scipy.spatial.transform import Rotation

from ppc_attitude.contract.topics import ALLOCATOR, PLANT, REFERENCE
from ppc_attitude.science.attitude import to_body
from ppc_attitude.science.environments.paper import ENVIRONMENT_BOUND
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.geomagnetic import ORBIT_FIELD, magnetic_field
from ppc_attitude.science.kinds import ACTUATORS, ALLOCATORS, PLANTS
from ppc_attitude.science.magnetorquers import unloading_dipole
from ppc_attitude.science.orbit import CURSOR, orbit_at
from ppc_attitude.science.part import Part
from ppc_attitude.simulation.closed_loop import simulate
from ppc_attitude.simulation.scenario import load

FILES = configs("paper", "wheels", "orbit", "unloading")
RODS = ACTUATORS.components["wheels_rods"]
AXES = np.reshape(RODS.defaults["wheels.axes"], (4, 3))
FIELD = (1.2e-5, -2.5e-5, 3.1e-5)  # [T]


def rods_of(**given: Any) -> Any:
    """Configuration of the rods; parameters without the group's name."""
    named = {f"magnetorquers__{name}": value for name, value in given.items()}
    return part_of(ACTUATORS, "wheels_rods", **named).configuration[0]["law"]


def speeds_of(momentum: Array) -> Array:
    """Speeds of the four wheels [rad/s] with a momentum [N·m·s]."""
    return np.concatenate([np.linalg.pinv(8e-4 * AXES.T) @ momentum, np.zeros(4)])


def truth_field() -> tuple[Any, list[float]]:
    """Field and attitude of the table `unloading`, from its notes."""
    notes = " ".join(truth_tables.notes("unloading"))
    elements = notes.split("orbit (")[1].split(")")[0].split(",")
    (a, e), angles = map(float, elements[:2]), np.deg2rad(np.array(elements[2:], np.float64))
    field = new_record(ORBIT_FIELD)
    field["orbit"] = orbit_record(a, e, *angles[:3], mean_anomaly(e, angles[3]))
    field["earth_angle"] = 1.0
    harmonics = field["harmonics"]
    harmonics["degree"] = 1
    harmonics["g"][1, 0], harmonics["g"][1, 1], harmonics["h"][1, 1] = (
        float(each) for each in notes.split("h11 = [")[1].split("] T")[0].split(",")
    )
    return field, [float(each) for each in notes.split("attitude ")[1].split()[:4]]


def test_wheels_are_unloaded_as_in_the_truth() -> None:
    """Three hours in a dipole field, the craft held still; the momentum is integrated here."""
    (field, q), truth = truth_field(), truth_tables.table("unloading")
    cursor, rods = new_record(CURSOR), rods_of(deadband=0.0)
    momenta, fields, dipoles = (
        truth_tables.columns(truth, *(f"{name}{axis}" for axis in "xyz")) for name in "hBm"
    )

    def field_at(t: float) -> Any:
        r, _ = orbit_at(t, field["orbit"], cursor)
        return to_body(magnetic_field(r, t, field), tuple(q[:3]), q[3])

    h, worst = momenta[0], np.zeros(3)
    for second in range(10801):
        b = field_at(float(second))
        dipole = unloading_dipole(tuple(h), b, second, rods)
        if second % 60 == 0:
            row = second // 60
            off = [h - momenta[row], b - fields[row], dipole - dipoles[row]]
            worst = np.maximum(worst, np.abs(off).max(axis=1))
        mean = np.add(b, np.add(np.multiply(4.0, field_at(second + 0.5)), field_at(second + 1.0)))
        h = h + np.cross(dipole, mean / 6.0)
    assert np.all(worst < (1e-12, 1e-15, 1e-10)), worst


def test_what_is_across_the_field_goes_and_the_rest_stays() -> None:
    h, b = np.array([0.02, 0.05, -0.03]), np.array(FIELD)
    dipole = unloading_dipole(tuple(h), FIELD, 0, rods_of())
    across = h - b * (h @ b) / (b @ b)
    assert np.cross(dipole, b) == pytest.approx(-1e-3 * across, rel=1e-12)
    weak = unloading_dipole(tuple(h), FIELD, 0, rods_of(max_dipole=0.5))
    assert np.abs(weak).max() == pytest.approx(0.5, rel=1e-12)
    assert np.linalg.norm(np.cross(weak, dipole)) < 1e-15
    for off in (rods_of(deadband=0.07), rods_of(law="off")):
        assert not any(unloading_dipole(tuple(h), FIELD, 0, off))
    assert any(unloading_dipole(tuple(h), FIELD, 0, rods_of(deadband=0.06)))


def test_noise_of_the_magnetometer_belongs_to_a_step() -> None:
    """Across the momentum, along the field: k/B² (Δh × n)·B̂, so σ is k |Δh| σ_B/B²."""
    b = np.array(FIELD)
    h = np.cross(b, [1.0, 2.0, -1.0])
    h *= 0.1 / np.linalg.norm(h)
    noisy = rods_of(magnetometer_noise=1e-7)
    drawn = np.array([unloading_dipole(tuple(h), FIELD, step, noisy) for step in range(4000)])
    along = drawn @ b / np.linalg.norm(b)
    assert along.std() == pytest.approx(1e-3 * 0.1 * 1e-7 / (b @ b), rel=0.05)
    assert tuple(drawn[17]) == unloading_dipole(tuple(h), FIELD, 17, noisy)
    noisy["seed"] = 1
    assert tuple(drawn[17]) != unloading_dipole(tuple(h), FIELD, 17, noisy)


def test_rods_act_beside_the_wheels_and_hold_their_dipole_for_a_period() -> None:
    rods = part_of(ACTUATORS, "wheels_rods", magnetorquers__period=0.5)
    wheels = part_of(ACTUATORS, "wheels")
    random = np.random.default_rng(5)
    dipoles = []
    for k in range(120):
        told = [*(0.02 * random.normal(size=3)), *(0.01 * random.normal(size=3))]
        told += [*speeds_of(0.1 * random.normal(size=3))]
        b = 3e-5 * random.normal(size=3)
        given = np.array(rods.step(k * STEP_NS, [*told, *b]))
        plain = np.array(wheels.step(k * STEP_NS, told))
        dipole = rods.output("magnetorquer_dipole")
        assert np.array_equal(given[3:11], plain[3:11])
        assert np.array_equal(given[:3], plain[:3] + np.cross(dipole, b))
        dipoles.append(dipole)
    begins = [0, 50, 100]
    assert [k for k in range(1, 120) if dipoles[k] != dipoles[k - 1]] == begins[1:]


def test_rods_give_one_dipole_whoever_asks_and_no_more_than_they_can() -> None:
    """By a law on board, and by one in a node; a smaller limit holds within a period, too."""
    board = part_of(ACTUATORS, "wheels_rods", magnetorquers__period=0.01)
    law = part_of(ALLOCATORS, "wheel_drive_rods", magnetorquers__period=0.01)
    motors = part_of(ACTUATORS, "wheel_motors_rods")
    random = np.random.default_rng(6)
    for k in range(500):
        speeds, b = speeds_of(0.7 * random.normal(size=3)), 3e-5 * random.normal(size=3)
        row = [*[0.0] * 6, *speeds, *b]
        sent = law.step(k * STEP_NS, row)
        wheels, dipole = sent[law.places["wheel_torque_command"]], sent[-3:]
        given = motors.step(k * STEP_NS, [*wheels, *[0.0] * 3, *speeds, *dipole, *b])
        assert given == board.step(k * STEP_NS, row)
    held = part_of(ACTUATORS, "wheels_rods")
    asked = np.array(held.step(0, row)[-3:])
    held.configure({**RODS.defaults, "rate": 100.0, "magnetorquers.max_dipole": 0.5})
    assert held.step(STEP_NS, row)[-3:] == pytest.approx(0.5 * asked / np.abs(asked).max())


def test_a_rod_that_fails_gives_another_dipole() -> None:
    faults = ["magnetorquer/x effectiveness 0.5", "magnetorquer/y stuck -3 from 0.5 for 0.2"]
    row = [*[0.0] * 6, *speeds_of(np.array([0.1, 0.2, -0.05])), *FIELD]
    whole, part = part_of(ACTUATORS, "wheels_rods"), part_of(ACTUATORS, "wheels_rods", *faults)
    for k in range(100):
        asked = np.array(whole.step(k * STEP_NS, row))[-3:]
        given = np.array(part.step(k * STEP_NS, row))
        expected = [0.5 * asked[0], -3.0 if 50 <= k < 70 else asked[1], asked[2]]
        assert np.abs(asked).min() > 0.0
        assert given[-3:] == pytest.approx(expected, rel=1e-12)
        turned = np.array(part.output("applied_torque")) - whole.output("applied_torque")
        assert turned == pytest.approx(np.cross(expected - asked, FIELD), abs=1e-15)


def test_the_field_takes_momentum_and_nothing_else_does() -> None:
    """H of craft and wheels, inertial axes: it changes by the torque of the rods alone."""
    given = {"initial_angular_velocity": [0.02, -0.01, 0.03], "wheels__initial_speed": [300.0]}
    plant, free = (part_of(PLANTS, name, **given) for name in ("gyrostat_rods", "gyrostat"))
    random = np.random.default_rng(2)
    motor, dipole, momenta, attitudes, pushes = np.zeros(8), np.zeros(3), [], [], []
    for k in range(400):
        told = np.array(plant.step(k * STEP_NS, [*motor, 0.0, 0.0, 0.0, *dipole]))
        attitudes.append(Rotation.from_quat(told[:4]))
        body = np.diag([2.8, 2.5, 1.9]) @ told[4:7] + 8e-4 * AXES.T @ told[7:11]
        momenta.append(attitudes[-1].apply(body))
        motor[:4], dipole = 0.02 * random.normal(size=4), 10.0 * random.normal(size=3)
        pushes.append(np.cross(dipole, told[15:18]))
    taken = [np.zeros(3)]
    for (a, b), push in zip(pairwise(attitudes), pushes, strict=False):
        between = a * Rotation.from_rotvec((a.inv() * b).as_rotvec() / 2.0)
        taken.append(taken[-1] + 0.01 * between.apply(push))
    off = np.subtract(momenta, momenta[0]) - taken
    assert np.abs(off).max() < 1e-6 * np.linalg.norm(taken[-1])
    # Without a dipole it is the gyrostat to the last bit.
    plant.forget()
    for k in range(50):
        motor[:4] = 0.02 * random.normal(size=4)
        given_now = plant.step(k * STEP_NS, [*motor, 1e-3, 0.0, 2e-3, 0.0, 0.0, 0.0])
        assert given_now[:15] == free.step(k * STEP_NS, [*motor, 1e-3, 0.0, 2e-3])


def test_a_law_that_is_switched_off_in_flight_holds_no_dipole() -> None:
    """It held the one of the period, which may be a quarter of an hour."""
    given = {**RODS.defaults, "rate": 100.0, "magnetorquers.period": 900.0}
    part = Part(RODS, given)
    read = [*np.zeros(6), *speeds_of(np.array([0.1, 0.2, -0.1])), *FIELD]
    part.step(0, read)
    assert np.any(part.output("magnetorquer_dipole"))
    part.configure({**given, "magnetorquers.law": "off"})
    part.step(STEP_NS, read)
    assert not np.any(part.output("magnetorquer_dipole"))


@pytest.mark.parametrize(
    ("chosen", "reason"),
    [
        ({"plant": "gyrostat"}, "wheels_rods reads magnetic_field, which no selected component"),
        ({"actuator": "wheels"}, "gyrostat_rods reads magnetorquer_dipole, which no selected"),
        ({"magnetorquers.period": 0.015}, "magnetorquers.period = 0.015 s is 1.5 steps at rate"),
        ({"magnetorquers.max_dipole": 0.0}, r"max_dipole = 0.0 A·m²; allowed: .*> 0"),
        (
            {"magnetorquers.max_dipole": 500.0, "wheels.max_torque": [0.03]},
            r"max_dipole = 500 A·m² gives 0.0495 N·m .* less than the 0.0346 N·m that",
        ),
        ({"magnetorquers.law": "b-dot"}, "magnetorquers.law = 'b-dot'; allowed: one of"),
        ({"orbit.field": "dipole"}, "orbit.field = igrf; allowed: dipole, as in spacecraft_plant"),
        ({"orbit.altitude": 600e3}, "orbit.altitude = 550000.0; allowed: 600000.0"),
    ],
)
def test_what_does_not_go_with_rods_is_refused(chosen: dict[str, Any], reason: str) -> None:
    with pytest.raises(ConfigurationError, match=reason):
        load(FILES, {PLANT: chosen})


def test_the_torque_limit_has_room_for_the_rods() -> None:
    certain, most = ACTUATORS.components["wheels"].torques(RODS.defaults)
    with_rods = RODS.torques({**RODS.defaults, "magnetorquers.max_dipole": 100.0})
    for dipole in 100.0 * np.array([[1.0, 1.0, 1.0], [1.0, -1.0, 0.0], [0.0, 1.0, 1.0]]):
        torque = np.abs(np.cross(dipole, [0.0, 5e-5, -4.8e-5])).max()
        assert most + torque < with_rods[1] < most + 1.5 * 100.0 * 7e-5
        assert certain - torque > with_rods[0]


@pytest.mark.long
def test_magnetorquers_empty_the_wheels_of_a_craft_that_holds_its_attitude() -> None:
    given = {PLANT: {"wheels.initial_speed": [500.0, 200.0, -100.0, 100.0]}}
    still = {REFERENCE: {"amplitude": [0.0, 0.0, 0.0]}}
    flight = simulate(load(FILES, {**given, **still}), 7200.0)
    momenta = np.linalg.norm(8e-4 * flight["wheel_speed"][:, :4] @ AXES, axis=1)
    assert momenta[0] > 0.4
    assert momenta[-100:].max() < 0.02
    assert np.abs(flight["attitude_error"][12000:, :3]).max() < 5e-4


@pytest.mark.parametrize(("gain", "grows"), [(0.09, False), (0.1, True)])
def test_a_dipole_that_is_held_too_long_is_warned_of(gain: float, grows: bool) -> None:
    """In a field at rest each period of 21 s multiplies the momentum across it by 1 − k T."""
    rods = rods_of(gain=gain, deadband=0.0, max_dipole=100.0)
    h, field = np.array([0.0, 0.0, 0.01]), np.array([3e-5, 0.0, 0.0])
    for _ in range(10):
        h += 21.0 * np.cross(unloading_dipole(tuple(h), tuple(field), 0, rods), field)
    assert bool(abs(h[2]) > 0.01) == grows
    law = {"magnetorquers.gain": gain, "magnetorquers.period": 21.0}
    craft = case("wheels", "orbit", "unloading").with_values(PLANT, **law)
    node = case("wheels", "orbit", "unloading", "allocator_unloading").with_values(ALLOCATOR, **law)
    for each in (craft, node):
        assert conditions(each)["unloading in a period"].holds != grows
    off = craft.with_values(PLANT, **{"magnetorquers.law": "off"})
    assert "unloading in a period" not in conditions(off)


def test_an_environment_beyond_what_magnetorquers_take_up_is_warned_of() -> None:
    """The paper's torque is of one sign for hours; the wheels are full after minutes."""
    for names, torque, enough in ((["orbit"], 5.4e-5, True), ([], ENVIRONMENT_BOUND, False)):
        craft = case("wheels", "unloading", *names)
        assert conditions(craft, environment=torque)["unloading torque"].holds == enough
        speeds = np.abs(simulate(craft, 400.0)["wheel_speed"])
        assert bool(speeds.max() < 0.99 * 628.3) == enough


def test_a_deadband_beyond_what_a_wheel_holds_is_warned_of() -> None:
    """The wheels would be full before they are unloaded."""
    craft = case("wheels", "orbit", "unloading")
    assert conditions(craft)["unloading deadband"].holds
    full = craft.with_values(PLANT, **{"magnetorquers.deadband": 0.51})
    assert not conditions(full)["unloading deadband"].holds
