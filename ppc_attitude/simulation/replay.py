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

from ppc_attitude.contract.declared import BY_COLUMN, is_told_the_truth, not_installed
from ppc_attitude.contract.parameters import PARAMETERS
from ppc_attitude.contract.run_record import Array, Change, RunRecord
from ppc_attitude.contract.topics import CONTROLLER, ENABLED, HOSTED, NODE_OF, PLANT
from ppc_attitude.science.component import Column, Component
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.given import rules_of, take_all
from ppc_attitude.science.kinds import CONTROLLERS, KINDS, PLANTS, SENSORS, Kind
from ppc_attitude.science.parameter import Value, resolved
from ppc_attitude.science.part import Part
from ppc_attitude.science.sensors.star_tracker import RATE, TOLERANCE, Slots, check_slots
from ppc_attitude.science.signals import ENVIRONMENT_TORQUE, TOLD, TORQUE_COMMAND, TRUTH
from ppc_attitude.science.stamps import LARGEST_STEP, LATEST, instant, seconds
from ppc_attitude.simulation.closed_loop import by_column
from ppc_attitude.simulation.diagram import play


@dataclass(frozen=True)
class Difference:
    """The result of the replay of one component."""

    component: str  # its name
    column: str  # the column that differs most, in its unit; the component's first if none does
    largest: float  # |recorded − computed| of a number of that column; infinite if it gives NaN
    at: float  # when that was [s]
    steps: int  # instants that were computed again
    skipped: int  # instants without a recorded input or output

    @property
    def unit(self) -> str:
        """Unit of the difference."""
        return BY_COLUMN[self.column].unit


@dataclass(frozen=True)
class Replay:
    """The result of a replay."""

    law: Difference | None  # of the control law, in its torque command; None: it is not installed
    others: tuple[Difference, ...]  # of other components whose inputs and outputs are on record
    missing: tuple[str, ...]  # selections and parameters on record that nothing installed knows
    left_out: tuple[str, ...]  # components that were not replayed, each with the reason

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
    others, left_out = _others(record)
    left_out += tuple(
        f"{change.value}: {change.node} was started again with it at "
        f"{instant(seconds(change.stamp_ns))} s"
        for kind in KINDS
        for change in _swapped(record, kind)
    )
    if record.controller not in CONTROLLERS.components:
        if not others:
            why = "the parameters of its nodes, which rosbags-convert drops, are not in it"
            if record.parameters:
                known = ", ".join(CONTROLLERS.components)
                why = f"controller {record.controller!r} is not one of {known}"
            raise ConfigurationError(f"{record.source} cannot be replayed: {why}")
        unknown = f"{CONTROLLERS.selector} = {record.controller}"
        missing = tuple(dict.fromkeys((unknown, *_missing(record))))
        return Replay(None, others, missing, left_out)
    if CONTROLLER not in record.parameters:
        raise ConfigurationError(f"{record.source} has no parameters of {CONTROLLER}")
    law = CONTROLLERS.components[record.controller]
    try:
        of_law = _replayed(record, CONTROLLERS, law, (TORQUE_COMMAND,))
    except ConfigurationError as error:
        raise ConfigurationError(f"{record.source}: {error}") from None
    return Replay(of_law, others, tuple(_missing(record)), left_out)


def _others(record: RunRecord) -> tuple[tuple[Difference, ...], tuple[str, ...]]:
    """Replay components besides the law, as far as all is on record; name the others with why."""
    replayed, left_out = [], []
    for node, kinds in HOSTED.items():
        for kind in kinds:
            component = kind.selected(record.parameters.get(node, {}))
            if node not in record.parameters or component is None or kind is CONTROLLERS:
                continue
            compared = list(component.outputs)
            # The torque of an environment of ours is on record only in the sum of disturbances.
            if ENVIRONMENT_TORQUE in compared and ENVIRONMENT_TORQUE.name not in record:
                compared.remove(ENVIRONMENT_TORQUE)
            if ENVIRONMENT_TORQUE in component.inputs or not compared:
                continue
            try:
                replayed.append(_replayed(record, kind, component, compared))
            except ConfigurationError as error:  # a bag may lack what the component reads
                left_out.append(f"{component.name}: {error}")
    return tuple(replayed), tuple(left_out)


