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

"""Bounds that follow from the craft alone: inertia, gyroscopic torque, tumbling, boxes."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from itertools import product
from operator import add

import numpy as np

from ppc_attitude.science.controllers.brake import ORDER
from ppc_attitude.science.guarantee.arithmetic import Arithmetic, Number
from ppc_attitude.science.guarantee.assumptions import Assumptions

_HALVINGS = ORDER.bit_length() - 1  # of the order of the brake's norm, until it is 1
_PADDING = 1e-9  # relative, of eigenvalues from LAPACK; proved afterwards

Numbers = tuple[Number, ...]


@dataclass(frozen=True)
class Body:
    """Inertia in one arithmetic.

    Attributes
    ----------
    inertia : tuple of 3 rows
        Ĵ [kg·m²].
    inverse : tuple of 3 rows
        Ĵ⁻¹, by Cramer's rule.
    row : tuple of 3
        R_i, norms of the rows of Ĵ.
    spread : tuple of 3
        G_i: |(ω × Ĵω)_i| ≤ G_i ‖ω‖².
    least, most : number
        Below and above every principal moment.
    proved : bool
        True if `least` and `most` are certain, by Sylvester's criterion.
    diagonal : bool
        True if Ĵ has no products.
    arithmetic : Arithmetic
        Arithmetic of all these numbers.
    """

    inertia: tuple[Numbers, ...]
    inverse: tuple[Numbers, ...]
    row: Numbers
    spread: Numbers
    least: Number
    most: Number
    proved: bool
    diagonal: bool
    arithmetic: Arithmetic

    def box(self, half: Numbers) -> Number:
        """Largest ‖Ĵ⁻¹y‖ over |y_i| ≤ half_i: at a vertex, the norm being convex."""
        norms = []
        for signs in product((1, -1), repeat=2):
            y = (half[0], signs[0] * half[1], signs[1] * half[2])
            z = [sum_of(m * each for m, each in zip(line, y, strict=True)) for line in self.inverse]
            norms.append(self.arithmetic.sqrt(sum_of(each * each for each in z)))
        return self.arithmetic.largest(*norms)

    def brakes(self, torque: Numbers, most: Number) -> tuple[Number, Number]:
        """Least and largest deceleration a(n) of the brake about any axis [rad/s²].

        For x = Ĵn/T let X be the largest |x_i| = R_i/T_i. Then ‖x‖₁₆ ≤ X if Ĵ is diagonal, and else
        X^⅞ ‖x‖₂^⅛; and 1 = ‖n‖ ≤ ‖x‖₁₆ times the largest ‖Ĵ⁻¹y‖ in the box |y_i| ≤ T_i.
        """
        arithmetic = self.arithmetic

        def at(norm: Number) -> Number:
            scaled = most * norm
            for _ in range(_HALVINGS):
                scaled = scaled * scaled
            return most / _root(1 + scaled, _HALVINGS, arithmetic)

        shares = [row / each for row, each in zip(self.row, torque, strict=True)]
        norm = arithmetic.largest(*shares)
        if not self.diagonal:
            together = arithmetic.sqrt(sum_of(each * each for each in shares))
            norm = norm * _root(together / norm, _HALVINGS - 1, arithmetic)
        return at(norm), at(1 / self.box(torque))

    def inverse_error(self, e_S: Number) -> Number:
        """ε ≥ ‖ĴJ⁻¹ − I‖, and ‖J⁻¹Ĵ − I‖, for J = Ĵ^½(I + S)Ĵ^½ with ‖S‖ ≤ e_S."""
        return self.arithmetic.sqrt(self.most / self.least) * e_S / (1 - e_S)


def sum_of(values: Iterable[Number]) -> Number:
    """Add numbers of any arithmetic one by one; `sum` of floats is compensated in Python 3.12."""
    return reduce(add, values, 0)


def _root(x: Number, halvings: int, arithmetic: Arithmetic) -> Number:
    """Take the square root `halvings` times."""
    for _ in range(halvings):
        x = arithmetic.sqrt(x)
    return x


def body_of(assumed: Assumptions, arithmetic: Arithmetic) -> Body:
    """Bounds of the inertia that the law knows."""
    number, sqrt = arithmetic.number, arithmetic.sqrt
    m = [[number(assumed.inertia[3 * i + j]) for j in range(3)] for i in range(3)]
    determinant, cofactors = _cofactors(m)
    inverse = [[cofactors[j][i] / determinant for j in range(3)] for i in range(3)]
    moments = np.linalg.eigvalsh(np.array(assumed.inertia).reshape(3, 3))
    least = number(float(moments[0]) * (1.0 - _PADDING))
    most = number(float(moments[2]) * (1.0 + _PADDING))
    if assumed.diagonal:
        pairs = ((1, 2), (2, 0), (0, 1))
        half = number(0.5)
        spread = [half * abs(m[j][j] - m[k][k]) for j, k in pairs]
    else:
        spread = [(most - least) / 2] * 3
    above = [[(least if i == j else 0) * -1 + m[i][j] for j in range(3)] for i in range(3)]
    below = [[(most if i == j else 0) - m[i][j] for j in range(3)] for i in range(3)]
    return Body(
        inertia=tuple(map(tuple, m)),
        inverse=tuple(map(tuple, inverse)),
        row=tuple(sqrt(sum_of(each * each for each in line)) for line in m),
        spread=tuple(spread),
        least=least,
        most=most,
        proved=_positive(above) and _positive(below),
        diagonal=assumed.diagonal,
        arithmetic=arithmetic,
    )


def _cofactors(m: list[list[Number]]) -> tuple[Number, list[list[Number]]]:
    table = [
        [
            m[(i + 1) % 3][(j + 1) % 3] * m[(i + 2) % 3][(j + 2) % 3]
            - m[(i + 1) % 3][(j + 2) % 3] * m[(i + 2) % 3][(j + 1) % 3]
            for j in range(3)
        ]
        for i in range(3)
    ]
    return sum_of(m[0][j] * table[0][j] for j in range(3)), table


def _positive(m: list[list[Number]]) -> bool:
    """Sylvester's criterion: the leading minors are certainly positive."""
    second = m[0][0] * m[1][1] - m[0][1] * m[1][0]
    return bool(m[0][0] > 0) and bool(second > 0) and bool(_cofactors(m)[0] > 0)
