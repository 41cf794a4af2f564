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

"""The series of a `RunRecord` as the analysis reads them: time of the run, vectors, gaps.

What of a run is not on record is a gap: nobody knows what the craft did meanwhile.
"""

from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.run_record import LONGEST, USUAL, Array, RunRecord, is_steady
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science.parameter import LARGEST
from ppc_attitude.science.stamps import LATEST, NANOSECONDS, instant

Mask = NDArray[np.bool_]
Span = tuple[float, float]
"""A part of a run, from and to [s]."""
_SHARE = 0.1  # of a judged span that may be absent
_Names = ParamSpec("_Names")
_Found = TypeVar("_Found")
_OfRecord = Callable[Concatenate[RunRecord, _Names], _Found]


class AnalysisError(ValueError):
    """The record lacks something that a judgement or a figure needs; the message names it."""


def once(function: _OfRecord[_Names, _Found]) -> _OfRecord[_Names, _Found]:
    """Keep the result of a function of a record, and of names; nobody may change the result."""

    @wraps(function)
    def kept(record: RunRecord, /, *names: _Names.args, **others: _Names.kwargs) -> _Found:
        key = _key(function, *names, **others)
        if key not in record.derived:
            record.derived[key] = function(record, *names, **others)
        found: _Found = record.derived[key]
        return found

    return kept


def _key(function: Callable[..., Any], *names: Any, **others: Any) -> Any:
    return (function.__module__, function.__qualname__, names, tuple(others.items()))


def zero_ns(record: RunRecord) -> int:
    """Stamp [ns] at which the time of the run is zero.

    Our plant's stamps count from the begin of the run, and a recorder that came late has missed
    what was before. With any other clock the run begins at the first instant on record.

    Raises
    ------
    AnalysisError
        If the record has no instant.
    """
    if record.stamps_ns.size == 0:
        raise AnalysisError(f"{record.source}: the record has no sample at all")
    first = int(record.stamps_ns[0])
    ours = bool(record.parameters.get(PLANT)) and 0 <= first <= LATEST * NANOSECONDS
    return 0 if ours else first


@once
def elapsed(record: RunRecord) -> Array:
    """Time of the run [s], shape (n,), which is zero at `zero_ns`.

    Each is the float64 nearest to the integer stamp, so that 60 s compares equal to 60.

    Raises
    ------
    AnalysisError
        If the record has no instant.
    """
    return np.asarray((record.stamps_ns - zero_ns(record)) / NANOSECONDS, dtype=np.float64)


def step(t: Array) -> float:
    """Nominal time between two samples [s]: the median, which gaps do not move; 0 for one sample.

    Rounded to nanoseconds, the resolution of a stamp.
    """
    if t.size < 2:
        return 0.0
    intervals = np.diff(t)
    low, high = np.round((intervals.min(), intervals.max()), 9)
    return float(low if low == high else np.round(np.median(intervals), 9))


@once
def lasting(record: RunRecord) -> Array:
    """How long each sample counts [s], shape (n,): the nominal time between two.

    A rhythm that changes has no gaps and no nominal time: each counts until the next one.
    """
    t = elapsed(record)
    h = step(t)
    if is_regular(record):
        return np.full(t.size, h)
    return np.asarray(np.diff(t, append=t[-1] + h), dtype=np.float64)


@once
def is_regular(record: RunRecord) -> bool:
    """Whether the instants follow a rhythm, in which it can be told what is missing."""
    t = elapsed(record)
    return t.size < 2 or is_steady(np.diff(t, append=t[-1] + step(t)), step(t))


def samples(record: RunRecord, column: str) -> Array:
    """Samples of a column, shape (n, width).

    A row with any non-finite number is NaN as a whole.

    Raises
    ------
    AnalysisError
        If the run has not the column, or no finite sample of it; names the topic.
    """
    if not has(record, column):
        raise AnalysisError(f"{record.source}: the record has no sample of '{topic_of(column)}'")
    rows, known = record[column], is_finite(record, column)
    return rows if known.all() else np.where(known[:, None], rows, np.nan)


def vectors(record: RunRecord, column: str) -> Array:
    """Three-vectors of a column (of a quaternion: its vector part), shape (n, 3); of parts: all.

    Raises
    ------
    AnalysisError
        As of `samples`, whose rows they are.
    """
    found = samples(record, column)
    return found if column in BY_COLUMN and BY_COLUMN[column].part else found[:, :3]


