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

"""Keep-out cones from a node's parameters."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.keep_out import CONES, FIXED, MOST_CONES, NADIR, SUN
from ppc_attitude.science.parameter import Parameter

BODY_AXES = Parameter(
    "keep_out.axes",
    [],
    "body axis of each keep-out cone, three numbers each; normalised",
    length=-3,
)
DIRECTIONS = Parameter(
    "keep_out.directions",
    ["sun"],
    "what each cone is about: `sun`, `nadir`, or three inertial numbers such as `0 0 1`; "
    "once each, or one for all",
)
HALF_ANGLES = Parameter(
    "keep_out.half_angles",
    [],
    "smallest angle allowed between axis and direction; once each",
    "rad",
    above=0.0,
    high=math.pi,
)
CONE_PARAMETERS = (BODY_AXES, DIRECTIONS, HALF_ANGLES)


def cones_of(values: Mapping[str, Any]) -> Any:
    """Record of dtype `CONES` from checked parameter values.

    Raises
    ------
    ConfigurationError
        Lists of different lengths, too many cones, or a direction without length.
    """
    cones = np.zeros((), CONES)[()]
    half_angles = values[HALF_ANGLES.name]
    axes = np.reshape(values[BODY_AXES.name], (-1, 3))
    count = len(half_angles)
    directions = one_for_each(DIRECTIONS.name, values[DIRECTIONS.name], count)
    if len(axes) != count:
        raise ConfigurationError(
            f"{BODY_AXES.name} has {axes.size} values, {HALF_ANGLES.name} {count}; "
            "allowed: 3 n and n"
        )
    if count > MOST_CONES:
        raise ConfigurationError(
            f"{HALF_ANGLES.name} has {count} values; allowed: up to {MOST_CONES}"
        )
    cones["count"] = count
    cones["half_angle"][:count] = half_angles
    for i, (axis, direction) in enumerate(zip(axes, directions, strict=True)):
        cones["body_axis"][i] = unit_vector(BODY_AXES.name, axis)
        cones["kind"][i] = {"sun": SUN, "nadir": NADIR}.get(direction, FIXED)
        if cones["kind"][i] == FIXED:
            try:
                numbers = [float(word) for word in direction.split()]
            except ValueError:
                numbers = []
            if len(numbers) != 3:
                raise ConfigurationError(
                    f"{DIRECTIONS.name} has {direction!r}; allowed: sun, nadir, or three numbers "
                    "such as '0 0 1'"
                )
            cones["direction"][i] = unit_vector(DIRECTIONS.name, numbers)
    return cones


def unit_vector(name: str, values: Any) -> NDArray[np.float64]:
    """Normalise a direction of a parameter.

    Raises
    ------
    ConfigurationError
        It has no length.
    """
    vector = np.asarray(values, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    if not 1e-6 < length < math.inf:
        raise ConfigurationError(
            f"{name} has {vector.tolist()}, which is no direction; allowed: a finite length > 1e-6"
        )
    return np.asarray(vector / length)


def one_for_each(name: str, texts: Sequence[str], count: int) -> Sequence[str]:
    """One text for each of `count`, which may be given once for all.

    Raises
    ------
    ConfigurationError
        Neither one text nor `count` texts are given.
    """
    if len(texts) == 1:
        return list(texts) * count
    if len(texts) != count:
        raise ConfigurationError(f"{name} has {len(texts)} values; allowed: 1 or {count}")
    return texts
