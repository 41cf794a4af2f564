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


import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from record_helpers import f_matrix, quaternions
from scipy.spatial.transform import Rotation

from ppc_attitude.science import attitude
from ppc_attitude.science.kernel import Quaternion, Vector

finite = st.floats(-1.0, 1.0)
vectors = st.tuples(finite, finite, finite)


@given(quaternions, quaternions)
def test_product_and_error_are_scipys(p: Quaternion, q: Quaternion) -> None:
    product = (Rotation.from_quat(p) * Rotation.from_quat(q)).as_matrix()
    assert np.allclose(Rotation.from_quat(attitude.product(p, q)).as_matrix(), product, atol=1e-13)
    error = (Rotation.from_quat(q).inv() * Rotation.from_quat(p)).as_matrix()
    assert np.allclose(
        Rotation.from_quat(attitude.attitude_error(p, q)).as_matrix(), error, atol=1e-13
    )
    assert np.linalg.norm(attitude.attitude_error(p, q)) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("count", [1, 7, 8, 37])
def test_errors_of_many_are_those_of_each(count: int) -> None:
    turns = Rotation.random(2 * count, np.random.default_rng(5)).as_quat()
    told, meant = turns[:count].T.copy(), turns[count:].T.copy()
    told[:, 0], meant[:, -1] = np.nan, 0.0
    errors = np.empty((4, count))
    attitude.attitude_errors(told, meant, errors)
    assert np.isnan(errors[:, [0, -1]]).all()
    for k in range(1, count - 1):
        error = attitude.attitude_error(tuple(told[:, k]), tuple(meant[:, k]))
        assert tuple(errors[:, k]) == error


def test_hamilton_and_scalar_last() -> None:
    i, j, k = (1.0, 0, 0, 0.0), (0.0, 1, 0, 0), (0.0, 0, 1, 0)
    assert attitude.product(i, j) == k
    assert attitude.product(j, i) == (0.0, 0.0, -1.0, 0.0)
    assert attitude.conjugate((1.0, 2.0, 3.0, 4.0)) == (-1.0, -2.0, -3.0, 4.0)


@given(quaternions, vectors)
def test_frames(q: Quaternion, a: Vector) -> None:
    rotation = Rotation.from_quat(q)
    assert np.allclose(attitude.rotate(q, a), rotation.apply(a), atol=1e-13)
    # The paper's C_e takes a vector from the desired frame to the body: the inverse rotation.
    assert np.allclose(attitude.to_body(a, q[:3], q[3]), rotation.inv().apply(a), atol=1e-13)


@given(quaternions, vectors)
def test_kinematics_turn_about_body_axes(q: Quaternion, omega: Vector) -> None:
    h = 1e-5
    ahead = (Rotation.from_quat(q) * Rotation.from_rotvec(np.multiply(h, omega))).as_quat()
    back = (Rotation.from_quat(q) * Rotation.from_rotvec(np.multiply(-h, omega))).as_quat()
    ahead, back = (p * np.sign(np.dot(p, q)) for p in (ahead, back))
    assert np.allclose(attitude.kinematics(q, omega), (ahead - back) / (2.0 * h), atol=1e-9)


@given(quaternions, vectors)
def test_the_matrices_of_the_error_system(q: Quaternion, a: Vector) -> None:
    v, q0 = q[:3], q[3]
    f = f_matrix(q)
    assert np.allclose(attitude.jacobian(v, q0, a), f @ a, atol=1e-15)
    assert np.allclose(attitude.jacobian_transposed(v, q0, a), f.T @ a, atol=1e-15)
    g = np.array([attitude.jacobian_inverse_scaled(v, q0, tuple(e)) for e in np.eye(3)]).T
    # G = (q0/2) F⁻¹, so F G = (q0/2) I also where F has no inverse; and ‖G‖ ≤ 1.
    assert np.allclose(f @ g, 0.5 * q0 * np.eye(3), atol=1e-14)
    assert np.linalg.norm(g, 2) <= 1.0 + 1e-14


@given(quaternions, vectors, vectors)
def test_rate_of_g_is_its_derivative(q: Quaternion, omega: Vector, a: Vector) -> None:
    h = 1e-6
    rate = np.array(attitude.kinematics(q, omega))

    def g(p: np.ndarray) -> np.ndarray:
        return np.array(attitude.jacobian_inverse_scaled(tuple(p[:3]), p[3], a))

    expected = (g(np.array(q) + h * rate) - g(np.array(q) - h * rate)) / (2.0 * h)
    given_rate = attitude.jacobian_inverse_scaled_rate(q[:3], q[3], tuple(rate[:3]), rate[3], a)
    assert np.allclose(given_rate, expected, atol=1e-8)


@given(quaternions)
def test_angle_is_the_short_way(q: Quaternion) -> None:
    assert attitude.rotation_angle(q) == pytest.approx(Rotation.from_quat(q).magnitude(), abs=1e-12)


def test_small_angles_keep_their_digits() -> None:
    assert attitude.rotation_angle((1e-12, 0.0, 0.0, -1.0)) == pytest.approx(2e-12, rel=1e-12)


@given(vectors, st.sampled_from([1e-9, 1e-4, 1.0, 3.0]))
def test_exponential_and_logarithm_are_scipys(a: Vector, size: float) -> None:
    phi = size * np.array(a) / max(1.0, float(np.linalg.norm(a)))
    q = attitude.exponential(tuple(phi))
    expected = Rotation.from_rotvec(phi)
    assert np.abs(np.array(q) - expected.as_quat(canonical=False)).max() < 1e-15
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-15)
    for same in (q, tuple(-x for x in q)):  # one attitude, and the short way round
        assert np.allclose(attitude.logarithm(same), phi, rtol=1e-14, atol=1e-300)
    assert np.abs(np.array(attitude.rotation_matrix(q)) - expected.as_matrix()).max() < 1e-15
