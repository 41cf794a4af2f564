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

"""Tools of every figure: style, panels, lines that stay light and lose no spike."""

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import ScalarFormatter
from numpy.typing import NDArray

from ppc_attitude.analysis.series import Mask
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.whole_file import whole_file

# Okabe and Ito's colours, which colour-blind readers can tell apart.
BLUE, RED, GREEN = "#0072B2", "#D55E00", "#009E73"
ORANGE, PURPLE, SKY, BLACK = "#E69F00", "#CC79A7", "#56B4E9", "#000000"
GREY = "#6E6E6E"
AXIS_COLOURS = (BLUE, RED, GREEN)
RUN_COLOURS = (RED, BLUE, GREEN, PURPLE, ORANGE, SKY)

COLUMN_WIDTH = 3.5
"""Width of a journal's column [inch]."""
PAGE_WIDTH = 7.2
"""Width of a journal's page [inch]."""

Drawn: TypeAlias = dict[str, tuple[str, Figure]]
"""Name of a figure's file to its caption and the figure."""

BUCKETS = 600
"""Pairs of points a line is drawn with: more than a printed column can show."""
DOTS = 4 * BUCKETS
"""Dots of a component: a day of fixes, each a dot, made a report of half a gigabyte."""
NOISY = 4.0
"""How many times its own height a line travels within a stretch before it is drawn as a band."""

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 7.5,
    "mathtext.fontset": "dejavusans",
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "axes.edgecolor": "#404040",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.limits": (-3, 4),
    "grid.color": "#E2E2E2",
    "grid.linewidth": 0.5,
    "xtick.direction": "in",
    "ytick.direction": "in",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}

