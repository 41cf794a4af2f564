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

"""Replay: the recorded inputs of a run through the steps of its components once more."""

from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.declared import BY_COLUMN, is_told_the_truth
from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import CONTROLLER, ENABLED, HOSTED, NODE_OF, PLANT
from ppc_attitude.science.component import Column, Component
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kinds import ACTUATORS, CONTROLLERS, NONE, PLANTS, SENSORS, Kind
from ppc_attitude.science.parameter import Value, resolved
from ppc_attitude.science.part import Part
from ppc_attitude.science.sensors.arrivals import TOLERANCE, Slots
from ppc_attitude.science.signals import ENVIRONMENT_TORQUE, TOLD, TORQUE_COMMAND, TRUTH
from ppc_attitude.science.stamps import seconds
from ppc_attitude.simulation.diagram import play


@dataclass(frozen=True)
class Difference:
    """The result of the replay of one component.

    Attributes
    ----------
    component : str
        Its name.
    column : str
        The column that differs most, in its unit; the component's first one if none does.
    largest : float
        Largest |recorded − computed| of a number of that column.
    at : float
        When that was [s].
    steps : int
        Instants that were computed again.
    skipped : int
        Instants without a recorded input or output.
    """

    component: str
    column: str
    largest: float
    at: float
    steps: int
    skipped: int

    @property
    def unit(self) -> str:
        """Unit of the difference."""
        return BY_COLUMN[self.column].unit


@dataclass(frozen=True)
class Replay:
    """The result of a replay.

    Attributes
    ----------
    law : Difference or None
        Of the control law, in its torque command; None if it is not installed.
    others : tuple of Difference
        Of every other component whose inputs and outputs are on record.
    missing : tuple of str
        Selections and parameters on record that nothing installed knows.
    """

    law: Difference | None
    others: tuple[Difference, ...]
    missing: tuple[str, ...]

    @property
    def found(self) -> tuple[Difference, ...]:
        """Result of each component, that of the law first."""
        return self.others if self.law is None else (self.law, *self.others)


def replay(record: RunRecord) -> Replay:
    """Feed the recorded inputs to the run's components and compare what they give.

    Raises
    ------
    ConfigurationError
        The record names no known law and nothing else can be replayed, or it has no parameters for
        the law, or lacks an input of it.
    """
    if record.controller not in CONTROLLERS.components:
        if others := tuple(_others(record)):
            unknown = f"{CONTROLLERS.selector} = {record.controller}"
            return Replay(None, others, tuple(dict.fromkeys((unknown, *_missing(record)))))
        raise ConfigurationError(
            f"{record.source}: controller {record.controller!r} is not one of "
            f"{', '.join(CONTROLLERS.components)}: it cannot be replayed"
        )
    if CONTROLLER not in record.parameters:
        raise ConfigurationError(f"{record.source}: the parameters of {CONTROLLER} are not in it")
    law = CONTROLLERS.components[record.controller]
    absent = [c.topic for c in (*law.inputs, TORQUE_COMMAND) if c.name not in record]
    if absent:
        raise ConfigurationError(f"{record.source}: no messages of {', '.join(absent)}")
    of_law = _replayed(record, CONTROLLERS, law, (TORQUE_COMMAND,))
    return Replay(of_law, tuple(_others(record)), tuple(_missing(record)))


def _others(record: RunRecord) -> Iterator[Difference]:
    """Replay the components, besides the law, whose inputs and outputs are all on record.

    A plant that runs free holds what has arrived by then, which the stamps do not tell: only its
    sensors are replayed.
    """
    lockstep = record.parameters.get(PLANT, {}).get("lockstep", False)
    left_out = (CONTROLLERS,) if lockstep else (CONTROLLERS, PLANTS, ACTUATORS)
    columns = _columns(record)
    for node, kinds in HOSTED.items():
        for kind in kinds:
            component = kind.selected(record.parameters.get(node, {}))
            if node not in record.parameters or component is None or kind in left_out:
                continue
            # The torque of an environment is on record in the sum with what is injected only.
            compared = [each for each in component.outputs if each != ENVIRONMENT_TORQUE]
            needed = [*component.inputs, *compared]
            if compared and all(each.name in columns for each in needed):
                yield _replayed(record, kind, component, compared)


def _missing(record: RunRecord) -> Iterator[str]:
    """Yield what the parameters of a record name that is not installed."""
    for node, kinds in HOSTED.items():
        values = record.parameters.get(node, {})
        for kind in kinds:
            name = values.get(kind.selector, NONE)
            if name != NONE and kind.selected(values) is None:
                yield f"{kind.selector} = {name}"
        yield from sorted(values.keys() - {each.name for each in PARAMETERS[node]})


