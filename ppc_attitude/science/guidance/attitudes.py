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

"""Attitudes from roll, pitch and yaw, or from the directions of two body axes."""

import math
from collections.abc import Sequence

from ppc_attitude.science.attitude import conjugate, product
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guidance.frames import LEAST_SINE, quaternion_of
from ppc_attitude.science.guidance.rotation import about
from ppc_attitude.science.kernel import Quaternion, Vector, cross, norm, scale


def from_euler(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Attitude x y z w after turns [rad] about the fixed axes x, y and z, in this order."""
    x = about((1.0, 0.0, 0.0), roll)
    y = about((0.0, 1.0, 0.0), pitch)
    z = about((0.0, 0.0, 1.0), yaw)
    return product(z, product(y, x))


def from_vectors(
    axis: Sequence[float],
    direction: Sequence[float],
    second_axis: Sequence[float],
    second_direction: Sequence[float],
) -> Quaternion:
    """Attitude x y z w that points a body axis, and a second one as near as it can.

    Parameters
    ----------
    axis, second_axis : three floats
        In body axes, of any length.
    direction, second_direction : three floats
        Where they shall point, in the frame of the attitude.

    Raises
    ------
    ConfigurationError
        The axes, or the directions, are parallel within 6°, or no direction at all.
    """
    seen = _triad("directions", direction, second_direction)
    carried = _triad("body axes", axis, second_axis)
    return product(quaternion_of(*seen), conjugate(quaternion_of(*carried)))


def _triad(
    name: str, first: Sequence[float], second: Sequence[float]
) -> tuple[Vector, Vector, Vector]:
    """Right-handed unit axes: the first along `first`, the third across both."""
    (x, y, z), (u, v, w) = first, second
    across = cross((x, y, z), (u, v, w))
    length, sine = norm((x, y, z)), norm(across)
    if not (math.isfinite(sine) and sine > LEAST_SINE * length * norm((u, v, w))):
        raise ConfigurationError(
            f"the two {name} are {[*map(float, first)]} and {[*map(float, second)]}; allowed: "
            "finite, and at least 6° from being parallel"
        )
    first, third = scale(1.0 / length, (x, y, z)), scale(1.0 / sine, across)
    return first, cross(third, first), third
