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

"""Attitude algebra: Hamilton quaternions, scalar last, body to inertial (eq. 1 of the paper)."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ppc_attitude.science.component import OWN_TOLERANCE, UNIT_TOLERANCE, norm_of
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import (
    Matrix,
    Quaternion,
    Vector,
    add,
    cross,
    dot,
    kernel,
    quaternion,
    scale,
    store,
    subtract,
    vector,
)

_SMALL = 1e-4  # [rad²] below which a series of four terms is exact to rounding


def unit_quaternion(name: str, values: ArrayLike) -> Quaternion:
    """Check that a quaternion x y z w is a unit one up to rounding, and normalise it.

    One whose norm is within `OWN_TOLERANCE` of 1 is taken as it is, as nodes do with messages.

    Parameters
    ----------
    name : str
        What to call it in an error.
    values : array_like
        Four numbers.

    Raises
    ------
    ConfigurationError
        The norm differs from 1 by more than 1e-3.
    """
    array = np.asarray(values, dtype=np.float64)
    length = float(np.linalg.norm(array))
    if not abs(length - 1.0) <= UNIT_TOLERANCE:
        raise ConfigurationError(
            f"{name} = {array.tolist()} has norm {length:.6g}; allowed: 1 within {UNIT_TOLERANCE:g}"
        )
    if abs(length - 1.0) > OWN_TOLERANCE:
        array = array / length
    x, y, z, w = array.tolist()
    return x, y, z, w


@kernel
def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """Hamilton product a ⊗ b of quaternions x y z w."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


@kernel
def conjugate(a: Quaternion) -> Quaternion:
    """Inverse of a unit quaternion."""
    return (-a[0], -a[1], -a[2], a[3])


quaternion_norm = kernel(norm_of)


@kernel
def normalised(a: Quaternion) -> Quaternion:
    """Unit quaternion in the direction of `a`, which must not be zero."""
    length = quaternion_norm(a)
    return (a[0] / length, a[1] / length, a[2] / length, a[3] / length)


@kernel
def continued(q: Quaternion, last: Quaternion) -> Quaternion:
    """Of `q` and its negative, which is the same attitude, the one that is nearer to `last`."""
    if q[0] * last[0] + q[1] * last[1] + q[2] * last[2] + q[3] * last[3] < 0.0:
        return (-q[0], -q[1], -q[2], -q[3])
    return q


@kernel
def kinematics(q: Quaternion, omega: Vector) -> Quaternion:
    """Rate of a quaternion, q' = ½ q ⊗ [ω, 0], ω [rad/s] in the turning frame."""
    return product(q, (0.5 * omega[0], 0.5 * omega[1], 0.5 * omega[2], 0.0))


@kernel
def euler_step(q: Quaternion, h: float, rate: Quaternion) -> Quaternion:
    """Euler step q + h q', not normalised: the stages of a Runge-Kutta step."""
    return (q[0] + h * rate[0], q[1] + h * rate[1], q[2] + h * rate[2], q[3] + h * rate[3])


@kernel
def runge_kutta(
    q: Quaternion, h: float, k1: Quaternion, k2: Quaternion, k3: Quaternion, k4: Quaternion
) -> Quaternion:
    """Attitude after h [s] from the four rates of the classical Runge-Kutta method, normalised."""
    return normalised(
        (
            q[0] + h / 6.0 * (k1[0] + 2.0 * (k2[0] + k3[0]) + k4[0]),
            q[1] + h / 6.0 * (k1[1] + 2.0 * (k2[1] + k3[1]) + k4[1]),
            q[2] + h / 6.0 * (k1[2] + 2.0 * (k2[2] + k3[2]) + k4[2]),
            q[3] + h / 6.0 * (k1[3] + 2.0 * (k2[3] + k3[3]) + k4[3]),
        )
    )


@kernel
def to_body(a: Vector, q: Vector, q0: float) -> Vector:
    """C_e a = (q0² − qᵀq) a + 2 q qᵀa − 2 q0 q × a: desired frame to body."""
    return add(
        scale(q0 * q0 - dot(q, q), a),
        subtract(scale(2.0 * dot(q, a), q), scale(2.0 * q0, cross(q, a))),
    )


@kernel
def rotate(q: Quaternion, a: Vector) -> Vector:
    """R(q) a = C(q)ᵀ a, and C of the conjugate is Cᵀ: body to inertial when q is an attitude."""
    return to_body(a, (-q[0], -q[1], -q[2]), q[3])


@kernel
def attitude_error(q_s: Quaternion, q_d: Quaternion) -> Quaternion:
    """q_e = q_d⁻¹ ⊗ q_s, normalised: rounding in messages must not leave the unit sphere."""
    return normalised(product(conjugate(q_d), q_s))


