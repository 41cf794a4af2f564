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

"""Bounds that follow from the inertia alone: gyroscopic torque, brake, boxes of momentum."""

from collections.abc import Sequence
from functools import reduce
from itertools import product
from operator import add, mul

import numpy as np

from ppc_attitude.science.controllers.brake import ORDER
from ppc_attitude.science.guarantee.arithmetic import Arithmetic, Number
from ppc_attitude.science.guarantee.assumptions import Assumptions

_HALVINGS = ORDER.bit_length() - 1  # of the order of the brake's norm, until it is 1
_PADDING = 1e-9  # relative, of eigenvalues from LAPACK; proved afterwards

Numbers = tuple[Number, ...]


class Body:
    """Bounds of the inertia Ĵ that the law knows, in one arithmetic."""

    def __init__(self, assumed: Assumptions, arithmetic: Arithmetic) -> None:
        number = arithmetic.number
        m = [[number(assumed.inertia[3 * i + j]) for j in range(3)] for i in range(3)]
        moments = np.linalg.eigvalsh(np.reshape(assumed.inertia, (3, 3)))
        self.arithmetic = arithmetic
        self._diagonal = not any(assumed.inertia[i] for i in (1, 2, 3, 5, 6, 7))
        # [kg·m²] Below and above every principal moment; `proved` says whether that is certain.
        self.least = least = number(float(moments[0]) * (1.0 - _PADDING))
        self.most = most = number(float(moments[2]) * (1.0 + _PADDING))
        above, below = (
            [[sign * (m[i][j] - (end if i == j else 0)) for j in range(3)] for i in range(3)]
            for sign, end in ((1, least), (-1, most))
        )
        self.proved = _positive(above) and _positive(below)
        # [kg·m²] R_i, norms of the rows, and G_i: |(ω × Ĵω)_i| ≤ G_i ‖ω‖².
        self.row = tuple(arithmetic.sqrt(_dot(line, line)) for line in m)
        self.spread = ((most - least) / 2,) * 3
        if self._diagonal:
            pairs = ((1, 2), (2, 0), (0, 1))
            self.spread = tuple(0.5 * abs(m[j][j] - m[k][k]) for j, k in pairs)
        determinant, cofactors = _cofactors(m)
        # Rows of Ĵ⁻¹, by Cramer's rule.
        self._inverse = [[cofactors[j][i] / determinant for j in range(3)] for i in range(3)]

    def box(self, half: Numbers) -> Number:
        """Largest ‖Ĵ⁻¹y‖ over |y_i| ≤ half_i: at a vertex, the norm being convex."""
        norms = []
        for signs in product((1, -1), repeat=2):
            y = (half[0], signs[0] * half[1], signs[1] * half[2])
            z = [_dot(line, y) for line in self._inverse]
            norms.append(self.arithmetic.sqrt(_dot(z, z)))
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
        if not self._diagonal:
            together = arithmetic.sqrt(_dot(shares, shares))
            norm = norm * _root(together / norm, _HALVINGS - 1, arithmetic)
        return at(norm), at(1 / self.box(torque))

    def inverse_error(self, e_S: Number) -> Number:
        """ε ≥ ‖ĴJ⁻¹ − I‖, and ‖J⁻¹Ĵ − I‖, for J = Ĵ^½(I + S)Ĵ^½ with ‖S‖ ≤ e_S."""
        return self.arithmetic.sqrt(self.most / self.least) * e_S / (1 - e_S)


def _dot(a: Sequence[Number], b: Sequence[Number]) -> Number:
    """Add products one by one, unlike `sum`, which compensates floats from Python 3.12 on."""
    return reduce(add, map(mul, a, b))


def _root(x: Number, halvings: int, arithmetic: Arithmetic) -> Number:
    """Take the square root `halvings` times."""
    for _ in range(halvings):
        x = arithmetic.sqrt(x)
    return x


def _cofactors(m: list[list[Number]]) -> tuple[Number, list[list[Number]]]:
    table = [
        [
            m[(i + 1) % 3][(j + 1) % 3] * m[(i + 2) % 3][(j + 2) % 3]
            - m[(i + 1) % 3][(j + 2) % 3] * m[(i + 2) % 3][(j + 1) % 3]
            for j in range(3)
        ]
        for i in range(3)
    ]
    return _dot(m[0], table[0]), table


def _positive(m: list[list[Number]]) -> bool:
    """Sylvester's criterion: the leading minors are certainly positive."""
    second = m[0][0] * m[1][1] - m[0][1] * m[1][0]
    return bool(m[0][0] > 0) and bool(second > 0) and bool(_cofactors(m)[0] > 0)
