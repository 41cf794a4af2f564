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

"""Is a filter as good as it says? Its errors against its own σ, its innovations, its refusals.

One run cannot show that a filter is a little wrong: errors correlate over minutes through the
gyro's bias, so a correct filter is outside its 3σ for more than 1 % of one run in five. A run shows
that it is right, or is not judged; many runs together decide. A filter that is outside 6σ for most
of a run is wrong, since a correct one hardly ever is for an instant.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.series import elapsed, has, is_finite, known, samples
from ppc_attitude.analysis.truth import knowledge_errors
from ppc_attitude.analysis.verdict import Requirement
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import ESTIMATOR, TRUE_ATTITUDE
from ppc_attitude.science.attitude import conjugate, logarithm, product
from ppc_attitude.science.kinds import ESTIMATORS
from ppc_attitude.science.sensors.star_tracker import MOUNTING

SETTLED = 10.0
"""From here on the filter's own σ is judged [s]."""
OUTSIDE_LIMIT = 0.01
"""Share of the instants that an axis may be outside 3σ."""
_MOST = 0.5  # share of the instants outside 6σ beyond which a filter is wrong
_ESTIMATE, _FIX, _INNOVATION = "estimate", "star_fix", "innovation"
GATE = "gate"
"""Parameter of a filter: squared innovation beyond which it refuses a fix."""
_ROUNDING = 1e-28  # [rad²] of the error of a fix that has no other
ATTITUDE_VARIANCES, RATE_VARIANCES = [4, 7, 9], [13, 16, 18]
"""Where the variances lie among the numbers of an estimate."""


def judge_filter(run: Measured) -> Iterator[Requirement]:
    """Compare a filter's errors with the covariance that it tells, and count what it refused."""
    record = run.record
    if not has(record, _ESTIMATE):
        return
    outside, why = _outside(record, 3.0), ""
    if outside is None:
        why = run.ends_before(SETTLED, "the filter settles")
    elif outside > OUTSIDE_LIMIT and (_outside(record, 6.0) or 0.0) <= _MOST:
        why = f"{outside:.3g}, but one run cannot tell: errors correlate over minutes"
    span = (min(max(SETTLED, run.begin), run.end), run.end)
    row = ("knowledge_outside", outside, OUTSIDE_LIMIT, "", why, span)
    yield run.row(*row, without=run.untold)
    settings, gate = record.parameters.get(ESTIMATOR, {}), gate_of(record)
    if gate is None or not has(record, _INNOVATION):
        return
    changed = run.changed(ESTIMATOR, GATE, MOUNTING.name)
    told = np.flatnonzero(is_finite(record, _INNOVATION))
    nis = np.square(record[_INNOVATION][told]).sum(axis=1)
    used = nis <= gate
    if count := int(used.sum()):
        # Three standard deviations of the mean of so many χ²₃.
        limit = 3.0 * math.sqrt(6.0 / count)
        yield run.row("nis", abs(float(nis[used].mean()) - 3.0), limit, "", changed)
    refused, why = None, changed or run.lacks(TRUE_ATTITUDE.column, _FIX)
    if not (why or used.all() or MOUNTING.name in settings):
        why = f"no mounting ({MOUNTING.name} of {ESTIMATOR}) on record"
    if not why:
        rows = told[~used].tolist()
        refused = float(sum(_is_good(record, settings, row) for row in rows))
    yield run.row("refused_fixes", refused, max(1.0, 1e-3 * float(told.size)), "", why)


def gate_of(record: RunRecord) -> float | None:
    """Gate of the filter that ran (`GATE`); None if the record tells none.

    Parameters of a node are on record for all estimators: those of another one mean nothing.
    """
    settings = record.parameters.get(ESTIMATOR, {})
    ran = ESTIMATORS.selected(settings)
    if GATE not in settings or (ran is not None and GATE not in ran.defaults):
        return None
    return float(settings[GATE])


def sigmas_of(record: RunRecord, variances: list[int]) -> Array:
    """σ [rad, rad/s] about each body axis as the filter says, shape (n, 3).

    `variances` are their places among the numbers of an estimate, `ATTITUDE_VARIANCES` or
    `RATE_VARIANCES`. NaN where there is no estimate.

    Raises
    ------
    AnalysisError
        If the record has no estimate.
    """
    squares = samples(record, _ESTIMATE).T[variances].T  # by component, as the loop gives them
    return np.asarray(np.sqrt(np.where(squares > 0.0, squares, np.nan)))


def _outside(record: RunRecord, sigmas: float) -> float | None:
    """Largest share of the instants that any axis is outside so many σ."""
    errors, first = known(knowledge_errors, record), int(np.searchsorted(elapsed(record), SETTLED))
    if errors is None:
        return None
    halves = errors.quaternions.T[:3, first:]
    variances = record[_ESTIMATE].T[ATTITUDE_VARIANCES, first:]
    told = is_finite(record, _ESTIMATE)[first:] & (variances > 0.0).all(axis=0)
    told &= np.isfinite(halves).all(axis=0)
    # A rotation vector of a small angle is twice the vector part of its quaternion.
    beyond = 4.0 * halves * halves > sigmas**2 * variances
    outside = max(np.count_nonzero(told & axis) for axis in beyond)
    return float(outside / np.count_nonzero(told)) if told.any() else None


def _is_good(record: RunRecord, settings: Any, row: int) -> bool:
    """True if a fix is within the gate of the truth, by the tracker's own variances."""
    x, y, z, w = (float(each) for each in settings[MOUNTING.name])
    true = product(tuple(record[TRUE_ATTITUDE.column][row]), (x, y, z, w))
    fix = record[_FIX][row]
    error = logarithm(product(conjugate(true), tuple(fix[:4])))
    variances = np.maximum(fix[4:7], _ROUNDING)
    return bool(np.sum(np.square(error) / variances) <= settings[GATE])
