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

"""Reaction wheels: their parameters and record, their columns, and their friction.

Drive electronics (`allocators.wheel_drive`), motors (`actuators.wheel_motors`) and body
(`plants.gyrostat`) read the same record. A wheel that the craft does not have is a row of zeros.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.allocation import certain_torque, largest_torque
from ppc_attitude.science.component import BODY, EFFORTS, MAX_WHEELS, VELOCITIES, Column
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.faults import OF_A_TORQUE, Failure, How
from ppc_attitude.science.kernel import ZERO, Vector, add, kernel, scale, vector
from ppc_attitude.science.parameter import RATE, Parameter, at_start, exact_text, record_type

_S = 3.0**-0.5
AXES = at_start(
    "wheels.axes",
    [_S, _S, _S, -_S, _S, _S, -_S, -_S, _S, _S, -_S, _S],
    f"spin axis of each wheel, body axes, three numbers each, up to {MAX_WHEELS} wheels; "
    "normalised",
    length=-3,
)


def _of_each(name: str, default: float, what: str, unit: str, **options: Any) -> Parameter:
    """Parameter that each wheel has."""
    return Parameter(name, [default], f"{what}; once each, or one for all", unit, **options)


INERTIA = _of_each(
    "wheels.inertia", 8e-4, "spin inertia J_s of each wheel", "kg·m²", above=0.0, read_only=True
)
MAX_TORQUE = _of_each(
    "wheels.max_torque", 0.05, "largest motor torque of each wheel", "N·m", above=0.0
)
MAX_SPEED = _of_each("wheels.max_speed", 628.3, "largest speed of each wheel", "rad/s", low=1e-30)
INITIAL_SPEED = _of_each(
    "wheels.initial_speed",
    0.0,
    "speed of each wheel at t = 0, relative to the body",
    "rad/s",
    read_only=True,
)
VISCOUS = _of_each("wheels.viscous", 3e-6, "viscous friction", "N·m·s", low=0.0)
COULOMB = _of_each("wheels.coulomb", 5e-4, "Coulomb friction", "N·m", low=0.0)
STATIC = _of_each(
    "wheels.static", 8e-4, "static friction, at least the Coulomb friction", "N·m", low=0.0
)
STRIBECK_SPEED = _of_each(
    "wheels.stribeck_speed",
    2.0,
    "speed over which friction falls from static to Coulomb",
    "rad/s",
    above=0.0,
)
TRANSITION_SPEED = _of_each(
    "wheels.transition_speed", 0.1, "speed over which friction changes its sign", "rad/s", above=0.0
)
_EACH = (
    INERTIA,
    MAX_TORQUE,
    MAX_SPEED,
    INITIAL_SPEED,
    VISCOUS,
    COULOMB,
    STATIC,
    STRIBECK_SPEED,
    TRANSITION_SPEED,
)
PARAMETERS = (AXES, *_EACH)
QUIET = {COULOMB.name: [0.0], STATIC.name: [0.0]}
"""Parameters with which no wheel sticks: at rest wheels answer as those that run."""
WHEELS = record_type(
    ("count", np.int64),
    ("h", np.float64),  # [s] of a step
    ("axes", np.float64, (MAX_WHEELS, 3)),  # unit, body
    *((each.name.partition(".")[2], np.float64, (MAX_WHEELS,)) for each in _EACH),
    ("full", np.float64, (MAX_WHEELS,)),  # [rad/s] from here a step may reach the largest
)
SPEED = Column(
    "wheel_speed",
    "wheels/speed",
    VELOCITIES,
    BODY,
    "rad/s",
    "speed of each wheel relative to the body",
    width=MAX_WHEELS,
    part="wheel",
)
_motor_torque = partial(
    Column, form=EFFORTS, frame=BODY, unit="N·m", width=MAX_WHEELS, part="wheel"
)
TORQUE = _motor_torque(
    "wheel_torque", "wheels/torque", meaning="motor torque of each wheel, from the stamp on"
)
COMMAND = _motor_torque(
    "wheel_torque_command",
    "wheels/torque_command",
    meaning="motor torque that each wheel is asked for, from the stamp on",
)
TRACE = 1e-9
"""Share of its torque that a wheel at its largest speed keeps, so that no load is infinite."""
_HOW = (*OF_A_TORQUE, Failure(How.DRAG, 1, 1.0), Failure(How.SEIZED))


def parts_of(values: Mapping[str, Any]) -> dict[str, tuple[Failure, ...]]:
    """Return each wheel by its name, and how it can fail."""
    return {f"wheel/{i}": _HOW for i in range(len(values[AXES.name]) // 3)}


def torques(values: Mapping[str, Any]) -> tuple[float, float]:
    """Torque on an axis [N·m] that the wheels give in any direction, and their largest one."""
    axes = axes_of(values)
    limits = np.broadcast_to(values[MAX_TORQUE.name], len(axes))  # one is for all
    return certain_torque(axes, limits), largest_torque(axes, limits)


def wheel_record(values: Mapping[str, Any]) -> Any:
    """Record of dtype `WHEELS` from checked parameter values.

    Raises
    ------
    ConfigurationError
        Too many wheels, lists of different lengths, axes that do not span space, a speed beyond
        the largest, or friction that a step cannot follow or a motor cannot overcome.
    """
    record = np.zeros((), WHEELS)[()]
    axes = axes_of(values)
    count = len(axes)
    record["count"] = count
    record["h"] = 1.0 / values[RATE.name]
    record["axes"][:count] = axes
    for parameter in _EACH:
        given = values[parameter.name]
        if len(given) not in (1, count):
            raise ConfigurationError(
                f"{parameter.name} has {len(given)} values; allowed: 1, or {count}, one for each "
                "wheel"
            )
        record[parameter.name.partition(".")[2]][:count] = given
    gained = record["max_torque"][:count] / (record["inertia"][:count] * values[RATE.name])
    record["full"][:count] = record["max_speed"][:count] - gained
    for i in range(count):
        _check(record, i)
    return record


def axes_of(values: Mapping[str, Any]) -> NDArray[np.float64]:
    """Unit axes of the wheels, shape (n, 3).

    Raises
    ------
    ConfigurationError
        Too many wheels, or axes that do not span space.
    """
    numbers = values[AXES.name]
    axes = np.reshape(np.array(numbers, np.float64), (-1, 3))
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    if len(axes) > MAX_WHEELS or not (lengths > 1e-6).all():
        raise ConfigurationError(
            f"{AXES.name} = {numbers}; allowed: up to {MAX_WHEELS} axes, each longer than 1e-6"
        )
    axes /= lengths
    if np.linalg.matrix_rank(axes, 1e-6) < 3:
        raise ConfigurationError(
            f"{AXES.name} = {numbers}: such wheels give no torque about some axis; allowed: axes "
            "that do not all lie in one plane"
        )
    return axes


def momenta(values: Mapping[str, Any], speeds: NDArray[np.float64]) -> NDArray[np.float64]:
    """Σ J_s Ω a [N·m·s], body, of parameter values and speeds [rad/s], shape (…, ≥ count).

    Raises
    ------
    ConfigurationError
        Too many wheels, or axes that do not span space.
    """
    axes = axes_of(values)
    spun = speeds[..., : len(axes)] * np.asarray(values[INERTIA.name])  # one is for all
    return np.asarray(spun @ axes)


def _check(record: Any, i: int) -> None:
    """Refuse what wheel i cannot be."""
    speed, largest = abs(record["initial_speed"][i]), record["max_speed"][i]
    if speed > largest:
        raise ConfigurationError(
            f"{INITIAL_SPEED.name} = {exact_text(speed)} rad/s of wheel {i}; allowed: at most "
            f"{MAX_SPEED.name} = {exact_text(largest)}"
        )
    static, coulomb = record["static"][i], record["coulomb"][i]
    if static < coulomb:
        raise ConfigurationError(
            f"{STATIC.name} = {exact_text(static)} N·m of wheel {i}; allowed: at least "
            f"{COULOMB.name} = {exact_text(coulomb)}"
        )
    resistance = max(static, coulomb + record["viscous"][i] * largest)
    if resistance >= record["max_torque"][i]:
        raise ConfigurationError(
            f"{MAX_TORQUE.name} = {exact_text(record['max_torque'][i])} N·m of wheel {i}; allowed: "
            f"more than its largest friction of {exact_text(resistance)} N·m"
        )
    see_that_a_step_follows(record, i)


def see_that_a_step_follows(record: Any, i: int, drag: float = 1.0) -> None:
    """Check that friction, times a drag, does not reverse wheel i within a step.

    Raises
    ------
    ConfigurationError
        It does.
    """
    h = record["h"]
    decay = h * drag * steepest(record, i) / record["inertia"][i]
    if decay > 1.0:
        times = f" and {drag:g} times its friction" if drag != 1.0 else ""
        less = ", or less drag" if drag != 1.0 else ""
        raise ConfigurationError(
            f"{TRANSITION_SPEED.name} = {record['transition_speed'][i]:g} rad/s of wheel "
            f"{i}{times}: in a step of {h:g} s friction takes {decay:.6g} times the speed; "
            f"allowed: at most 1, by a larger {TRANSITION_SPEED.name}, or rate{less}"
        )


def steepest(record: Any, part: int | slice) -> Any:
    """Largest slope f'(Ω) [N·m·s/rad] of the friction of a wheel or wheels: that at Ω = 0."""
    return record["static"][part] / record["transition_speed"][part] + record["viscous"][part]


@kernel
def friction(wheels: Any, i: int, speed: float) -> float:
    """Torque f(Ω) [N·m] against a wheel's motion (Stribeck), smooth through zero."""
    over = speed / wheels.stribeck_speed[i]
    dry = wheels.coulomb[i] + (wheels.static[i] - wheels.coulomb[i]) * np.exp(-over * over)
    return float(dry * np.tanh(speed / wheels.transition_speed[i]) + wheels.viscous[i] * speed)


@kernel
def room(wheels: Any, i: int, speed: float) -> tuple[float, float]:
    """Torques [N·m] that bring a wheel to its largest speed in a step, backwards and forwards."""
    faster = wheels.inertia[i] * (wheels.max_speed[i] - speed) / wheels.h
    slower = wheels.inertia[i] * (wheels.max_speed[i] + speed) / wheels.h
    return slower, faster


@kernel
def momentum(wheels: Any, speeds: Any) -> Vector:
    """Σ J_s Ω a [N·m·s], body, of wheels at their speeds [rad/s] relative to it."""
    total = ZERO
    for i in range(wheels.count):
        total = add(total, scale(wheels.inertia[i] * speeds[i], vector(wheels.axes[i])))
    return total
