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

"""The figures of one run, each the counterpart of one in the paper.

A function that draws one raises AnalysisError if the record lacks its data; then it is left out.
"""

from collections.abc import Iterator
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from ppc_attitude.analysis.drawing import (
    AXIS_COLOURS,
    BLACK,
    BLUE,
    ENVELOPE_WIDTH,
    LIMIT_STYLE,
    RED,
    Drawn,
    dots,
    draw,
    in_degrees,
    judged_limit,
    limit_lines,
    log_axis,
    panels,
)
from ppc_attitude.analysis.envelopes import ATTITUDE, Envelope, declared, envelopes_of
from ppc_attitude.analysis.filter_health import ATTITUDE_VARIANCES, GATE, gate_of, sigmas_of
from ppc_attitude.analysis.guidance_figures import Drawing, guidance_drawings
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.requirements import DEGREES
from ppc_attitude.analysis.run_panels import (
    AXES,
    COLOURS,
    accuracy_limits,
    components,
    draw_envelope,
    finish,
    fit,
    log_floor,
    panels_of,
    points,
    symbols,
)
from ppc_attitude.analysis.series import AnalysisError, has, known, samples, vectors
from ppc_attitude.analysis.truth import (
    EXACT,
    RECORDED,
    knowledge_errors,
    pointing_errors,
    reference_rates_in_body,
    truth_of,
)
from ppc_attitude.contract.declared import BY_COLUMN, UNSATURATED_TORQUE
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import (
    APPLIED_TORQUE,
    DISTURBANCE,
    ESTIMATOR,
    REFERENCE_ATTITUDE,
    STANDARD,
    TORQUE_COMMAND,
)
from ppc_attitude.science.component import JOINTS, QUATERNION, VECTOR, WRENCH
from ppc_attitude.science.stamps import instant

_DRAWN = (QUATERNION, VECTOR, WRENCH, *JOINTS)  # forms of columns with a figure of their own
ANGLE_FLOOR = 1e-4  # [deg] where the panel of angles ends
ARCSEC = float(np.rad2deg(3600.0))
BAND = 3.0  # σ


def pointing_figure(run: Measured) -> Figure:
    """Draw the angles of the attitude errors: pointing, and what it is made of if that differs."""
    pointing, exact = pointing_errors(run.record), run.truth.standing == EXACT
    figure, shown, _ = panels_of(run, 1, row_height=2.1)
    for axes in shown:
        for label, errors, colour in (
            ("control: estimate against reference", None if exact else run.control, BLUE),
            ("knowledge: truth against estimate", None if exact else run.knowledge, RED),
            ("pointing: truth against reference", pointing, BLACK),  # over the others
        ):
            if errors is not None:
                draw(axes, run.t, np.rad2deg(errors.angles), label=label, colour=colour)
        accuracy_limits(axes, run, DEGREES)
        log_axis(axes, ANGLE_FLOOR)
        axes.set_ylabel("attitude error, angle [deg]")
    finish(shown, run)
    return figure


def error_figure(run: Measured, envelope: Envelope) -> Figure:
    """Draw the law's own error in its envelope: linear, logarithmic, and around a late hit."""
    error, bound = (vectors(run.record, each) for each in (envelope.error, envelope.bound))
    return _in_envelope(run, envelope, error, bound)


def attitude_figure(run: Measured) -> Figure:
    """Draw the pointing error, unless it is the law's own error, which is drawn in its envelope."""
    if ATTITUDE.error in envelopes_of(run.record) and run.truth.standing != RECORDED:
        raise AnalysisError(f"{run.record.source}: has an envelope")
    return _in_envelope(run, ATTITUDE, pointing_errors(run.record).quaternions[:, :3], None)


def applied_torque_figure(run: Measured) -> Figure:
    """Draw the torque that the actuator gave, with its limits."""
    torque, limits = vectors(run.record, APPLIED_TORQUE.column), run.torque_limits
    figure, shown, _ = panels_of(run, 1, row_height=2.0)
    reach = 1.15 * max(limits.max(), float(np.nanmax(np.abs(torque))))
    label = f"limit ±{', '.join(f'{limit:g}' for limit in dict.fromkeys(limits.tolist()))} N·m"
    for axes in shown:
        components(axes, run.t, torque)
        for level, told in ((limits, label), (-limits, "_")):
            draw(axes, run.t, level, width=0.8, style=LIMIT_STYLE, label=told)
        axes.set_ylabel("applied torque [N·m]")
        axes.set_ylim(-reach, reach)
    finish(shown, run)
    return figure


