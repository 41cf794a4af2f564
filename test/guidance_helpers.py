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

"""Records of guidance for tests."""

import gzip
import json
import math
from typing import Any

import numpy as np
from craft_helpers import orbit_record
from truth_tables import TRUTH

from ppc_attitude.contract.run_record import Array
from ppc_attitude.science.guidance.frames import SPINNING, frame_at
from ppc_attitude.science.guidance.goals import STATE, begin, motion_now
from ppc_attitude.science.guidance.orders import ORDER, Orders
from ppc_attitude.science.guidance.rotation import Motion
from ppc_attitude.science.guidance.trajectory import POINTS
from ppc_attitude.science.kernel import Quaternion
from ppc_attitude.science.orbit import CURSOR
from ppc_attitude.science.part import Part
from ppc_attitude.science.references.goal import COMPONENT, configuration_of, configure

DEGREE = math.pi / 180.0
START = (0.155396346674834, 0.42708995923308624, 0.47918873440527965, 0.7508823469635318)
DESIRED = (0.20000447615026493, -0.5000111903756623, -0.5000111903756623, -0.6782151786255484)
STRAIGHT = (0.0, 0.0, 0.0, 1.0)
MOTION = ("qx", "qy", "qz", "qw", "wx", "wy", "wz", "ax", "ay", "az")
"""Columns of a motion in the truth's tables."""
RADIUS, TILT = 6378137.0 + 550e3, math.radians(97.6)
TURNING = math.sqrt(3.986004418e14 / RADIUS**3)  # [rad/s] of the default orbit


def scenes() -> list[dict[str, Any]]:
    """Keep-out scenes of the truth data."""
    with gzip.open(TRUTH / "keepout.json.gz", "rt") as file:
        cases: list[dict[str, Any]] = json.load(file)["cases"]
    return cases


def mean_anomaly(e: float, true: float) -> float:
    """Mean anomaly [rad] of a true one [rad] on an orbit with an eccentricity."""
    eccentric = 2.0 * math.atan(math.sqrt((1.0 - e) / (1.0 + e)) * math.tan(0.5 * true))
    return eccentric - e * math.sin(eccentric)


def truth_orbit() -> Any:
    """Orbit of pointing.csv and goal_switch.csv: true anomaly 10° at t = 0."""
    mean = mean_anomaly(0.001, math.radians(10.0))
    return orbit_record(6928137.0, 0.001, *map(math.radians, (97.6, 30.0, 40.0)), mean)


def guidance(*each: tuple[Any, str, float]) -> Any:
    """Configuration with the default limits, the truth's orbit and ground point, and `cones`."""
    target = {"target.latitude": math.radians(47.0), "target.longitude": math.radians(8.0)}
    kept_out = cones(*each) if each else {}
    given = {**COMPONENT.defaults, **target, "spin.axis": [0.0, 0.6, 0.8], **kept_out}
    record, *_no_orders = configure(given)
    record["sky"]["orbit"] = truth_orbit()
    record["sky"]["days"] = 9132.0
    record["sky"]["earth_angle"] = math.radians(350.0)
    return record


def begun(attitude: Quaternion, t: float = 0.0) -> Any:
    """State at rest at an attitude."""
    state = np.zeros((), STATE)[()]
    begin(t, attitude, state)
    return state


def goals(*each: tuple[float, str, Any]) -> dict[str, Any]:
    """Parameters of goals: time [s], frame and attitude of each."""
    times, frames, attitudes = zip(*each, strict=True)
    numbers = [float(x) for attitude in attitudes for x in attitude]
    return {"goals.times": [*times], "goals.frames": [*frames], "goals.attitudes": numbers}


def cones(*each: tuple[Any, str, float]) -> dict[str, Any]:
    """Parameters of keep-out cones: body axis, direction and half angle [rad] of each."""
    axes, directions, half_angles = zip(*each, strict=True)
    return {
        "keep_out.axes": [float(x) for axis in axes for x in axis],
        "keep_out.directions": [*directions],
        "keep_out.half_angles": [*half_angles],
    }


def guided(orders: Any, profiles: Any = ()) -> Part:
    """The reference with the default parameters, orders and the profiles that they refer to."""
    part = Part(COMPONENT, COMPONENT.defaults)
    listed = np.concatenate([np.zeros(0, ORDER), *orders])
    record, *part.kept = configuration_of(
        COMPONENT.defaults, Orders(listed, np.array(list(profiles), POINTS))
    )
    part.hold(record)
    return part


def motion(t: float, configuration: Any, state: Any) -> Array:
    """q_d, ω_d, ω_d' as ten numbers."""
    return np.concatenate(motion_now(t, configuration, state))


def motion_of(frame: int, t: float, sky: Any) -> Motion:
    """Motion at t [s] of a frame that does not spin."""
    spinning, cursor = np.zeros((), SPINNING)[()], np.zeros((), CURSOR)[()]
    return frame_at(t, frame, spinning, sky, cursor)[0]


def assert_same(ours: Array, truth: Array, attitude: float, rate: float, bend: float) -> None:
    """See that two motions, ten numbers each, differ by no more than so much."""
    ours[:4] = same_sign(ours[:4], truth[:4])
    assert np.abs(ours[:4] - truth[:4]).max() <= attitude
    assert np.abs(ours[4:7] - truth[4:7]).max() <= rate
    assert np.abs(ours[7:] - truth[7:]).max() <= bend


def quaternion(values: Any) -> Quaternion:
    x, y, z, w = map(float, values)
    return (x, y, z, w)


def same_sign(q: Array, other: Array) -> Array:
    """Q or −q, whichever is nearer to another, row by row."""
    return np.where(np.sum(q * other, axis=-1, keepdims=True) < 0.0, -q, q)


def to_earth(t: Any) -> Any:
    """Direction to Earth's centre on the default orbit without J2, shape (n, 3)."""
    angle = TURNING * np.asarray(t, float)
    side = np.sin(angle)
    return -np.stack([np.cos(angle), side * math.cos(TILT), side * math.sin(TILT)], axis=-1)
