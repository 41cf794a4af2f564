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

import math
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from conftest import Ask
from guidance_helpers import same_sign
from scipy.spatial.transform import Rotation

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guidance.frames import from_euler, from_vectors


def test_euler_angles_are_turns_about_fixed_axes() -> None:
    angles = (0.3, -1.1, 2.5)
    expected = Rotation.from_euler("xyz", angles).as_quat()
    assert np.allclose(same_sign(np.array(from_euler(*angles)), expected), expected, atol=1e-15)


def test_first_axis_points_and_the_second_is_as_near_as_it_can() -> None:
    random = np.random.default_rng(5)
    for axis, direction, second_axis, second_direction in random.normal(size=(50, 4, 3)):
        if np.linalg.norm(np.cross(axis, second_axis)) < 1.0:
            continue  # near to parallel, which is refused
        if np.linalg.norm(np.cross(direction, second_direction)) < 1.0:
            continue
        turn = Rotation.from_quat(from_vectors(axis, direction, second_axis, second_direction))
        pointed = turn.apply(axis / np.linalg.norm(axis))
        assert np.allclose(pointed, direction / np.linalg.norm(direction), atol=1e-14)
        # About the direction, no other roll brings the second axis nearer.
        reached = [
            (Rotation.from_rotvec(roll * pointed) * turn).apply(second_axis) @ second_direction
            for roll in (-1e-3, 0.0, 1e-3)
        ]
        assert reached[1] == max(reached)


@pytest.mark.parametrize(
    "vectors",
    [
        ([0, 0, 1], [1, 0, 0], [0, 0, 2], [0, 1, 0]),
        ([0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0.01, 0]),
        ([0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0]),
        ([0, 0, 1], [math.nan, 0, 0], [0, 1, 0], [0, 1, 0]),
    ],
)
def test_parallel_or_no_directions_are_refused(vectors: tuple[list[float], ...]) -> None:
    with pytest.raises(ConfigurationError, match="allowed: finite, and at least 6°"):
        from_vectors(*vectors)


@pytest.mark.parametrize(
    "form",
    [
        ("--quaternion", 0, 0, 0.6, 0.8),
        ("--euler", 0, 0, math.degrees(math.acos(0.28))),
        ("--vectors", 2, 0, 0, 0.28, 0.96, 0, 0, 0, 1, 0, 0, 3),
    ],
)
def test_the_command_takes_an_attitude_in_each_form(
    form: tuple[Any, ...], monkeypatch: pytest.MonkeyPatch, ask: Ask
) -> None:
    goto = pytest.importorskip("ppc_attitude.nodes.goto")

    def answered(node: Any, attitude: Any, *_: Any) -> Any:
        assert attitude == pytest.approx((0.0, 0.0, 0.6, 0.8), abs=1e-15)
        return goto.Answer("it turns", followed=True)

    monkeypatch.setattr("ppc_attitude.nodes.visiting.visiting", lambda *_: nullcontext())
    monkeypatch.setattr(goto, "go_to", answered)
    assert ask("goto", *form).out == "it turns\n"
