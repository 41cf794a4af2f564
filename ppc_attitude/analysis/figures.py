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


"""The figures of one run, each the counterpart of one in the paper."""

import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ppc_attitude.analysis.drawing import (
    AXIS_COLOURS,
    BLACK,
    BLUE,
    ENVELOPE_WIDTH,
    GREEN,
    RED,
    draw,
    in_degrees,
    judged_limit,
    legend,
    limit_lines,
    log_axis,
    mark_hits,
    panels,
    save,
    time_axis,
)
from ppc_attitude.analysis.envelopes import ATTITUDE, ENVELOPES, Envelope, envelopes_of
from ppc_attitude.analysis.filter_figures import (
    bias_figure,
    innovation_figure,
    knowledge_figure,
)
from ppc_attitude.analysis.guidance_figures import Drawing, guidance_drawings
from ppc_attitude.analysis.measure import Measured, known
from ppc_attitude.analysis.metrics import torque_limit
from ppc_attitude.analysis.requirements import DEGREES, PAPER, Requirements
from ppc_attitude.analysis.series import AnalysisError, has, lacking, vectors
from ppc_attitude.analysis.truth import (
    EXACT,
    knowledge_errors,
    reference_rates_in_body,
    truth_of,
)
from ppc_attitude.contract.declared import BY_COLUMN, UNSATURATED_TORQUE
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import (
    APPLIED_TORQUE,
    DISTURBANCE,
    REFERENCE_ATTITUDE,
    STANDARD,
)
from ppc_attitude.science.component import QUATERNION, VECTOR, WRENCH

AXES = ("x", "y", "z")
COLOURS = (*AXIS_COLOURS, BLACK)
ENVELOPE_LABEL = "envelope"
BELOW = 3e3  # how far below the least envelope a logarithmic panel reaches
ANGLE_FLOOR = 1e-4  # [deg] where the panel of angles ends
ZOOM_BEFORE, ZOOM_AFTER = 2.0, 12.0  # of a hit [s]


def pointing_figure(run: Measured) -> Figure:
    """Draw the angles of the attitude errors: pointing, and what it is made of if that differs.

    Raises
    ------
    AnalysisError
        If the record has no attitude or no reference.
    """
    if run.pointing is None:
        raise AnalysisError(f"{run.record.source}: {run.lacks_attitude}")
    window = _window(run)
    figure, rows = panels(1 if window is None else 2, row_height=2.1)
    shown = [row[0] for row in rows]
    look_closely(shown, window)
    kinds = [("pointing: truth against reference", run.pointing, BLACK)]
    if run.truth.standing != EXACT:
        for label, errors, colour in (
            ("control: told against reference", run.control, BLUE),
            ("knowledge: truth against told", known(knowledge_errors, run.record), RED),
        ):
            kinds += [(label, errors, colour)] if errors is not None else []
    for axes in shown:
        for label, errors, colour in kinds:
            draw(axes, run.t, np.rad2deg(errors.angles), label=label, colour=colour)
        _accuracy_limits(axes, run, DEGREES)
        log_axis(axes, ANGLE_FLOOR)
        axes.set_ylabel("attitude error, angle [deg]")
    _finish(shown, run)
    return figure


def error_figure(run: Measured, envelope: Envelope) -> Figure:
    """Draw the law's own error in its envelope: linear, logarithmic, and around a late hit.

    Raises
    ------
    AnalysisError
        If the record has no such error.
    """
    error, bound = vectors(run.record, envelope.error), None
    if has(run.record, envelope.bound):
        bound = vectors(run.record, envelope.bound)
    return _in_envelope(run, envelope, error, bound)


def attitude_figure(run: Measured) -> Figure:
    """Draw the pointing error of a law that has no envelope for it.

    Raises
    ------
    AnalysisError
        If the record has no attitude or no reference, or an envelope.
    """
    if run.pointing is None or has(run.record, ATTITUDE.bound):
        raise AnalysisError(f"{run.record.source}: {run.lacks_attitude or 'has an envelope'}")
    return _in_envelope(run, ATTITUDE, run.pointing.quaternions[:, :3], None)


def applied_torque_figure(run: Measured) -> Figure:
    """Draw the torque that the actuator gave, with its limits."""
    torque, limit = (
        vectors(run.record, APPLIED_TORQUE.column),
        torque_limit(run.record, run.required),
    )
    window = _window(run)
    figure, rows = panels(1 if window is None else 2, row_height=2.0)
    shown = [row[0] for row in rows]
    look_closely(shown, window)
    reach = 1.15 * max(limit, float(np.nanmax(np.abs(torque))))
    for axes in shown:
        _components(axes, run.t, torque)
        limit_lines(axes, limit, -limit, label=f"limit ±{limit:g} N·m")
        axes.set_ylabel("applied torque [N·m]")
        axes.set_ylim(-reach, reach)
    _finish(shown, run)
    return figure


