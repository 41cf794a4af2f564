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

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ppc_attitude.analysis.drawing import (
    AXIS_COLOURS,
    BLACK,
    ENVELOPE_WIDTH,
    draw,
    legend,
    limit_lines,
    log_axis,
    mark_hits,
    panels,
    save,
    time_axis,
)
from ppc_attitude.analysis.metrics import (
    RATE_LIMIT_DEG,
    SETTLED,
    SETTLING_DEADLINE,
    TERMINAL_LIMIT,
    pulses_of,
    torque_limit,
)
from ppc_attitude.analysis.series import (
    AnalysisError,
    attitude_errors,
    elapsed,
    has,
    reference_rates_in_body,
    vectors,
)
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE_ENVELOPE,
    AUXILIARY_STATE,
    DISTURBANCE,
    RATE_ENVELOPE,
    RATE_ERROR,
)

AXES = ("x", "y", "z")
ATTITUDE_FLOOR, RATE_FLOOR = 1e-6, 1e-8  # where the logarithmic panels end
ZOOM_BEFORE, ZOOM_AFTER = 2.0, 12.0  # of a hit [s]


def attitude_error_figure(record: RunRecord) -> Figure:
    """Draw q_ev in its envelope ±ρ_q: linear, logarithmic, and around a late hit.

    Raises
    ------
    AnalysisError
        If the record has no attitude error.
    """
    figure = _in_envelope(
        record,
        attitude_errors(record),
        _optional(record, ATTITUDE_ENVELOPE.column),
        ("q_{ev}", r"\rho_q", " [1]"),
        ATTITUDE_FLOOR,
        closely="linear",
    )
    limit_lines(figure.axes[1], SETTLED, TERMINAL_LIMIT)
    for level, name in ((SETTLED, "settled"), (TERMINAL_LIMIT, "terminal")):
        figure.axes[1].annotate(
            f"{name} {level:g}",
            (0.01, level),
            xycoords=("axes fraction", "data"),
            xytext=(4, 2),
            textcoords="offset points",
            fontsize=6.5,
        )
    return figure


def rate_error_figure(record: RunRecord) -> Figure:
    """Draw z2 in its envelope ±ρ_ω: linear, logarithmic, and around a late hit.

    Raises
    ------
    AnalysisError
        If the record has no rate error.
    """
    return _in_envelope(
        record,
        vectors(record, RATE_ERROR.column),
        _optional(record, RATE_ENVELOPE.column),
        ("z_2", r"\rho_\omega", " [rad/s]"),
        RATE_FLOOR,
        closely="log",  # a hit is a thousand times the envelope
    )


def applied_torque_figure(record: RunRecord) -> Figure:
    """Draw the torque that the actuator gave, with its limits."""
    t, torque, limit = elapsed(record), vectors(record, APPLIED_TORQUE.column), torque_limit(record)
    window = zoom_window(t, _hits(record))
    figure, rows = panels(1 if window is None else 2, row_height=2.0)
    shown = [row[0] for row in rows]
    look_closely(shown, window)
    reach = 1.15 * max(limit, float(np.nanmax(np.abs(torque))))
    for axes in shown:
        _components(axes, t, torque, r"\tau")
        limit_lines(axes, limit, -limit, label="limit")
        axes.set_ylabel("applied torque [N·m]")
        axes.set_ylim(-reach, reach)
    _finish(shown, record)
    return figure


def angular_velocity_figure(record: RunRecord) -> Figure:
    """Draw ω_s over the desired ω_d (dotted, body axes), and its norm under the limit."""
    t, rate = elapsed(record), np.rad2deg(vectors(record, ANGULAR_VELOCITY.column))
    figure, rows = panels(2, share_x=True)
    top, bottom = rows[0][0], rows[1][0]
    _components(top, t, rate, r"\omega_s")
    try:
        desired = np.rad2deg(reference_rates_in_body(record))
    except AnalysisError:
        desired = None  # a run without a reference still has its rate
    if desired is not None:
        for k, colour in enumerate(AXIS_COLOURS):
            label = r"$C_e\omega_d$" if k == 0 else ""
            draw(top, t, desired[:, k], colour=colour, style=(0, (1, 1.2)), width=1.2, label=label)
    draw(bottom, t, np.linalg.norm(rate, axis=1), label=r"$\|\omega_s\|$")
    limit_lines(bottom, RATE_LIMIT_DEG, label=f"limit {RATE_LIMIT_DEG:g} deg/s")
    bottom.set_ylim(bottom=0.0)
    top.set_ylabel("angular velocity [deg/s]")
    bottom.set_ylabel("its norm [deg/s]")
    _finish([top, bottom], record)
    return figure


