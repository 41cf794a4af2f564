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

"""Magnetorquers: their parameters and columns, and the law that unloads wheels.

In a field B a dipole m makes the torque m × B. By the cross-product law (Markley and Crassidis,
section 7.5) m = (k/B²) (Δh × B), so that m × B = −k Δh⊥: of a momentum Δh only the part across the
field is removed; but along the orbit the field turns.

Δh is the momentum of the wheels. With the law `b_dot` it is that of the body, too: a craft sees
the field turn by B' = −ω × B, so −(B × B')/B² is its rate across the field, whatever else it knows.
Without a commanded torque wheels take up nothing, and the body alone counts: this is the B-dot law
m = −(k J/B²) B' (Markley and Crassidis, section 7.5.1), which stops a tumbling craft that has no
attitude yet. With the wheels' momentum it would make the body turn until it cancels that.
"""

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from ppc_attitude.science.compiled_stamps import step_of
from ppc_attitude.science.component import BODY, VECTOR, Column
from ppc_attitude.science.conditions import Condition, Task, advisable
from ppc_attitude.science.faults import Failure, How
from ppc_attitude.science.kernel import (
    ZERO,
    Vector,
    add,
    cross,
    dot,
    kernel,
    largest,
    norm,
    scale,
    store,
    vector,
)
from ppc_attitude.science.noise import normal_vector
from ppc_attitude.science.parameter import RATE, Parameter, at_start, filled, record_type
from ppc_attitude.science.plants import rigid_body
from ppc_attitude.science.sensors.direct import SEED
from ppc_attitude.science.sensors.star_tracker import MAX_RATE
from ppc_attitude.science.stamps import whole_steps
from ppc_attitude.science.wheels import INERTIA, MAX_SPEED, momentum

B_DOT = "b_dot"
"""The law that also slows a turning body."""
STRONGEST_FIELD = 7e-5
"""[T] Earth's field is nowhere stronger above ground."""
MAX_DIPOLE = Parameter(
    "magnetorquers.max_dipole",
    10.0,
    "largest dipole along each axis; a larger one is scaled as a whole",
    "A·m²",
    above=0.0,
    high=1e6,
)
GAIN = Parameter(
    "magnetorquers.gain",
    1e-3,
    "gain k of unloading: rate at which wheel momentum across the field decays",
    "1/s",
    low=0.0,
    high=0.1,
)
DEADBAND = Parameter(
    "magnetorquers.deadband",
    0.01,
    "momentum below which there is no dipole",
    "N·m·s",
    low=0.0,
    high=1e6,
)
PERIOD = at_start(
    "magnetorquers.period",
    1.0,
    "time for which a dipole is held, a whole number of steps",
    "s",
    above=0.0,
    high=1e3,
)
LAW = Parameter(
    "magnetorquers.law",
    "cross_product",
    "which momentum is removed: that of the wheels (cross_product), that of wheels and body "
    "(b_dot), or none (off)",
    choices=("cross_product", B_DOT, "off"),
)
CRAFT_INERTIA = Parameter(
    "magnetorquers.craft_inertia",
    2.4,
    "inertia J of the craft about any axis, as b_dot takes it",
    "kg·m²",
    above=0.0,
    high=1e6,
)
NOISE = Parameter(
    "magnetorquers.magnetometer_noise",
    0.0,
    "standard deviation of the field as the law measures it, per axis",
    "T",
    low=0.0,
    high=1e-3,
)
PARAMETERS = (MAX_DIPOLE, GAIN, DEADBAND, PERIOD, LAW, CRAFT_INERTIA, NOISE, SEED)
MAGNETORQUERS = record_type(
    MAX_DIPOLE,
    GAIN,  # 0 if the law is off
    DEADBAND,
    CRAFT_INERTIA,  # 0 if the body's momentum is not removed
    ("period", np.int64),  # in steps
    NOISE,
    SEED,
    RATE,
)
HELD = record_type(
    ("begun", np.int64),  # periods, the present one included
    ("field", np.float64, (3,)),  # [T] measured when it began
    ("dipole", np.float64, (3,)),  # [A·m²] commanded, held
)
_dipole = partial(Column, form=VECTOR, frame=BODY, unit="A·m²")
DIPOLE = _dipole(
    "magnetorquer_dipole",
    "magnetorquers/dipole",
    meaning="dipole of the magnetorquers, from the stamp on",
)
COMMAND = _dipole(
    "magnetorquer_dipole_command",
    "magnetorquers/dipole_command",
    meaning="dipole that the magnetorquers are asked for, from the stamp on",
)
RODS = dict.fromkeys(
    ("magnetorquer/x", "magnetorquer/y", "magnetorquer/z"),
    (Failure(How.EFFECTIVENESS, 1, 0.0, 1.0), Failure(How.STUCK, 1, unit="A·m²")),
)
"""Each rod by its name, and how it can fail."""
_CHANNEL = 28  # of the noise, as is the next one; sensors have those below