def angular_velocity_figure(run: Measured) -> Figure:
    """Draw ω_s over the desired ω_d (dotted, body axes), and its norm under the limit."""
    if run.rate is None:
        raise AnalysisError(f"{run.record.source}: {run.lacks_rate}")
    figure, rows = panels(2, share_x=True)
    top, bottom = rows[0][0], rows[1][0]
    _components(top, run.t, run.rate)
    try:
        desired = np.rad2deg(reference_rates_in_body(run.record))
    except AnalysisError:
        desired = None  # a run without a reference still has its rate
    if desired is not None:
        for axis, colour, values in zip(AXES, AXIS_COLOURS, desired.T, strict=True):
            dots = (0, (1, 1.2))
            draw(top, run.t, values, colour=colour, style=dots, width=1.2, label=f"{axis} desired")
    draw(bottom, run.t, np.linalg.norm(run.rate, axis=1), label="norm")
    limit = run.required.rate
    if limit is not None and run.first_hit > 0.0:
        until = "" if run.first_hit > run.end else f", judged to {run.first_hit:g} s"
        judged_limit(bottom, run.t, run.calm, limit, label=f"limit {limit:g} deg/s{until}")
    bottom.set_ylim(bottom=0.0)
    top.set_ylabel("angular velocity [deg/s]")
    bottom.set_ylabel("its norm [deg/s]")
    _finish([top, bottom], run)
    return figure


def disturbance_figure(run: Measured) -> Figure:
    """Draw the external torque; with hits, the environment once more at its own scale."""
    torque = vectors(run.record, DISTURBANCE.column)
    figure, rows = panels(2 if run.hits else 1, row_height=1.9, share_x=True)
    shown = [row[0] for row in rows]
    for axes in shown:
        _components(axes, run.t, torque)
        axes.set_ylabel("external torque [N·m]")
    if run.hits:
        rest = np.ones(run.t.size, dtype=np.bool_)
        for hit in run.hits:
            rest &= (run.t < hit.start_s) | (run.t >= hit.start_s + hit.duration_s)
        reach = 1.2 * max(float(np.nanmax(np.abs(torque[rest]), initial=0.0)), 1e-4)
        shown[1].set_ylim(-reach, reach)
        shown[1].set_ylabel("external torque, enlarged [N·m]")
    _finish(shown, run)
    return figure


def transformed_errors_figure(run: Measured) -> Figure:
    """Draw each of the law's own errors over its envelope, which stays within ±1 inside it."""
    pairs = envelopes_of(run.record)
    if not pairs:
        raise AnalysisError(f"{run.record.source}: the record has no envelope")
    figure, rows = panels(len(pairs), share_x=True)
    shown = [row[0] for row in rows]
    for axes, envelope in zip(shown, pairs, strict=True):
        bound = vectors(run.record, envelope.bound)
        values = vectors(run.record, envelope.error)[:, : bound.shape[1]] / bound
        _components(axes, run.t, values)
        limit_lines(axes, 1.0, -1.0, label="envelope")
        label = f"{envelope.name} / envelope [1]"
        if np.nanmax(np.abs(values), initial=0.0) > 2.0:
            # A hit takes a rate error a hundred times beyond.
            axes.set_yscale("symlog", linthresh=1.0, linscale=2.0)
            label = f"{envelope.name} / envelope,\nlogarithmic beyond ±1 [1]"
        axes.set_ylabel(label)
    _finish(shown, run)
    return figure


def column_figure(run: Measured, column: str) -> Figure:
    """Draw a column of the record; what comes with some instants only, as points."""
    topic = BY_COLUMN[column]
    factor, unit = in_degrees(topic.unit)
    if not has(run.record, column):
        raise lacking(run.record, column)
    values = factor * run.record[column]
    figure, rows = panels(1, row_height=2.0)
    axes = rows[0][0]
    if topic.late:
        for axis, colour, component in zip(AXES, AXIS_COLOURS, values.T, strict=False):
            axes.plot(run.t, component, ".", color=colour, markersize=1.5, label=axis)
    else:
        _components(axes, run.t, values)
    axes.set_ylabel(f"{column.replace('_', ' ')} [{unit}]")
    _finish([axes], run)
    return figure