def angular_velocity_figure(run: Measured) -> Figure:
    """Draw ω_s over the desired ω_d (dotted, body axes), and its norm under the limit."""
    if run.lacks_rate:
        raise AnalysisError(f"{run.record.source}: {run.lacks_rate}")
    figure, (top, bottom) = panels(2, share_x=True)
    components(top, run.t, run.rate)
    desired = known(reference_rates_in_body, run.record)
    if desired is not None:  # a run without a reference still has its rate
        for axis, colour, values in zip(AXES, AXIS_COLOURS, np.rad2deg(desired).T, strict=True):
            dots = (0, (1, 1.2))
            draw(top, run.t, values, colour=colour, style=dots, width=1.2, label=f"{axis} desired")
    draw(bottom, run.t, np.linalg.norm(run.rate, axis=1), label="norm")
    limit = run.required.rate
    if limit is not None and run.first_hit > 0.0:
        until = "" if run.first_hit > run.end else f", judged to {instant(run.first_hit)} s"
        judged_limit(bottom, run.t, run.calm, limit, label=f"limit {limit:g} deg/s{until}")
    bottom.set_ylim(bottom=0.0)
    top.set_ylabel("angular velocity [deg/s]")
    bottom.set_ylabel("its norm [deg/s]")
    finish([top, bottom], run)
    return figure


def disturbance_figure(run: Measured) -> Figure:
    """Draw the external torque; with hits, any environment once more at its own scale."""
    torque = vectors(run.record, DISTURBANCE.column)
    rest = np.ones(run.t.size, dtype=np.bool_)
    for hit in run.hits:
        rest &= (run.t < hit.start_s) | (run.t >= hit.start_s + hit.duration_s)
    reach = 1.2 * float(np.nanmax(np.abs(torque[rest]), initial=0.0))
    enlarged = run.hits and reach > 0.0
    figure, shown = panels(2 if enlarged else 1, row_height=1.9, share_x=True)
    for axes in shown:
        components(axes, run.t, torque)
        axes.set_ylabel("external torque [N·m]")
    if enlarged:
        shown[1].set_ylim(-reach, reach)
        shown[1].set_ylabel("external torque, enlarged [N·m]")
    finish(shown, run)
    return figure


def transformed_errors_figure(run: Measured) -> Figure:
    """Draw each of the law's own errors over its envelope, which stays within ±1 inside it."""
    pairs = envelopes_of(run.record).values()
    if not pairs:
        raise AnalysisError(f"{run.record.source}: the record has no envelope")
    figure, shown = panels(len(pairs), share_x=True)
    for axes, envelope in zip(shown, pairs, strict=True):
        bound = vectors(run.record, envelope.bound)
        values = vectors(run.record, envelope.error)[:, : bound.shape[1]]
        values = np.divide(values, bound, out=np.full_like(bound, np.nan), where=bound != 0.0)
        components(axes, run.t, values, envelope.parts)
        limit_lines(axes, 1.0, -1.0, label="envelope")
        label = f"{envelope.name} / envelope [1]"
        if np.nanmax(np.abs(values), initial=0.0) > 2.0:
            # A hit takes a rate error a hundred times beyond.
            axes.set_yscale("symlog", linthresh=1.0, linscale=2.0)
            label = f"{envelope.name} / envelope,\nlogarithmic beyond ±1 [1]"
        axes.set_ylabel(label)
    finish(shown, run)
    return figure


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
    dots(bottom, run.t, np.square(values).sum(axis=1), label="NIS", colour=BLACK)
    gate = gate_of(run.record)
    if gate is not None and not run.changed(ESTIMATOR, GATE):
        limit_lines(bottom, gate, label=f"gate {gate:g}")
    bottom.set_yscale("log")
    top.set_ylabel("innovation / σ [1]")
    bottom.set_ylabel("NIS [1]")
    for axes in (top, bottom):
        finish([axes], run)
    return figure


def column_figure(run: Measured, column: str) -> Figure:
    """Draw a column of the record; as points if it has samples at some instants only."""
    topic = BY_COLUMN[column]
    factor, unit = (1.0, topic.unit) if topic.form in JOINTS else in_degrees(topic.unit)
    values = factor * samples(run.record, column)
    figure, (axes,) = panels(1, row_height=2.0)
    if topic.late:
        points(axes, run.t, values)
    elif topic.form in JOINTS:
        last = max(np.flatnonzero(values.any(axis=0)), default=0)  # no part is behind it
        components(axes, run.t, values[:, : last + 1], topic.parts)
    else:
        components(axes, run.t, values)
    if column in run.required.limits:
        limit = factor * run.required.limits[column]
        levels = (limit, -limit) if np.nanmin(values) < 0.0 else (limit,)
        limit_lines(axes, *levels, label="required")
    axes.set_ylabel(f"{column.replace('_', ' ')} [{unit}]")
    finish([axes], run)
    return figure


