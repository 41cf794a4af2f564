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

"""The best knowledge from a gyro and a star tracker, in closed form (Farrenkopf, 1978).

One axis, a fix every T [s]; Markley and Reynolds (2000) give the form used here. The envelopes of a
law must not be narrower than this knowledge allows: `FLOOR` says how much wider.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from ppc_attitude.science.rate_observer import RATE_OBSERVER, rate_sigma
from ppc_attitude.science.sensors.gyro import (
    ANGULAR_RANDOM_WALK,
    INITIAL_BIAS_SIGMA,
    RATE_RANDOM_WALK,
    RESOLUTION,
    effective_white_noise,
)
from ppc_attitude.science.sensors.star_tracker import BORESIGHT_NOISE, CROSS_NOISE, slots


class AxisKnowledge(NamedTuple):
    """Covariance of one axis: P_θθ [rad²], P_θb [rad²/s], P_bb [rad²/s²]."""

    attitude: float
    cross: float
    bias: float


def steady_state(
    fix: float, white: float, walk: float, interval: float
) -> tuple[AxisKnowledge, AxisKnowledge]:
    """Covariance of one axis just before and just after a fix, when it no longer changes.

    Parameters
    ----------
    fix : float
        σ_n of a fix [rad], > 0.
    white : float
        σ_v of the gyro [rad/√s].
    walk : float
        σ_u of the gyro [rad/s^1.5].
    interval : float
        T, from fix to fix [s].
    """
    s_v = white * math.sqrt(interval) / fix
    s_u = walk * interval**1.5 / fix
    gamma = math.sqrt(1.0 + s_v**2 / 4.0 + s_u**2 / 48.0)
    # ζ − 1, so that nothing cancels where the gyro is far better than the tracker.
    excess = (s_v**2 / 4.0 + s_u**2 / 48.0) / (gamma + 1.0)
    excess += s_u / 4.0 + 0.5 * math.sqrt(2.0 * gamma * s_u + s_v**2 + s_u**2 / 3.0)
    zeta = 1.0 + excess
    growth = excess * (2.0 + excess)  # ζ² − 1
    cross = -fix * walk * math.sqrt(interval)
    middle = walk * fix / math.sqrt(interval) * growth / zeta
    half = 0.5 * walk**2 * interval
    return (
        AxisKnowledge(fix**2 * growth, cross * zeta, middle + half),
        AxisKnowledge(fix**2 * growth / zeta**2, cross / zeta, middle - half),
    )


def after_gap(known: AxisKnowledge, white: float, walk: float, gap: float) -> AxisKnowledge:
    """Covariance of one axis after a gap [s] without fixes.

    Parameters
    ----------
    known : AxisKnowledge
        Covariance at the start of the gap.
    white, walk : float
        σ_v [rad/√s] and σ_u [rad/s^1.5].
    gap : float
        Length of the gap [s].
    """
    return AxisKnowledge(
        known.attitude
        - 2.0 * known.cross * gap
        + known.bias * gap**2
        + white**2 * gap
        + walk**2 * gap**3 / 3.0,
        known.cross - known.bias * gap - 0.5 * walk**2 * gap**2,
        known.bias + walk**2 * gap,
    )


def first_knowledge(estimator: Mapping[str, Any], rate: float) -> tuple[float, float, float]:
    """Largest uncertainty of a filter once it has a fix; from then on it only decreases.

    A bias that is known better at the start than in the long run is taken as known in the long run.

    Parameters
    ----------
    estimator : mapping
        Checked parameters of its node.
    rate : float
        Steps per second [Hz].

    Returns
    -------
    attitude, bias : float
        Variances on the worst axis [rad²], [rad²/s²], an instant before the second fix comes.
    white : float
        σ_v of the gyro with its rounding [rad/√s].

    Raises
    ------
    ConfigurationError
        The tracker's rate does not divide the steps'.
    """
    every, delay = slots(rate, estimator)
    white, walk = _gyro_noise(estimator, rate)
    fix = max(estimator[CROSS_NOISE.name], estimator[BORESIGHT_NOISE.name])
    settled, _ = steady_state(fix, white, walk, every / rate)
    bias = max(estimator[INITIAL_BIAS_SIGMA.name] ** 2, settled.bias)
    known = after_gap(AxisKnowledge(fix**2, 0.0, bias), white, walk, (every + delay) / rate)
    return known.attitude, known.bias, white


def bias_in_innovation(estimator: Mapping[str, Any], rate: float) -> float:
    """How far a change of the gyro's bias takes a fix from its prediction [s/rad].

    In σ of the innovation, for each rad/s: in the long run a filter adds K = P_θθ/(P_θθ + σ_n²) of
    an innovation to the attitude and little to the bias, so the innovation grows to T Δb/K.

    Parameters
    ----------
    estimator, rate
        As of `first_knowledge`.
    """
    every, _ = slots(rate, estimator)
    white, walk = _gyro_noise(estimator, rate)

    def of_axis(fix: float) -> float:
        before, _ = steady_state(fix, white, walk, every / rate)
        sigma = math.hypot(math.sqrt(before.attitude), fix)
        return every / rate * sigma / before.attitude if before.attitude else math.inf

    return max(of_axis(estimator[CROSS_NOISE.name]), of_axis(estimator[BORESIGHT_NOISE.name]))


def _gyro_noise(estimator: Mapping[str, Any], rate: float) -> tuple[float, float]:
    """σ_v of the gyro with its rounding [rad/√s], and σ_u [rad/s^1.5]."""
    given, resolution = estimator[ANGULAR_RANDOM_WALK.name], estimator[RESOLUTION.name]
    white = effective_white_noise(given, resolution, 1.0 / rate)
    return white, estimator[RATE_RANDOM_WALK.name]


FLOOR = 6.0
"""Least width of an envelope, in σ of its error.

