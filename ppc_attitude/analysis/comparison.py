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

"""Figures of several runs: side by side as in the paper's comparisons, and the pulse sweep."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ppc_attitude.analysis.drawing import (
    BLUE,
    PAGE_WIDTH,
    RED,
    RUN_COLOURS,
    draw,
    legend,
    limit_lines,
    log_axis,
    mark_hits,
    panels,
    save,
    time_axis,
)
from ppc_attitude.analysis.figures import (
    AXES,
    RATE_FLOOR,
    draw_envelope,
    fit,
    look_closely,
    zoom_window,
)
from ppc_attitude.analysis.metrics import (
    OUTSIDE_LIMIT_PER_HIT,
    RATE_LIMIT_DEG,
    RECOVERY_LIMIT,
    pulses_of,
)
from ppc_attitude.analysis.series import AnalysisError, attitude_errors, elapsed, has, vectors
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    ATTITUDE_ENVELOPE,
    RATE_ENVELOPE,
    RATE_ERROR,
)

# A run: time (n,), values (n, k), envelope (n, 3) if there is one.
_Series = tuple[Array, Array, Array | None]


def attitude_comparison(records: Sequence[RunRecord], labels: Sequence[str]) -> Figure:
    """Draw q_ev of several runs, each in its own envelope, and a late hit closely."""
    series: list[_Series] = [
        (elapsed(record), attitude_errors(record), _envelope(record, ATTITUDE_ENVELOPE.column))
        for record in records
    ]
    rows = [rf"$q_{{ev,{axis}}}$ [1]" for axis in AXES]
    return _side_by_side(records, labels, series, rows)[0]


def rate_error_comparison(records: Sequence[RunRecord], labels: Sequence[str]) -> Figure:
    """Draw |z2| of several runs, each in its own envelope, and a late hit closely.

    Logarithmic: a hit is a thousand times the envelope.
    """
    series = [
        (
            elapsed(record),
            np.abs(vectors(record, RATE_ERROR.column)),
            vectors(record, RATE_ENVELOPE.column),
        )
        for record in records
    ]
    rows = [f"$|z_{{2,{axis}}}|$ [rad/s]" for axis in AXES]
    figure, _ = _side_by_side(records, labels, series, rows, floor=RATE_FLOOR)
    return figure


def angular_velocity_comparison(records: Sequence[RunRecord], labels: Sequence[str]) -> Figure:
    """Draw ω_s of several runs, its norm with the limit, and a late hit closely."""
    series: list[_Series] = []
    for record in records:
        rate = np.rad2deg(vectors(record, ANGULAR_VELOCITY.column))
        norm = np.linalg.norm(rate, axis=1, keepdims=True)
        series.append((elapsed(record), np.hstack([rate, norm]), None))
    rows = [rf"$\omega_{{s,{axis}}}$ [deg/s]" for axis in AXES] + [r"$\|\omega_s\|$ [deg/s]"]
    figure, axes = _side_by_side(records, labels, series, rows)
    for each in axes[-1]:
        limit_lines(each, RATE_LIMIT_DEG, label=f"limit {RATE_LIMIT_DEG:g} deg/s")
        each.set_ylim(bottom=0.0, top=max(each.get_ylim()[1], 1.1 * RATE_LIMIT_DEG))
    return figure


COMPARISONS: dict[str, tuple[str, Callable[[Sequence[RunRecord], Sequence[str]], Figure]]] = {
    "comparison_attitude_error": ("Attitude errors in their envelopes", attitude_comparison),
    "comparison_angular_velocity": ("Angular velocities", angular_velocity_comparison),
    "comparison_rate_error": ("Rate errors in their envelopes", rate_error_comparison),
}
"""Name of a figure's file to its caption and who draws it."""


def comparisons_of(records: Sequence[RunRecord], labels: Sequence[str]) -> dict[str, Figure]:
    """Draw every comparison for which all the runs have the data.

    Parameters
    ----------
    records : sequence of RunRecord
        Two to six runs; the first is red and the second blue, as in the paper.
    labels : sequence of str
        What to call each.

    Returns
    -------
    dict of str to Figure
        By the names of `COMPARISONS`, in that order.

    Raises
    ------
    AnalysisError
        If there are fewer runs or more, not one label each, or a run lacks attitude error or rate.
    """
    if not 2 <= len(records) <= len(RUN_COLOURS):
        raise AnalysisError(
            f"{len(records)} runs to compare; from 2 to {len(RUN_COLOURS)} can be told apart"
        )
    if len(labels) != len(records):
        raise AnalysisError(f"{len(labels)} labels for {len(records)} runs; each needs one")
    return {
        name: draw_figure(records, labels)
        for name, (_, draw_figure) in COMPARISONS.items()
        if draw_figure is not rate_error_comparison
        or all(
            has(record, column)
            for record in records
            for column in (RATE_ERROR.column, RATE_ENVELOPE.column)
        )
    }


def save_comparison(
    records: Sequence[RunRecord], labels: Sequence[str], folder: Path
) -> list[Path]:
    """Draw every comparison for which all the runs have the data and save each as PNG.

    Parameters
    ----------
    records : sequence of RunRecord
        Two to six runs; the first is red and the second blue, as in the paper.
    labels : sequence of str
        What to call each.
    folder : Path
        Where to; made if there is none. Figures of the same name are replaced.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    AnalysisError
        As `comparisons_of`.
    """
    drawn = comparisons_of(records, labels)
    return [save(figure, folder, name) for name, figure in drawn.items()]