def _swapped(record: RunRecord, kind: Kind) -> Iterator[Change]:
    """Yield the changes that select another component of a kind."""
    for change in record.changes:
        if (change.node, change.name) == (NODE_OF[kind.name], kind.selector):
            yield change


def _see_that_it_can_be_played(
    record: RunRecord, kind: Kind, component: Component, compared: Sequence[Column]
) -> None:
    """Raise ConfigurationError if a component cannot run: a bag may lack what it reads."""
    columns = _columns(record)
    # What comes late may never have come.
    needed = (each for each in (*component.inputs, *compared) if not each.late)
    if absent := [each.topic for each in needed if each.name not in columns]:
        raise ConfigurationError(f"no messages of {', '.join(absent)}")
    if not component.inputs and (last := seconds(int(record.stamps_ns[-1]))) > LATEST:
        raise ConfigurationError(  # it may integrate from zero to the stamp
            f"stamps go on to {instant(last)} s; allowed: up to {LATEST:g} s from the run's begin"
        )
    waits = record.parameters.get(PLANT, {}).get("lockstep", False)
    if NODE_OF[kind.name] == PLANT and kind is not SENSORS and not waits:
        raise ConfigurationError(
            "the plant ran free (lockstep = false): no stamp tells which inputs a step had"
        )
    check_slots(component)
    for column in component.inputs:
        if column.late and _is_astray(record, _sent(record, column), NODE_OF[kind.name]):
            raise ConfigurationError(
                f"{column.topic} came at other times than parameters of {NODE_OF[kind.name]} say"
            )


def _sent(record: RunRecord, column: Column) -> Array:
    """Samples of a late column, which is on no record if none of it came."""
    none = np.full((record.stamps_ns.size, column.width - 1), np.nan)
    return record.columns.get(column.name, none)


def _is_astray(record: RunRecord, rows: Array, node: str) -> bool:
    """Whether a late column has a sample where none is due: nothing tells when it arrived."""
    slots = Slots(record.parameters[node])
    came = record.stamps_ns[np.isfinite(rows).any(axis=1)]
    return not all(map(slots.has, came.tolist()))


def _missing(record: RunRecord) -> Iterator[str]:
    """Yield what the parameters of a record name that is not installed."""
    yield from not_installed(record.parameters)
    for node in HOSTED:
        values = record.parameters.get(node, {})
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
    """Run one component over the instants that have all it reads and all that is compared.

    They end where its node, started again, runs another one.
    """
    _see_that_it_can_be_played(record, kind, component, compared)
    values = record.parameters[NODE_OF[kind.name]]
    read = _read(record, component, values)
    if kind is PLANTS:
        # A plant reads what was given at the instant before.
        read = np.hstack([np.zeros((len(read), 1)), read[:, :-1]])
    columns = _columns(record)
    complete = np.isfinite(read).all(axis=0)
    for change in _swapped(record, kind):
        complete &= record.stamps_ns < change.stamp_ns
    for column in compared:
        if not column.late:
            complete &= np.isfinite(columns[column.name]).all(axis=1)
    if not complete.any():
        raise ConfigurationError("no instant has all inputs and all outputs on record")
    stamps = record.stamps_ns[complete]
    samples = _computed(record, kind, component, stamps, read[:, complete], compared)
    name, largest, k = compared[0].name, 0.0, 0
    for given, computed in by_column(compared, stamps, samples).items():
        recorded = columns.get(given, np.full((complete.size, 1), np.nan))[complete]
        difference = np.abs(recorded - computed)
        unknown = np.isnan(difference)
        if BY_COLUMN[given].late:
            # Nobody can tell a late message that was never sent from one that is missing. One that
            # is on record came at some instant: if none was skipped it should be computed.
            difference[unknown] = 0.0
            unknown &= np.isfinite(recorded) & bool(complete.all())
            for place in np.flatnonzero(unknown.any(axis=1)):
                unknown[place] &= not _came_elsewhere(record, kind, component, int(stamps[place]))
        difference[unknown] = np.inf
        difference = difference.max(axis=1)
        worst = int(np.argmax(difference))
        if difference[worst] > largest:
            name, largest, k = given, float(difference[worst]), worst
    if largest and (lacking := sorted(component.defaults.keys() - values.keys())):
        raise ConfigurationError(  # as with a record of another version of it
            f"{name} differs by up to {largest:.3g}, with the defaults of {', '.join(lacking)}, "
            "because the record has no allowed value of them"
        )
    return Difference(
        component.name,
        name,
        largest,
        seconds(int(stamps[k])),
        int(stamps.size),
        int(complete.size - stamps.size),
    )