def _drawings(record: RunRecord) -> Iterator[Drawing]:
    """Name of a figure's file, caption, and the function that draws it."""
    yield "pointing_error", "Attitude error as an angle", pointing_figure
    own = ATTITUDE.error in envelopes_of(record)  # the law's own, in its envelope, has that name
    name, caption = ("true_attitude_error", "True a") if own else ("attitude_error", "A")
    yield name, f"{caption}ttitude error", attitude_figure
    for each in envelopes_of(record).values():
        who = BY_COLUMN[each.error].source
        caption = f"{each.name.capitalize()} in its envelope, as {who} reports it"
        yield each.error, caption, partial(error_figure, envelope=each)
    yield "applied_torque", "Applied torque and its limits", applied_torque_figure
    yield "angular_velocity", "Angular velocity, desired and limit", angular_velocity_figure
    yield "disturbance", "External torque", disturbance_figure
    yield "transformed_errors", "Errors over envelopes", transformed_errors_figure
    yield "knowledge_error", "Knowledge error in the filter's own 3σ", knowledge_figure
    yield "innovation", "Innovation of each fix by its σ, and its square (NIS)", innovation_figure
    yield "gyro_bias", "Estimated bias of the gyro, with 3σ", bias_figure
    yield from guidance_drawings(record)
    drawn = {UNSATURATED_TORQUE.column, ATTITUDE.error, "gyro_bias_sigma"}
    drawn |= {each.column for each in STANDARD}
    drawn |= {column for each in declared(record).values() for column in (each.error, each.bound)}
    if not has(record, REFERENCE_ATTITUDE.column):
        drawn.remove(truth_of(record).attitude)  # where there is no error to draw
    if not has(record, APPLIED_TORQUE.column):
        drawn.remove(TORQUE_COMMAND.column)  # a plant that is not ours may tell no other torque
    for column, topic in BY_COLUMN.items():
        if column not in drawn and topic.form in _DRAWN:
            caption = topic.meaning[:1].upper() + topic.meaning[1:]
            yield column, caption, partial(column_figure, column=column)


def figures_of(run: Measured) -> Drawn:
    """Draw every figure for which the record of a run has the data.

    What is required is drawn over the part of the run that is judged.

    Raises
    ------
    AnalysisError
        If the record has nothing at all to draw.
    """
    drawn: Drawn = {}
    for name, caption, draw_figure in _drawings(run.record):
        if name in drawn:
            continue  # a column that has a figure of its own
        try:
            drawn[name] = caption, draw_figure(run)
        except AnalysisError:
            continue  # a controller without envelope or θ has no such figure
    if not drawn:
        raise AnalysisError(f"{run.record.source}: the record has nothing to draw")
    return drawn


def _in_envelope(run: Measured, envelope: Envelope, error: Array, bound: Array | None) -> Figure:
    """Draw an error, shape (n, 3), in its envelope, if it has one."""
    factor, unit = in_degrees(envelope.unit)
    error, bound = factor * error, None if bound is None else factor * bound
    figure, shown, window = panels_of(run, 2)
    # A hit throws a rate error a thousand times beyond its envelope.
    scales = ("linear", "log", "log" if envelope.jumps else "linear")
    for axes, scale in zip(shown, scales, strict=False):
        magnitude = scale == "log"
        components(axes, run.t, np.abs(error) if magnitude else error, envelope.parts)
        if bound is not None:
            colours, names = COLOURS[: bound.shape[1]], envelope.parts or AXES
            draw_envelope(axes, run.t, bound, colours, names, mirrored=not magnitude)
        title = symbols(envelope.title)
        axes.set_ylabel(f"|{title}| [{unit}]" if magnitude else f"{title} [{unit}]")
        if magnitude:
            seen = np.nanmax(np.abs(error), keepdims=True) if bound is None else bound
            log_axis(axes, log_floor(seen))
    if envelope.error == ATTITUDE.error and (bound is None or run.truth.standing != RECORDED):
        accuracy_limits(shown[1], run, "")
    finish(shown, run)
    if window is not None and not envelope.jumps:
        fit(shown[2], window, [(run.t, each) for each in (error, bound) if each is not None])
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