def topic_of(column: str) -> str:
    """Name of the topic that fills a column."""
    topic = BY_COLUMN.get(column)
    return topic.name if topic else column.replace("_", "/", 1)


@once
def has(record: RunRecord, column: str) -> bool:
    """Whether the run has at least one finite sample of the column."""
    return column in record and bool(is_finite(record, column).any())


@once
def is_finite(record: RunRecord, column: str) -> Mask:
    """At which instants a column is finite throughout, shape (n,)."""
    return finite(record[column])


def take_for_finite(record: RunRecord, columns: Iterable[str]) -> None:
    """Let columns count as finite throughout: the caller has seen their numbers."""
    always = np.ones(record.stamps_ns.size, np.bool_)
    for column in columns:
        record.derived[_key(is_finite, column)] = always


def finite(rows: Array) -> Mask:
    """Which rows, of shape (n, width), are finite throughout; shape (n,).

    A number beyond any craft's is as good as none: its square overflows.
    """
    # No product of vectors instead: BLAS starts threads for it, which fight those of other workers.
    known = np.abs(rows.T) <= LARGEST
    if known.all():
        return np.ones(len(rows), np.bool_)
    # Column by column: a reduction along so short an axis costs six times as much.
    return np.asarray(np.logical_and.reduce(list(known)))


def known(of: Callable[[RunRecord], _Found], record: RunRecord) -> _Found | None:
    """What a function finds in a record; None if the record lacks a column for it."""
    try:
        return of(record)
    except AnalysisError:
        return None


def largest(values: Array | None, where: Mask | slice = slice(None)) -> float | None:
    """Largest finite number of those picked; None if there is none."""
    if values is None:
        return None
    picked = values[where]
    if picked.size and np.isfinite(most := picked.max()):
        return float(most)
    finite = picked[np.isfinite(picked)]
    return float(finite.max()) if finite.size else None


def known_span(t: Array, values: Array) -> Span | None:
    """First and last instant [s] with a finite value, each of shape (n,); None if none is."""
    finite = t[np.isfinite(values)]
    return (float(finite[0]), float(finite[-1])) if finite.size else None


def absent_spans(record: RunRecord, known: Mask) -> tuple[Span, ...]:
    """Between which instants [s] nothing is known for long; the mask has shape (n,).

    What is before the first one that is known is not absent: it has not begun.
    """
    t = elapsed(record)
    if t.size < 2 or (known.all() and _has_no_gap(record)):
        return ()
    # Steps that vary are not long because of their median.
    longest = LONGEST * max(step(t), float(np.quantile(np.diff(t), USUAL)))
    told = t[known]
    told = np.append(told, t[-1]) if told.size else told
    long = np.flatnonzero(np.round(np.diff(told) / longest, 6) > 1.0)
    return tuple((float(told[k]), float(told[k + 1])) for k in long)


def absent_in(record: RunRecord, *columns: str) -> tuple[Span, ...]:
    """Between which instants [s] one of some columns of a record has no sample for long."""
    known = [is_finite(record, each) for each in columns]
    return absent_spans(record, np.logical_and.reduce(known))


@once
def _has_no_gap(record: RunRecord) -> bool:
    t = elapsed(record)
    return bool(np.diff(t).max() <= LONGEST * step(t))


def clipped(spans: Iterable[Span], within: Span) -> tuple[Span, ...]:
    """The parts of some spans [s] that lie within another."""
    parts = ((max(start, within[0]), min(end, within[1])) for start, end in spans)
    return tuple(part for part in parts if part[0] < part[1])


def lacks_too_much(spans: Iterable[Span], within: Span) -> str:
    """Why a span [s] cannot be judged of which some are absent; empty if it can."""
    parts = clipped(spans, within)
    absent = sum(end - start for start, end in parts)
    if absent <= _SHARE * (within[1] - within[0]):
        return ""
    return not_on_record(*parts)


def not_on_record(*spans: Span) -> str:
    """Say that some spans are not on record."""
    return f"nothing is on record from {', '.join(map(span_text, spans))} s"


def span_text(span: Span | None) -> str:
    """Write a part of a run for a reader."""
    return "–" if span is None else f"{instant(span[0])} to {instant(span[1])}"
