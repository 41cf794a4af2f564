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

"""The adversary's choice, as a vector of numbers: start, disturbance, craft."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import INJECTOR, PLANT, REFERENCE
from ppc_attitude.science.actuators.ideal import LATE_COMMAND
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.inertia import inertia_matrix
from ppc_attitude.science.kinds import ACTUATORS, PLANTS, REFERENCES
from ppc_attitude.science.plants.rigid_body import INERTIA
from ppc_attitude.science.references.paper import BEGIN
from ppc_attitude.simulation.scenario import (
    Scenario,
    check_components,
    see_that_it_has,
    spread,
    weakened,
)

_START = 7  # numbers of the start: a quaternion of any length, and a rate
# Numbers of the craft: six of a symmetric matrix, the actuator's strength, the instant of the
# reference at which the run begins, and whether commands act a sample late.
_CRAFT = 9


@dataclass(frozen=True)
class Space:
    """Bounds of what the adversary may choose about a scenario.

    Sudden disturbances of the scenario act in any case.
    """

    base: Scenario  # what it leaves as it is; its plant's `duration` is the length of every run
    rate: float  # [rad/s] largest ‖ω_s‖ at the start
    disturbance: float  # [N·m] bound of the torque in place of the environment's, per axis
    pieces: int  # of constant torque into which it is cut; 0: the environment acts as configured
    e_S: float  # largest relative error of the inertia, about any axis
    eta: float  # least share of its torque limit that the actuator has
    begin: float = 0.0  # [s] latest instant of the paper's reference at which a run begins
    late: bool = False  # whether commands may act a sample late

    def __post_init__(self) -> None:
        """See that the components have what is to be chosen, and accept its extremes."""
        for asked, kind, what, name in (
            (True, PLANTS, "start", "initial_attitude"),
            (self.rate, PLANTS, "rate at the start", "initial_angular_velocity"),
            (self.e_S, PLANTS, "inertia", INERTIA.name),
            (self.begin, REFERENCES, "begin of the reference", BEGIN.name),
            (self.late, ACTUATORS, "late commands", LATE_COMMAND.name),
        ):
            if asked:
                see_that_it_has(self.base, kind, what, name)
        extreme = self.scenario(np.ones(self.size))  # as fast, as weak and as late as any
        check_components(PLANT, extreme.parameters[PLANT])

    @property
    def duration(self) -> float:
        """Length of a run [s]."""
        return self.base.number(PLANT, "duration")

    @property
    def size(self) -> int:
        """How many numbers a choice has."""
        return _START + 3 * self.pieces + _CRAFT

    def choice(self, x: Array) -> dict[str, dict[str, Any]]:
        """Return the parameters of each node that a choice changes: any numbers of order one."""
        turn, rate = x[:4], x[4:_START]
        length = float(np.linalg.norm(turn))
        attitude = turn / length if length > 0.0 else np.array([0.0, 0.0, 0.0, 1.0])
        rate = rate / max(1.0, float(np.linalg.norm(rate)))  # no longer than one
        *inertia, strength, begin, late = x[-_CRAFT:].tolist()
        strength = 1.0 - (1.0 - self.eta) * min(abs(strength), 1.0)
        changed: dict[str, dict[str, Any]] = {
            PLANT: {
                "duration": self.duration,
                "initial_attitude": attitude.tolist(),
                "initial_angular_velocity": (self.rate * rate).tolist(),
                "inertia": self._changed_inertia(inertia).ravel().tolist(),
                **weakened(self.base.parameters[PLANT], strength),
            }
        }
        if self.late:
            changed[PLANT][LATE_COMMAND.name] = late > 0.0
        if self.begin:
            changed[REFERENCE] = {"begin": self.begin * min(abs(begin), 1.0)}
        if self.pieces:
            torques = self.disturbance * np.clip(x[_START:-_CRAFT], -1.0, 1.0)
            length, own = self.duration / self.pieces, self.base.parameters[INJECTOR]
            changed[INJECTOR] = {
                "environment": False,
                "pulse_times": [*own["pulse_times"], *(k * length for k in range(self.pieces))],
                "pulse_durations": [*own["pulse_durations"], *[length] * self.pieces],
                "pulse_torques": [*own["pulse_torques"], *torques.tolist()],
            }
        return spread(self.base.parameters, changed)

    def scenario(self, x: Array) -> Scenario:
        """Return the scenario of a choice."""
        return self.base.overlaid(self.choice(x))

    def _changed_inertia(self, numbers: list[float]) -> Array:
        """J = Ĵ^½ (I + S) Ĵ^½ with ‖S‖ ≤ e_S; S is halved until a rigid body can have it."""
        nominal = np.array(self.base.parameters[PLANT]["inertia"], np.float64).reshape(3, 3)
        if self.e_S == 0.0:
            return nominal
        x, y, z, yz, zx, xy = numbers
        S = np.array([[x, xy, zx], [xy, y, yz], [zx, yz, z]])
        S *= self.e_S / max(1.0, float(np.abs(np.linalg.eigvalsh(S)).max()))
        moments, axes = np.linalg.eigh(nominal)
        root = axes * np.sqrt(moments) @ axes.T
        for _ in range(20):
            inertia = root @ (np.eye(3) + S) @ root
            inertia = 0.5 * (inertia + inertia.T)
            try:
                return inertia_matrix("inertia", inertia)
            except ConfigurationError:
                S *= 0.5
        return nominal

    def to_json(self) -> Mapping[str, Any]:
        """Say what the space is, for a file that is to be continued in the same one."""
        numbers = ("rate", "disturbance", "pieces", "e_S", "eta", "duration", "begin", "late")
        return {"parameters": self.base.used} | {n: getattr(self, n) for n in numbers}
