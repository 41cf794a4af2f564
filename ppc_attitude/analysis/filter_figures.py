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

"""The figures of a filter: its errors in the band of its own 3σ, and how each fix surprised it.

A function that draws one raises AnalysisError if the record lacks its data; then it is left out.
"""

import numpy as np
from matplotlib.figure import Figure

from ppc_attitude.analysis.drawing import (
    AXIS_COLOURS,
    BLACK,
    ENVELOPE_WIDTH,
    draw,
    limit_lines,
    panels,
)
from ppc_attitude.analysis.filter_health import ATTITUDE_VARIANCES, sigmas_of
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.run_panels import AXES, finish, points
from ppc_attitude.analysis.series import vectors
from ppc_attitude.analysis.truth import knowledge_errors
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import ESTIMATOR

ARCSEC = float(np.rad2deg(3600.0))
BAND = 3.0  # σ


def knowledge_figure(run: Measured) -> Figure:
    """Draw the knowledge error about each body axis within 3σ of the filter's own covariance."""
    sigmas = sigmas_of(run.record, ATTITUDE_VARIANCES)
    # A rotation vector of a small angle is twice the vector part of its quaternion.
    errors = 2.0 * knowledge_errors(run.record).quaternions[:, :3]
    return _in_band(run, ARCSEC * errors, 0.0, ARCSEC * sigmas, "knowledge error", "arcsec")


def bias_figure(run: Measured) -> Figure:
    """Draw the estimated bias of the gyro with 3σ on either side."""
    bias, sigmas = (vectors(run.record, name) for name in ("gyro_bias", "gyro_bias_sigma"))
    bias, sigmas = np.rad2deg(bias), np.rad2deg(sigmas)
    return _in_band(run, bias, bias, sigmas, "gyro bias", "deg/s")


def innovation_figure(run: Measured) -> Figure:
    """Draw the innovation of each fix by its standard deviation, and its square beside the gate."""
    values = vectors(run.record, "innovation")
    figure, (top, bottom) = panels(2, share_x=True)
    points(top, run.t, values)
    limit_lines(top, BAND, -BAND, label="3σ")
    bottom.plot(run.t, np.square(values).sum(axis=1), ".", color=BLACK, markersize=1.5, label="NIS")
    gate = run.record.parameters.get(ESTIMATOR, {}).get("gate")
    if gate is not None and not run.changed(ESTIMATOR, "gate"):
        limit_lines(bottom, gate, label=f"gate {gate:g}")
    bottom.set_yscale("log")
    top.set_ylabel("innovation / σ [1]")
    bottom.set_ylabel("NIS [1]")
    for axes in (top, bottom):
        finish([axes], run)
    return figure


def _in_band(
    run: Measured, values: Array, middle: Array | float, sigmas: Array, name: str, unit: str
) -> Figure:
    """Draw values, shape (n, 3), an axis a panel, and 3σ on either side of their middle."""
    figure, shown = panels(3, share_x=True, row_height=1.6)
    low, high = middle - BAND * sigmas, middle + BAND * sigmas
    for k, (axis, axes) in enumerate(zip(AXES, shown, strict=True)):
        draw(axes, run.t, values[:, k], colour=AXIS_COLOURS[k], label=axis)
        for edge, label in ((low, "3σ"), (high, "")):
            draw(axes, run.t, edge[:, k], width=ENVELOPE_WIDTH, style="--", label=label)
        # At the start the bias is unknown: with its wide band all that follows would be flat.
        late = run.t >= 0.25 * run.t[-1]
        lines = np.concatenate([each[late, k] for each in (low, high, values)])
        lines = lines[np.isfinite(lines)]
        if lines.size and (width := np.ptp(lines)) > 0.0:
            axes.set_ylim(lines.min() - 0.3 * width, lines.max() + 0.3 * width)
        axes.set_ylabel(f"{name},\n{axis} [{unit}]")
        finish([axes], run)
    return figure
