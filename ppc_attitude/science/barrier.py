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

"""The non-singular ln-cosh barrier (eqs. 4 and 5 of the paper), and the logarithmic one."""

import math

from ppc_attitude.science.kernel import Vector, dot, kernel


@kernel
def barrier_gain(epsilon: Vector, k: float, F: float) -> float:
    """K tanh(εᵀε/F), the factor of ε in the gradient of V_B = (k/2) F ln cosh(εᵀε/F).

    V_B is finite everywhere, also outside the envelope, where the logarithmic barrier is singular.
    """
    return k * math.tanh(dot(epsilon, epsilon) / F)


@kernel
def log_barrier_force(q: Vector, rho: Vector) -> Vector:
    """χ_i = q_i / (ρ_i² − q_i²): the traditional barrier's gradient; it points outward outside."""
    return (
        q[0] / (rho[0] * rho[0] - q[0] * q[0]),
        q[1] / (rho[1] * rho[1] - q[1] * q[1]),
        q[2] / (rho[2] * rho[2] - q[2] * q[2]),
    )