def _drawings(record: RunRecord) -> Iterator[Drawing]:
    """Name of a figure's file, caption, and who draws it."""
    yield "pointing_error", "Attitude error as an angle", pointing_figure
    yield "attitude_error", "Attitude error", attitude_figure
    for each in envelopes_of(record):
        caption = f"{each.name.capitalize()} in its envelope, as the law reports it"
        yield each.error, caption, partial(error_figure, envelope=each)
    yield "applied_torque", "Applied torque and its limits", applied_torque_figure
    yield "angular_velocity", "Angular velocity, desired and limit", angular_velocity_figure
    yield "disturbance", "External torque", disturbance_figure
    yield "transformed_errors", "Errors over envelopes", transformed_errors_figure
    yield "knowledge_error", "Knowledge error in the filter's own 3σ", knowledge_figure
    yield "innovation", "Innovation of each fix by its σ, and its square (NIS)", innovation_figure
    yield "gyro_bias", "Estimated bias of the gyro, with 3σ", bias_figure
    yield from guidance_drawings(record)
    drawn = {UNSATURATED_TORQUE.column, ATTITUDE.error, *(each.column for each in STANDARD)}
    drawn |= {"innovation", "gyro_bias", "gyro_bias_sigma"}
    drawn |= {column for each in ENVELOPES for column in (each.error, each.bound)}
    if not has(record, REFERENCE_ATTITUDE.column):
        drawn.remove(truth_of(record).attitude)  # where there is no error to draw
    for column, topic in BY_COLUMN.items():
        if column not in drawn and topic.form in (QUATERNION, VECTOR, WRENCH):
            caption = topic.meaning[:1].upper() + topic.meaning[1:]
            yield column, caption, partial(column_figure, column=column)


def figures_of(record: RunRecord, required: Requirements = PAPER) -> dict[str, tuple[str, Figure]]:
    """Draw every figure for which the record has the data.

    Parameters
    ----------
    record : RunRecord
        The run.
    required : Requirements
        Whose limits are drawn, each over the part of the run that is judged.

    Returns
    -------
    dict of str to (str, Figure)
        Name of a figure's file to caption and figure.

    Raises
    ------
    AnalysisError
        If the record has no instant, or nothing at all to draw.
    """
    run = Measured(record, required)
    drawn = {}
    for name, caption, draw_figure in _drawings(record):
        try:
            drawn[name] = caption, draw_figure(run)
        except AnalysisError:
            continue  # a controller without envelope or θ has no such figure
    if not drawn:
        raise AnalysisError(f"{record.source}: the record has nothing to draw")
    return drawn


def save_figures(
    record: RunRecord,
    folder: Path,
    required: Requirements = PAPER,
    formats: Sequence[str] = ("png",),
) -> list[Path]:
    """Draw every figure for which the record has the data and save each.

    Parameters
    ----------
    record : RunRecord
        The run.
    folder : Path
        Where to; made if there is none. Figures of the same name are replaced.
    required : Requirements
        Whose limits are drawn.
    formats : sequence of str
        Some of `drawing.FORMATS`.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    AnalysisError
        If the record has no instant, or nothing at all to draw.
    """
    return [
        save(figure, folder / f"{name}.{form}")
        for name, (_, figure) in figures_of(record, required).items()
        for form in formats
    ]


def zoom_window(t: Array, hits: Sequence[float], deadline: float) -> tuple[float, float] | None:
    """Time to look at closely [s]: around the first hit from the settling deadline on.

    Earlier ones are plain to see in the large error of the approach. None if there is none.
    """
    late = [start for start in hits if start >= deadline]
    if not late:
        return None
    return max(late[0] - ZOOM_BEFORE, float(t[0])), min(late[0] + ZOOM_AFTER, float(t[-1]))


def _window(run: Measured) -> tuple[float, float] | None:
    hits = [hit.start_s for hit in run.hits]
    return zoom_window(run.t, hits, run.required.settling_deadline)


def look_closely(shown: Sequence[Axes], window: tuple[float, float] | None) -> None:
    """Restrict the last panel to the window, if there is one, before anything is drawn."""
    if window is not None:
        shown[-1].set_xlim(*window)


def symbols(text: str) -> str:
    """Write the symbols of a declaration, such as q_e, as mathematics."""
    return re.sub(r"\b(\w)_(\w+)\b", r"$\1_{\2}$", text)


def log_floor(least: float) -> float:
    """Where a logarithmic panel ends, from the least envelope: zero crossings reach no lower."""
    return float(10.0 ** np.floor(np.log10(max(least, 1e-12) / BELOW)))