def _installed(node: str, values: Mapping[str, Any]) -> dict[str, Value]:
    """Complete parameters of a node, without those of what is not installed."""
    absent = {kind.selector for kind in HOSTED[node] if kind.selected(values) is None}
    known = {each.name for each in PARAMETERS[node]} - absent
    chosen = {name: value for name, value in values.items() if name in known}
    return resolved(PARAMETERS[node], chosen, node)


def _columns(record: RunRecord) -> Mapping[str, Array]:
    """Columns of a record; where sensing is exact, what was told is the truth."""
    columns = dict(record.columns)
    if is_told_the_truth(record.parameters.get(PLANT, {})):
        for truth, told in zip(TRUTH, TOLD, strict=True):
            if told.name in columns:
                columns.setdefault(truth.name, columns[told.name])
    return columns


def _replayed(
    record: RunRecord, kind: Kind, component: Component, compared: Sequence[Column]
) -> Difference:
    """Run one component over the instants that have all it reads and all that is compared."""
    values = record.parameters[NODE_OF[kind.name]]
    read = _table(record, component.inputs, values)
    if kind is PLANTS:
        # A plant reads what was given at the instant before.
        read = np.hstack([np.zeros((len(read), 1)), read[:, :-1]])
    recorded = _table(record, compared, values)
    names = [column.name for column in compared for _ in range(column.width)]
    # Nobody can tell a late message that was never sent from one that is missing.
    prompt = [not column.late for column in compared for _ in range(column.width)]
    complete = np.isfinite(read).all(axis=0) & np.isfinite(recorded[prompt]).all(axis=0)
    if not complete.any():
        raise ConfigurationError(f"{record.source}: no instant has all inputs and a command")
    stamps = record.stamps_ns[complete]
    computed = _computed(record, kind, component, stamps, read[:, complete], compared)
    difference = np.nan_to_num(np.abs(recorded[:, complete] - computed))
    row, k = np.unravel_index(int(np.argmax(difference)), difference.shape)
    return Difference(
        component.name,
        names[row],
        float(difference[row, k]),
        seconds(int(stamps[k])),
        int(stamps.size),
        int(complete.size - stamps.size),
    )


def _computed(
    record: RunRecord,
    kind: Kind,
    component: Component,
    stamps: NDArray[np.int64],
    read: Array,
    compared: Sequence[Column],
) -> Array:
    """Run a component over the stamps, with the parameters that it had at each."""
    node = NODE_OF[kind.name]
    values = dict(record.parameters[node])
    part = Part(component, _installed(node, values))
    # The state of an instant comes from before it: the motion takes a change over at the next.
    side: Literal["left", "right"] = "right" if kind in (PLANTS, SENSORS) else "left"
    own = [change for change in record.changes if change.node == node]
    starts = np.searchsorted(stamps, [change.stamp_ns for change in own], side).tolist()
    pieces, begin, enabled = [], 0, True

    def played(end: int | None = None) -> Array:
        outputs = play(part, stamps[begin:end], read[:, begin:end], compared)
        return outputs if enabled else np.zeros_like(outputs)

    # What changed at one instant fits together only as a whole.
    for start, group in groupby(zip(starts, own, strict=True), itemgetter(0)):
        pieces.append(played(start))
        begin = start
        changed = {change.name: change.value for _, change in group}
        values.update(changed)
        part.configure(_installed(node, values))
        enabled = changed.get(ENABLED, enabled)
        if ENABLED in changed:  # it begins anew
            part.forget()
    pieces.append(played())
    return np.concatenate(pieces, axis=1)


def _table(
    record: RunRecord, wanted: Sequence[Column], values: Mapping[str, Any]
) -> NDArray[np.float64]:
    """Return a row for each number of the wanted columns, a column for each instant.

    Parameters
    ----------
    record : RunRecord
        The run.
    wanted : sequence of Column
        What of it.
    values : mapping of str to value
        Parameters of the node that reads or gives the columns.
    """
    columns = _columns(record)
    rows: list[Any] = [
        (_arrived(columns[each.name], record, values) if each.late else columns[each.name]).T
        for each in wanted
    ]
    return np.ascontiguousarray(np.vstack(rows)) if rows else np.zeros((0, record.stamps_ns.size))


def _arrived(rows: Array, record: RunRecord, values: Mapping[str, Any]) -> Array:
    """Rows of a late column as they arrived, with their age [s].

    A record has them at the instants to which they belong. A row is zero where none was due, and
    NaN where one was due that is not on record.
    """
    slots, last = Slots(values), None
    stamps = record.stamps_ns.tolist()
    found = np.zeros((len(stamps), rows.shape[1] + 1))
    for k, stamp in enumerate(stamps):
        slot = slots.due(last, stamp)
        last = stamp
        if slot is not None:
            place = bisect_left(stamps, slot - TOLERANCE)
            valid = stamps[place]
            row = rows[place] if valid <= slot + TOLERANCE else np.nan
            found[k, :-1] = row
            found[k, -1] = seconds(stamp - valid) if np.isfinite(row).all() else np.nan
    return found
