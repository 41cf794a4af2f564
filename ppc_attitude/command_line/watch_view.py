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

"""The view of `ppc_attitude watch`: errors in their envelopes, rates, torques, health."""

import math
from collections.abc import Iterable, Sequence

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from ppc_attitude.contract.declared import ATTITUDE_ERROR, RATE_ERROR
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE,
    DISTURBANCE,
    TORQUE_COMMAND,
    Topic,
)
from ppc_attitude.nodes.onlooker import BOUNDED, Snapshot
from ppc_attitude.science.attitude import rotation_angle
from ppc_attitude.science.stamps import seconds

_AXES = "xyz"
# Word and style of each level of a DiagnosticStatus.
_LEVELS = (("OK", "green"), ("WARN", "yellow"), ("ERROR", "bold red"), ("STALE", "dim"))
_WELL = b"\x00"  # the level OK
_NEAR = 0.8  # part of an envelope from which its bar is yellow
_DEGREES, _MILLI = 180.0 / math.pi, 1e3
_ABSENT = "–"
_SHARE = "|error| / envelope"
_ELSEWHERE = ("time [s]",)  # a detail that the title shows


def view(snapshot: Snapshot, silent: float, brief: bool = False) -> RenderableType:
    """Draw a snapshot, a brief one without the numbers of nodes that are well.

    For `silent` seconds no new state has come.
    """
    parts: list[RenderableType] = [_errors(snapshot), _motion(snapshot)]
    if snapshot.health:
        parts.append(_health(snapshot, brief))
    return Panel(Group(*parts), title=_title(snapshot, silent), title_align="left", expand=False)


def _title(snapshot: Snapshot, silent: float) -> Text:
    state = snapshot.samples.get(ATTITUDE.name)
    if state is None:
        return Text("waiting for attitude", style="yellow")
    text = f"t = {seconds(state.stamp_ns):.2f} s"
    error = snapshot.samples.get(ATTITUDE_ERROR.name)
    if error is not None:
        x, y, z, w = error.values
        text += f"   attitude error {_DEGREES * rotation_angle((x, y, z, w)):.4g}°"
    if silent > 1.0:
        return Text(f"{text}   no new state for {silent:.0f} s", style="yellow")
    return Text(text, style="bold")


def _errors(snapshot: Snapshot) -> Table:
    table = _table("error", "", "envelope", _SHARE)
    for topic, bound in _bounded(snapshot):
        name = topic.column.removesuffix("_error").replace("_", " ")
        factor, unit = 1.0, topic.unit
        if unit.startswith("rad"):
            factor, unit = _DEGREES, unit.replace("rad", "°")
        errors = _numbers(snapshot, topic, factor)
        envelopes = _numbers(snapshot, bound, factor)
        axes = map(str, range(topic.width)) if topic.part else _AXES
        for axis, error, envelope in zip(axes, errors, envelopes, strict=False):
            told = name if unit == "1" else f"{name} [{unit}]"
            if bound.width > 1:
                told += f" {axis}"
            table.add_row(Text(told), *_inside(error, envelope))
    return table


def _bounded(snapshot: Snapshot) -> Iterable[tuple[Topic, Topic]]:
    """Errors to show, each with what bounds it in this run."""
    shown: dict[str, tuple[Topic, Topic]] = {}
    for topic, bound in BOUNDED:
        known = topic.name in snapshot.samples or topic in (ATTITUDE_ERROR, RATE_ERROR)
        if known and (topic.name not in shown or bound.name in snapshot.samples):
            shown[topic.name] = topic, bound
    return shown.values()


def _table(*names: str) -> Table:
    # Text, because rich takes a unit in brackets for its own markup.
    table = Table(box=None, pad_edge=False)
    for number, name in enumerate(names):
        table.add_column(Text(name), justify="right" if number and name != _SHARE else "left")
    return table


def _inside(error: float, envelope: float) -> tuple[str, str, RenderableType]:
    if math.isnan(error) or not envelope > 0.0:  # a law that has no attitude yet bounds nothing
        return _text(error), _text(envelope), ""
    normalised = abs(error) / envelope
    style = "green" if normalised < _NEAR else "yellow" if normalised <= 1.0 else "bold red"
    bar = Table.grid(padding=(0, 1))
    bar.add_row(
        ProgressBar(
            total=1.0,
            completed=min(normalised, 1.0),
            width=16,
            complete_style=style,
            finished_style=style,
        ),
        Text(
            f"{100.0 * normalised:3.0f} %" + (" outside" if normalised > 1.0 else ""), style=style
        ),
    )
    return _text(error), _text(envelope), bar


def _motion(snapshot: Snapshot) -> Table:
    columns = (
        ("rate [°/s]", _numbers(snapshot, ANGULAR_VELOCITY, _DEGREES)),
        ("torque [mN·m]", _numbers(snapshot, APPLIED_TORQUE, _MILLI)),
        ("commanded", _numbers(snapshot, TORQUE_COMMAND, _MILLI)),
        ("disturbance", _numbers(snapshot, DISTURBANCE, _MILLI)),
    )
    table = _table("axis", *(name for name, _ in columns))
    for i, axis in enumerate(_AXES):
        table.add_row(axis, *(_text(numbers[i]) for _, numbers in columns))
    return table


def _health(snapshot: Snapshot, brief: bool) -> Table:
    """Health of the nodes, first of those that are not well."""
    table = Table("node", "health", "", box=None, pad_edge=False)
    ranked = sorted(snapshot.health.items(), key=lambda each: (each[1].level == _WELL, each[0]))
    for name, (level, summary, details) in ranked:
        if brief and level == _WELL:
            details = {}
        word, style = _LEVELS[min(level[0], len(_LEVELS) - 1)]
        told = "  ".join(f"{key} {each}" for key, each in details.items() if key not in _ELSEWHERE)
        table.add_row(name, Text(f"{word} {summary}", style=style), Text(told))
    return table


def _numbers(snapshot: Snapshot, topic: Topic, factor: float = 1.0) -> Sequence[float]:
    sample = snapshot.samples.get(topic.name)
    if sample is None:
        return (math.nan,) * len(_AXES)
    return [factor * value for value in sample.values]


def _text(number: float) -> str:
    return _ABSENT if math.isnan(number) else f"{number:+.3e}"