def magnetorquer_record(values: Mapping[str, Any]) -> Any:
    """Record of dtype `MAGNETORQUERS` from checked parameter values.

    Raises
    ------
    ConfigurationError
        The period is no whole number of steps.
    """
    return filled(
        MAGNETORQUERS,
        values,
        "magnetorquers.",
        gain=0.0 if values[LAW.name] == "off" else values[GAIN.name],
        craft_inertia=values[CRAFT_INERTIA.name] if values[LAW.name] == B_DOT else 0.0,
        period=whole_steps(PERIOD.name, values[PERIOD.name], values[RATE.name]),
        seed=values[SEED.name],
        rate=values[RATE.name],
    )


def conditions(values: Mapping[str, Any], task: Task) -> Iterator[Condition]:
    """Compare what is removed in a period, and what is left, with what there is and may be.

    Of a tumbling craft that b_dot slows, its turn in a period and the time that it needs, too.
    """
    if values[LAW.name] != "off":
        yield advisable(
            "unloading in a period",
            values[GAIN.name] * values[PERIOD.name],
            2.0,
            "",
            "k T, with T the time for which a dipole is held: it does not turn the momentum across "
            "the field into a larger one of opposite sign",
        )
        held = np.multiply(values[INERTIA.name], values[MAX_SPEED.name]).min()  # [N·m·s]
        meaning = "momentum of the wheels from which on they are unloaded, against what one holds"
        if values[LAW.name] == B_DOT and MAX_RATE.name in task.craft:
            held = min(held, values[CRAFT_INERTIA.name] * task.craft[MAX_RATE.name])
            meaning = "momentum from which on it is removed, against what a wheel holds, and what "
            meaning += "the craft has at star_tracker.max_rate"
        yield advisable("unloading deadband", values[DEADBAND.name], held, "N·m·s", meaning)
        meaning = "largest torque of the environment, against the largest that the magnetorquers "
        meaning += "give about an axis: what they cannot take up stays in the wheels"
        most = torque_of_rods(values)
        yield advisable("unloading torque", task.environment, most, "N·m", meaning)
    if values[LAW.name] == B_DOT and rigid_body.INITIAL_RATE.name in task.craft:
        omega = np.array(task.craft[rigid_body.INITIAL_RATE.name])
        turn = float(np.linalg.norm(omega)) * values[PERIOD.name]
        meaning = "turn in the time for which a dipole is held: after more than π/2 it may spin "
        meaning += "the craft up"
        yield advisable("turn in a period", turn, math.pi / 2.0, "rad", meaning)
        if MAX_RATE.name in task.craft:
            meaning = "least time until the craft is slow enough for a fix, by the largest dipole "
            meaning += "in the strongest field, and by the gain, against settling deadline and run"
            least = _detumbling_time(values, task.craft, omega)
            there_is = min(task.deadline, task.duration or math.inf)
            yield advisable("time to detumble", least, there_is, "s", meaning)


