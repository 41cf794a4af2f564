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

"""How a torque is shared among wheels, against linear programming."""

import numpy as np
import pytest
from estimation_helpers import Array
from scipy.linalg import null_space
from scipy.optimize import linprog

from ppc_attitude.science import wheels
from ppc_attitude.science.allocation import WheelArray, allocate, certain_torque, idle_speeds

PYRAMID = np.reshape(wheels.AXES.default, (4, 3))
ARRAYS = {
    "pyramid": PYRAMID,
    "pyramid_without_0": PYRAMID[1:],
    "orthogonal_3_and_skew": np.vstack([np.eye(3), [3.0**-0.5] * 3]),
}


def allocated(
    t: Array, axes: Array, low: Array, high: Array, lost: tuple[int, ...] = ()
) -> tuple[float, Array]:
    given, torques, marks = np.zeros((3, len(axes)))
    marks[list(lost)] = 1.0
    wheels = WheelArray(axes, len(axes), low, high, marks, given, torques)
    load, rank = allocate(tuple(t.tolist()), wheels)
    left = np.delete(axes, lost, axis=0)
    assert rank == (np.linalg.matrix_rank(left, 1e-6) if left.size else 0)
    return load, torques


@pytest.mark.parametrize("seed", range(12))
def test_no_other_sharing_loads_the_wheels_less(seed: int) -> None:
    """Any array, any limits, some of the wheels lost: also parallel ones, several in one plane."""
    random = np.random.default_rng(seed)
    axes = random.normal(size=(int(random.integers(3, 9)), 3))
    if seed % 2:  # twice the coordinate axes, and one between them
        axes = np.vstack([np.eye(3), -np.eye(3), [[1.0, 1.0, 0.0]]])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    count = len(axes)
    low, high = -random.uniform(0.1, 2.0, count), random.uniform(0.1, 2.0, count)
    t = random.normal(size=3)
    for losses in range(count + 1):
        lost = tuple(random.choice(count, losses, replace=False).tolist())
        left = np.delete(np.arange(count), lost)
        span = np.linalg.pinv(axes[left]) @ axes[left]  # onto what the others span
        load, torques = allocated(t, axes, low, high, lost)
        assert not torques[list(lost)].any()
        assert np.abs(axes.T @ torques - span @ t).max() < 1e-12
        assert np.all(torques <= load * high * (1.0 + 1e-9) + 1e-15)
        assert np.all(torques >= load * low * (1.0 + 1e-9) - 1e-15)
        least = least_load(span @ t, axes[left], low[left], high[left])
        assert load == pytest.approx(least, rel=1e-9, abs=1e-12)


def least_load(t: Array, axes: Array, low: Array, high: Array) -> float:
    """Least v with A u = t, v low ≤ u ≤ v high, by linear programming."""
    count = len(axes)
    if not count:
        return 0.0
    basis = np.linalg.svd(axes)[2][: np.linalg.matrix_rank(axes, 1e-6)]
    below, above = np.column_stack([np.eye(count), -high]), np.column_stack([-np.eye(count), low])
    least = linprog(
        [*[0.0] * count, 1.0],
        A_ub=np.vstack([below, above]),
        b_ub=np.zeros(2 * count),
        A_eq=np.column_stack([basis @ axes.T, np.zeros(len(basis))]),
        b_eq=basis @ t,
        bounds=[(None, None)] * count + [(0.0, None)],
    )
    return float(least.fun)


@pytest.mark.parametrize(
    ("name", "certain"),
    [("pyramid", 1.1547005), ("pyramid_without_0", 0.5773503), ("orthogonal_3_and_skew", 1.0)],
)
def test_what_an_array_gives_on_every_axis(name: str, certain: float) -> None:
    axes = ARRAYS[name]
    assert certain_torque(axes, np.ones(len(axes))) == pytest.approx(certain, rel=1e-7)


@pytest.mark.parametrize("name", ARRAYS)
def test_what_an_array_gives_in_every_direction(name: str) -> None:
    axes = ARRAYS[name]
    limits = np.ones(len(axes))
    certain = certain_torque(axes, limits, 2)
    directions = np.random.default_rng(1).normal(size=(1000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    heaviest = max(allocated(certain * each, axes, -limits, limits)[0] for each in directions)
    assert 0.98 < heaviest < 1.0 + 1e-9


@pytest.mark.parametrize("number", [4, 6])
def test_idle_speeds_cancel_and_are_those_of_every_basis_and_processor(number: int) -> None:
    """Rounding says which of equally fast wheels is the fastest; it must not say how they turn."""
    round_z = 2.0 * np.pi / number * np.arange(number)
    axes = np.stack([np.cos(round_z), np.sin(round_z), np.full(number, 0.7)], axis=1)
    inertia, free = np.full(number, 8e-4), null_space(axes.T)
    speeds = idle_speeds(free, inertia)
    assert axes.T @ speeds == pytest.approx(np.zeros(3), abs=1e-12)
    assert np.abs(speeds) == pytest.approx(np.ones(number))
    rng = np.random.default_rng(3)
    for _ in range(20):
        turn = np.linalg.qr(rng.standard_normal((number - 3, number - 3)))[0]
        other = free @ turn * (1.0 + 2e-16 * rng.standard_normal(free.shape))
        assert idle_speeds(other, inertia) == pytest.approx(speeds)
