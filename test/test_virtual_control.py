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

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from record_helpers import derivative, f_matrix, quaternions
from scipy.spatial.transform import Rotation

from ppc_attitude.science.kernel import Quaternion, Vector
from ppc_attitude.science.virtual_control import directional, sign, virtual_control

K, M_OMEGA = 3.0, 0.017
SPEED = K * M_OMEGA
FORMS = pytest.mark.parametrize("norm_form", [False, True], ids=["componentwise", "norm"])

component = st.floats(-1.0, 1.0)
envelopes = st.tuples(*[st.floats(1e-3, 1.0)] * 3)
betas = st.floats(1.0, 20.0)


def paper_virtual_control(q_e: Quaternion, rho: Vector, beta: float, norm_form: bool) -> np.ndarray:
    """Eq. 12 as printed, with the inverse of F_e, scaled to ψ_q⁻¹ tanh; singular at q_e0 = 0."""
    epsilon = np.divide(q_e[:3], rho)
    if norm_form:
        length = np.linalg.norm(epsilon)
        shape = epsilon / length * np.tanh(beta * length)
    else:
        shape = np.tanh(beta * epsilon)
    return -0.5 * abs(q_e[3]) * SPEED * np.linalg.solve(f_matrix(q_e), np.multiply(rho, shape))


def value(q_e: Quaternion, rho: Vector, beta: float, norm_form: bool) -> np.ndarray:
    zero = (0.0, 0.0, 0.0)
    return np.array(virtual_control(q_e[:3], q_e[3], zero, rho, zero, beta, SPEED, norm_form)[0])


@FORMS
@given(quaternions.filter(lambda q: abs(q[3]) > 1e-2), envelopes, betas)
def test_it_is_the_papers(norm_form: bool, q_e: Quaternion, rho: Vector, beta: float) -> None:
    if np.linalg.norm(q_e[:3]) < 1e-6:
        return
    expected = paper_virtual_control(q_e, rho, beta, norm_form)
    assert np.allclose(value(q_e, rho, beta, norm_form), expected, rtol=1e-9, atol=1e-13)


@FORMS
@given(quaternions, envelopes, betas)
def test_bounds(norm_form: bool, q_e: Quaternion, rho: Vector, beta: float) -> None:
    """Of the norm: k M_ω max ρ of the norm form, √3 times as much of the other one."""
    v, most = value(q_e, rho, beta, norm_form), SPEED * max(rho) * (1.0 + 1e-12)
    assert np.linalg.norm(v) <= (most if norm_form else math.sqrt(3.0) * most)
    assert norm_form or np.abs(v).max() <= 0.5 * (1.0 + math.sqrt(3.0)) * most


@pytest.mark.parametrize("beta", [3.6, 10.0, 100.0, 1e3, 1e5])
@pytest.mark.parametrize("size", [1e-6, 9.9e-5, 1.01e-4])
def test_a_steep_norm_form_is_what_it_says_for_small_errors(beta: float, size: float) -> None:
    w, rate = directional((size, 0.0, 0.0), (1e-3, 0.0, 0.0), (1.0,) * 3, (0.0,) * 3, beta)
    assert w[0] == pytest.approx(math.tanh(beta * size), rel=1e-12)
    assert rate[0] == pytest.approx(1e-3 * beta / math.cosh(beta * size) ** 2, rel=1e-10)


def test_both_bounds_are_reached_and_the_papers_is_passed() -> None:
    rho, beta = (0.05, 0.05, 0.05), 50.0
    q = np.array([0.05, 0.05, 0.05])
    q_e = (*q.tolist(), math.sqrt(1.0 - q @ q))
    assert np.linalg.norm(value(q_e, rho, beta, False)) > 1.7 * SPEED * 0.05
    assert np.linalg.norm(value(q_e, rho, beta, True)) > 0.99 * SPEED * 0.05


@FORMS
@given(
    q_e=quaternions.filter(lambda q: abs(q[3]) > 1e-3),
    omega=st.tuples(*[st.floats(-0.1, 0.1)] * 3),
    rho=st.tuples(*[st.floats(0.05, 1.0)] * 3),
    decay=st.tuples(*[st.floats(-0.2, 0.05)] * 3),
    beta=betas,
)
def test_rate_is_the_derivative_along_the_true_motion(
    norm_form: bool, q_e: Quaternion, omega: Vector, rho: Vector, decay: Vector, beta: float
) -> None:
    rho_rate = tuple(d * r for d, r in zip(decay, rho, strict=True))

    def at(t: float) -> np.ndarray:
        turned = (Rotation.from_quat(q_e) * Rotation.from_rotvec(np.multiply(t, omega))).as_quat()
        turned *= math.copysign(1.0, float(np.dot(turned, q_e)))
        now = tuple(r * (1.0 + d * t) for r, d in zip(rho, decay, strict=True))
        return value(tuple(turned.tolist()), now, beta, norm_form)

    _, rate = virtual_control(q_e[:3], q_e[3], omega, rho, rho_rate, beta, SPEED, norm_form)
    assert np.allclose(rate, derivative(at, 1e-4), rtol=1e-6, atol=2e-9)


@FORMS
@given(quaternions, envelopes, betas)
def test_it_always_takes_the_short_way(
    norm_form: bool, q_e: Quaternion, rho: Vector, beta: float
) -> None:
    v = value(q_e, rho, beta, norm_form)
    q0_rate = -0.5 * float(np.dot(q_e[:3], v))
    # q_e0 never falls when positive nor rises when negative: to +1 or −1, no unwinding.
    assert q0_rate * sign(q_e[3]) >= -1e-15


def test_a_half_turn_has_a_way() -> None:
    assert sign(0.0) == 1.0
    assert sign(-0.0) == 1.0
    v = value((1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 6.0, True)
    assert v[0] == pytest.approx(-SPEED * math.tanh(6.0), rel=1e-12)


def test_no_error_no_turn() -> None:
    zero = (0.0, 0.0, 0.0)
    v, rate = virtual_control(zero, 1.0, zero, (1.0, 1.0, 1.0), zero, 6.0, SPEED, True)
    assert v == rate == (0.0, 0.0, 0.0)
