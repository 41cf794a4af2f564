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

"""What of a run is not on record: nobody knows what the craft did meanwhile."""

from collections.abc import Iterable

import numpy as np

from ppc_attitude.analysis.series import Mask, elapsed, is_finite, once, step
from ppc_attitude.analysis.verdict import Span, span_text
from ppc_attitude.contract.run_record import LONGEST, USUAL, Array, RunRecord

_SHARE = 0.1  # of a judged span that may be absent


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
