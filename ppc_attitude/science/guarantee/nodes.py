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

"""The surroundings of a law, from the parameters of other nodes, and their known bounds."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from ppc_attitude.science.actuators import ideal, wheels, wheels_rods
from ppc_attitude.science.component import Component
from ppc_attitude.science.estimators import mekf
from ppc_attitude.science.guarantee.actuation import has_wheels
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
from ppc_attitude.science.multibody import FREQUENCY
from ppc_attitude.science.plants import gyrostat, gyrostat_rods, rigid_body
from ppc_attitude.science.sensors import direct, gyro_star_tracker

KNOWN: dict[str, tuple[Component, ...]] = {
    PLANTS.name: (rigid_body.COMPONENT, gyrostat.COMPONENT, gyrostat_rods.COMPONENT),
    SENSORS.name: (direct.COMPONENT, gyro_star_tracker.COMPONENT),
    ESTIMATORS.name: (mekf.COMPONENT,),
    ACTUATORS.name: (ideal.COMPONENT, wheels.COMPONENT, wheels_rods.COMPONENT),
}
HARDWARE = (PLANTS, SENSORS, ESTIMATORS, ACTUATORS)


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