def disturbance_figure(record: RunRecord) -> Figure:
    """Draw the external torque; with hits, the environment once more at its own scale."""
    t, torque = elapsed(record), vectors(record, DISTURBANCE.column)
    hits = pulses_of(record)
    figure, rows = panels(2 if hits else 1, row_height=1.9, share_x=True)
    shown = [row[0] for row in rows]
    for axes in shown:
        _components(axes, t, torque, "d")
        axes.set_ylabel("external torque [N·m]")
    if hits:
        rest = _without_hits(record, t, torque)
        reach = 1.2 * max(float(np.nanmax(np.abs(rest), initial=0.0)), 1e-4)
        shown[1].set_ylim(-reach, reach)
        shown[1].set_ylabel("the same, enlarged [N·m]")
    _finish(shown, record)
    return figure


def transformed_errors_figure(record: RunRecord) -> Figure:
    """Draw ε_q = q_ev/ρ_q and ε_ω = z2/ρ_ω, which stay within ±1 inside the envelopes."""
    t = elapsed(record)
    pairs = []
    if has(record, ATTITUDE_ENVELOPE.column):
        envelope = vectors(record, ATTITUDE_ENVELOPE.column)
        pairs.append((attitude_errors(record) / envelope, r"\varepsilon_q"))
    if has(record, RATE_ENVELOPE.column) and has(record, RATE_ERROR.column):
        envelope = vectors(record, RATE_ENVELOPE.column)
        pairs.append((vectors(record, RATE_ERROR.column) / envelope, r"\varepsilon_\omega"))
    if not pairs:
        raise AnalysisError(f"{record.source}: the record has no envelope")
    figure, rows = panels(len(pairs), share_x=True)
    shown = [row[0] for row in rows]
    for axes, (values, symbol) in zip(shown, pairs, strict=True):
        _components(axes, t, values, symbol)
        limit_lines(axes, 1.0, -1.0, label="envelope")
        axes.set_ylabel(f"${symbol}$ [1]")
        if np.nanmax(np.abs(values), initial=0.0) > 2.0:
            # A hit takes z2 a hundred times beyond: logarithmic outside the envelope.
            axes.set_yscale("symlog", linthresh=1.0, linscale=2.0)
    _finish(shown, record)
    return figure


def auxiliary_state_figure(record: RunRecord) -> Figure:
    """Draw θ, the state that answers for saturation."""
    t, theta = elapsed(record), vectors(record, AUXILIARY_STATE.column)
    figure, rows = panels(1, row_height=2.0)
    axes = rows[0][0]
    _components(axes, t, theta, r"\theta")
    axes.set_ylabel(r"auxiliary state $\theta$ [1]")
    _finish([axes], record)
    return figure


FIGURES: dict[str, tuple[str, Callable[[RunRecord], Figure]]] = {
    "attitude_error": ("Attitude error in its envelope", attitude_error_figure),
    "rate_error": ("Rate error in its envelope", rate_error_figure),
    "applied_torque": ("Applied torque and its limits", applied_torque_figure),
    "angular_velocity": ("Angular velocity, desired and limit", angular_velocity_figure),
    "disturbance": ("External torque", disturbance_figure),
    "transformed_errors": ("Errors over envelopes", transformed_errors_figure),
    "auxiliary_state": ("Anti-saturation state", auxiliary_state_figure),
}
"""Name of a figure's file to its caption and who draws it."""


def figures_of(record: RunRecord) -> dict[str, Figure]:
    """Draw every figure for which the record has the data.

    Parameters
    ----------
    record : RunRecord
        The run.

    Returns
    -------
    dict of str to Figure
        By the names of `FIGURES`, in that order.

    Raises
    ------
    AnalysisError
        If the record has no instant, or nothing at all to draw.
    """
    elapsed(record)
    drawn = {}
    for name, (_, draw_figure) in FIGURES.items():
        try:
            drawn[name] = draw_figure(record)
        except AnalysisError:
            continue  # a controller without envelope or θ has no such figure
    if not drawn:
        raise AnalysisError(f"{record.source}: the record has nothing to draw")
    return drawn


def save_figures(record: RunRecord, folder: Path) -> list[Path]:
    """Draw every figure for which the record has the data and save each as PNG.

    Parameters
    ----------
    record : RunRecord
        The run.
    folder : Path
        Where to; made if there is none. Figures of the same name are replaced.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    AnalysisError
        If the record has no instant, or nothing at all to draw.
    """
    return [save(figure, folder, name) for name, figure in figures_of(record).items()]


