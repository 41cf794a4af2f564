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

"""Matrices of three rows as tuples; a symmetric one as its upper triangle xx xy xz yy yz zz."""

import math
from typing import TypeAlias

from ppc_attitude.science.kernel import Matrix, Vector, add, apply, dot, kernel, scale

Symmetric: TypeAlias = tuple[float, float, float, float, float, float]


@kernel
def transposed(m: Matrix) -> Matrix:
    """Mᵀ."""
    return (
        (m[0][0], m[1][0], m[2][0]),
        (m[0][1], m[1][1], m[2][1]),
        (m[0][2], m[1][2], m[2][2]),
    )


@kernel
def sum_of(m: Matrix, n: Matrix) -> Matrix:
    """M + N."""
    return (add(m[0], n[0]), add(m[1], n[1]), add(m[2], n[2]))


@kernel
def scaled(s: float, m: Matrix) -> Matrix:
    """Multiple s M."""
    return (scale(s, m[0]), scale(s, m[1]), scale(s, m[2]))


@kernel
def times_transposed(m: Matrix, n: Matrix) -> Matrix:
    """M Nᵀ: every element is a product of two rows."""
    return (apply(n, m[0]), apply(n, m[1]), apply(n, m[2]))


@kernel
def symmetric_product(m: Matrix, n: Matrix) -> Symmetric:
    """M Nᵀ where it is known to be symmetric."""
    return (
        dot(m[0], n[0]),
        dot(m[0], n[1]),
        dot(m[0], n[2]),
        dot(m[1], n[1]),
        dot(m[1], n[2]),
        dot(m[2], n[2]),
    )


@kernel
def full(s: Symmetric) -> Matrix:
    """Rows of a symmetric matrix."""
    return ((s[0], s[1], s[2]), (s[1], s[3], s[4]), (s[2], s[4], s[5]))


@kernel
def symmetric_sum(a: Symmetric, b: Symmetric) -> Symmetric:
    """A + B."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5])


@kernel
def plus_diagonal(a: Symmetric, d: float) -> Symmetric:
    """A + d I."""
    return (a[0] + d, a[1], a[2], a[3] + d, a[4], a[5] + d)


@kernel
def diagonal(a: Symmetric) -> Vector:
    """Diagonal of A."""
    return (a[0], a[3], a[5])


@kernel
def cholesky(a: Symmetric) -> Symmetric:
    """L of A = L Lᵀ for a positive definite A, as xx yx zx yy zy zz."""
    xx = math.sqrt(a[0])
    yx = a[1] / xx
    zx = a[2] / xx
    yy = math.sqrt(a[3] - yx * yx)
    zy = (a[4] - zx * yx) / yy
    return (xx, yx, zx, yy, zy, math.sqrt(a[5] - zx * zx - zy * zy))


@kernel
def forward(factor: Symmetric, a: Vector) -> Vector:
    """L⁻¹ a for the factor of `cholesky`."""
    x = a[0] / factor[0]
    y = (a[1] - factor[1] * x) / factor[3]
    return (x, y, (a[2] - factor[2] * x - factor[4] * y) / factor[5])


@kernel
def solved(factor: Symmetric, a: Vector) -> Vector:
    """A⁻¹ a for the factor of A that `cholesky` gives."""
    x, y, z = forward(factor, a)
    z = z / factor[5]
    y = (y - factor[4] * z) / factor[3]
    return ((x - factor[1] * y - factor[2] * z) / factor[0], y, z)
