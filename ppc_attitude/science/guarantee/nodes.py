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

"""The surroundings of a law, from the parameters of other nodes, and their known bounds.

The torque that an actuator certainly gives, and its residual, are those that a certificate assumes.
With reaction wheels the drive compensates ω × h and friction at each sample. The craft then moves
like a rigid body with the inertia J* = J − Σ J_s a aᵀ,

    J* ω' + ω × J* ω = τ + d + r,

if the array can give τ + ω × h. The residual r comes from what changes until the next sample. h
follows from the momentum of the whole craft, H = J ω + h, which only external torques change. The
torque of magnetorquers that unload the wheels is part of r, too.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppc_attitude.science.actuators import ideal, wheels, wheels_rods
from ppc_attitude.science.allocation import certain_torque
from ppc_attitude.science.allocators.wheel_drive import COMPENSATION, KNOWLEDGE
from ppc_attitude.science.component import Component
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.inertia import gyroscopic_share
from ppc_attitude.science.kinds import (
    ACTUATORS,
    ENVIRONMENTS,
    ESTIMATORS,
    NONE,
    PLANTS,
    REFERENCES,
    SENSORS,
    Kind,
)
from ppc_attitude.science.magnetorquers import torque_of_rods
from ppc_attitude.science.multibody import FREQUENCY
from ppc_attitude.science.plants import gyrostat, gyrostat_rods, rigid_body
from ppc_attitude.science.sensors import direct, gyro_star_tracker
from ppc_attitude.science.wheels import momenta, wheel_record

Floats = NDArray[np.float64]
KNOWN: dict[str, tuple[Component, ...]] = {
    PLANTS.name: (rigid_body.COMPONENT, gyrostat.COMPONENT, gyrostat_rods.COMPONENT),
    SENSORS.name: (direct.COMPONENT, gyro_star_tracker.COMPONENT),
    ESTIMATORS.name: (mekf.COMPONENT,),
    ACTUATORS.name: (ideal.COMPONENT, wheels.COMPONENT, wheels_rods.COMPONENT),
}
HARDWARE = (PLANTS, SENSORS, ESTIMATORS, ACTUATORS)


class Actuation(NamedTuple):
    """An actuator and its effect on the body."""

    told: str  # description of `torque` for the user
    torque: float  # [N·m] largest that it can give on each axis at once
    dead_band: float  # [N·m] smallest command to which it responds
    late: bool  # whether a command acts one sample late
    rest: float  # [N·m] bound of the residual torque beside the command, per axis
    inertia: Floats  # [kg·m²] of the rigid body that it turns, shape (3, 3)


def has_wheels(plant: Mapping[str, Any]) -> bool:
    """Whether a plant's parameters select reaction wheels."""
    return ACTUATORS.selected(plant) in (wheels.COMPONENT, wheels_rods.COMPONENT)


def actuation_of(
    plant: Mapping[str, Any], momentum: float, fastest: float, commanded: float
) -> Actuation:
    """Read an actuator from the plant's checked parameters.

    Parameters
    ----------
    plant : mapping
        Checked parameters.
    momentum : float
        Bound of ‖H‖ of a craft with wheels [N·m·s].
    fastest : float
        Bound of ‖ω_s‖ [rad/s].
    commanded : float
        Bound of the commanded torque per axis [N·m].
    """
    inertia = np.reshape(plant["inertia"], (3, 3))
    if not has_wheels(plant):
        torque, dead = float(plant["max_torque"]), float(plant["min_torque"])
        return Actuation("max_torque", torque, dead, bool(plant["late_command"]), 0.0, inertia)
    craft = _wheels(plant)
    axes, motor, spin = craft["axes"], craft["max_torque"], craft["inertia"]
    friction = np.maximum(craft["static"], craft["coulomb"]) + craft["viscous"] * craft["max_speed"]
    spinning = (axes.T * spin) @ axes  # Σ J_s a aᵀ
    body = inertia - spinning
    gyroscopic = fastest * momentum + gyroscopic_share(inertia) * fastest**2  # ‖ω × h‖, h = H − J ω
    compensated = bool(plant[COMPENSATION.name])
    knowledge = float(plant[KNOWLEDGE.name])
    left = motor - np.minimum(knowledge * friction, motor)
    torque = certain_torque(axes, left) - compensated * gyroscopic
    # The disturbance is below the largest command, or nothing could be guaranteed.
    h, pushed = 1.0 / plant["rate"], 2.0 * math.sqrt(3.0) * max(min(torque, commanded), 0.0)
    least, most = np.linalg.eigvalsh(body)[0], np.linalg.eigvalsh(inertia)[-1]
    turned = (pushed + gyroscopic_share(body) * fastest**2) / least  # ‖ω'‖
    added = 0.5 * h * pushed  # to the momentum, until the next sample
    stored = momentum + added + most * fastest  # ‖h‖
    changed = 0.5 * pushed + fastest * (momentum + added) + most * turned  # ‖h'‖ in body axes
    if compensated:
        rest = h * (turned * stored + fastest * changed)
    else:
        rest = gyroscopic + fastest * added
    rest += gyroscopic_share(spinning) * fastest**2
    # Friction may change its sign within a sample, at the speed that a wheel gains meanwhile.
    gained = h * ((motor + friction) / spin + turned)
    unknown = 2.0 * (craft["static"] + craft["viscous"] * gained) + abs(1.0 - knowledge) * friction
    rest += float((unknown @ np.abs(axes)).max())
    if ACTUATORS.selected(plant) is wheels_rods.COMPONENT:
        rest += torque_of_rods(plant)
    return Actuation("guaranteed torque of the wheels", torque, 0.0, False, float(rest), body)