LINE_WIDTH = 1.0
LIMIT_STYLE = (0.0, (6.0, 2.0, 1.0, 2.0))
CHARACTERS = 15.0  # of a legend in an inch
_SUPERSCRIPTS = str.maketrans("−0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_OFFSET = 7  # characters of the common factor of an ordinate's numbers
ENVELOPE_WIDTH = 0.8


class _Numbers(ScalarFormatter):
    """Numbers of a linear axis as plain text: formulas took a third of a report's time."""

    def get_offset(self) -> str:
        """Return the common factor, such as ×10⁻³, and what is common to all."""
        told = re.sub(
            r"e(−?\d+)",
            lambda power: f"×10{power[1].translate(_SUPERSCRIPTS)}",
            super().get_offset(),
        )
        return told.removeprefix("1")


def panels(
    rows: int,
    columns: int = 1,
    *,
    width: float = COLUMN_WIDTH,
    row_height: float = 1.75,
    share_x: bool = False,
) -> tuple[Figure, list[Axes]]:
    """Make a figure of panels in the common style, without pyplot's global state.

    The panels are returned row by row; those of a column share their time axis with `share_x`. The
    width is that of the figure, the height that of a row [inch].
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, row_height * rows + 0.3), layout="constrained")
        sharing: Literal["col", "none"] = "col" if share_x else "none"
        figure.subplots(rows, columns, sharex=sharing)
        for axes in figure.axes:
            axes.yaxis.set_offset_position("right")  # the legend is on the left
            axes.xaxis.set_major_formatter(_Numbers())
            axes.yaxis.set_major_formatter(_Numbers())
    return figure, figure.axes


def decimated(t: Array, values: Array) -> tuple[Array, Array]:
    """Thin a line, shape (n,), to its extremes, so that it stays light and no spike is lost.

    NaN breaks the line. Returns the samples themselves if they are few; otherwise the least and the
    largest of each of `BUCKETS` stretches, in order, the first and the last sample, and a NaN for a
    stretch without any number.
    """
    if values.size <= 2 * BUCKETS:
        return t, values
    picked = np.concatenate([[0], _extremes(values), [values.size - 1]])
    return t[picked], values[picked]


def thinned(t: Array, values: Array) -> tuple[Array, Array]:
    """Thin a cloud of dots, shape (n,), so that it stays light and no extreme is lost.

    Returns the samples themselves if they are few; otherwise the first and the last sample, and of
    those that are finite at most `DOTS`: the extremes of each of `BUCKETS` stretches, and others in
    equal distances, which show how dense the cloud is.
    """
    if values.size <= DOTS:
        return t, values
    picked = np.flatnonzero(np.isfinite(values))
    if picked.size > DOTS:
        every = -(-picked.size // (DOTS - 2 * BUCKETS))
        others = np.arange(0, picked.size, every)
        picked = picked[np.union1d(_extremes(values[picked]), others)]
    picked = np.union1d(picked, [0, values.size - 1])
    return t[picked], values[picked]


def _extremes(values: Array) -> NDArray[np.intp]:
    """Where the least and the largest of each of `BUCKETS` stretches of a line are, in order."""
    rows = _stretches(values)
    gaps = np.isnan(rows)
    extremes = np.column_stack(
        [np.where(gaps, np.inf, rows).argmin(axis=1), np.where(gaps, -np.inf, rows).argmax(axis=1)]
    )
    picked = np.sort(extremes, axis=1) + rows.shape[1] * np.arange(len(rows))[:, None]
    return np.asarray(picked.ravel())


def _stretches(values: Array) -> Array:
    """Rows of `BUCKETS` stretches of a line, shape (n,); the last one goes on as it ends."""
    size = -(-values.size // BUCKETS)
    return np.pad(values, (0, -values.size % size), "edge").reshape(-1, size)


def band(t: Array, values: Array) -> tuple[Array, Array, Array, Array] | None:
    """Reduce a noisy line, shape (n,), to a band: a line would hide its own middle.

    That is time, least, mean and largest value of each stretch, shape (m,); None for a line that
    is not noisy.
    """
    if values.size <= 2 * BUCKETS:
        return None
    times, rows = _stretches(t), _stretches(values)
    known = np.isfinite(rows)  # of a stretch with some gaps the others are drawn
    low, high = np.fmin.reduce(rows, axis=1), np.fmax.reduce(rows, axis=1)
    travelled = np.nansum(np.abs(np.diff(rows, axis=1)), axis=1)
    moving = high > low
    if not moving.any() or np.median(travelled[moving] / (high - low)[moving]) < NOISY:
        return None
    with np.errstate(invalid="ignore"):  # there may be none
        mean = np.where(known, rows, 0.0).sum(axis=1) / known.sum(axis=1)
    return times.mean(axis=1), low, mean, high


def draw(
    axes: Axes,
    t: Array,
    values: Array,
    *,
    label: str = "",
    colour: str = BLACK,
    width: float = LINE_WIDTH,
    style: str | tuple[float, Sequence[float]] = "-",
) -> None:
    """Draw one line, thinned, in the common style; a noisy one as a band with its mean.

    In a panel whose time is set beforehand only what is in view is drawn, so that a window of a
    long run is drawn as finely as a short run.
    """
    if not axes.get_autoscalex_on():
        first, last = np.searchsorted(t, axes.get_xlim())
        view = slice(max(int(first) - 1, 0), int(last) + 2)  # with one more on either side
        t, values = t[view], values[view]
    noisy = band(t, values)
    if noisy is not None:
        t, low, values, high = noisy
        axes.fill_between(t, low, high, color=colour, alpha=0.3, linewidth=0, label="_")
        for edge in (low, high):
            axes.plot(t, edge, color=colour, linewidth=0.2, label="_")
    axes.plot(
        *decimated(t, values),
        color=colour,
        linewidth=width,
        linestyle=style,
        label=label or "_",
        solid_joinstyle="round",
    )


def dots(axes: Axes, t: Array, values: Array, *, label: str, colour: str) -> None:
    """Draw samples as a thinned cloud of dots."""
    axes.plot(*thinned(t, values), ".", color=colour, markersize=1.5, label=label)


def judged_limit(axes: Axes, t: Array, judged: Mask, level: float, **told: Any) -> None:
    """Draw a limit where it is judged, shape (n,), and nowhere else."""
    draw(axes, t, np.where(judged, level, np.nan), width=0.8, style=LIMIT_STYLE, **told)


def limit_lines(axes: Axes, *levels: float, label: str) -> None:
    """Draw horizontal limits; the label goes to the first."""
    for level in levels:
        axes.axhline(level, color=BLACK, linewidth=0.8, linestyle=LIMIT_STYLE, label=label)
        label = "_"


def mark_hits(axes: Axes, starts: Iterable[float]) -> None:
    """Mark the starts of sudden disturbances that are in view: a faint line, a triangle on top."""
    low, high = axes.get_xlim()
    for start in (start for start in starts if low <= start <= high):
        axes.axvline(start, color=GREY, linewidth=0.6, linestyle=(0, (1, 1.5)), zorder=0.5)
        axes.plot(
            [start],
            [1.0],
            marker="v",
            markersize=4,
            color=GREY,
            linestyle="none",
            transform=axes.get_xaxis_transform(),
            clip_on=False,
            label="hit begins",  # a run may be called hit
            zorder=5,
        )


def mark_faults(axes: Axes, spans: Iterable[tuple[float, float]]) -> None:
    """Mark when something of the craft was faulty, from and to [s], by a faint band."""
    low, high = axes.get_xlim()
    for start, end in spans:
        if start < high and end > low:
            span = (max(start, low), min(end, high))
            axes.axvspan(*span, color=RED, alpha=0.08, linewidth=0, label="fault", zorder=0.4)


def legend(axes: Axes, beside: Axes | None = None) -> None:
    """Put the legend above the panel, where it hides nothing, if there is anything to tell.

    A label stands there once, and not at all if the legend of the panel beside has it.
    """
    told = set(beside.get_legend_handles_labels()[1]) if beside else set()
    first: dict[str, Any] = {}
    for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
        if label not in told:
            first.setdefault(label, handle)
    if not first:
        return
    labels = list(first)
    figure, grid = axes.get_figure(), axes.get_gridspec()
    assert isinstance(figure, Figure)
    assert grid is not None
    width = CHARACTERS * figure.get_figwidth() / grid.ncols
    axes.legend(
        list(first.values()),
        labels,
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=_columns(labels, width - (_OFFSET if _has_offset(axes) else 0)),
        frameon=False,
        fontsize=7.5,
        handlelength=1.6,
        columnspacing=0.9,
        handletextpad=0.4,
        borderaxespad=0.2,
    )


def _columns(labels: Sequence[str], width: float) -> int:
    """How many columns of a legend fit into so many characters, with as few rows as may be."""
    for rows in range(1, len(labels)):
        count = math.ceil(len(labels) / rows)
        columns = np.array_split(np.array([len(label) + 6 for label in labels]), count)
        if sum(column.max() for column in columns) <= width:
            return count
    return 1


def _has_offset(axes: Axes) -> bool:
    """Whether the ordinate's numbers have a common factor, which stands on the right on top."""
    largest = max(map(abs, axes.get_ylim()))
    few, many = STYLE["axes.formatter.limits"]
    return axes.get_yscale() == "linear" and not 10.0 ** (few + 1) <= largest < 10.0**many


def time_axis(axes: Axes, t: Array) -> None:
    """Label the time and show the whole run, unless the panel's time is set already.

    Of panels that share their time the lowest is labelled.
    """
    place = axes.get_subplotspec()
    assert place is not None
    if place.is_last_row() or len(axes.get_shared_x_axes().get_siblings(axes)) == 1:
        axes.set_xlabel("time [s]")
    if not axes.get_autoscalex_on():
        return
    axes.set_xlim(float(t[0]), float(t[-1]) if t[-1] > t[0] else float(t[0]) + 1.0)


def log_axis(axes: Axes, floor: float) -> None:
    """Make the ordinate logarithmic, from `floor` up: zero crossings reach no further down."""
    if not axes.dataLim.y1 > floor:  # nothing to see, and no range that follows from it
        axes.set_ylim(floor, 1.0)
    axes.set_yscale("log")
    axes.set_ylim(bottom=floor)


def in_degrees(unit: str) -> tuple[float, str]:
    """Factor and unit in which an angle or a rate is drawn: degrees throughout."""
    shown = {"rad": "deg", "rad/s": "deg/s", "rad/s²": "deg/s²"}.get(unit)
    return (1.0, unit) if shown is None else (float(np.rad2deg(1.0)), shown)


_UNDATED = {".png": {"Software": None}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}


def save(figure: Figure, path: Path) -> Path:
    """Write a figure, the same for the same run, as the path's suffix says: .png, .svg or .pdf.

    The folder is made if there is none. PNG has print resolution.
    """
    form = path.suffix
    with mpl.rc_context({"svg.hashsalt": "ppc_attitude"}), whole_file(path) as file:
        figure.savefig(file, format=form[1:], dpi=300, metadata=_UNDATED[form])
    return path


def save_all(drawn: Drawn, folder: Path, formats: Sequence[str] | None = None) -> list[Path]:
    """Write figures to a folder, which is made if there is none; files of these names are replaced.

    The formats are some of ``png``, ``svg`` and ``pdf``, by default PNG. Returns the files written.
    """
    return [
        save(figure, folder / f"{name}.{form}")
        for name, (_, figure) in drawn.items()
        for form in dict.fromkeys(formats or ("png",))
    ]
