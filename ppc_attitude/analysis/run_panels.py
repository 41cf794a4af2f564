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

"""Panels that the figures of runs share: a hit from near, envelopes, limits, legends."""

import re
from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ppc_attitude.analysis.drawing import (
    AXIS_COLOURS,
    BLACK,
    ENVELOPE_WIDTH,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    dots,
    draw,
    judged_limit,
    legend,
    mark_faults,
    mark_hits,
    panels,
    time_axis,
)
from ppc_attitude.analysis.faults import faults_of
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.contract.run_record import Array

AXES = ("x", "y", "z")
COLOURS = (*AXIS_COLOURS, BLACK, ORANGE, PURPLE, SKY, GREY)
ENVELOPE_LABEL = "envelope"
BELOW = 3e3  # how far below the least envelope a logarithmic panel reaches
ZOOM_BEFORE, ZOOM_AFTER = 2.0, 12.0  # of a hit [s]


def zoom_window(t: Array, hits: Sequence[float], deadline: float) -> tuple[float, float] | None:
    """Time to look at closely [s]: around the first hit from the settling deadline on.

    Earlier ones are plain to see in the large error of the approach. None if there is none.
    """
    late = [start for start in hits if start >= deadline]
    if not late:
        return None
    return max(late[0] - ZOOM_BEFORE, float(t[0])), min(late[0] + ZOOM_AFTER, float(t[-1]))


def panels_of(
    run: Measured, count: int, row_height: float = 1.75
) -> tuple[Figure, list[Axes], tuple[float, float] | None]:
    """Make panels one below the other, and one more for the time to look at closely, if any [s]."""
    window = zoom_window(run.t, [hit.start_s for hit in run.hits], run.required.settling_deadline)
    figure, shown = panels(count if window is None else count + 1, row_height=row_height)
    if window is not None:  # before anything is drawn
        shown[-1].set_xlim(*window)
    return figure, shown, window


def symbols(text: str) -> str:
    """Write the symbols of a declaration, such as q_e, as mathematics."""
    return re.sub(r"\b(\w)_(\w+)\b", r"$\1_{\2}$", text)


def log_floor(envelope: Array) -> float:
    """Where a logarithmic panel ends, from the least envelope: zero crossings reach no lower.

    While the law has no attitude its envelope is zero, which does not count.
    """
    known = envelope[envelope > 0.0]
    least = max(float(known.min()), 1e-12) if known.size else 1e-12
    return float(10.0 ** np.floor(np.log10(least / BELOW)))


def fit(axes: Axes, window: tuple[float, float], shown: Sequence[tuple[Array, Array]]) -> None:
    """Make the ordinate just large enough for what is shown in the window.

    That is a time, shape (n,), and values, shape (n, …), for each.
    """
    inside = [values[(t >= window[0]) & (t <= window[1])] for t, values in shown]
    largest = max(float(np.nanmax(np.abs(each), initial=0.0)) for each in inside)
    if largest > 0.0:
        axes.set_ylim(-1.1 * largest, 1.1 * largest)


def draw_envelope(
    axes: Axes,
    t: Array,
    envelope: Array,
    colours: Sequence[str],
    names: Sequence[str] = AXES,
    *,
    mirrored: bool,
) -> None:
    """Draw envelopes, shape (n, k), dashed in the colours of their errors.

    The dashes of several take turns, so that envelopes that coincide still show every colour;
    a single one is dotted, as the paper has it. The legend tells the dashes, in black, for all.
    """
    count = len(colours)
    for k, colour in enumerate(colours):
        dashes = (0.0, (1.0, 1.5)) if count == 1 else (3.0 * k, (3.0, 3.0 * (count - 1)))
        name = f"_{ENVELOPE_LABEL} {names[k]}" if count > 1 else f"_{ENVELOPE_LABEL}"
        told: dict[str, Any] = {"colour": colour, "width": ENVELOPE_WIDTH, "style": dashes}
        draw(axes, t, envelope[:, k], label=name, **told)
        if mirrored:
            draw(axes, t, -envelope[:, k], **told)
    if ENVELOPE_LABEL not in axes.get_legend_handles_labels()[1]:
        style = (0.0, (1.0, 1.5)) if count == 1 else "--"
        axes.plot([], [], color=BLACK, linewidth=0.8, linestyle=style, label=ENVELOPE_LABEL)


def accuracy_limits(axes: Axes, run: Measured, unit: str) -> None:
    """Draw the required accuracies that are given in this unit, where they are judged."""
    ends_settled = run.end >= run.terminal_from and not run.shorter_than_window
    for name, accuracy, judged, colour in (
        ("settled", run.required.settled, run.settled, BLACK),
        ("terminal", run.required.terminal, run.last & ends_settled, GREEN),
    ):
        if accuracy is not None and accuracy.unit == unit and judged.any():
            label = f"{name} < {accuracy}"
            judged_limit(axes, run.t, judged, accuracy.limit, label=label, colour=colour)


def components(axes: Axes, t: Array, values: Array, names: Sequence[str] = ()) -> None:
    """Draw the components with their names; the ninth has the colour of the first."""
    names = names or ((*AXES, "w") if values.shape[1] > 1 else ("_",))  # a number has no axis
    for name, colour, component in zip(names, cycle(COLOURS), values.T, strict=False):
        draw(axes, t, component, label=name, colour=colour)


def points(axes: Axes, t: Array, values: Array) -> None:
    """Draw the components of a column with samples at some instants only, with their names."""
    for axis, colour, component in zip(AXES, AXIS_COLOURS, values.T, strict=False):
        dots(axes, t, component, label=axis, colour=colour)


def finish(shown: Sequence[Axes], run: Measured) -> None:
    """Label time and marks; a panel has a legend if it says more than the first panel's."""
    for axes in shown:
        time_axis(axes, run.t)
        mark_hits(axes, [hit.start_s for hit in run.hits])
        mark_faults(axes, [(fault.start_s, fault.end_s) for fault in faults_of(run.record)])
    legend(shown[0])
    for axes in shown[1:]:
        legend(axes, beside=shown[0])