def zoom_window(t: Array, hits: Sequence[float]) -> tuple[float, float] | None:
    """Time to look at closely [s]: around the first hit from the settling deadline on.

    Earlier ones are plain to see in the large error of the approach. None if there is none.
    """
    late = [start for start in hits if start >= SETTLING_DEADLINE]
    if not late:
        return None
    return max(late[0] - ZOOM_BEFORE, float(t[0])), min(late[0] + ZOOM_AFTER, float(t[-1]))


def look_closely(shown: Sequence[Axes], window: tuple[float, float] | None) -> None:
    """Restrict the last panel to the window, if there is one, before anything is drawn."""
    if window is not None:
        shown[-1].set_xlim(*window)


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
    a single one is dotted, as the paper has it.
    """
    count = len(colours)
    for k, colour in enumerate(colours):
        dashes = (0.0, (1.0, 1.5)) if count == 1 else (3.0 * k, (3.0, 3.0 * (count - 1)))
        for sign in (1.0, -1.0) if mirrored else (1.0,):
            draw(axes, t, sign * envelope[:, k], colour=colour, width=ENVELOPE_WIDTH, style=dashes)


def _in_envelope(
    record: RunRecord,
    error: Array,
    envelope: Array | None,
    names: tuple[str, str, str],
    floor: float,
    *,
    closely: str,
) -> Figure:
    """Draw an error in its envelope; `names` are their symbols and the unit.

    `closely` is the scale, ``linear`` or ``log``, on which a late hit is shown.
    """
    t = elapsed(record)
    symbol, bound, unit = names
    window = zoom_window(t, _hits(record))
    figure, rows = panels(2 if window is None else 3)
    shown = [row[0] for row in rows]
    look_closely(shown, window)
    scales = ("linear", "log", closely)
    for axes, scale in zip(shown, scales, strict=False):
        magnitude = scale == "log"
        _components(axes, t, np.abs(error) if magnitude else error, symbol)
        if envelope is not None:
            draw_envelope(axes, t, envelope, AXIS_COLOURS, mirrored=not magnitude)
        axes.set_ylabel(f"$|{symbol}|${unit}" if magnitude else f"${symbol}${unit}")
        if magnitude:
            log_axis(axes, floor)
    if envelope is not None:
        shown[0].plot([], [], color=BLACK, linewidth=0.8, linestyle="--", label=rf"$\pm{bound}$")
    _finish(shown, record)
    if window is not None and closely == "linear":
        fit(shown[2], window, t, [error] if envelope is None else [error, envelope])
    return figure


def _components(axes: Axes, t: Array, values: Array, symbol: str) -> None:
    """Draw the three components, shape (n, 3)."""
    base, _, index = symbol.partition("_")
    inner = index.strip("{}")
    for k, (axis, colour) in enumerate(zip(AXES, AXIS_COLOURS, strict=True)):
        subscript = f"{inner},{axis}" if inner else axis
        draw(axes, t, values[:, k], label=rf"${base}_{{{subscript}}}$", colour=colour)


def _finish(shown: Sequence[Axes], record: RunRecord) -> None:
    """Label time and marks; a panel has a legend if it says more than the first panel's."""
    t, hits = elapsed(record), _hits(record)
    for axes in shown:
        time_axis(axes, t)
        mark_hits(axes, hits)
    for axes in shown[:-1]:
        if axes.get_shared_x_axes().joined(axes, shown[-1]):
            axes.set_xlabel("")
    _, told = shown[0].get_legend_handles_labels()
    for axes in shown:
        _, labels = axes.get_legend_handles_labels()
        if axes is shown[0] or set(labels) - set(told):
            legend(axes)


def _hits(record: RunRecord) -> list[float]:
    """Find when the sudden disturbances start [s]."""
    return [hit.start_s for hit in pulses_of(record)]


def _without_hits(record: RunRecord, t: Array, torque: Array) -> Array:
    """Pick the external torque where no sudden disturbance acts, shape (m, 3)."""
    rest = np.ones(t.size, dtype=np.bool_)
    for hit in pulses_of(record):
        rest &= (t < hit.start_s) | (t >= hit.start_s + hit.duration_s)
    return torque[rest]


def _optional(record: RunRecord, column: str) -> Array | None:
    return vectors(record, column) if has(record, column) else None
