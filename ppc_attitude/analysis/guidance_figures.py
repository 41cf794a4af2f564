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

"""The figures of guidance: sky map, slews over time, and the angles to the keep-out cones.

A function that draws one raises AnalysisError if the record lacks its data; then it is left out.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from itertools import cycle, islice
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ppc_attitude.analysis.drawing import (
    BLACK,
    BLUE,
    GREY,
    LIMIT_STYLE,
    LINE_WIDTH,
    ORANGE,
    RED,
    RUN_COLOURS,
    draw,
    legend,
    limit_lines,
    panels,
    time_axis,
)
from ppc_attitude.analysis.flight import (
    Flight,
    angles_to_cones,
    cone_names,
    flight_of,
    guidance_values,
    pointed,
)
from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.series import AnalysisError, samples, vectors, zero_ns
from ppc_attitude.analysis.truth import errors_of
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import REFERENCE_ACCELERATION, REFERENCE_ATTITUDE, REFERENCE_RATE
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guidance.cones import HALF_ANGLES
from ppc_attitude.science.guidance.scene import Cone
from ppc_attitude.science.keep_out import perpendicular
from ppc_attitude.science.stamps import seconds

Z_AXIS = (0.0, 0.0, 1.0)
_RIM = np.linspace(0.0, 2.0 * np.pi, 181)
_SHORT = (0.0, (2.0, 1.5))

Drawing = tuple[str, str, Callable[[Measured], Figure]]


def guidance_drawings(record: RunRecord) -> Iterator[Drawing]:
    """Name, caption and drawer of each figure of guidance; none if the run had none."""
    flight = None
    with suppress(ConfigurationError):  # the verdict says why nothing can be told of it
        flight = flight_of(record)
    if flight is None:
        return
    yield "slews", "Way to the goals: angle left, rate, acceleration", partial(slews, flight=flight)
    caption = "Sky: where body axes pointed, and where they must not"
    yield "sky_map", caption, partial(sky_map, flight=flight)
    caption = "Angle of body axes to the directions that they must keep away from"
    yield "cone_angles", caption, cone_angles


def slews(run: Measured, flight: Flight) -> Figure:
    """Draw the angle to the goal, and rate and acceleration of the desired motion in limits."""
    wanted = samples(run.record, REFERENCE_ATTITUDE.column)[flight.picked]
    craft = samples(run.record, run.truth.attitude)[flight.picked]
    figure, (left, rate, acceleration) = panels(3, share_x=True, row_height=1.5)
    t = run.t[flight.picked]
    for label, attitudes, colour in (("craft", craft, BLUE), ("desired", wanted, BLACK)):
        angles = np.rad2deg(errors_of(attitudes, flight.goals).angles)
        style: Any = "-" if label == "craft" else _SHORT
        draw(left, t, angles, label=label, colour=colour, style=style)
    left.set_ylabel("angle to the goal [deg]")
    left.set_ylim(bottom=0.0)
    for axes, topic, limits, label in (
        (rate, REFERENCE_RATE, flight.limits[:, 0], "rate [deg/s]"),
        (acceleration, REFERENCE_ACCELERATION, flight.limits[:, 1], "accel. [deg/s²]"),
    ):
        norm = np.rad2deg(np.linalg.norm(vectors(run.record, topic.column), axis=1))
        draw(axes, run.t, norm, label="desired, norm")
        limit_lines(axes, *np.rad2deg(np.unique(limits)), label="limit of a slew")
        axes.set_ylabel(f"desired {label}")
        axes.set_ylim(bottom=0.0)
    start = seconds(zero_ns(run.record))
    for axes in (left, rate, acceleration):
        _mark_orders(axes, flight, start)
        time_axis(axes, run.t)
    legend(left)
    legend(rate, beside=left)
    return figure


def _mark_orders(axes: Axes, flight: Flight, start: float) -> None:
    """Shade brakes and turns, and mark where something was ordered or warned of."""
    # A turn ends where the next one begins; a refusal or a warning ends none.
    ends = [np.inf]
    for word in flight.words[:0:-1]:
        ends.append(word.time if word.legs else ends[-1])
    for word, until in zip(flight.words, reversed(ends), strict=False):
        for leg in word.legs:
            if leg.begin < until:
                label, colour = ("turn", BLUE) if leg.turns else ("brake or timed profile", ORANGE)
                span = (leg.begin - start, min(leg.end, until) - start)
                axes.axvspan(*span, color=colour, alpha=0.12, linewidth=0, label=label)
        colour = RED if word.warning else GREY
        label = "refusal or warning" if word.warning else "order"
        axes.axvline(word.time - start, color=colour, linewidth=0.8, linestyle=":", label=label)


def sky_map(run: Measured, flight: Flight) -> Figure:
    """Draw the paths of body axes and the keep-out cones on the inertial sky."""
    figure, (axes,) = panels(1, row_height=2.4)
    axes_of_cones = (cone.axis for cones in flight.cones for cone in cones)
    bodies = list(dict.fromkeys(axes_of_cones)) or [Z_AXIS]
    wanted = samples(run.record, REFERENCE_ATTITUDE.column)[flight.picked]
    craft = samples(run.record, run.truth.attitude)[flight.picked]
    for body, colour in zip(bodies, islice(cycle(RUN_COLOURS), 1, None), strict=False):
        name = f"axis {' '.join(f'{x:.3g}' for x in body)}"
        for attitudes, style, who, width in (
            (craft, "-", "craft", LINE_WIDTH),
            (wanted, _SHORT, "desired", 2.0 * LINE_WIDTH),
        ):
            path = pointed(attitudes, body)
            _trace(axes, path, colour, style, width)
            _entry(axes, f"{who}, {name}", colour, style)
        x, y = _longitude_latitude(path[:1])[0]
        axes.scatter(x, y, s=14, color=colour, zorder=4)
    for i, name in enumerate(flight.names):
        seen = [cones[i] for cones in flight.cones if i < len(cones)]
        first, last = seen[0], seen[-1]
        _trace(axes, _rim(first), RED, "-", 0.8)
        # A cone that moves is drawn where it is at the end, too, with the way of its middle.
        if np.rad2deg(np.arccos(np.clip(np.dot(first.direction, last.direction), -1, 1))) > 0.5:
            _trace(axes, _rim(last), RED, LIMIT_STYLE, 0.8)
            middles = np.array([each.direction for each in seen])
            _trace(axes, middles, RED, ":", 0.8)
        x, y = _longitude_latitude(np.array([first.direction]))[0]
        x = min(max(x, -150.0), 150.0)  # the text stays on the map
        axes.text(x, y, f"{i}: {name}", color=RED, ha="center", fontsize=6, clip_on=True)
    if flight.names:
        _entry(axes, "keep-out cone", RED, "-")
    axes.set(xlim=(-180.0, 180.0), ylim=(-90.0, 90.0))
    axes.set(xlabel="right ascension [deg]", ylabel="declination [deg]")
    axes.set_xticks(range(-180, 181, 90))
    axes.set_yticks(range(-90, 91, 45))
    legend(axes)
    return figure


def cone_angles(run: Measured) -> Figure:
    """Draw the angle of each cone's body axis to its direction, of the craft and as desired.

    The cones are those with which the run began.
    """
    values = guidance_values(run.record)
    if values is None or not values[HALF_ANGLES.name]:
        raise AnalysisError(f"{run.record.source}: no keep-out cones")
    names, allowed = cone_names(values), np.rad2deg(values[HALF_ANGLES.name])
    figure, (axes,) = panels(1, row_height=2.2)
    for column, style, who in (
        (REFERENCE_ATTITUDE.column, _SHORT, "desired"),
        (run.truth.attitude, "-", "craft"),
    ):
        angles = np.rad2deg(angles_to_cones(run.record, column, values))
        for i, (name, colour) in enumerate(zip(names, cycle(RUN_COLOURS), strict=False)):
            label = f"{i}: {name}" if who == "craft" else ""
            draw(axes, run.t, angles[:, i], label=label, colour=colour, style=style)
            if who == "craft":
                limit = float(allowed[i])
                axes.axhline(limit, color=colour, linewidth=0.8, linestyle=LIMIT_STYLE, label="_")
    _entry(axes, "allowed", BLACK, LIMIT_STYLE)
    _entry(axes, "desired", BLACK, _SHORT)
    axes.set_ylabel("angle to the direction [deg]")
    axes.set_ylim(bottom=0.0)
    time_axis(axes, run.t)
    legend(axes)
    return figure


def _entry(axes: Axes, label: str, colour: str, style: Any) -> None:
    """Add an entry of the legend for what is drawn as a collection."""
    axes.plot([], [], color=colour, linestyle=style, linewidth=LINE_WIDTH, label=label)


def _longitude_latitude(directions: Array) -> Array:
    """Right ascension and declination [deg], shape (m, 2), of unit vectors, shape (m, 3)."""
    x, y, z = directions.T
    places: Array = np.column_stack([np.arctan2(y, x), np.arcsin(np.clip(z, -1.0, 1.0))])
    return np.asarray(np.rad2deg(places))


def _trace(axes: Axes, directions: Array, colour: str, style: Any, width: float) -> None:
    """Draw a path on the sky; it is cut where it leaves the map on one side."""
    places = _longitude_latitude(directions)
    jumps = np.flatnonzero(np.abs(np.diff(places[:, 0])) > 180.0) + 1
    pieces = [piece for piece in np.split(places, jumps) if len(piece) > 1]
    axes.add_collection(LineCollection(pieces, colors=colour, linestyles=[style], linewidths=width))


def _rim(cone: Cone) -> Array:
    """Edge of a cone on the sky, shape (m, 3)."""
    s = np.array(cone.direction)
    u = np.array(perpendicular(cone.direction))
    v = np.cross(s, u)
    across = np.outer(np.cos(_RIM), u) + np.outer(np.sin(_RIM), v)
    return np.asarray(np.cos(cone.half_angle) * s + np.sin(cone.half_angle) * across)
