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

"""Random numbers as functions of seed, step and channel: drawn alone, anywhere, in any order.

Logarithm, cosine and sine are computed here: so the numbers are the same whatever the mathematical
library of a machine, and the processor draws several pairs at once. Coefficients and forms are
those of fdlibm (Copyright 1993 Sun Microsystems, freely distributable), for the arguments that
random bits give.
"""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.kernel import Vector, inlined, kernel

_FIRST_UNIFORM = 64  # draws below this belong to the normal numbers
_UNIT = 2.0**-53  # a float64 has so many bits
_FRACTION_BITS = np.int64(52)
_ROOT_HALF = np.int64(0x3FE6A09E667F3BCD)  # bits of √½
_SIGN = np.int64(-(2**63))
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_LOG = (
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
    1.818357216161805012e-01,
    1.531383769920937332e-01,
    1.479819860511658591e-01,
)
_SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
_COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


@inlined
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


@inlined
def _logarithm(x: float) -> float:
    """Natural logarithm of a normal positive number, to one unit of its last place."""
    bits = np.float64(x).view(np.int64)
    exponent = (bits - _ROOT_HALF) >> _FRACTION_BITS
    f = np.int64(bits - (exponent << _FRACTION_BITS)).view(np.float64) - 1.0  # √½ ≤ 1 + f < √2
    s = f / (2.0 + f)  # ln(1 + f) = 2 artanh s
    z = s * s
    w = z * z
    odd = z * (_LOG[0] + w * (_LOG[2] + w * (_LOG[4] + w * _LOG[6])))
    even = w * (_LOG[1] + w * (_LOG[3] + w * _LOG[5]))
    half, k = 0.5 * f * f, float(exponent)
    return k * _LN2_HIGH - ((half - (s * (half + odd + even) + k * _LN2_LOW)) - f)


@inlined
def _signed(x: float, sign: Any) -> float:
    """Return x, or −x where the highest bit of `sign` is set."""
    return float(np.int64(np.float64(x).view(np.int64) ^ (sign & _SIGN)).view(np.float64))


@inlined
def _polynomial(c: Any, z: float) -> float:
    """Return the sum of c_i zⁱ over six coefficients."""
    w = z * z
    return float((c[0] + z * c[1]) + w * ((c[2] + z * c[3]) + w * (c[4] + z * c[5])))


@inlined
def _circle(turns: float) -> tuple[float, float]:
    """Cosine and sine of 2π turns, 0 ≤ turns < 1."""
    quarter = np.int64(4.0 * turns + 0.5)
    x = (4.0 * turns - float(quarter)) * (0.5 * math.pi)  # |x| ≤ π/4: what was taken off is exact
    z = x * x
    sine = x + x * z * _polynomial(_SINE, z)
    cosine = (1.0 - 0.5 * z) + z * z * _polynomial(_COSINE, z)
    turned = quarter & 1 != 0
    first, second = (sine if turned else cosine), (cosine if turned else sine)
    return _signed(first, (quarter + 1) << 62), _signed(second, quarter << 62)


@inlined
def normal_pair(seed: int, step: int, draw: int) -> tuple[float, float]:
    """Two independent standard normal numbers of a seed, a step and a channel."""
    # Box-Muller; the first uniform is in (0, 1], so its logarithm is finite.
    u = (float(random_bits(seed, step, 2 * draw) >> np.uint64(11)) + 1.0) * _UNIT
    cosine, sine = _circle(float(random_bits(seed, step, 2 * draw + 1) >> np.uint64(11)) * _UNIT)
    radius = math.sqrt(-2.0 * _logarithm(u))
    return radius * cosine, radius * sine


@kernel
def normal_pairs(seed: int, step: int, channel: int, count: int, pairs: Any) -> None:
    """Write `count` pairs to `pairs`, shape (2, ≥ count).

    They are those of four channels from `channel` on, of `step`, then of the next step, and so on.
    """
    # No pair depends on another, nor a branch on a number: the processor computes as many at a
    # time as it has lanes, four or eight, if `count` is no constant that would unroll the loop.
    first, second = pairs[0], pairs[1]
    for i in range(count):
        first[i], second[i] = normal_pair(seed, step + (i >> 2), channel + (i & 3))


@kernel
def normal_vector(seed: int, step: int, channel: int) -> Vector:
    """Three independent standard normal numbers; they take a channel and the next."""
    x, y = normal_pair(seed, step, channel)
    z, _ = normal_pair(seed, step, channel + 1)
    return (x, y, z)


@kernel
def uniform(seed: int, step: int, channel: int) -> float:
    """Return a number uniform in [0, 1); its channels are apart from those of normal numbers."""
    return float(random_bits(seed, step, _FIRST_UNIFORM + channel) >> np.uint64(11)) * _UNIT
