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


"""Two arithmetics for one set of formulas: floats to search with, balls to prove with.

The formulas of this folder use the operators of their numbers, and what stands here. With `FLOATS`
they are fast and rounded; with `balls()` every result is an interval that contains the true value.
"""

import math
from dataclasses import dataclass
from functools import reduce
from typing import Any, Protocol, TypeAlias

Number: TypeAlias = Any  # float, or a library's interval: an operand of + − × / and of comparisons


class Arithmetic(Protocol):
    """Functions that formulas need beyond operators; a comparison is true only if it is certain."""

    @property
    def pi(self) -> Number:
        """Enclose π."""

    def number(self, value: float) -> Number:
        """Exact value of a float."""

    def sqrt(self, x: Number) -> Number:
        """√x, x ≥ 0."""

    def sin(self, x: Number) -> Number:
        """Sine."""

    def cos(self, x: Number) -> Number:
        """Cosine."""

    def largest(self, *values: Number) -> Number:
        """Largest of the values."""

    def least(self, *values: Number) -> Number:
        """Least of the values."""

    def upper(self, x: Number) -> Number:
        """Upper end of x: a number without width."""

    def outward(self, x: Number) -> tuple[float, float]:
        """Floats below and above x."""


@dataclass(frozen=True)
class Floats:
    """Ordinary floats: no proof."""

    pi: float = math.pi

    def number(self, value: float) -> float:
        """Return the float itself."""
        return float(value)

    sqrt = staticmethod(math.sqrt)
    sin = staticmethod(math.sin)
    cos = staticmethod(math.cos)

    def largest(self, *values: float) -> float:
        """Return the largest."""
        return max(values)

    def least(self, *values: float) -> float:
        """Return the least."""
        return min(values)

    def upper(self, x: float) -> float:
        """Return x, which has no width."""
        return x

    def outward(self, x: float) -> tuple[float, float]:
        """Return x twice."""
        return x, x


FLOATS: Arithmetic = Floats()


class Balls:
    """Arb's balls, by python-flint: outward rounding in a library of its own."""

    def __init__(self) -> None:
        import flint

        self._arb: Any = flint.arb
        self.pi = flint.arb.pi()

    def number(self, value: float) -> Number:
        """Ball of radius zero about the float."""
        return self._arb(value)

    def sqrt(self, x: Number) -> Number:
        """√x."""
        return x.sqrt()

    def sin(self, x: Number) -> Number:
        """Sine."""
        return x.sin()

    def cos(self, x: Number) -> Number:
        """Cosine."""
        return x.cos()

    def largest(self, *values: Number) -> Number:
        """Enclose the largest."""
        return reduce(lambda a, b: a.max(b), values)

    def least(self, *values: Number) -> Number:
        """Enclose the least."""
        return reduce(lambda a, b: a.min(b), values)

    def upper(self, x: Number) -> Number:
        """Upper end, as a ball of radius zero."""
        return x.upper()

    def outward(self, x: Number) -> tuple[float, float]:
        """Floats beyond both ends: a conversion may round by half a unit."""
        low, high = float(x.lower()), float(x.upper())
        return math.nextafter(low, -math.inf), math.nextafter(high, math.inf)


def balls() -> Arithmetic:
    """Arithmetic that proves.

    Raises
    ------
    ValueError
        python-flint is not installed.
    """
    try:
        return Balls()
    except ImportError:
        raise ValueError(
            "interval arithmetic needs python-flint: pip install 'ppc_attitude[guarantee]'"
        ) from None
