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

"""`RunRecord`: the arrays of one run, the currency between those who run and those who judge.

The in-process loop and the bag reader produce it; metrics, figures, reports and the replay
consume it. So a figure never knows whether ROS was there.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby
from operator import attrgetter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.parameter import NodeParameters

Array = NDArray[np.float64]
STEADY = 0.2
"""Samples can have gaps only if three in four steps are within this share of the usual step [1]."""
LONGEST, USUAL = 10, 0.95
"""Usual steps without a sample after which nothing is known; quantile that is the usual step."""


def is_steady(steps: NDArray[Any], period: float) -> bool:
    """Whether steps between samples, shape (n,), mostly last a period, so that others are gaps."""
    near = np.abs(steps / period - 1.0) <= STEADY
    return bool(4 * np.count_nonzero(near) >= 3 * near.size)


def times_of(stamps_ns: NDArray[np.int64]) -> Array:
    """Times [s] for a reader, each the float64 nearest to its stamp [ns]: 60 s equals 60."""
    return np.asarray(stamps_ns / 1e9, dtype=np.float64)


class Change(NamedTuple):
    """A parameter that was changed in flight.

    Attributes
    ----------
    stamp_ns : int
        The first instant [ns] that the new value acts on.
    node : str
        Whose parameter it is.
    name : str
        The parameter.
    value : bool, int, float, str or list
        Its new value.
    """

    stamp_ns: int
    node: str
    name: str
    value: Any


ToldChange: TypeAlias = tuple[Change, Any]
"""A change, and the value before it; None if the record does not say that."""


def told(changes: Iterable[Change], parameters: NodeParameters) -> Iterator[ToldChange]:
    """Yield changes in the order of their stamps, each with the value before.

    Parameters
    ----------
    changes : iterable of Change
        The changes.
    parameters : mapping of str to mapping
        What the nodes' parameters were before the first.
    """
    values = {(node, name): each for node, own in parameters.items() for name, each in own.items()}
    for change in changes:
        key = change.node, change.name
        yield change, values.get(key)
        values[key] = change.value


@dataclass(frozen=True)
class RunRecord:
    """The samples of one run.

    Attributes
    ----------
    source : str
        Where it comes from: the bag's path, with the namespace if several runs of it are read, or
        ``simulate``.
    controller : str
        Name of the control law.
    stamps_ns : ndarray of int64, shape (n,)
        Instants, strictly increasing [ns].
    columns : mapping of str to ndarray, each of shape (n, width)
        Samples by column name (`contract.topics`); NaN where a message is missing. A quantity
        that the run does not have is not a key.
    missing : mapping of str to int
        Topic name to number of instants without a message; only topics that lack some.
    held : frozenset of str
        Columns that came at stamps of their own: they have the latest sample at each instant, and
        NaN before the first one, where nothing is missing; the motion has NaN long after its last.
    parameters : mapping of str to mapping
        Node name to its parameters, as the run began with them.
    changes : tuple of Change
        What of the parameters was changed during the run, in the order of the stamps.
    metadata : mapping of str to str
        Versions, seed, git revision.
    warnings : tuple of str
        What a reader must know before believing the record (recording cut, clock jump, …).
    """

    source: str
    controller: str
    stamps_ns: NDArray[np.int64]
    columns: Mapping[str, Array]
    missing: Mapping[str, int] = field(default_factory=dict)
    held: frozenset[str] = frozenset()
    parameters: NodeParameters = field(default_factory=dict)
    changes: tuple[Change, ...] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def __getitem__(self, column: str) -> Array:
        """Samples of one column, shape (n, width); KeyError if the run does not have it."""
        return self.columns[column]

    def __contains__(self, column: str) -> bool:
        """True if the run has the column."""
        return column in self.columns

    @cached_property
    def derived(self) -> dict[Any, Any]:
        """Results computed from the record, by a key, so that none is computed twice."""
        return {}

    @property
    def t(self) -> Array:
        """Instants [s], shape (n,)."""
        return times_of(self.stamps_ns)

    @property
    def told_changes(self) -> list[ToldChange]:
        """Changes during the run, each with the value before, in the order of the stamps."""
        return list(told(self.changes, self.parameters))

    def stretches(self, changes: Iterable[Change]) -> Iterator[tuple[slice, NodeParameters]]:
        """Yield the instants between some of the changes, and the parameters that hold there.

        The same dictionaries are changed and yielded each time: copy them to keep them.
        """
        parameters = {node: dict(values) for node, values in self.parameters.items()}
        begin = 0
        for stamp_ns, together in groupby(changes, attrgetter("stamp_ns")):
            end = int(np.searchsorted(self.stamps_ns, stamp_ns))
            yield slice(begin, end), parameters
            for change in together:
                parameters.setdefault(change.node, {})[change.name] = change.value
            begin = end
        yield slice(begin, self.stamps_ns.size), parameters

    @property
    def missing_messages(self) -> int:
        """How many messages are missing in all."""
        return sum(self.missing.values())
