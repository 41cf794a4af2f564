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

"""Figures of several runs: side by side as in the paper's comparisons, and the pulse sweep.

A function that draws one raises AnalysisError if a run lacks what it shows; then it is left out.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ppc_attitude.analysis.drawing import (
    BLUE,
    PAGE_WIDTH,
    RED,
    RUN_COLOURS,
    Drawn,
    draw,
    in_degrees,
    judged_limit,
    legend,
    limit_lines,
    log_axis,
    mark_faults,
    mark_hits,
    panels,
    time_axis,
)
from ppc_attitude.analysis.envelopes import ATTITUDE, ENVELOPES, Envelope, bound_of, envelopes_of
from ppc_attitude.analysis.faults import faults_of
from ppc_attitude.analysis.hits import SweptHit
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.requirements import PAPER, Requirements
from ppc_attitude.analysis.run_panels import (
    AXES,
    draw_envelope,
    fit,
    log_floor,
    symbols,
    zoom_window,
)
from ppc_attitude.analysis.series import AnalysisError, has, vectors
from ppc_attitude.contract.run_record import Array, RunRecord

# The components of a run: time (n,), value (n,), and what bounds it (n,) if anything does.
_Curves = list[tuple[Array, Array, Array | None]]


def attitude_comparison(runs: Sequence[Measured], labels: Sequence[str]) -> Figure:
    """Draw the pointing errors of runs, each in its own envelope, and a late hit closely."""
    curves = []
    for run in runs:
        if run.pointing is None:
            raise AnalysisError(f"{run.record.source}: {run.lacks_attitude}")
        bound = bound_of(run.record, ATTITUDE.error)
        envelope = vectors(run.record, bound) if has(run.record, bound) else None
        curves.append(_curves(run, run.pointing.quaternions[:, :3], envelope))
    names = [f"pointing error\n$q_{{ev,{axis}}}$ [1]" for axis in AXES]
    return _side_by_side(runs, labels, names, curves)[0]


def error_comparison(runs: Sequence[Measured], labels: Sequence[str], envelope: Envelope) -> Figure:
    """Draw the laws' own errors, each in its own envelope, and a late hit closely.

    Logarithmic: a hit is a thousand times the envelope.
    """
    factor, unit = in_degrees(envelope.unit)
    curves, floors = [], []
    for run in runs:
        bound = bound_of(run.record, envelope.error)
        if not bound:
            raise AnalysisError(f"{run.record.source}: no component bounds the {envelope.name}")
        error = factor * np.abs(vectors(run.record, envelope.error))
        bounds = factor * vectors(run.record, bound)
        curves.append(_curves(run, error, bounds))
        floors.append(log_floor(bounds))
    parts = (envelope.parts or AXES)[: max(map(len, curves))]
    names = [f"|{symbols(envelope.title)}|\n{part} [{unit}]" for part in parts]
    return _side_by_side(runs, labels, names, curves, floor=min(floors))[0]


def angular_velocity_comparison(runs: Sequence[Measured], labels: Sequence[str]) -> Figure:
    """Draw ω_s of runs, its norm with the limit, and a late hit closely."""
    curves = []
    for run in runs:
        if run.lacks_rate:
            raise AnalysisError(f"{run.record.source}: {run.lacks_rate}")
        norm = np.linalg.norm(run.rate, axis=1, keepdims=True)
        curves.append(_curves(run, np.hstack([run.rate, norm]), None))
    names = [f"angular velocity\n{axis} [deg/s]" for axis in AXES] + ["its norm [deg/s]"]
    figure, axes = _side_by_side(runs, labels, names, curves)
    limit = runs[0].required.rate
    for each in axes[-1]:
        if limit is not None:
            for run, colour in zip(runs, RUN_COLOURS, strict=False):
                label = f"limit {limit:g} deg/s, where the run is judged" if run is runs[0] else ""
                judged_limit(each, run.t, run.calm, limit, label=label, colour=colour)
        each.set_ylim(bottom=0.0)
    legend(axes[-1][0], beside=axes[0][0])
    return figure


def run_labels(records: Sequence[RunRecord]) -> list[str]:
    """Name each run as shortly as tells it from the others.

    By the controllers if they differ; else by the names of the bags, or of the namespaces in one;
    else by these with numbers.
    """
    controllers = [record.controller for record in records]
    bags = [Path(record.source).name or record.source for record in records]
    for names in (controllers, bags):
        if len(set(names)) == len(names):
            return names
    return [f"{name} ({k})" for k, name in enumerate(bags, start=1)]


def comparisons_of(runs: Sequence[Measured]) -> tuple[Drawn, list[str]]:
    """Draw every comparison for which all of two to six runs have the data.

    The first is red and the second blue, as in the paper. The list says which comparison is not
    drawn although some run has the data, and which run lacks what.

    Raises
    ------
    AnalysisError
        If there is nothing that all of them have.
    """
    # Matplotlib takes $ for mathematics, and a name that begins with _ for one to hide.
    names = (name.replace("$", r"\$") for name in run_labels([run.record for run in runs]))
    labels = [f"\u200b{name}" if name.startswith("_") else name for name in names]
    drawn: Drawn = {}
    lacking = []
    for name, caption, draw_figure in _comparisons(runs):
        try:
            drawn[name] = caption, draw_figure(runs, labels)
        except AnalysisError as error:
            lacking.append(f"{name} is not drawn: {error}")
    if not drawn:
        raise AnalysisError(f"the runs have no quantity in common to compare: {lacking[0]}")
    return drawn, lacking


_Comparison = Callable[[Sequence[Measured], Sequence[str]], Figure]


def _comparisons(runs: Sequence[Measured]) -> Iterator[tuple[str, str, _Comparison]]:
    """Name of a figure's file, caption, and the function that draws it."""
    bounded = {error for run in runs for error in envelopes_of(run.record)}
    yield "comparison_attitude_error", "Pointing errors in the envelopes", attitude_comparison
    yield "comparison_angular_velocity", "Angular velocities", angular_velocity_comparison
    for each in {each.error: each for each in reversed(ENVELOPES)}.values():
        if each.jumps and each.error in bounded:
            caption = f"{each.name.capitalize()}s in their envelopes, as reported"
            yield f"comparison_{each.error}", caption, partial(error_comparison, envelope=each)


