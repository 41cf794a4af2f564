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

"""A rate gyro that gives the mean rate of each interval (Crassidis and Junkins, section 7.2).

White noise of the rate is a random walk of the angle (σ_v), and the bias walks too (σ_u). The mean
rate over an interval follows exactly from both, whatever the interval's length.
"""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import conjugate, logarithm, product
from ppc_attitude.science.kernel import (
    Quaternion,
    Vector,
    add,
    apply,
    inlined,
    kernel,
    matrix,
    scale,
)
from ppc_attitude.science.noise import normal_pair, normal_pairs, normal_vector
from ppc_attitude.science.parameter import Parameter, at_start, filled, record_type

_size = partial(Parameter, low=0.0, high=1.0)
ANGULAR_RANDOM_WALK = _size(
    "gyro.angular_random_walk", 0.0, "σ_v of the gyro: white noise of the rate", "rad/√s"
)
RATE_RANDOM_WALK = _size(
    "gyro.rate_random_walk", 0.0, "σ_u of the gyro: random walk of its bias", "rad/s^1.5"
)
INITIAL_BIAS_SIGMA = at_start(
    "gyro.initial_bias_sigma",
    0.0,
    "standard deviation of the unknown bias at the start, per axis",
    "rad/s",
    low=0.0,
    high=1.0,
)
RESOLUTION = _size("gyro.resolution", 0.0, "LSB of the gyro; 0: not rounded", "rad/s")
_MOST_COUNTS = 2.0**52  # a float64 beyond has no fractional digits
_added = partial(Parameter, low=0.0, high=0.1)
PARAMETERS = (
    ANGULAR_RANDOM_WALK,
    RATE_RANDOM_WALK,
    INITIAL_BIAS_SIGMA,
    RESOLUTION,
    at_start(
        "gyro.initial_bias",
        [0.0] * 3,
        "fixed part of the bias at the start",
        "rad/s",
        length=3,
        low=-1.0,
        high=1.0,
    ),
    Parameter(
        "gyro.scale_factor",
        [0.0] * 3,
        "relative errors of the scale: the diagonal of M",
        length=3,
        low=-0.5,
        high=0.5,
    ),
    Parameter(
        "gyro.misalignment",
        [0.0] * 6,
        "M off its diagonal: xy, xz, yx, yz, zx, zy",
        "rad",
        length=6,
        low=-0.5,
        high=0.5,
    ),
    _added(
        "gyro.scale_factor_sigma",
        0.0,
        "standard deviation of what the seed adds to the scale errors",
    ),
    _added(
        "gyro.misalignment_sigma",
        0.0,
        "standard deviation of what the seed adds to the misalignments",
        "rad",
    ),
    Parameter(
        "gyro.full_scale", 20.0, "the gyro's largest rate, per axis", "rad/s", above=0.0, high=1e3
    ),
)
QUIET = dict.fromkeys((each.name for each in PARAMETERS[:4]), 0.0)
"""Parameters with which there is no noise and no rounding."""
GYRO = record_type(
    ("white", np.float64),  # σ_v [rad/√s]
    ("walk", np.float64),  # σ_u [rad/s^1.5]
    ("initial_bias", np.float64, (3,)),  # [rad/s] b_0
    ("response", np.float64, (3, 3)),  # I + M
    RESOLUTION,
    ("full_scale", np.float64),  # [rad/s]
    ("seed", np.int64),
    ("pairs", np.int64),  # of normal numbers that are computed together
)
_TOGETHER = 2  # steps of which the noise is computed at once
_CHANNELS = 4  # of a step
NOISE = record_type(
    ("end", np.int64),  # the step before which it ends
    ("pairs", np.float64, (2, _TOGETHER * _CHANNELS)),
)
# Channels of the noise (`noise.normal_pair`); a vector takes two, and those of a step are in a row.
_NOISE, _INITIAL_BIAS, _SCALE, _MISALIGNMENT = 8, 16, 18, 20


