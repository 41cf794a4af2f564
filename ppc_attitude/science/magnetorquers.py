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
from ppc_attitude.science.sensors.direct import SEED
from ppc_attitude.science.stamps import whole_steps
from ppc_attitude.science.wheels import INERTIA, MAX_SPEED, momentum

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
    "momentum of the wheels below which there is no dipole",
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
    "what the dipole is: that of the cross-product law, or none",
    choices=("cross_product", "off"),
)
NOISE = Parameter(
    "magnetorquers.magnetometer_noise",
    0.0,
    "standard deviation of the field as the law measures it, per axis",
    "T",
    low=0.0,
    high=1e-3,
)
PARAMETERS = (MAX_DIPOLE, GAIN, DEADBAND, PERIOD, LAW, NOISE, SEED)
MAGNETORQUERS = record_type(
    MAX_DIPOLE,
    GAIN,  # 0 if the law is off
    DEADBAND,
    ("period", np.int64),  # in steps
    NOISE,
    SEED,
    RATE,
)
HELD = record_type(
    ("begun", np.int64),  # periods, the present one included
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
        gain=values[GAIN.name] if values[LAW.name] == "cross_product" else 0.0,
        period=whole_steps(PERIOD.name, values[PERIOD.name], values[RATE.name]),
        seed=values[SEED.name],
        rate=values[RATE.name],
    )


def conditions(values: Mapping[str, Any], _: Task) -> Iterator[Condition]:
    """Compare what a period removes with twice the momentum, and what is left with a wheel."""
    if values[LAW.name] == "cross_product":
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
        yield advisable("unloading deadband", values[DEADBAND.name], held, "N·m·s", meaning)


def torque_of_rods(values: Mapping[str, Any]) -> float:
    """Largest torque on an axis [N·m]: two rods are across it."""
    return math.sqrt(2.0) * float(values[MAX_DIPOLE.name]) * STRONGEST_FIELD


@kernel
def within(m: Vector, most: float) -> Vector:
    """Dipole m [A·m²], scaled as a whole if it has more than `most` along an axis."""
    return scale(most / max(largest(m), most), m)


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
    if norm(excess) < rods.deadband:
        return ZERO
    b = add(b, scale(rods.magnetometer_noise, normal_vector(rods.seed, step, _CHANNEL)))
    m = scale(rods.gain / dot(b, b), cross(excess, b))
    return within(m, rods.max_dipole)


@kernel
def unload(inputs: Any, wheels: Any, held: Any, rods: Any) -> Vector:
    """Dipole m [A·m²] of an instant: that of the law, made when a period begins and held since.

    Parameters
    ----------
    inputs
        Record with the instant, the true field, and the speed of each wheel. All their momentum
        counts as Δh, because the momenta h* to which a drive leads the wheels cancel.
    wheels, held, rods
        Records of dtype `WHEELS`, `HELD` and `MAGNETORQUERS`.
    """
    now = step_of(inputs.stamp_ns, rods.rate)
    if now // rods.period + 1 != held.begun:
        held.begun = now // rods.period + 1
        full, b = momentum(wheels, inputs.wheel_speed), vector(inputs.magnetic_field)
        store(held.dipole, unloading_dipole(full, b, now, rods))
    if rods.gain == 0.0:  # switched off in flight, it holds nothing
        store(held.dipole, ZERO)
    return vector(held.dipole)