def sweep_figure(hits: Sequence[SweptHit], required: Requirements = PAPER) -> Figure:
    """Draw how recovery and time outside depend on how long a hit lasts, with what is required.

    The time outside is that of errors that a hit throws out of their envelopes at once. There is at
    least one hit; they are in the order of their duration.
    """
    durations = [hit.duration_s for hit in hits]
    thrown = [each for each in hits[0].outside if each.jumps]
    figure, shown = panels(1 + len(thrown), share_x=True)
    top = shown[0]
    # A hit that is not recovered breaks the line: nothing is known between its neighbours.
    known = [np.nan if hit.recovery_time_s is None else hit.recovery_time_s for hit in hits]
    lost = [hit.duration_s for hit in hits if hit.recovery_time_s is None]
    told: dict[str, Any] = {"color": BLUE, "markersize": 4, "linewidth": 1.0}
    top.plot(durations, known, "o-", **told, label="recovery")
    if lost:  # Matplotlib finds no place for a line of no points outside the axes
        top.plot(
            lost,
            [1.0] * len(lost),  # on the frame, where no recovery time is
            "X",
            color=RED,
            markersize=6,
            transform=top.get_xaxis_transform(),
            clip_on=False,
            label="not recovered",
        )
    limit_lines(top, required.recovery, label=f"limit {required.recovery:g} s")
    top.set_ylabel("recovery time [s]")
    allowed = required.outside_after_hit
    for axes, envelope in zip(shown[1:], thrown, strict=True):
        outside = [hit.outside[envelope] for hit in hits]
        axes.plot(durations, outside, "s-", **told, label="outside")
        if allowed is not None:
            limit_lines(axes, allowed, label=f"limit {allowed:g} s")
        axes.set_ylabel(f"{envelope.name} outside\nits envelope [s]")
    bottom = shown[-1]
    bottom.set_xlabel("duration of the hit [s]")
    bottom.set_xscale("log")
    bottom.set_xticks(durations, [f"{each:g}" for each in durations])
    bottom.minorticks_off()
    for axes in shown:
        axes.set_ylim(bottom=0.0)
        axes.margins(x=0.1)
        legend(axes)
    return figure


def _curves(run: Measured, values: Array, bounds: Array | None) -> _Curves:
    """Components of values, shape (n, k), with the bounds of the first of them, shape (n, ≤ k)."""
    pairs = zip_longest(values.T, [] if bounds is None else bounds.T)
    return [(run.t, value, bound) for value, bound in pairs]


def _side_by_side(
    runs: Sequence[Measured],
    labels: Sequence[str],
    names: Sequence[str],
    curves: Sequence[_Curves],
    *,
    floor: float | None = None,
) -> tuple[Figure, list[list[Axes]]]:
    """Draw one row for each component: the whole run, and a late hit closely if a run has one.

    The first run is on top. Logarithmic from `floor` up, if that is given.
    """
    hits = sorted({hit.start_s for run in runs for hit in run.hits})
    faults = sorted({(each.start_s, each.end_s) for run in runs for each in faults_of(run.record)})
    whole = np.array([min(run.begin for run in runs), max(run.end for run in runs)])
    window = zoom_window(whole, hits, runs[0].required.settling_deadline)
    columns = 1 if window is None else 2
    figure, shown = panels(len(names), columns, width=PAGE_WIDTH, row_height=1.4, share_x=True)
    rows = [shown[k : k + columns] for k in range(0, len(shown), columns)]
    for name, row, own in zip(names, rows, zip(*curves, strict=False), strict=False):
        row[0].set_ylabel(name)
        if window is not None:  # before anything is drawn
            row[-1].set_xlim(*window)
        for axes in row:
            for label, colour, (t, value, bound) in zip(labels, RUN_COLOURS, own, strict=False):
                draw(axes, t, value, colour=colour, label=label)
                if bound is not None:
                    draw_envelope(axes, t, bound[:, None], [colour], mirrored=floor is None)
            for order, line in enumerate(reversed(axes.get_lines())):
                line.set_zorder(2.0 + 0.01 * order)
            if floor is not None:
                log_axis(axes, floor)
            time_axis(axes, whole)
            mark_hits(axes, hits)
            mark_faults(axes, faults)
        if floor is None and window is not None:
            shown_closely = [(t, each) for t, *pair in own for each in pair if each is not None]
            fit(row[1], window, shown_closely)
    legend(rows[0][0])
    return figure, rows