def gyro_record(values: Mapping[str, Any]) -> Any:
    """Record of dtype `GYRO` from checked parameters of the plant.

    Errors drawn by the seed, with the given standard deviations, are added to the fixed ones.
    """
    seed = values["seed"]

    def with_drawn(name: str, drawn: Any) -> Any:
        return np.asarray(values[name]) + values[f"{name}_sigma"] * np.ravel(drawn)

    bias = normal_vector(seed, 0, _INITIAL_BIAS)
    scales = normal_vector(seed, 0, _SCALE)
    sides = [normal_pair(seed, 0, _MISALIGNMENT + i) for i in range(3)]
    response = np.eye(3) + np.diag(with_drawn("gyro.scale_factor", scales))
    response[[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]] += with_drawn("gyro.misalignment", sides)
    return filled(
        GYRO,
        values,
        "gyro.",
        white=values[ANGULAR_RANDOM_WALK.name],
        walk=values[RATE_RANDOM_WALK.name],
        initial_bias=with_drawn("gyro.initial_bias", bias),
        response=response,
        seed=seed,
        pairs=_TOGETHER * _CHANNELS,
    )


def effective_white_noise(white: float, resolution: float, interval: float) -> float:
    """σ_v,eff [rad/√s] = √(σ_v² + LSB² Δt/12): rounding acts as white noise of its own.

    Parameters
    ----------
    white : float
        σ_v [rad/√s].
    resolution : float
        LSB [rad/s].
    interval : float
        Δt of a sample [s].
    """
    return math.sqrt(white**2 + resolution**2 * interval / 12.0)


@kernel
def mean_rate(q_before: Quaternion, q_now: Quaternion, h: float) -> Vector:
    """Mean rate [rad/s] of an interval of h [s]: log(q_{k−1}⁻¹ ⊗ q_k)/h, body axes."""
    return scale(1.0 / h, logarithm(product(conjugate(q_before), q_now)))


@inlined
def gyro_noise(gyro: Any, step: int, noise: Any) -> tuple[Vector, Vector]:
    """Standard normal numbers of a sample and of the walk of its bias.

    `noise`, of dtype `NOISE`, holds those of some steps; it is zero at first.
    """
    if not noise.end - _TOGETHER <= step < noise.end:
        normal_pairs(gyro.seed, step, _NOISE, gyro.pairs, noise.pairs)
        noise.end = step + _TOGETHER
    i = _CHANNELS * (step + _TOGETHER - noise.end)
    x, y = noise.pairs[0], noise.pairs[1]
    return (x[i], y[i], x[i + 1]), (x[i + 2], y[i + 2], x[i + 3])


@kernel
def walked_bias(gyro: Any, bias: Vector, noise: Vector, h: float) -> Vector:
    """Bias [rad/s] h [s] after the given one."""
    return add(bias, scale(gyro.walk * math.sqrt(h), noise))


@kernel
def _read_axis(rate: float, resolution: float, full_scale: float) -> float:
    limited = min(max(rate, -full_scale), full_scale)
    counts = limited / resolution
    if not abs(counts) < _MOST_COUNTS:  # the resolution is zero, or finer than the number itself
        return limited
    return float(resolution * np.floor(counts + 0.5))


@kernel
def sample_variance(white: float, rounding: float, walk: float, h: float) -> float:
    """Variance [rad²/s²] of a sample of h [s], rounding included: σ_v,eff²/h + σ_u² h/12.

    From σ_v² [rad²/s], LSB²/12 [rad²/s²] and σ_u² [rad²/s³].
    """
    return white / h + rounding + walk * h / 12.0


@inlined
def gyro_sample(
    gyro: Any, rate: Vector, bias: Vector, noise: Vector, h: float, louder: float = 1.0
) -> Vector:
    """Measured mean rate [rad/s] of an interval of h [s].

    ω_k = (I + M) ω̄ + b + √(σ_v²/h + σ_u² h/12) n, clipped to the full scale, rounded to the LSB;
    `rate` is the true mean rate ω̄, `bias` the mean of the interval's first and last bias, and
    `louder` a factor on the noise n.
    """
    sigma = louder * math.sqrt(
        sample_variance(gyro.white * gyro.white, 0.0, gyro.walk * gyro.walk, h)
    )
    measured = add(add(apply(matrix(gyro.response), rate), bias), scale(sigma, noise))
    return (
        _read_axis(measured[0], gyro.resolution, gyro.full_scale),
        _read_axis(measured[1], gyro.resolution, gyro.full_scale),
        _read_axis(measured[2], gyro.resolution, gyro.full_scale),
    )
