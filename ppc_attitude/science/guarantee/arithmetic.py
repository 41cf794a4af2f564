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

The formulas of this folder use the operators of their numbers and the functions of an `Arithmetic`.
With `FLOATS` they are fast and rounded; with `balls()` every result is an interval that contains
the true value.
"""

import math
from collections.abc import Callable
from functools import reduce
from typing import Any, NamedTuple, TypeAlias

from ppc_attitude.science.errors import needed_by

Number: TypeAlias = Any  # float, or a library's interval: an operand of + − × / and of comparisons


class Arithmetic(NamedTuple):
    """What formulas need beyond operators; a comparison of its numbers is true only if certain."""

    pi: Number
    number: Callable[[float], Number]  # converts exactly
    sqrt: Callable[[Number], Number]
    sin: Callable[[Number], Number]
    cos: Callable[[Number], Number]
    largest: Callable[..., Number]  # of some numbers
    least: Callable[..., Number]
    upper: Callable[[Number], Number]  # upper end: a number without width
    outward: Callable[[Number], tuple[float, float]]  # floats below and above


FLOATS = Arithmetic(
    pi=math.pi,
    number=float,
    sqrt=math.sqrt,
    sin=math.sin,
    cos=math.cos,
    largest=max,
    least=min,
    upper=lambda x: x,
    outward=lambda x: (x, x),
)
"""Ordinary floats: no proof."""


def balls() -> Arithmetic:
    """Arb's balls, by python-flint, which rounds outward: they prove.

    Raises
    ------
    ConfigurationError
        python-flint is not installed.
    """
    with needed_by("interval arithmetic needs python-flint", "guarantee"):
        from flint import arb

    def outward(x: Number) -> tuple[float, float]:
        if x.is_nan():  # as the root of what may be negative: it may be any number
            return -math.inf, math.inf
        # A conversion may round by half a unit.
        low, high = float(x.lower()), float(x.upper())
        return math.nextafter(low, -math.inf), math.nextafter(high, math.inf)

    return Arithmetic(
        pi=arb.pi(),
        number=arb,
        sqrt=arb.sqrt,
        sin=arb.sin,
        cos=arb.cos,
        # Most often of two numbers, a million times in one proof.
        largest=lambda x, y, *more: reduce(arb.max, more, x.max(y)) if more else x.max(y),
        least=lambda x, y, *more: reduce(arb.min, more, x.min(y)) if more else x.min(y),
        upper=arb.upper,
        outward=outward,
    )
