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

"""Orbit, date and ground point from a node's parameters."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.orbit import EARTH_RADIUS, MU, ORBIT
from ppc_attitude.science.parameter import Parameter
from ppc_attitude.science.sky import days_of
from ppc_attitude.science.two_line import orbit_by_lines

_TURN = math.tau
ALTITUDE = Parameter(
    "orbit.altitude",
    550e3,
    "semi-major axis less Earth's equatorial radius",
    "m",
    low=100e3,
    high=1e9,
    read_only=True,
    agreed=True,
)
ECCENTRICITY = Parameter(
    "orbit.eccentricity",
    0.0,
    "eccentricity; the perigee is above ground",
    low=0.0,
    high=0.99,
    read_only=True,
    agreed=True,
)
INCLINATION = Parameter(
    "orbit.inclination",
    1.7034413499,
    "inclination (97.6°)",
    "rad",
    low=0.0,
    high=math.pi,
    read_only=True,
    agreed=True,
)
RAAN = Parameter(
    "orbit.raan",
    0.0,
    "right ascension of the ascending node",
    "rad",
    low=-_TURN,
    high=_TURN,
    read_only=True,
    agreed=True,
)
ARGUMENT_OF_PERIGEE = Parameter(
    "orbit.argument_of_perigee",
    0.0,
    "argument of perigee",
    "rad",
    low=-_TURN,
    high=_TURN,
    read_only=True,
    agreed=True,
)
MEAN_ANOMALY = Parameter(
    "orbit.mean_anomaly",
    0.0,
    "mean anomaly at t = 0",
    "rad",
    low=-_TURN,
    high=_TURN,
    read_only=True,
    agreed=True,
)
EPOCH = Parameter(
    "orbit.epoch", "2025-01-01", "date of t = 0, ISO 8601, UTC", read_only=True, agreed=True
)
TLE = Parameter(
    "orbit.tle",
    "",
    "two-line element set, whose epoch is within 30 days of orbit.epoch; then the elements above "
    "have no meaning",
    read_only=True,
    agreed=True,
)
ORBIT_PARAMETERS = (
    ALTITUDE,
    ECCENTRICITY,
    INCLINATION,
    RAAN,
    ARGUMENT_OF_PERIGEE,
    MEAN_ANOMALY,
    EPOCH,
    TLE,
)
"""Parameters of every node that knows the orbit."""


def orbit_of(values: Mapping[str, Any]) -> Any:
    """Record of dtype `ORBIT` from checked parameter values.

    Raises
    ------
    ConfigurationError
        The perigee is below Earth's surface, or the two lines are no orbit.
    """
    if values[TLE.name]:
        return orbit_by_lines(TLE.name, values[TLE.name], epoch_of(values))
    return orbit_record(
        EARTH_RADIUS + values[ALTITUDE.name],
        values[ECCENTRICITY.name],
        values[INCLINATION.name],
        values[RAAN.name],
        values[ARGUMENT_OF_PERIGEE.name],
        values[MEAN_ANOMALY.name],
    )


def epoch_of(values: Mapping[str, Any]) -> float:
    """Days from J2000 to t = 0, from checked parameter values.

    Raises
    ------
    ConfigurationError
        The epoch is no date.
    """
    return days_of(EPOCH.name, values[EPOCH.name])


def orbit_record(
    semi_major_axis: float,
    eccentricity: float,
    inclination: float,
    raan: float,
    argument_of_perigee: float,
    mean_anomaly: float,
) -> Any:
    """Record of dtype `ORBIT` from the classical elements at t = 0.

    Parameters
    ----------
    semi_major_axis : float
        a [m].
    eccentricity : float
        e, 0 ≤ e < 1.
    inclination, raan, argument_of_perigee, mean_anomaly : float
        Angles [rad].

    Raises
    ------
    ConfigurationError
        The perigee is below Earth's surface.
    """
    perigee = semi_major_axis * (1.0 - eccentricity)
    if perigee <= EARTH_RADIUS:
        raise ConfigurationError(
            f"the orbit's perigee is {perigee - EARTH_RADIUS:.6g} m above Earth's surface; "
            "allowed: > 0"
        )
    eccentric = _eccentric_anomaly(mean_anomaly, eccentricity)
    root = math.sqrt(1.0 - eccentricity**2)
    distance = semi_major_axis * (1.0 - eccentricity * math.cos(eccentric))
    speed = math.sqrt(MU * semi_major_axis) / distance
    x = semi_major_axis * (math.cos(eccentric) - eccentricity)
    y = semi_major_axis * root * math.sin(eccentric)
    axes = (
        _about(2, raan) @ _about(0, inclination) @ _about(2, argument_of_perigee)
    )  # perifocal to inertial
    record = np.zeros((), ORBIT)[()]
    record["position"] = axes @ (x, y, 0.0)
    record["velocity"] = axes @ (
        -speed * math.sin(eccentric),
        speed * root * math.cos(eccentric),
        0.0,
    )
    return record


def _eccentric_anomaly(mean_anomaly: float, eccentricity: float) -> float:
    """E of Kepler's equation M = E − e sin E [rad], by Newton's method."""
    eccentric = mean_anomaly + eccentricity * math.sin(mean_anomaly)
    for _ in range(50):
        change = (eccentric - eccentricity * math.sin(eccentric) - mean_anomaly) / (
            1.0 - eccentricity * math.cos(eccentric)
        )
        eccentric -= change
        if abs(change) < 1e-15:
            break
    return eccentric


def _about(axis: int, angle: float) -> Any:
    """Rotation matrix about a coordinate axis (0: x, 2: z) by an angle [rad]."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = math.cos(angle)
    matrix[i, j], matrix[j, i] = -math.sin(angle), math.sin(angle)
    return matrix