def fit(axes: Axes, window: tuple[float, float], t: Array, shown: Sequence[Array]) -> None:
    """Make the ordinate just large enough for what the arrays, shape (n, …), do in the window."""
    inside = (t >= window[0]) & (t <= window[1])
    largest = max(float(np.nanmax(np.abs(each[inside]), initial=0.0)) for each in shown)
    if largest > 0.0:
        axes.set_ylim(-1.1 * largest, 1.1 * largest)


def draw_envelope(
    axes: Axes, t: Array, envelope: Array, colours: Sequence[str], *, mirrored: bool = True
) -> None:
    """Draw envelopes, shape (n, k), dashed in the colours of their errors.

    The dashes of several take turns, so that envelopes that coincide still show every colour;
    a single one is dotted, as the paper has it. The legend tells the dashes, in black, for all.
    """
    count = len(colours)
    for k, colour in enumerate(colours):
        dashes = (0.0, (1.0, 1.5)) if count == 1 else (3.0 * k, (3.0, 3.0 * (count - 1)))
        name = f"_{ENVELOPE_LABEL} {AXES[k]}" if count > 1 else f"_{ENVELOPE_LABEL}"
        told: dict[str, Any] = {"colour": colour, "width": ENVELOPE_WIDTH, "style": dashes}
        draw(axes, t, envelope[:, k], label=name, **told)
        if mirrored:
            draw(axes, t, -envelope[:, k], **told)
    if ENVELOPE_LABEL not in axes.get_legend_handles_labels()[1]:
        style = (0.0, (1.0, 1.5)) if count == 1 else "--"
        axes.plot([], [], color=BLACK, linewidth=0.8, linestyle=style, label=ENVELOPE_LABEL)


def _in_envelope(run: Measured, envelope: Envelope, error: Array, bound: Array | None) -> Figure:
    """Draw an error, shape (n, 3), in its envelope, if it has one."""
    factor, unit = in_degrees(envelope.unit)
    error, bound = factor * error, None if bound is None else factor * bound
    window = _window(run)
    figure, rows = panels(2 if window is None else 3)
    shown = [row[0] for row in rows]
    look_closely(shown, window)
    # A hit throws a rate error a thousand times beyond its envelope.
    scales = ("linear", "log", "log" if envelope.jumps else "linear")
    for axes, scale in zip(shown, scales, strict=False):
        magnitude = scale == "log"
        _components(axes, run.t, np.abs(error) if magnitude else error)
        if bound is not None:
            colours = AXIS_COLOURS[: bound.shape[1]]
            draw_envelope(axes, run.t, bound, colours, mirrored=not magnitude)
        title = symbols(envelope.title)
        axes.set_ylabel(f"|{title}| [{unit}]" if magnitude else f"{title} [{unit}]")
        if magnitude:
            least = np.nanmin(bound) if bound is not None else np.nanmax(np.abs(error))
            log_axis(axes, log_floor(float(least)))
    if not envelope.jumps:
        _accuracy_limits(shown[1], run, "")
    _finish(shown, run)
    if window is not None and not envelope.jumps:
        fit(shown[2], window, run.t, [error] if bound is None else [error, bound])
    return figure


def _accuracy_limits(axes: Axes, run: Measured, unit: str) -> None:
    """Draw the required accuracies that are given in this unit, where they are judged."""
    for name, accuracy, judged, colour in (
        ("settled", run.required.settled, run.settled, BLACK),
        ("terminal", run.required.terminal, run.last & (run.end >= run.terminal_from), GREEN),
    ):
        if accuracy is not None and accuracy.unit == unit and judged.any():
            label = f"{name} < {accuracy}"
            judged_limit(axes, run.t, judged, accuracy.limit, label=label, colour=colour)


def _components(axes: Axes, t: Array, values: Array) -> None:
    """Draw the components, shape (n, up to 4)."""
    for axis, colour, component in zip((*AXES, "w"), COLOURS, values.T, strict=False):
        draw(axes, t, component, label=axis, colour=colour)


def _finish(shown: Sequence[Axes], run: Measured) -> None:
    """Label time and marks; a panel has a legend if it says more than the first panel's."""
    for axes in shown:
        time_axis(axes, run.t)
        mark_hits(axes, [hit.start_s for hit in run.hits])
    for axes in shown[:-1]:
        if axes.get_shared_x_axes().joined(axes, shown[-1]):
            axes.set_xlabel("")
    _, told = shown[0].get_legend_handles_labels()
    legend(shown[0])
    for axes in shown[1:]:
        _, labels = axes.get_legend_handles_labels()
        if set(labels) - set(told):
            legend(axes, told)
