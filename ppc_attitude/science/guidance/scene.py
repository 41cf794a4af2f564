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

"""The surroundings that guidance publishes for drawing: goal and keep-out cones."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ppc_attitude.science.guidance.sight import directions_at, goal_at
from ppc_attitude.science.kernel import Quaternion, Vector, vector

_GOAL, _CONE = "goal in inertial axes", "keep-out cone "


class Cone(NamedTuple):
    """A keep-out cone at an instant."""

    axis: Vector  # unit vector that must stay away, body axes
    direction: Vector  # unit vector that it must stay away from, inertial axes
    half_angle: float  # [rad] least allowed angle between the two


class Scene(NamedTuple):
    """The goal, as an inertial attitude x y z w, and the cones at an instant."""

    goal: Quaternion
    cones: tuple[Cone, ...]


def scene_at(t: float, guidance: Any, state: Any) -> Scene:
    """Scene at t [s], not before the last step.

    Parameters
    ----------
    guidance, state
        Records of dtype `GUIDANCE` and `STATE`.
    """
    look, cones = state["look"], guidance["cones"]
    look["ahead"] = look["now"]
    goal = goal_at(t, state["plans"][state["active"]], guidance["sky"], look["ahead"])
    directions = directions_at(t, guidance, look["ahead"])
    # There are as many directions as cones, and room for more cones.
    rows = zip(cones["body_axis"], directions, cones["half_angle"], strict=False)
    return Scene(goal, tuple(Cone(vector(b), vector(s), float(angle)) for b, s, angle in rows))


def told(scene: Scene) -> dict[str, str]:
    """Scene as names and texts, which keep every digit."""
    cones = {
        f"{_CONE}{i}": _text((*cone.axis, *cone.direction, cone.half_angle))
        for i, cone in enumerate(scene.cones)
    }
    return {_GOAL: _text(scene.goal), **cones}


def heard(facts: Mapping[str, str]) -> Scene | None:
    """Scene among names and texts, as `told` wrote it; None if there is none.

    Raises
    ------
    ValueError
        It is not as `told` writes it.
    """
    if _GOAL not in facts:
        return None
    x, y, z, w = _numbers(facts, _GOAL, 4).tolist()
    cones = []
    for name in facts:
        if name.startswith(_CONE):
            numbers = _numbers(facts, name, 7)
            cones.append(Cone(vector(numbers), vector(numbers[3:]), float(numbers[6])))
    return Scene((x, y, z, w), tuple(cones))


def _numbers(facts: Mapping[str, str], name: str, count: int) -> Any:
    numbers = np.array(facts[name].split(), np.float64)
    if numbers.size != count or not np.isfinite(numbers).all():
        raise ValueError(f"{name} = {facts[name]!r}; allowed: {count} finite numbers")
    return numbers


def _text(numbers: tuple[float, ...]) -> str:
    return " ".join(repr(float(number)) for number in numbers)