def momentum_of(plant: Mapping[str, Any], rates: ArrayLike, speeds: ArrayLike) -> Floats:
    """‖J ω + Σ J_s Ω a‖ [N·m·s] of rates [rad/s] and wheel speeds [rad/s], one row per instant."""
    inertia = np.reshape(plant["inertia"], (3, 3))
    whole = np.asarray(rates) @ inertia + momenta(plant, np.asarray(speeds))
    return np.asarray(np.linalg.norm(whole, axis=-1))


def first_momentum(plant: Mapping[str, Any], rate: ArrayLike) -> float:
    """‖J ω + h‖ [N·m·s] at a rate [rad/s], with the wheels at their initial speeds."""
    return float(momentum_of(plant, rate, _wheels(plant)["initial_speed"]))


def held_momentum(plant: Mapping[str, Any]) -> float:
    """‖h‖ [N·m·s] that the wheels can hold in any direction before one of them is full."""
    craft = _wheels(plant)
    return certain_torque(craft["axes"], craft["inertia"] * np.maximum(craft["full"], 0.0), 2)


def are_full(plant: Mapping[str, Any], speeds: Floats) -> NDArray[np.bool_]:
    """For each row of speeds [rad/s]: whether some wheel may reach its largest one in a sample."""
    full = _wheels(plant)["full"]
    return np.asarray((np.abs(speeds[:, : full.size]) >= full).any(axis=1))


def _wheels(plant: Mapping[str, Any]) -> dict[str, Floats]:
    """Numbers of the wheels that a craft has, by the fields of `wheels.WHEELS`."""
    record = wheel_record(plant)
    fields = (name for name in record.dtype.names if name not in ("count", "h"))
    return {name: record[name][: int(record["count"])] for name in fields}


class Nodes(NamedTuple):
    """Checked parameters of the nodes around the law."""

    plant: Mapping[str, Any]
    reference: Mapping[str, Any]
    injector: Mapping[str, Any]
    estimator: Mapping[str, Any]

    def selected(self, kind: Kind) -> Component | None:
        """Component of a kind that is selected."""
        others = {
            ESTIMATORS.name: self.estimator,
            REFERENCES.name: self.reference,
            ENVIRONMENTS.name: self.injector,
        }
        return kind.selected(others.get(kind.name, self.plant))

    def told(self, kind: Kind) -> str:
        """Say which component of a kind is selected."""
        found = self.selected(kind)
        return f"{kind.selector} = {found.name if found else NONE}"

    def unknown(self, kind: Kind) -> str:
        """Say which component of a kind is selected, if its bounds are not known here."""
        if kind is PLANTS and has_wheels(self.plant) and self.plant[FREQUENCY.name]:
            return f"{FREQUENCY.name} = {self.plant[FREQUENCY.name]}"
        return "" if self.selected(kind) in (None, *KNOWN[kind.name]) else self.told(kind)

    def motion_bounds(self, duration: float) -> tuple[float, float, float]:
        """Bounds of ‖ω_d‖ [rad/s], ‖ω_d'‖ [rad/s²] and ‖ω_d''‖ [rad/s³] for a time [s].

        An unknown bound is infinite.
        """
        found = self.selected(REFERENCES)
        if found is None or found.motion_bounds is None:
            return math.inf, math.inf, math.inf
        return found.motion_bounds(self.reference, duration)

    @property
    def torque_bound(self) -> float | None:
        """Bound of the norm of the environment's torque [N·m]; None if it is not known.

        It is zero if nothing is told of an environment: what acts is on record then.
        """
        if not self.injector:
            return 0.0
        found = self.selected(ENVIRONMENTS)
        return found.bound(self.injector) if found and found.bound else None

    @property
    def estimated(self) -> bool:
        """True if the law gets the estimate of a filter."""
        return self.selected(ESTIMATORS) is mekf.COMPONENT
