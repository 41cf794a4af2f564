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

"""The block diagram of a scenario: its components, wired by the columns they declare.

Every component has its records of inputs and outputs in one array of signals. At each instant the
components run in the order of `KINDS`: what a component reads is copied from where it was given,
then its step is called. A plant reads what was given at the instant before, since the torques act
from stamp to stamp.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.declared import columns_of
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.topics import HOSTED, NODE_OF
from ppc_attitude.science.compiled_stamps import seconds
from ppc_attitude.science.component import Column, Component
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import call_step, kernel
from ppc_attitude.science.kinds import KINDS, PLANTS, Kind, given_twice, not_given
from ppc_attitude.science.parameter import NodeParameters
from ppc_attitude.science.part import Part, signals_of

_BLOCK = 256  # [instants] whose samples a core's own cache holds
_APART = 8  # [instants] between rows of a block, which else would share few places of the cache
_INSTANT = 2  # numbers before the columns in a component's record of inputs


@kernel
def run_parts(
    parts: Any,
    instants: Any,
    first_source: Any,
    sources: Any,
    played: Any,
    timetable: Any,
    recorded: Any,
    stamps_ns: Any,
    signals: Any,
    samples: Any,
    whole: Any,
) -> None:
    """Run the parts over the stamps [ns] and write a sample of every recorded number.

    Parameters
    ----------
    parts : ndarray of uint64, shape (p, 5)
        Addresses of each part: step, inputs, state, configuration, outputs.
    instants : ndarray of uint64, shape (p,)
        Place in `signals` of each part's inputs, which begin with the instant.
    first_source : ndarray of uint64, shape (p + 1,)
        First place in `sources` of each part.
    sources : ndarray of uint64, shape (w,)
        From which place in `signals` each number comes that a part reads.
    played : ndarray of uint64, shape (m,)
        Places that are filled from the timetable.
    timetable : ndarray, shape (n, m)
        What was computed or recorded before, the numbers of an instant side by side.
    recorded : ndarray of uint64, shape (r,)
        Places whose numbers are written to `samples`, each to a row.
    stamps_ns : ndarray of int64, shape (n,)
        Instants [ns].
    signals : ndarray
        The records of all parts.
    samples : ndarray, shape (≥ r, n)
        Where to write.
    whole : ndarray of bool, shape (r,)
        Becomes False for a row that gets a number that is not finite.
    """
    # Places are unsigned: of each signed one Numba would check whether it counts from the end.
    # The numbers of some instants go to `samples` together: one by one, each number would touch
    # another page of memory at every instant.
    stamps = signals.view(np.int64)  # the same memory
    block = np.empty((recorded.size, _BLOCK + _APART))
    first = 0  # instant whose numbers are the block's first
    for k in range(stamps_ns.size):
        t = seconds(stamps_ns[k])
        for each in range(played.size):
            signals[played[each]] = timetable[k, each]
        for p in range(parts.shape[0]):
            place = instants[p]
            stamps[place] = stamps_ns[k]
            signals[place + np.uint64(1)] = t
            place += np.uint64(_INSTANT)
            for source in range(first_source[p], first_source[p + 1]):
                signals[place] = signals[sources[source]]
                place += np.uint64(1)
            call_step(parts[p, 0], parts[p, 1], parts[p, 2], parts[p, 3], parts[p, 4])
        place = np.uint64(k - first)
        for each in range(recorded.size):
            block[each, place] = signals[recorded[each]]
        if k + 1 - first == _BLOCK or k + 1 == stamps_ns.size:
            for each in range(recorded.size):
                row = samples[each, first : k + 1]
                numbers = block[each]
                finite = True
                for i in range(row.size):
                    row[i] = numbers[i]
                    finite &= abs(numbers[i]) < np.inf
                whole[each] &= finite
            first = k + 1


def selected(parameters: NodeParameters) -> list[tuple[Kind, Component]]:
    """Components that the parameters of all nodes select, in the order of an instant."""
    chosen = [(kind, kind.selected(parameters.get(NODE_OF[kind.name], {}))) for kind in KINDS]
    return [(kind, component) for kind, component in chosen if component is not None]


def recorded_columns(parameters: NodeParameters) -> tuple[Column, ...]:
    """Columns that a run puts on record, in the order of an instant."""
    columns = {
        column.name: column
        for node in HOSTED
        for column in columns_of(node, parameters.get(node, {}))
    }
    names = [column.name for _, component in selected(parameters) for column in component.outputs]
    return tuple(columns[name] for name in names if name in columns)


class Diagram:
    """The components that a scenario selects, wired and ready to run.

    Parameters
    ----------
    parameters : mapping of str to mapping
        Complete parameters of every node.
    ahead : bool, optional
        True for a diagram of only the components that depend on time alone.
    timetable : ndarray, optional
        Samples of such a diagram: then these components do not run again.

    Raises
    ------
    ConfigurationError
        A parameter is infeasible, or the selected components do not fit together.
    """

    def __init__(
        self, parameters: NodeParameters, ahead: bool = False, timetable: Array | None = None
    ) -> None:
        chosen = self._selected = selected(parameters)
        if ahead:
            chosen = [(kind, component) for kind, component in chosen if not component.inputs]
        sizes = [signals_of(component) for _, component in chosen]
        starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self._signals = np.zeros(starts[-1])
        self._places = _places(chosen, starts)
        self._timetable = np.zeros((0, 0)) if timetable is None else timetable.T.copy()
        played: list[int] = []
        instants, first_source, sources = [], [0], []
        self.parts: dict[str, Part] = {}
        self._values: dict[str, Mapping[str, Any]] = {}
        for (kind, component), start, size in zip(chosen, starts, sizes, strict=False):
            if timetable is not None and not component.inputs:
                played += self._places_of(component.outputs)
                continue
            values = self._values[kind.name] = parameters.get(NODE_OF[kind.name], {})
            signals = self._signals[start : start + size]
            with _naming(kind.name):
                self.parts[kind.name] = Part(component, values, signals)
            sources += self._sources_of(kind, component, int(start))
            first_source.append(len(sources))
            instants.append(int(start))
        self._instants, self._first_source, self._sources, self._played = (
            np.array(each, np.uint64) for each in (instants, first_source, sources, played)
        )
        self._record(
            tuple(column for _, component in chosen for column in component.outputs)
            if ahead
            else recorded_columns(parameters)
        )

    def restart(self, parameters: NodeParameters) -> None:
        """Begin anew, with other parameters of the same components.

        Raises
        ------
        ConfigurationError
            A parameter is infeasible, or other components are selected.
        """
        if (now := selected(parameters)) != self._selected:
            names, own = (
                ", ".join(component.name for _, component in each) for each in (now, self._selected)
            )
            raise ConfigurationError(f"components {names}; allowed in this loop: {own}")
        for kind, part in self.parts.items():
            part.forget()
            values = parameters.get(NODE_OF[kind], {})
            if values != self._values[kind]:
                with _naming(kind):
                    part.configure(values)
                self._values[kind] = values
        self._record(recorded_columns(parameters))

    def _record(self, columns: tuple[Column, ...]) -> None:
        """Arrange what goes on record: a row of the table for each number."""
        self.columns = columns
        self._first_rows = list(accumulate((each.width for each in columns[:-1]), initial=0))
        self._recorded = np.array(self._places_of(columns), np.uint64)

    whole: frozenset[str] = frozenset()
    """Columns that were finite throughout in the last run."""

    @property
    def rows(self) -> dict[str, slice]:
        """Where the numbers of each column on record are among the rows of the samples."""
        starts = zip(self.columns, self._first_rows, strict=True)
        return {each.name: slice(start, start + each.width) for each, start in starts}

    def snapshot(self) -> list[NDArray[Any]]:
        """Copy all that a run changes, so that a run can go on from here again (`put_back`)."""
        return [each.copy() for each in self._changing]

    def put_back(self, snapshot: Sequence[NDArray[Any]]) -> None:
        """Let the next run go on from where a snapshot was taken."""
        for each, was in zip(self._changing, snapshot, strict=True):
            each[:] = was

    @property
    def _changing(self) -> list[NDArray[Any]]:
        return [self._signals, *(part.state for part in self.parts.values())]

    def _places_of(self, columns: Sequence[Column]) -> list[int]:
        """Place in the signals of every number of some columns."""
        return [self._places[column.name] + k for column in columns for k in range(column.width)]

    def _sources_of(self, kind: Kind, component: Component, start: int) -> list[int]:
        """Place in the signals from which each number comes that a component reads."""
        for column in component.inputs:
            place = self._places.get(column.name)
            if place is None:
                raise ConfigurationError(
                    f"{kind.selector} = {component.name} reads {not_given(column)}"
                )
            if place > start and kind is not PLANTS:
                raise ConfigurationError(
                    f"{kind.selector} = {component.name} reads {column.name}, which is computed "
                    "later in the step; allowed: columns that are computed before it; a plant can "
                    "give such a column's value of the step before as a column of its own"
                )
        return self._places_of(component.inputs)

    def run(self, stamps_ns: NDArray[np.int64], samples: Array | None = None) -> Array:
        """Run over the stamps [ns].

        Parameters
        ----------
        stamps_ns : ndarray of int64, shape (n,)
            Instants [ns].
        samples : ndarray, shape (≥ r, n), optional
            Where to write.

        Returns
        -------
        ndarray, shape (≥ r, n)
            A row for each number of `columns`. So the instants of a number lie side by side, and a
            reader of one column need not pass the others.

        Raises
        ------
        ConfigurationError
            The timetable is of fewer instants, or of other columns.
        """
        numbers, played = self._recorded.size, (stamps_ns.size, self._played.size)
        if self._played.size and self._timetable.shape != played:
            raise ConfigurationError(
                f"timetable of shape {self._timetable.shape[::-1]}; allowed: {played[::-1]}"
            )
        if samples is None:
            samples = np.zeros((numbers, stamps_ns.size))
        whole = np.ones(numbers, np.bool_)
        run_parts(
            np.array([part.addresses for part in self.parts.values()], np.uint64).reshape(-1, 5),
            self._instants,
            self._first_source,
            self._sources,
            self._played,
            self._timetable,
            self._recorded,
            stamps_ns,
            self._signals,
            samples,
            whole,
        )
        known = np.logical_and.reduceat(whole, self._first_rows) if numbers else ()
        self.whole = frozenset(
            column.name for column, each in zip(self.columns, known, strict=True) if each
        )
        return samples


@contextmanager
def _naming(kind: str) -> Iterator[None]:
    """Put before an error of a part of this kind the node whose parameters it is about."""
    try:
        yield
    except ConfigurationError as error:
        raise ConfigurationError(f"{NODE_OF[kind]}: {error}") from None


def play(
    part: Part, stamps_ns: NDArray[np.int64], inputs: Array, wanted: Sequence[Column]
) -> Array:
    """Run one part over the stamps [ns] with inputs that are known.

    Parameters
    ----------
    part : Part
        Part to run, from its present state on.
    stamps_ns : ndarray of int64, shape (n,)
        Instants [ns].
    inputs : ndarray, shape (m, n)
        A row for each number that the part reads.
    wanted : sequence of Column
        Outputs of the part.

    Returns
    -------
    ndarray, shape (r, n)
        A row for each number of the wanted columns.
    """
    given = range(part.signals.size)[part.component.input_record.itemsize // 8 :]
    recorded = [place for column in wanted for place in given[part.places[column.name]]]
    samples = np.zeros((len(recorded), stamps_ns.size))
    run_parts(
        np.array([part.addresses], np.uint64),
        np.zeros(1, np.uint64),
        np.zeros(2, np.uint64),
        np.zeros(0, np.uint64),
        np.arange(_INSTANT, _INSTANT + len(inputs), dtype=np.uint64),
        np.ascontiguousarray(inputs.T),
        np.array(recorded, np.uint64),
        stamps_ns,
        part.signals,
        samples,
        np.ones(len(recorded), np.bool_),
    )
    return samples


def _places(chosen: Sequence[tuple[Kind, Component]], starts: NDArray[np.int64]) -> dict[str, int]:
    """Place in the signals of each column that some component gives, which only one may give."""
    places: dict[str, int] = {}
    owners: dict[str, tuple[Kind, Component]] = {}
    for owner, start in zip(chosen, starts, strict=False):
        component = owner[1]
        place = int(start) + component.input_record.itemsize // 8
        for column in component.outputs:
            if column.name in places:
                raise ConfigurationError(given_twice(column, owners[column.name], owner))
            places[column.name], owners[column.name] = place, owner
            place += column.width
    return places