def _came_elsewhere(record: RunRecord, kind: Kind, component: Component, valid_ns: int) -> bool:
    """Whether a late message [ns] is of no instant that is computed again.

    That is one after the end of the record, or one at which the node was killed amid its answer,
    and whose answer is that of its successor.
    """
    if RATE.name not in component.defaults:
        return False
    node, stamps = NODE_OF[kind.name], record.stamps_ns
    slots = Slots(record.parameters[node])
    begun = [each.stamp_ns for each in record.changes if (each.node, each.name) == (node, ENABLED)]
    places = [stamps.size, *np.searchsorted(stamps, begun).tolist()]
    return any(
        not slots.arrived(valid_ns, int(stamps[place - 1]))
        and (place == stamps.size or slots.arrived(valid_ns, int(stamps[place])))
        for place in places
        if place
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
    # The motion at an instant comes from the step before it: a change acts on the next one.
    side: Literal["left", "right"] = "right" if kind in (PLANTS, SENSORS) else "left"
    own = [change for change in record.changes if change.node == node]
    starts = np.searchsorted(stamps, [change.stamp_ns for change in own], side).tolist()
    # A node takes a leap of the stamps for time that begins anew; not so the plant, their source.
    leaps = np.flatnonzero((np.diff(stamps) > LARGEST_STEP) & (node != PLANT)) + 1
    events = [*zip(starts, own, strict=True), *((leap, None) for leap in leaps.tolist())]
    pieces, begin, enabled = [], 0, True

    def played(end: int | None = None) -> Array:
        outputs = play(part, stamps[begin:end], read[:, begin:end], compared)
        return outputs if enabled else np.zeros_like(outputs)

    # Changes of one instant are made together, because only together they need be feasible.
    for start, group in groupby(sorted(events, key=itemgetter(0)), itemgetter(0)):
        pieces.append(played(start))
        begin = start
        changed = {change.name: change.value for _, change in group if change}
        values.update(changed)
        part.configure(_installed(node, values))
        enabled = changed.get(ENABLED, enabled)
        # The part begins anew there; so does one that depends on time alone, which has no past.
        if ENABLED in changed or start in leaps or (not component.inputs and node != PLANT):
            part.forget()
    pieces.append(played())
    return np.concatenate(pieces, axis=1)


def _read(record: RunRecord, component: Component, values: Mapping[str, Any]) -> Array:
    """Return a row for each number that a component reads, a column for each instant."""
    columns, stamps = _columns(record), record.stamps_ns
    if not component.inputs:
        return np.zeros((0, stamps.size))
    rows = [
        _arrived(each, _sent(record, each), stamps.tolist(), values)
        if each.late
        else columns[each.name]
        for each in component.inputs
    ]
    read = np.ascontiguousarray(np.hstack(rows))
    take_all(read, rules_of(component.inputs))
    return np.ascontiguousarray(read.T)


def _arrived(column: Column, rows: Array, stamps: list[int], values: Mapping[str, Any]) -> Array:
    """Rows of a late column as they arrived, with their age [s], by the estimator's parameters.

    A record has them at the instants to which they belong. A row is zero where none was due, and
    NaN where one was due of an instant that is not on record. If the instant is on record, but not
    its message, nothing tells what the estimator heard, which is an error except at the record's
    last instant: there a bag that was cut may lack any.
    """
    slots, last = Slots(values), None
    found = np.zeros((len(stamps), rows.shape[1] + 1))
    for k, stamp in enumerate(stamps):
        slot = slots.due(last, stamp)
        last = stamp
        if slot is not None:
            place = bisect_left(stamps, slot - TOLERANCE)
            valid = stamps[place]
            if valid > slot + TOLERANCE:
                found[k] = np.nan
            elif np.isnan(rows[place]).any() and stamp < stamps[-1]:
                raise ConfigurationError(
                    f"no message of {column.topic} at {instant(seconds(valid))} s, where one was "
                    "due"
                )
            else:
                found[k] = *rows[place], seconds(stamp - valid)
    return found
