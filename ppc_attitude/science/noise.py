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

"""Random numbers as functions of seed, step and channel: drawn alone, anywhere, in any order."""

import math

import numpy as np

from ppc_attitude.science.kernel import Vector, kernel

_FIRST_UNIFORM = 64  # draws below this belong to the normal numbers


@kernel
def random_bits(seed: int, step: int, draw: int) -> np.uint64:
    """64 random bits of a seed, a step and a channel."""
    # splitmix64 of a counter: any sample can be drawn alone, in any process, after any restart.
    z = np.uint64(seed) * np.uint64(0xD1342543DE82EF95) + np.uint64(step) * np.uint64(
        0x9E3779B97F4A7C15
    )
    z += np.uint64(draw) * np.uint64(0xBF58476D1CE4E5B9) + np.uint64(0x94D049BB133111EB)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@kernel
def normal_pair(seed: int, step: int, draw: int) -> tuple[float, float]:
    """Two independent standard normal numbers of a seed, a step and a channel."""
    # Box-Muller; the first uniform is in (0, 1], so its logarithm is finite.
    unit = 2.0**-53
    u = (float(random_bits(seed, step, 2 * draw) >> np.uint64(11)) + 1.0) * unit
    angle = 2.0 * math.pi * float(random_bits(seed, step, 2 * draw + 1) >> np.uint64(11)) * unit
    radius = math.sqrt(-2.0 * math.log(u))
    return radius * math.cos(angle), radius * math.sin(angle)


@kernel
def normal_vector(seed: int, step: int, channel: int) -> Vector:
    """Three independent standard normal numbers; they take a channel and the next."""
    x, y = normal_pair(seed, step, channel)
    z, _ = normal_pair(seed, step, channel + 1)
    return (x, y, z)


@kernel
def uniform(seed: int, step: int, channel: int) -> float:
    """Return a number uniform in [0, 1); its channels are apart from those of normal numbers."""
    return float(random_bits(seed, step, _FIRST_UNIFORM + channel) >> np.uint64(11)) * 2.0**-53