Rice: a stationary error leaves ±ρ on three axes 6 ν0 T exp(−ρ²/2σ²) times in a time T, so for p
excursions c = √(2 ln(6 ν0 T/p)) σ are needed. One in a hundred hours makes 5.8 behind the observer
(ν0 = 8 Hz), and 6.0 with raw samples at 100 Hz (25 Hz)."""


class Sigmas(NamedTuple):
    """σ of the noise in a law's errors on one axis: of q_ev [1] and of z2 [rad/s]."""

    attitude: float
    rate: float


def error_sigmas(
    controller: Mapping[str, Any], rate: float, attitude: float, bias: float, white: float
) -> Sigmas:
    """σ of the errors that a law sees on one axis.

    σ of q_ev is ½ σ_θ; that of z2 is √(σ_ω² + P_bb + (½ k M_ω β σ_θ)²), where the last term is the
    virtual control's answer to the attitude's error.

    Parameters
    ----------
    controller : mapping
        Checked parameters of the law's node.
    rate : float
        Steps per second [Hz].
    attitude, bias, white : float
        What `Component.noise` gives of who tells the law its motion.
    """
    frequency = controller[RATE_OBSERVER.name]
    measured = rate_sigma(frequency, white) if frequency else white * math.sqrt(rate)
    slope = 0.5 * controller["k"] * controller["M_omega"] * controller["beta"]
    return Sigmas(0.5 * math.sqrt(attitude), math.sqrt(measured**2 + bias + slope**2 * attitude))


def settled_knowledge(estimator: Mapping[str, Any], rate: float) -> tuple[float, float, float]:
    """Uncertainty of a filter once it has settled, as `first_knowledge` gives that of the start.

    A published estimate is oldest just before a fix arrives: latency and interval after it was
    updated.

    Raises
    ------
    ConfigurationError
        The tracker's rate does not divide the steps'.
    """
    every, delay = slots(rate, estimator)
    white, walk = _gyro_noise(estimator, rate)
    fix = max(estimator[CROSS_NOISE.name], estimator[BORESIGHT_NOISE.name])
    _, after = steady_state(fix, white, walk, every / rate)
    known = after_gap(after, white, walk, (every + delay) / rate)
    return known.attitude, known.bias, white
