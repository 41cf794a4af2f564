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

"""One step of a multiplicative extended Kalman filter: the estimate, propagated and updated.

Matrices of three rows are tuples; a symmetric one is its upper triangle xx xy xz yy yz zz.

The error state is δθ and δb in body axes, q = q̂ ⊗ exp(δθ) and b = b̂ + δb. Sources: Lefferts,
Markley and Shuster (1982); Markley and Crassidis, Fundamentals of Spacecraft Attitude
Determination and Control, section 6.2.
"""

import math
from typing import TypeAlias

from ppc_attitude.science.attitude import (
    conjugate,
    exponential,
    logarithm,
    normalised,
    product,
    rotation_matrix,
)
from ppc_attitude.science.kernel import (
    NO_ATTITUDE,
    ZERO,
    Matrix,
    Quaternion,
    Vector,
    add,
    apply,
    dot,
    inlined,
    kernel,
    scale,
    subtract,
)

Symmetric: TypeAlias = tuple[float, float, float, float, float, float]
# q̂, b̂ [rad/s], and the blocks of P: P_θθ [rad²], P_θb [rad²/s], P_bb [rad²/s²].
Knowledge: TypeAlias = tuple[Quaternion, Vector, Symmetric, Matrix, Symmetric]
_ZEROS: Matrix = (ZERO, ZERO, ZERO)
_NONE: Symmetric = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
NOTHING: Knowledge = (NO_ATTITUDE, ZERO, _NONE, _ZEROS, _NONE)


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


@kernel
def begun(
    attitude: Quaternion, fix_covariance: Symmetric, bias: Vector, bias_variance: float
) -> Knowledge:
    """The estimate from a first fix: its attitude, and the prior knowledge of the bias."""
    d = bias_variance
    return (attitude, bias, fix_covariance, _ZEROS, (d, 0.0, 0.0, d, 0.0, d))


@inlined
def _transition(turn: Quaternion, phi: Vector, h: float) -> tuple[Matrix, Matrix]:
    """Blocks of F over h [s]: exp(−φ^×), and −h (I − s2 φ^× + s3 φ^×²).

    With the turn exp(φ) at hand, s1 = sin φ/φ and s2 = (1 − cos φ)/φ² need no further sine.
    """
    square = dot(phi, phi)
    if square < 1e-4:
        half = 0.5 - square / 48.0 + square * square / 3840.0  # sin(φ/2)/φ
        s3 = 1.0 / 6.0 - square / 120.0 + square * square / 5040.0
    else:
        half = math.sin(0.5 * math.sqrt(square)) / math.sqrt(square)
        s3 = (1.0 - 2.0 * half * turn[3]) / square
    s2 = 2.0 * half * half
    x, y, z = phi
    xx, yy, zz = s3 * x * x, s3 * y * y, s3 * z * z
    xy, xz, yz = s3 * x * y, s3 * x * z, s3 * y * z
    ax, ay, az = s2 * x, s2 * y, s2 * z
    integral = (
        (-h * (1.0 - yy - zz), -h * (xy + az), -h * (xz - ay)),
        (-h * (xy - az), -h * (1.0 - xx - zz), -h * (yz + ax)),
        (-h * (xz + ay), -h * (yz - ax), -h * (1.0 - xx - yy)),
    )
    return rotation_matrix(conjugate(turn)), integral


@inlined
def propagated(known: Knowledge, rate: Vector, h: float, white: float, walk: float) -> Knowledge:
    """Propagate the estimate over h [s] with a gyro sample [rad/s], a mean rate.

    Parameters
    ----------
    known
        Estimate at the start of the interval.
    rate, h
        The sample, and the interval's length [s].
    white, walk
        σ_v² [rad²/s] and σ_u² [rad²/s³].

    Returns
    -------
    Knowledge
        q̂ ⊗ exp(φ), φ = (ω − b̂) h, and F P Fᵀ + Q. Only the upper triangles are computed, so P stays
        symmetric.
    """
    q, b, theta, cross, bias = known
    phi = scale(h, subtract(rate, b))
    turn = exponential(phi)
    f, g = _transition(turn, phi, h)
    x = sum_of(times_transposed(f, full(theta)), times_transposed(g, cross))
    y = sum_of(times_transposed(f, transposed(cross)), times_transposed(g, full(bias)))
    theta = plus_diagonal(
        symmetric_sum(symmetric_product(x, f), symmetric_product(y, g)),
        h * (white + walk * h * h / 3.0),
    )
    c = -0.5 * walk * h * h
    cross = (
        (y[0][0] + c, y[0][1], y[0][2]),
        (y[1][0], y[1][1] + c, y[1][2]),
        (y[2][0], y[2][1], y[2][2] + c),
    )
    return (normalised(product(q, turn)), b, theta, cross, plus_diagonal(bias, walk * h))


@kernel
def residual(known: Knowledge, attitude: Quaternion) -> Vector:
    """Rotation vector z [rad], body axes, from the estimate to a measured attitude of the body."""
    return logarithm(product(conjugate(known[0]), attitude))


@kernel
def innovation(known: Knowledge, z: Vector, fix_covariance: Symmetric) -> Vector:
    """L⁻¹ z with S = P_θθ + R = L Lᵀ: standard normal if the filter is right; its square is NIS."""
    return forward(cholesky(symmetric_sum(known[2], fix_covariance)), z)


@kernel
def updated(known: Knowledge, z: Vector, fix_covariance: Symmetric) -> Knowledge:
    """The estimate after a fix with residual z [rad] and covariance R [rad²], both in body axes.

    K = P_(:,θ) S⁻¹ and Joseph's form of (I − K H) P (I − K H)ᵀ + K R Kᵀ, H = [I 0].
    """
    q, b, theta, cross, bias = known
    factor = cholesky(symmetric_sum(theta, fix_covariance))
    p, r = full(theta), full(fix_covariance)
    # Rows of K = (K1, K2): S is symmetric, so a row of P S⁻¹ is S⁻¹ times a row of P.
    k1 = (solved(factor, p[0]), solved(factor, p[1]), solved(factor, p[2]))
    across = transposed(cross)
    k2 = (solved(factor, across[0]), solved(factor, across[1]), solved(factor, across[2]))
    rest = (
        (1.0 - k1[0][0], -k1[0][1], -k1[0][2]),
        (-k1[1][0], 1.0 - k1[1][1], -k1[1][2]),
        (-k1[2][0], -k1[2][1], 1.0 - k1[2][2]),
    )
    noise = times_transposed(k1, r)
    left = times_transposed(rest, p)
    # (I − K1)(P_θb − P_θθ K2ᵀ) + K1 R K2ᵀ, and the corresponding terms for P_bb.
    corrected = sum_of(cross, scaled(-1.0, times_transposed(p, k2)))
    new_cross = sum_of(times_transposed(rest, transposed(corrected)), times_transposed(noise, k2))
    # P_bb + (K2 (P_θθ + R) − P_bθ) K2ᵀ − K2 P_θb
    bias_noise = sum_of(times_transposed(k2, p), times_transposed(k2, r))
    lower = sum_of(bias_noise, scaled(-1.0, across))
    new_bias = symmetric_sum(
        symmetric_sum(bias, symmetric_product(lower, k2)),
        symmetric_product(scaled(-1.0, k2), across),
    )
    return (
        normalised(product(q, exponential(apply(k1, z)))),
        add(b, apply(k2, z)),
        symmetric_sum(symmetric_product(left, rest), symmetric_product(noise, k1)),
        new_cross,
        new_bias,
    )
