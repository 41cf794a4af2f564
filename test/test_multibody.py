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

"""Wheels and flexible modes: the motion of a craft that has them."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
import truth_tables
from craft_helpers import FRICTIONLESS, part_of
from estimation_helpers import STEP_NS, Array, angles_between
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ppc_attitude.science import multibody
from ppc_attitude.science.component import MAX_WHEELS
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kinds import PLANTS
from ppc_attitude.science.part import Part


def values_after(line: str, *names: str) -> list[float]:
    """The number after each name in a line."""
    return [float(line.split(f"{name} ", 1)[1].split(maxsplit=1)[0].rstrip(";")) for name in names]


plant_of = partial(part_of, PLANTS)
# Three wheels, the first about z; and the inertia [kg·m²] of its speed relative to the body.
Z_FIRST = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]
RELATIVE = 1.0 / (1.0 / 8e-4 + 1.0 / (1.9 - 8e-4))


def padded(torques: Array) -> Array:
    return np.concatenate([torques, np.zeros(MAX_WHEELS - torques.size)])


@pytest.mark.parametrize(
    ("case", "allowed"),
    [("wheels_pyramid", (1e-12, 1e-13, 1e-10)), ("wheels_zero_crossing", (1e-7, 1e-8, 1e-5))],
)
def test_wheels_move_as_two_integrators_say(case: str, allowed: tuple[float, ...]) -> None:
    told, rows = truth_tables.notes(case), truth_tables.numbers(case)
    each = [line for line in told if line.startswith("# wheel ")]
    axes = [line.split("axis ")[1].split(";")[0].split() for line in each]
    sine = ("amplitude", "frequency", "phase", "offset")
    amplitude, frequency, phase, offset = np.array([values_after(line, *sine) for line in each]).T
    (friction,) = (line for line in told if line.startswith("# friction: "))
    names = ("viscous", "coulomb", "static", "stribeck", "transition")
    viscous, coulomb, static, stribeck, transition = values_after(friction, *names)
    part = plant_of(
        "gyrostat",
        initial_attitude=rows[0, 1:5].tolist(),
        initial_angular_velocity=rows[0, 5:8].tolist(),
        wheels__axes=[float(number) for axis in axes for number in axis],
        wheels__initial_speed=rows[0, 8:12].tolist(),
        wheels__viscous=[viscous],
        wheels__coulomb=[coulomb],
        wheels__static=[static],
        wheels__stribeck_speed=[stribeck],
        wheels__transition_speed=[transition],
    )
    torques, k = np.zeros(8), 0
    worst = np.zeros(3)
    for row in rows:
        while k <= round(100.0 * row[0]):
            told_now = np.array(part.step(k * STEP_NS, [*torques, 0.0, 0.0, 0.0]))
            if k % 10 == 0:  # each torque is held for 0.1 s
                swing = np.sin(2.0 * np.pi * frequency * (k / 100.0) + phase)
                torques = padded(amplitude * swing + offset)
            k += 1
        off = np.abs(told_now[:11] - row[1:12])
        turned = angles_between(told_now[:4], row[1:5])
        worst = np.maximum(worst, [turned, off[4:7].max(), off[7:].max()])
    assert np.all(worst < allowed), worst


@pytest.mark.parametrize(("torque", "start"), [(0.05, -20.0), (0.5, -203.0)])
def test_a_wheel_that_crosses_zero_at_full_torque_is_that_of_an_integrator(
    torque: float, start: float
) -> None:
    """In a step it crosses the speeds over which friction changes its sign, and bends."""
    part = plant_of(
        "gyrostat",
        wheels__axes=Z_FIRST,
        wheels__initial_speed=[start, 0.0, 0.0],
    )

    def faster(_: float, speed: Array) -> Array:
        dry = 5e-4 + 3e-4 * np.exp(-((speed / 2.0) ** 2))
        return np.asarray((torque - dry * np.tanh(speed / 0.1) - 3e-6 * speed) / RELATIVE)

    truth = solve_ivp(faster, (0.0, 0.5), [start], method="DOP853", rtol=1e-13, atol=1e-12).y[0, -1]
    for k in range(51):
        given = part.step(k * STEP_NS, [torque, *[0.0] * 10])
    assert given[7] > 10.0
    assert given[7] == pytest.approx(truth, abs=1e-6)
    assert given[6] == pytest.approx(-8e-4 / 1.9 * (truth - start), abs=1e-9)


def test_a_wheel_that_friction_alone_stops_slows_by_its_closed_form() -> None:
    """J Ω' = −f tanh(Ω/Ω_t) gives sinh(Ω/Ω_t) = sinh(Ω(0)/Ω_t) exp(−f t/(J Ω_t)).

    In a step friction takes nearly all of the speed; undivided, that would be off by 2 %.
    """
    transition, start = 0.0101, 0.02
    part = plant_of(
        "gyrostat",
        wheels__axes=Z_FIRST,
        wheels__initial_speed=[start, 0.0, 0.0],
        wheels__transition_speed=[transition],
        wheels__coulomb=[8e-4],
        wheels__viscous=[0.0],
    )
    for k in range(6):
        given = part.step(k * STEP_NS, [0.0] * 11)
        decay = math.exp(-8e-4 * 0.01 * k / (RELATIVE * transition))
        truth = transition * math.asinh(math.sinh(start / transition) * decay)
        assert given[7] == pytest.approx(truth, rel=5e-3)


@pytest.mark.parametrize("rate", [10.0, 50.0])
def test_a_small_craft_nutates_as_its_wheel_makes_it(rate: float) -> None:
    """About a wheel on the axis of symmetry the rate goes round in a circle.

    With M = J − Σ J_s a aᵀ, M_x = M_y, and c = J_s (Ω_w + ω) of the wheels constant, c_x = c_y = 0:
    M ω' = −ω × (M ω + c) turns ω_x, ω_y with λ = c_z/M_x while ω_z = 0.
    """
    radius, spin, speed = 0.02, 8e-4, 400.0
    part = plant_of(
        "gyrostat",
        rate=rate,
        inertia=[0.02, 0.0, 0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 0.03],
        initial_angular_velocity=[radius, 0.0, 0.0],
        wheels__axes=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        wheels__initial_speed=[-radius, 0.0, speed],
        **FRICTIONLESS,
    )
    faster = spin * speed / (0.02 - spin)  # λ [rad/s]: 1.7 rad in a step at 10 Hz
    for k in range(round(20.0 * rate) + 1):
        given = part.step(round(k * 1e9 / rate), [0.0] * 11)
        turn = faster * k / rate
        truth = [radius * math.cos(turn), radius * math.sin(turn), 0.0]
        assert given[4:7] == pytest.approx(truth, rel=0.0, abs=1e-7)


@pytest.mark.parametrize("plant", ["rigid_body", "gyrostat"])
def test_a_body_that_turns_far_in_a_step_moves_as_a_symmetric_top(plant: str) -> None:
    """R(t) = Rot(Ĥ, ‖H‖ t/A) R(0) Rot(z, −λ t), with λ = (C − A)/A ω_z, free of torque.

    A hit can make a small craft turn so far; a step that was not divided would be off by 3e-3 rad.
    """
    a, c, rates = 0.1, 0.17, np.array([12.0, -7.0, 14.0])  # [rad/s]: 0.2 rad in a step
    given = {"inertia": [a, 0.0, 0.0, 0.0, a, 0.0, 0.0, 0.0, c]}
    if plant == "gyrostat":  # wheels that carry nothing
        given |= {"wheels__inertia": [1e-12], "wheels__initial_speed": [0.0], **FRICTIONLESS}
    part = plant_of(plant, initial_angular_velocity=rates.tolist(), **given)
    nothing = [0.0] * sum(column.width for column in part.component.inputs)
    start = Rotation.from_quat(part.step(0, nothing)[:4])
    momentum = start.apply(rates * [a, a, c])
    for k in range(1, 2001):
        told = part.step(k * STEP_NS, nothing)[:4]
    precession = Rotation.from_rotvec(20.0 * momentum / a)
    spin = Rotation.from_rotvec([0.0, 0.0, -20.0 * (c - a) / a * rates[2]])
    assert (precession * start * spin * Rotation.from_quat(told).inv()).magnitude() < 1e-6


def test_flexible_modes_move_as_two_integrators_say() -> None:
    rows = truth_tables.numbers("flexible")
    modes = [line for line in truth_tables.notes("flexible") if line.startswith("# mode ")]
    coupling = [float(each) for line in modes for each in line.split("coupling ")[1].split()[:3]]
    part = plant_of(
        "flexible",
        inertia=[4.2, 0.0, 0.0, 0.0, 2.6, 0.0, 0.0, 0.0, 3.5],
        initial_attitude=rows[0, 1:5].tolist(),
        initial_angular_velocity=rows[0, 5:8].tolist(),
        flexible__frequency=[values_after(line, "frequency")[0] for line in modes],
        flexible__damping=[values_after(line.replace(",", ""), "ratio")[0] for line in modes],
        flexible__coupling=coupling,
    )
    worst, torque = np.zeros(3), np.zeros(3)
    for k in range(round(100.0 * rows[-1, 0]) + 1):
        given = np.array(part.step(k * STEP_NS, [*torque, 0.0, 0.0, 0.0]))
        torque = np.array([0.05, -0.02, 0.03]) if 100 <= k < 600 else np.zeros(3)
        if k % 10 == 0:
            row = rows[k // 10]
            bend = part.state[0]["motion"][multibody.BEND :]
            deflection = np.array([bend[0], bend[1], bend[6], bend[7]])
            off = [angles_between(given[:4], row[1:5]), np.abs(given[4:7] - row[5:8]).max()]
            worst = np.maximum(worst, [*off, np.abs(deflection - row[8:12]).max()])
    assert np.all(worst < (1e-9, 1e-8, 1e-7)), worst


@pytest.mark.parametrize(("frequency", "free_frequency"), [(0.35, 0.50220), (3.3, 4.73504)])
def test_one_mode_on_one_axis_swings_by_its_closed_form(
    frequency: float, free_frequency: float
) -> None:
    """Also a mode that turns by 0.298 rad in a step, which is as far as any may."""
    inertia, delta, damping, torque = 2.8, 1.2, 0.005, 0.05
    clamped = 2.0 * math.pi * frequency
    part = plant_of(
        "flexible",
        initial_attitude=[0.0, 0.0, 0.0, 1.0],
        flexible__frequency=[frequency],
        flexible__damping=[damping],
        flexible__coupling=[delta, 0.0, 0.0],
    )
    c = 1.0 - delta**2 / inertia
    swing, ratio = clamped / math.sqrt(c), damping / math.sqrt(c)
    free = swing * math.sqrt(1.0 - ratio**2)
    steady = -delta * torque / (inertia * clamped**2)
    assert swing / (2.0 * math.pi) == pytest.approx(free_frequency, abs=1e-5)
    for k in range(1001):
        given = part.step(k * STEP_NS, [torque, 0.0, 0.0, 0.0, 0.0, 0.0])
        t = k / 100.0
        decay = steady * math.exp(-ratio * swing * t)
        lag = ratio / math.sqrt(1.0 - ratio**2)
        bent = steady - decay * (math.cos(free * t) + lag * math.sin(free * t))
        rate = decay * swing / math.sqrt(1.0 - ratio**2) * math.sin(free * t)
        assert part.state[0]["motion"][multibody.BEND] == pytest.approx(bent, abs=1e-8)
        assert given[4] == pytest.approx((torque * t - delta * rate) / inertia, abs=1e-8)


def test_a_panel_on_a_hinge_turns_its_hub_as_two_bodies_in_free_flight_do() -> None:
    """The recipe of docs/actuators.md for frequency and coupling, beside the exact planar motion.

    Both bodies move as well as turn: with the modal mass of a panel on a clamped hub the rate would
    be off by 7e-3 rad/s.
    """
    hub, hub_inertia, hinge = 60.0, 2.5, 0.5  # [kg], [kg·m²] and [m] about the hub's own centre
    panel, own, reach, spring, torque = 4.0, 0.35, 0.7, 6.0, 0.05
    whole = hub + panel
    # The mass matrix of the two angles, with the centre of mass at rest.
    pulled = hub * panel / whole
    a, b, c = hub_inertia + pulled * hinge**2, pulled * hinge * reach, own + pulled * reach**2
    inertia, volume = a + 2.0 * b + c, a * c - b * b
    swing = math.sqrt(spring * inertia / volume)
    share = (b + c) ** 2 / (inertia * volume)  # of the hub in the mode that does not turn the whole
    # Recipe: from the panel's own numbers, and its place from the craft's centre of mass.
    mass = own + panel * reach**2 * (1.0 - panel / whole)
    moment = own + panel * (hub / whole * (hinge + reach)) * reach
    part = plant_of(
        "flexible",
        inertia=[6.0, 0.0, 0.0, 0.0, 7.0, 0.0, 0.0, 0.0, inertia],
        initial_attitude=[0.0, 0.0, 0.0, 1.0],
        flexible__frequency=[math.sqrt(spring / mass) / (2.0 * math.pi)],
        flexible__damping=[0.0],
        flexible__coupling=[0.0, 0.0, moment / math.sqrt(mass)],
    )
    for k in range(1001):
        given = part.step(k * STEP_NS, [0.0, 0.0, torque, 0.0, 0.0, 0.0])
        t = k / 100.0
        angle = torque * (t**2 / (2.0 * inertia) + share * (1.0 - math.cos(swing * t)) / swing**2)
        rate = torque * (t / inertia + share * math.sin(swing * t) / swing)
        assert 2.0 * math.atan2(given[2], given[3]) == pytest.approx(angle, abs=1e-9)
        assert given[6] == pytest.approx(rate, abs=1e-9)


def test_without_wheels_and_modes_the_body_is_rigid() -> None:
    start = {
        "initial_attitude": [0.5, 0.5, -0.5, 0.5],
        "initial_angular_velocity": [0.1, -0.2, 0.3],
    }
    rigid, flexible = (plant_of(name, **start) for name in ("rigid_body", "flexible"))
    for k in range(1000):
        torque = [0.05 * math.sin(0.1 * k), 0.02, -0.03, 0.001, 0.0, 0.002]
        one, other = (part.step(k * STEP_NS, torque) for part in (rigid, flexible))
    assert np.abs(np.subtract(one, other)).max() < 1e-14


@pytest.mark.parametrize("seed", range(4))
def test_momentum_is_exchanged_and_never_made(seed: int) -> None:
    """Random wheels, modes and motor torques; inertial momentum R (J ω + Σ J_s Ω a + δᵀη')."""
    random = np.random.default_rng(seed)
    count, inertia = 3 + seed, np.diag([2.8, 2.5, 1.9])
    axes, coupling = random.normal(size=(count, 3)), 0.4 * random.normal(size=(2, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    part = plant_of(
        "gyrostat",
        inertia=inertia.ravel().tolist(),
        initial_angular_velocity=(0.05 * random.normal(size=3)).tolist(),
        wheels__axes=axes.ravel().tolist(),
        wheels__initial_speed=(100.0 * random.normal(size=count)).tolist(),
        flexible__frequency=[0.4, 1.1],
        flexible__damping=[0.005, 0.01],
        flexible__coupling=coupling.ravel().tolist(),
    )
    momenta, torques = [], np.zeros(8)
    for k in range(3000):
        given = np.array(part.step(k * STEP_NS, [*torques, 0.0, 0.0, 0.0]))
        assert abs(np.linalg.norm(given[:4]) - 1.0) < 1e-15
        torques = padded(0.05 * random.uniform(-1.0, 1.0, count))
        bending = part.state[0]["motion"][multibody.BEND_RATE :][:2]
        spin = 8e-4 * given[7 : 7 + count]
        body = inertia @ given[4:7] + axes.T @ spin + coupling.T @ bending
        momenta.append(Rotation.from_quat(given[:4]).apply(body))
    off = np.linalg.norm(np.array(momenta) - momenta[0], axis=1).max()
    assert off < 1e-9 * np.linalg.norm(momenta[0])


def mode(frequency: float, damping: float, coupling: float) -> dict[str, Any]:
    """Parameters of one mode that swings about x."""
    numbers = {"frequency": [frequency], "damping": [damping], "coupling": [coupling, 0.0, 0.0]}
    return {f"flexible.{name}": value for name, value in numbers.items()}


# 0.9 of the speed of wheels on a stand; three quarters of the craft turn back.
HEAVY_WHEELS = {
    "wheels.axes": np.eye(3).ravel().tolist(),
    "wheels.inertia": [1.875],
    **{f"wheels.{name}": [0.0] for name in ("coulomb", "static")},
    "wheels.viscous": [168.75],
    "wheels.max_torque": [1e6],
    "inertia": (2.5 * np.eye(3)).ravel().tolist(),
}


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"wheels.axes": [1.0, 0.0, 0.0]}, "do not all lie in one plane"),
        ({"wheels.axes": [0.0] * 9}, "longer than 1e-6"),
        ({"wheels.axes": [1.0, 0.0, 0.0] * 9}, "up to 8 axes"),
        ({"wheels.inertia": [1e-3, 1e-3]}, "2 values; allowed: 1, or 4"),
        ({"wheels.initial_speed": [700.0]}, "at most wheels.max_speed"),
        ({"wheels.static": [1e-4]}, "at least wheels.coulomb"),
        ({"wheels.max_torque": [1e-3]}, "more than its largest friction"),
        ({"wheels.transition_speed": [1e-3]}, "by a larger wheels.transition_speed, or rate"),
        ({"wheels.inertia": [5.0]}, "more than that of the wheels"),
        (HEAVY_WHEELS, "friction takes 3.6 times the speed of such wheels on a craft of inertia"),
        ({"flexible.frequency": [0.5]}, "as many of each"),
        (mode(20.0, 0.01, 0.1), r"mode swings with 20 Hz; allowed at rate = 100 Hz: up to 4\.77"),
        # From 2.785 times on Runge and Kutta's fourth order diverges.
        (mode(1.3, 0.9, 1.6), "takes 1.7. times the speed of a mode; allowed: at most 1"),
    ],
)
def test_impossible_wheels_and_modes_are_refused(changed: dict[str, Any], reason: str) -> None:
    plant = PLANTS.components["gyrostat"]
    with pytest.raises(ConfigurationError, match=reason):
        Part(plant, {**plant.defaults, "rate": 100.0, **changed})
