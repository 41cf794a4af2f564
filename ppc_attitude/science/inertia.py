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

"""The inertia of a rigid body: its checks, its principal moments, and how two of them differ."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ppc_attitude.science.errors import ConfigurationError


def inertia_matrix(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """Check an inertia [kg·m²] and return it as a 3 × 3 array.

    Parameters
    ----------
    name : str
        What to call it in an error.
    values : array_like
        Nine finite numbers, row-major.

    Raises
    ------
    ConfigurationError
        Not symmetric, not positive definite, or the principal moments break the triangle
        inequality, so that no rigid body has it.
    """
    inertia = np.asarray(values, dtype=np.float64).reshape(3, 3)
    rounding = 1e-14 * np.abs(inertia).max()  # what it may leave of a zero product of inertia
    if not np.allclose(inertia, inertia.T, rtol=1e-9, atol=rounding):
        raise ConfigurationError(f"{name} = {inertia.tolist()} must be symmetric")
    moments = np.linalg.eigvalsh(inertia)
    if moments[0] <= 0.0:
        raise ConfigurationError(
            f"{name} = {inertia.tolist()} must be positive definite; "
            f"its principal moments are {moments.tolist()} kg·m²"
        )
    if moments[0] + moments[1] < moments[2] * (1.0 - 1e-9):
        raise ConfigurationError(
            f"{name} = {inertia.tolist()} belongs to no rigid body: its principal moments "
            f"{moments.tolist()} kg·m² break the triangle inequality"
        )
    return inertia


def principal_moments(inertia: ArrayLike) -> NDArray[np.float64]:
    """Principal moments [kg·m²], shape (3,), ascending, of what `inertia_matrix` takes."""
    return np.asarray(np.linalg.eigvalsh(inertia_matrix("inertia", inertia)))


def gyroscopic_share(inertia: NDArray[np.float64]) -> float:
    """Largest ‖ω × J ω‖/‖ω‖² [kg·m²] of an inertia, shape (3, 3)."""
    moments = np.linalg.eigvalsh(inertia)
    return float(moments[-1] - moments[0]) / 2.0


def inertia_error(known: NDArray[np.float64], true: NDArray[np.float64]) -> float:
    """‖S‖ with J = Ĵ^½ (I + S) Ĵ^½ for a known Ĵ and the true J, nine numbers each [kg·m²]."""
    moments, axes = np.linalg.eigh(known.reshape(3, 3))
    root = axes / np.sqrt(moments) @ axes.T
    return float(np.abs(np.linalg.eigvalsh(root @ true.reshape(3, 3) @ root - np.eye(3))).max())
