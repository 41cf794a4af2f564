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

"""The noise is standard normal, and the same however many numbers are drawn at once."""

import math

import numpy as np
import pytest

from ppc_attitude.science.kernel import kernel
from ppc_attitude.science.noise import normal_pair, normal_pairs, random_bits

DRAWN = 20_000


@kernel
def drawn_one_by_one(seed: int, step: int, pairs: np.ndarray) -> None:
    """Write as many pairs as there is room for."""
    for i in range(pairs.shape[1]):
        pairs[0, i], pairs[1, i] = normal_pair(seed, step + i // 4, i % 4)


def test_pairs_are_those_of_box_and_muller() -> None:
    with np.errstate(over="ignore"):
        bits = [int(random_bits(7, 3 + draw // 8, draw % 8)) >> 11 for draw in range(2 * DRAWN)]
    pairs = np.zeros((2, DRAWN))
    normal_pairs(7, 3, 0, DRAWN, pairs)
    radius = np.sqrt(-2.0 * np.log((np.array(bits[::2]) + 1.0) / 2.0**53))
    angle = 2.0 * math.pi * np.array(bits[1::2]) / 2.0**53
    expected = radius * np.array([np.cos(angle), np.sin(angle)])
    assert np.abs(pairs - expected).max() < 1e-14


@pytest.mark.parametrize("count", [1, 3, 4, 5, 64])
def test_a_pair_is_the_same_alone_and_among_others(count: int) -> None:
    together, alone = np.zeros((2, count)), np.zeros((2, count))
    normal_pairs(2**53 - 1, 2**40, 0, count, together)
    drawn_one_by_one(2**53 - 1, 2**40, alone)
    assert np.array_equal(together, alone)


def test_numbers_are_standard_normal_and_independent() -> None:
    pairs = np.zeros((2, DRAWN))
    normal_pairs(1, 5, 0, DRAWN, pairs)
    for power, expected, spread in ((1, 0.0, 1.0), (2, 1.0, 2.0), (4, 3.0, 96.0)):
        found = (pairs**power).mean(axis=1)
        assert np.abs(found - expected).max() < 5.0 * math.sqrt(spread / DRAWN)
    assert abs(np.mean(pairs[0] * pairs[1])) < 5.0 / math.sqrt(DRAWN)
    assert abs(np.mean(pairs[0, 1:] * pairs[0, :-1])) < 5.0 / math.sqrt(DRAWN)