def sweep_figure(
    durations: Sequence[float],
    recovery_times: Sequence[float | None],
    outside_times: Sequence[float],
) -> Figure:
    """Draw how recovery and time outside depend on how long a hit lasts.

    Parameters
    ----------
    durations : sequence of float
        How long each hit lasts, positive [s].
    recovery_times : sequence of float or None
        Recovery from each [s]; None if the run did not recover.
    outside_times : sequence of float
        Time that each puts the rate error outside its envelope [s].

    Raises
    ------
    AnalysisError
        If the three are empty or not of one length.
    """
    if not durations or not len(durations) == len(recovery_times) == len(outside_times):
        raise AnalysisError(
            f"a sweep needs one recovery and one time outside for each duration; "
            f"given {len(recovery_times)} and {len(outside_times)} for {len(durations)}"
        )
    figure, rows = panels(2, share_x=True)
    top, bottom = rows[0][0], rows[1][0]
    known = [(d, r) for d, r in zip(durations, recovery_times, strict=True) if r is not None]
    lost = [d for d, r in zip(durations, recovery_times, strict=True) if r is None]
    top.plot(*_columns(known), "o-", color=BLUE, markersize=4, linewidth=1.0, label="recovery")
    top.plot(
        lost,
        [0.93] * len(lost),
        "X",
        color=RED,
        markersize=6,
        transform=top.get_xaxis_transform(),
        label="not recovered" if lost else "_",
    )
    limit_lines(top, RECOVERY_LIMIT, label=f"limit {RECOVERY_LIMIT:g} s")
    top.set_ylabel("recovery time [s]")
    bottom.plot(durations, outside_times, "s-", color=BLUE, markersize=4, linewidth=1.0, label="_")
    limit_lines(bottom, OUTSIDE_LIMIT_PER_HIT, label=f"limit {OUTSIDE_LIMIT_PER_HIT:g} s")
    bottom.set_ylabel(r"$z_2$ outside its envelope [s]")
    bottom.set_xlabel("duration of the hit [s]")
    bottom.set_xscale("log")
    bottom.set_xticks(durations, [f"{each:g}" for each in durations])
    bottom.minorticks_off()
    for axes in (top, bottom):
        axes.set_ylim(bottom=0.0)
        axes.margins(x=0.1)
        legend(axes)
    return figure


def save_sweep(
    durations: Sequence[float],
    recovery_times: Sequence[float | None],
    outside_times: Sequence[float],
    path: Path,
) -> None:
    """Save `sweep_figure` as the PNG file `path`; its folder is made if there is none.

    Raises
    ------
    AnalysisError
        As `sweep_figure`.
    """
    save(sweep_figure(durations, recovery_times, outside_times), path.parent, path.stem)


def _side_by_side(
    records: Sequence[RunRecord],
    labels: Sequence[str],
    series: Sequence[_Series],
    names: Sequence[str],
    *,
    floor: float | None = None,
) -> tuple[Figure, list[list[Axes]]]:
    """Draw a row a component: the whole run, and a late hit closely if a run has one.

    Logarithmic from `floor` up, if that is given.
    """
    hits = sorted({hit.start_s for record in records for hit in pulses_of(record)})
    longest = max((t for t, _, _ in series), key=lambda t: float(t[-1]))
    window = zoom_window(longest, hits)
    figure, rows = panels(
        len(names), 1 if window is None else 2, width=PAGE_WIDTH, row_height=1.4, share_x=True
    )
    for k, row in enumerate(rows):
        row[0].set_ylabel(names[k])
        look_closely(row, window)
        for axes in row:
            _draw_row(axes, k, labels, series, mirrored=floor is None)
        if floor is None and window is not None:
            _fit_all(row[1], window, k, series)
        for axes in row:
            if floor is not None:
                log_axis(axes, floor)
            time_axis(axes, longest)
            mark_hits(axes, hits)
            axes.set_xlabel("time [s]" if row is rows[-1] else "")
    legend(rows[0][0])
    return figure, rows


def _draw_row(
    axes: Axes, k: int, labels: Sequence[str], series: Sequence[_Series], *, mirrored: bool
) -> None:
    """Draw component k of every run, the first on top, each with its envelope dotted."""
    for label, colour, (t, values, envelope) in zip(labels, RUN_COLOURS, series, strict=False):
        draw(axes, t, values[:, k], colour=colour, label=label)
        if envelope is not None:
            draw_envelope(axes, t, envelope[:, [k]], [colour], mirrored=mirrored)
    for order, line in enumerate(reversed(axes.get_lines())):
        line.set_zorder(2.0 + 0.01 * order)


def _fit_all(axes: Axes, window: tuple[float, float], k: int, series: Sequence[_Series]) -> None:
    """Scale the ordinate to what all runs and envelopes do in the window."""
    t = np.concatenate([each for each, _, _ in series])
    values = np.concatenate([each[:, k] for _, each, _ in series])
    bounds = np.concatenate([values_k[:, k] if e is None else e[:, k] for _, values_k, e in series])
    fit(axes, window, t, [values, bounds])


def _envelope(record: RunRecord, column: str) -> Array | None:
    return vectors(record, column) if has(record, column) else None


def _columns(pairs: list[tuple[float, float]]) -> tuple[list[float], list[float]]:
    return [a for a, _ in pairs], [b for _, b in pairs]
