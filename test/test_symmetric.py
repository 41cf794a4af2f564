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
from hypothesis import given
from hypothesis import strategies as st

from ppc_attitude.science import symmetric
from ppc_attitude.science.kernel import Matrix

component = st.floats(-10.0, 10.0)
vectors = st.tuples(component, component, component)
matrices = st.tuples(vectors, vectors, vectors)


@given(matrices, matrices, vectors, component)
def test_matrices_are_numpys(m: Matrix, n: Matrix, a: tuple[float, float, float], s: float) -> None:
    x, y = np.array(m), np.array(n)
    upper = np.triu_indices(3)
    assert np.array_equal(symmetric.transposed(m), x.T)
    assert np.array_equal(symmetric.sum_of(m, n), x + y)
    assert np.array_equal(symmetric.scaled(s, m), s * x)
    # In the order of a dot product, so that numbers are the same whoever computes them.
    dots = [[r[0] * c[0] + r[1] * c[1] + r[2] * c[2] for c in n] for r in m]
    assert np.array_equal(symmetric.times_transposed(m, n), dots)
    square = x @ x.T + np.eye(3)
    packed = tuple(square[upper])
    assert np.allclose(
        symmetric.plus_diagonal(symmetric.symmetric_product(m, m), 1.0), packed, atol=1e-12
    )
    assert np.array_equal(symmetric.full(packed), square)
    assert np.array_equal(symmetric.symmetric_sum(packed, packed), 2.0 * square[upper])
    factor = symmetric.cholesky(packed)
    lower = np.linalg.cholesky(square)
    # The factor is packed by columns: xx yx zx yy zy zz.
    assert np.allclose(factor, lower.T[upper], rtol=1e-9, atol=1e-9)
    assert np.allclose(lower @ symmetric.forward(factor, a), a, atol=1e-9)
    assert np.allclose(square @ symmetric.solved(factor, a), a, atol=1e-7)