@kernel
def jacobian(q: Vector, q0: float, a: Vector) -> Vector:
    """F_e a = ½ (q0 I + q^×) a; with a = ω_e it is q_ev' (eq. 1)."""
    return scale(0.5, add(scale(q0, a), cross(q, a)))


@kernel
def jacobian_transposed(q: Vector, q0: float, a: Vector) -> Vector:
    """F_eᵀ a = ½ (q0 I − q^×) a."""
    return scale(0.5, subtract(scale(q0, a), cross(q, a)))


@kernel
def jacobian_inverse_scaled(q: Vector, q0: float, a: Vector) -> Vector:
    """G a = (q0² I − q0 q^× + q qᵀ) a = ½ q0 F_e⁻¹ a: no inverse, no division, ‖G‖ ≤ 1."""
    return add(subtract(scale(q0 * q0, a), scale(q0, cross(q, a))), scale(dot(q, a), q))


@kernel
def jacobian_inverse_scaled_rate(
    q: Vector, q0: float, q_rate: Vector, q0_rate: float, a: Vector
) -> Vector:
    """G' a, the time derivative of G at a fixed vector a."""
    return add(
        subtract(
            scale(2.0 * q0 * q0_rate, a),
            add(scale(q0_rate, cross(q, a)), scale(q0, cross(q_rate, a))),
        ),
        add(scale(dot(q, a), q_rate), scale(dot(q_rate, a), q)),
    )


@kernel
def rotation_angle(q: Quaternion) -> float:
    """Angle [rad] of the rotation, 0 to π, the short way."""
    vector_part = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    return 2.0 * math.atan2(vector_part, abs(q[3]))


@kernel
def exponential(phi: Vector) -> Quaternion:
    """Quaternion of a rotation vector φ [rad]: exp(φ) = [φ sin(|φ|/2)/|φ|, cos(|φ|/2)]."""
    square = dot(phi, phi)
    if square < _SMALL:  # the series is exact to rounding here, and it has no 0/0
        s = 0.5 - square * (1.0 / 48.0 - square * (1.0 / 3840.0 - square / 645120.0))
        c = 1.0 - square * (1.0 / 8.0 - square * (1.0 / 384.0 - square / 46080.0))
        return (s * phi[0], s * phi[1], s * phi[2], c)
    angle = math.sqrt(square)
    s = math.sin(0.5 * angle) / angle
    return (s * phi[0], s * phi[1], s * phi[2], math.cos(0.5 * angle))


@kernel
def logarithm(q: Quaternion) -> Vector:
    """Rotation vector [rad] of a unit quaternion, the short way: the inverse of `exponential`."""
    square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
    w = q[3]
    if square < _SMALL * (w * w):  # 2 arctan(x)/x, x = |q_v|/w
        z = square / (w * w)
        s = 2.0 / w * (1.0 - z * (1.0 / 3.0 - z * (1.0 / 5.0 - z * (1.0 / 7.0 - z / 9.0))))
    else:
        length = math.sqrt(square)
        s = math.copysign(2.0 * math.atan2(length, abs(w)) / length, w) if length > 0.0 else 2.0
    return (s * q[0], s * q[1], s * q[2])


@kernel
def rotation_matrix(q: Quaternion) -> Matrix:
    """R(q), rows: R(q) a = `rotate`(q, a)."""
    x, y, z, w = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


@kernel
def attitude_errors(attitudes: Any, references: Any, errors: Any) -> None:
    """`attitude_error` of attitudes against references, all of shape (4, n).

    Where one of two attitudes is not finite or all zero, the error is NaN.
    """
    x, y, z, w = errors[0], errors[1], errors[2], errors[3]
    for k in range(w.size):
        # Indices instead of views of columns let the processor take several instants at once.
        q_s = (attitudes[0, k], attitudes[1, k], attitudes[2, k], attitudes[3, k])
        q_d = (references[0, k], references[1, k], references[2, k], references[3, k])
        # NaN from 0/0: kernels follow NumPy's error model.
        x[k], y[k], z[k], w[k] = attitude_error(q_s, q_d)


@kernel
def rotation_angles(rotations: Any, angles: Any) -> None:
    """Angles [rad], shape (n,), of rotations, shape (4, n); of a NaN it is NaN."""
    for k in range(len(angles)):
        angles[k] = rotation_angle(quaternion(rotations[:, k]))


@kernel
def vectors_to_body(vectors: Any, errors: Any, turned: Any) -> None:
    """`to_body` of vectors, shape (n, 3), by errors, shape (n, 4)."""
    for k in range(len(turned)):
        store(turned[k], to_body(vector(vectors[k]), vector(errors[k]), errors[k, 3]))
