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

from ppc_attitude.science.controllers.log_barrier import log_barrier_force
from ppc_attitude.science.controllers.ppc import barrier_gain
from ppc_attitude.science.kernel import Vector

components = st.floats(-3.0, 3.0)
vectors = st.tuples(components, components, components)
weights = st.floats(0.1, 5.0)


@given(vectors, weights, weights)
def test_the_gain_is_that_of_the_barriers_derivative(epsilon: Vector, k: float, F: float) -> None:
    h = 1e-6

    def barrier(x: np.ndarray) -> float:  # V_B = (k/2) F ln cosh(εᵀε/F)
        return 0.5 * k * F * math.log(math.cosh(float(x @ x) / F))

    gain = barrier_gain(epsilon, k, F)
    assert 0.0 <= gain <= k
    for i, step in enumerate(h * np.eye(3)):
        expected = (barrier(epsilon + step) - barrier(epsilon - step)) / (2.0 * h)
        assert gain * epsilon[i] == pytest.approx(expected, rel=1e-6, abs=1e-7)


def test_the_gain_stays_finite_far_outside() -> None:
    assert barrier_gain((1e150, 0.0, 0.0), 2.0, 0.1) == 2.0


@given(st.floats(-0.99, 0.99), st.floats(1e-3, 2.0))
def test_log_barrier_force_is_a_derivative_inside(part: float, rho: float) -> None:
    q, h = part * rho, 1e-6 * rho * (1.0 - abs(part))

    def potential(x: float) -> float:  # ½ ln(ρ²/(ρ² − x²))
        return -0.5 * math.log1p(-((x / rho) ** 2))

    expected = (potential(q + h) - potential(q - h)) / (2.0 * h)
    force = log_barrier_force((q, 0.0, -q), (rho, rho, rho))
    assert force[0] == pytest.approx(expected, rel=1e-4, abs=1e-5 / rho)
    assert force[1:] == (0.0, -force[0])


def test_log_barrier_pushes_outward_outside() -> None:
    assert log_barrier_force((2.0, -2.0, 0.5), (1.0, 1.0, 1.0))[0] < 0.0
    assert log_barrier_force((2.0, -2.0, 0.5), (1.0, 1.0, 1.0))[1] > 0.0
