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

"""The common evidence of refused fixes: that they are false, or that the estimate is.

Between two refused fixes the estimate turns by the gyro, and the fixes turn by what they saw. A
false fix agrees with no other. Three kinds of wrongness do agree with themselves:

- If the estimate began from a false fix, the error is the same each time in inertial axes.
- If the estimated gyro bias is wrong, for example because the bias has jumped by more than the
  filter allows for, the error grows in body axes at a constant rate, which is the bias's error.
- If the tracker is wrong in a body-fixed way, the error is the same each time in body axes. Such a
  tracker is not believed. It differs from the first kind only while the body turns by more than the
  threshold between two fixes.
"""

from typing import Any

import numpy as np

from ppc_attitude.science.attitude import conjugate, logarithm, product
from ppc_attitude.science.compiled_stamps import seconds
from ppc_attitude.science.kernel import (
    Quaternion,
    Vector,
    add,
    dot,
    kernel,
    quaternion,
    scale,
    store,
    store_quaternion,
    subtract,
    vector,
)
from ppc_attitude.science.parameter import record_type

REFUSALS = record_type(
    ("agreeing", np.int64),  # refused fixes in a row with the same error in inertial axes
    ("error", np.float64, (4,)),  # of the last refused fix, inertial axes
    ("body_error", np.float64, (4,)),  # the same in body axes
    ("valid_ns", np.int64),  # its validity [ns]
    ("drifting", np.int64),  # refused fixes in a row whose error grows at one rate
    ("first_error", np.float64, (4,)),  # of the first of these, body axes
    ("first_ns", np.int64),  # its validity [ns]
    ("drift", np.float64, (3,)),  # [rad] by how much the error has grown since, body axes
)
NOTHING_YET, START_WAS_FALSE, BIAS_IS_WRONG = range(3)
_PATIENCE, _EARLY_PATIENCE = 10, 2
EARLY = 5
"""Fixes that a filter has accepted when it no longer doubts the one from which it began."""


@kernel
def _spread(settings: Any, white: float, t: float) -> float:
    """Variance [rad²] of how far two fixes t [s] apart disagree: their own noise and the gyro's."""
    return float(2.0 * settings.fix_variance + white * t)


@kernel
def _stays(settings: Any, white: float, before: Quaternion, now: Quaternion, t: float) -> bool:
    """Whether an error is the same t [s] later, up to noise and the expected error of the bias."""
    turn = logarithm(product(now, conjugate(before)))
    spread = _spread(settings, white, t) + settings.bias_variance * t * t
    return bool(dot(turn, turn) <= settings.gate * spread)


@kernel
def _drifts(refusals: Any, settings: Any, white: float, turn: Vector, t: float) -> bool:
    """Whether the error grows by a turn [rad] in t [s] at the rate at which it grew before."""
    before = seconds(refusals.valid_ns - refusals.first_ns)
    x = t / before
    misfit = subtract(turn, scale(x, vector(refusals.drift)))
    # The fixes' own noise: that of the last one counts in both turns, with opposite signs.
    spread = 2.0 * settings.fix_variance * (1.0 + x + x * x) + white * t * (1.0 + x)
    return bool(dot(misfit, misfit) <= settings.gate * spread)


@kernel
def _is_of_bias(refusals: Any, settings: Any, white: float, body_error: Quaternion) -> bool:
    """Whether the error's growth is more than noise, and not that of a body-fixed error."""
    t = seconds(refusals.valid_ns - refusals.first_ns)
    drift = vector(refusals.drift)
    grows = dot(drift, drift) > settings.gate * _spread(settings, white, t)
    return grows and not _stays(settings, white, quaternion(refusals.first_error), body_error, t)


@kernel
def heard(
    refusals: Any,
    settings: Any,
    white: float,
    attitude: Quaternion,
    estimate: Quaternion,
    valid_ns: int,
    accepted: int,
) -> int:
    """Hear one more refused fix.

    Parameters
    ----------
    refusals
        Evidence of the earlier ones, a record of dtype `REFUSALS`.
    settings
        The filter's record.
    white : float
        σ_v,eff² [rad²/s].
    attitude, estimate : Quaternion
        Attitude of the body by the fix, and by the estimate at its validity.
    valid_ns : int
        Its validity [ns].
    accepted : int
        Fixes that were accepted since the filter began.

    Returns
    -------
    int
        `NOTHING_YET`, or why the filter must begin anew: `START_WAS_FALSE` or `BIAS_IS_WRONG`.
    """
    error = product(attitude, conjugate(estimate))
    body_error = product(conjugate(estimate), attitude)
    if refusals.agreeing == 0:
        refusals.agreeing = refusals.drifting = 1
    else:
        last = quaternion(refusals.error)
        t = seconds(valid_ns - refusals.valid_ns)
        agrees = _stays(settings, white, last, error, t)
        refusals.agreeing = refusals.agreeing + 1 if agrees else 1
        turn = logarithm(product(conjugate(estimate), product(conjugate(last), attitude)))
        if t <= 0.0:
            refusals.drifting = 1  # an older one begins a row of its own
        elif refusals.drifting > 1 and _drifts(refusals, settings, white, turn, t):
            store(refusals.drift, add(vector(refusals.drift), turn))
            refusals.drifting += 1
        else:
            store(refusals.drift, turn)
            store_quaternion(refusals.first_error, quaternion(refusals.body_error))
            refusals.first_ns = refusals.valid_ns
            refusals.drifting = 2
    store_quaternion(refusals.error, error)
    store_quaternion(refusals.body_error, body_error)
    refusals.valid_ns = valid_ns
    if refusals.drifting >= _PATIENCE and _is_of_bias(refusals, settings, white, body_error):
        return BIAS_IS_WRONG
    patience = _EARLY_PATIENCE if accepted < EARLY else _PATIENCE
    return START_WAS_FALSE if refusals.agreeing >= patience else NOTHING_YET


@kernel
def bias_error(refusals: Any, settings: Any, white: float) -> tuple[Vector, float]:
    """Correction of the estimated bias [rad/s], and its variance [rad²/s²]."""
    t = seconds(refusals.valid_ns - refusals.first_ns)
    return scale(-1.0 / t, vector(refusals.drift)), _spread(settings, white, t) / (t * t)
