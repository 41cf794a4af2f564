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

"""The figures of a campaign: errors over time of all runs, and where runs fail."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ppc_attitude.analysis.drawing import (
    BLUE,
    GREY,
    PAGE_WIDTH,
    RED,
    judged_limit,
    legend,
    limit_lines,
    log_axis,
    panels,
    time_axis,
)
from ppc_attitude.analysis.requirements import PAPER, Requirements
from ppc_attitude.campaign.quantile_bands import QuantileBands
from ppc_attitude.contract.run_record import Array

Sample = Sequence[Mapping[str, float]]

_BANDS = ((0.0, 1.0, "all runs", 0.14), (0.05, 0.95, "90 %", 0.28), (0.25, 0.75, "50 %", 0.45))
_ERROR_FLOOR = 1e-6
_SHOWN = 3  # variables that are drawn against each other


def bands_figure(bands: QuantileBands, required: Requirements = PAPER) -> Figure:
    """Draw the attitude error of all runs over time against the envelope, and the part it fills."""
    figure, (top, bottom) = panels(2, width=PAGE_WIDTH, row_height=2.6, share_x=True)
    t = 0.5 * (bands.ends[:-1] + bands.ends[1:])
    _bands(top, t, bands, "attitude_error")
    envelope = [bands.quantiles("attitude_envelope", share) for share in (0.05, 0.5, 0.95)]
    if np.isfinite(envelope[1]).any():
        top.plot(t, envelope[1], color=RED, linewidth=1.2, label="envelope, median")
        for edge, label in ((envelope[0], "envelope, 5 % and 95 %"), (envelope[2], "_")):
            top.plot(t, edge, color=RED, linewidth=0.7, linestyle=(0, (3, 2)), label=label)
    last, deadline = float(bands.ends[-1]) - required.terminal_window, required.settling_deadline
    for name, accuracy, judged in (
        ("settled", required.settled, t >= deadline),
        ("terminal", required.terminal, (t >= last) & (last >= deadline)),
    ):
        if accuracy is not None and judged.any():
            label = f"{name} < {accuracy}"
            judged_limit(top, t, judged, accuracy.component, label=label)
    log_axis(top, _ERROR_FLOOR)
    top.set_ylabel(r"pointing error $\max_i|q_{ev,i}|$ [1]")
    _bands(bottom, t, bands, "normalised_error")
    limit_lines(bottom, 1.0, label="envelope")
    bottom.set_yscale("log")
    bottom.set_ylabel(r"law's error / envelope $\max_i|q_{ev,i}|/\rho_{q,i}$ [1]")
    for axes in (top, bottom):
        time_axis(axes, bands.ends)
        legend(axes)
    return figure


def _bands(axes: Axes, t: Array, bands: QuantileBands, quantity: str) -> None:
    """Draw nested bands and the median; nothing where nothing is known."""
    for low, high, label, opacity in _BANDS:
        below, above = bands.quantiles(quantity, low), bands.quantiles(quantity, high)
        axes.fill_between(t, below, above, color=BLUE, alpha=opacity, linewidth=0, label=label)
    axes.plot(t, bands.quantiles(quantity, 0.5), color=BLUE, linewidth=1.3, label="median")


def failing_figure(passing: Sample, failing: Sample, units: Mapping[str, str]) -> Figure | None:
    """Draw where runs fail, over the drawn variables that tell failing from passing best.

    Given are the values of the variables in runs that meet every requirement, and in runs that do
    not, and the variables with their units. None if fewer than two of them vary.
    """
    names = telling_variables(passing, failing, units)[:_SHOWN]
    if len(names) < 2:
        return None
    couples = list(combinations(names, 2))
    figure, row = panels(1, len(couples), width=PAGE_WIDTH, row_height=2.7)
    figure.set_dpi(200)  # of the points, which are pixels in the page: there may be thousands
    for axes, (x, y) in zip(row, couples, strict=True):
        for runs, colour, label, size in ((passing, GREY, "met", 4), (failing, RED, "NOT MET", 6)):
            both = [(run[x], run[y]) for run in runs if x in run and y in run]
            points = np.array(both).reshape(-1, 2)
            axes.scatter(
                points[:, 0],
                points[:, 1],
                s=size,
                c=colour,
                alpha=0.55,
                linewidths=0,
                label=label,
                rasterized=True,
            )
        for name, scale in ((x, axes.set_xscale), (y, axes.set_yscale)):
            if _spans_decades(_values(name, [*passing, *failing])):
                scale("log")
        axes.set_xlabel(_label(x, units))
        axes.set_ylabel(_label(y, units))
    legend(row[0])
    return figure


def telling_variables(passing: Sample, failing: Sample, names: Iterable[str]) -> list[str]:
    """Named variables that vary, those first that tell failing runs from passing ones best.

    Best by the Kolmogorov-Smirnov distance: the largest difference between the shares of failing
    and of passing runs below any one value. Where all runs fail or all pass, it is 1.
    """
    from scipy.stats import ks_2samp

    distances = {}
    for name in names:
        good, bad = _values(name, passing), _values(name, failing)
        every = np.concatenate([good, bad])
        if every.size and every.min() < every.max():
            both = good.size and bad.size
            with np.errstate(divide="ignore"):  # of one number each there is no significance
                distances[name] = ks_2samp(good, bad, method="asymp").statistic if both else 1.0
    return sorted(distances, key=lambda name: -distances[name])


def _values(name: str, runs: Sample) -> Array:
    return np.array([run[name] for run in runs if name in run], dtype=np.float64)


def _spans_decades(values: Array) -> bool:
    """Whether most values crowd at the lower end, so that a logarithmic axis shows them better."""
    if values.size == 0 or values.min() <= 0.0:
        return False
    return bool(5.0 * np.median(values) < values.max())


def _label(name: str, units: Mapping[str, str]) -> str:
    words = name.replace("_", " ")
    return f"{words} [{units[name]}]"
