"""The non-singular ln-cosh barrier (eqs. 4 and 5 of the paper), and the logarithmic one."""

import math

from ppc_attitude.science.kernel import Vector, dot, kernel, scale

_LN_2 = math.log(2.0)


@kernel
def ln_cosh(x: float) -> float:
    """ln(cosh(x)) without overflow."""
    magnitude = abs(x)
    return magnitude + math.log1p(math.exp(-2.0 * magnitude)) - _LN_2


@kernel
def barrier(epsilon: Vector, k: float, F: float) -> float:
    """V_B = (k/2) F ln cosh(εᵀε/F): finite everywhere, also outside the envelope."""
    return 0.5 * k * F * ln_cosh(dot(epsilon, epsilon) / F)


@kernel
def barrier_gain(epsilon: Vector, k: float, F: float) -> float:
    """K tanh(εᵀε/F), the factor of ε in the gradient."""
    return k * math.tanh(dot(epsilon, epsilon) / F)


@kernel
def barrier_gradient(epsilon: Vector, k: float, F: float) -> Vector:
    """∇V_B = k tanh(εᵀε/F) ε: bounded growth where the logarithmic barrier is singular."""
    return scale(barrier_gain(epsilon, k, F), epsilon)


@kernel
def log_barrier_force(q: Vector, rho: Vector) -> Vector:
    """χ_i = q_i / (ρ_i² − q_i²): the traditional barrier's gradient; it points outward outside."""
    return (
        q[0] / (rho[0] * rho[0] - q[0] * q[0]),
        q[1] / (rho[1] * rho[1] - q[1] * q[1]),
        q[2] / (rho[2] * rho[2] - q[2] * q[2]),
    )