def _detumbling_time(values: Mapping[str, Any], craft: Mapping[str, Any], omega: Any) -> float:
    """Least time [s] from a rate ω [rad/s] to that of the star tracker, with wheels at rest.

    A dipole takes momentum with a torque of up to √3 m B, and the law takes energy at a rate of up
    to 2 k J/J_min.
    """
    inertia, most = np.reshape(craft[rigid_body.INERTIA.name], (3, 3)), craft[MAX_RATE.name]
    least, _, largest = np.linalg.eigvalsh(inertia)
    torque = math.sqrt(3.0) * values[MAX_DIPOLE.name] * STRONGEST_FIELD
    by_dipole = (np.linalg.norm(inertia @ omega) - largest * most) / torque
    decay = 2.0 * values[GAIN.name] * values[CRAFT_INERTIA.name] / least
    energies = max(omega @ inertia @ omega / (largest * most**2), 1.0)  # of start and fix
    by_law = math.log(energies) / max(decay, 1e-300)
    return float(max(by_dipole, by_law))


def torque_of_rods(values: Mapping[str, Any]) -> float:
    """Largest torque on an axis [N·m]: two rods are across it."""
    return math.sqrt(2.0) * float(values[MAX_DIPOLE.name]) * STRONGEST_FIELD


@kernel
def within(m: Vector, most: float) -> Vector:
    """Dipole m [A·m²], scaled as a whole if it has more than `most` along an axis."""
    return scale(most / max(largest(m), most), m)


@kernel
def measured(b: Vector, step: int, rods: Any) -> Vector:
    """Field B [T] with the magnetometer's noise of a step."""
    return add(b, scale(rods.magnetometer_noise, normal_vector(rods.seed, step, _CHANNEL)))


@kernel
def rate_across(b: Vector, before: Vector, h: float) -> Vector:
    """Rate ω⊥ = −(B × B')/B² [rad/s] of a body that measured B [T] now and h [s] before."""
    return scale(1.0 / (h * dot(b, b)), cross(b, before))


@kernel
def unloading_dipole(excess: Vector, b: Vector, step: int, rods: Any) -> Vector:
    """Dipole m [A·m²] of the cross-product law, body axes.

    Parameters
    ----------
    excess
        Momentum Δh [N·m·s] that is to be removed, body axes.
    b
        True field B [T], body axes; the law measures it with noise.
    step
        Step to which the noise belongs.
    rods
        Record of dtype `MAGNETORQUERS`.
    """
    if norm(excess) < rods.deadband or b == ZERO:  # of no field, as one not yet measured
        return ZERO
    b = measured(b, step, rods)
    m = scale(rods.gain / dot(b, b), cross(excess, b))
    return within(m, rods.max_dipole)


@kernel
def unload(inputs: Any, wheels: Any, held: Any, rods: Any) -> Vector:
    """Dipole m [A·m²] of an instant: that of the law, made when a period begins and held since.

    Parameters
    ----------
    inputs
        Record with the instant, the true field, the commanded torque, and the speed of each wheel.
        All momentum of the wheels counts, because the momenta h* to which a drive leads them
        cancel.
    wheels, held, rods
        Records of dtype `WHEELS`, `HELD` and `MAGNETORQUERS`.
    """
    now = step_of(inputs.stamp_ns, rods.rate)
    period = now // rods.period + 1
    if period != held.begun:
        true, excess = vector(inputs.magnetic_field), momentum(wheels, inputs.wheel_speed)
        b = measured(true, now, rods)
        if rods.craft_inertia > 0.0:
            if vector(inputs.torque_command) == ZERO:
                excess = ZERO
            if 0 < held.begun == period - 1 and b != ZERO:  # the last field is a period old
                rate = rate_across(b, vector(held.field), rods.period / rods.rate)
                excess = add(excess, scale(rods.craft_inertia, rate))
        held.begun = period
        store(held.field, b)
        store(held.dipole, unloading_dipole(excess, true, now, rods))
    if rods.gain == 0.0:  # switched off in flight, it holds nothing
        store(held.dipole, ZERO)
    return vector(held.dipole)
