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

"""Distribution of errors over time in a memory of fixed size: counts of levels in time bins.

A run is reduced to one small number for each quantity and time bin: the level, on a logarithmic
scale, of the largest value in the bin. Counting levels is exact and knows no order, so any
grouping of the runs gives the same counts to the last bit.
"""

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.analysis.envelopes import ATTITUDE, envelopes_of
from ppc_attitude.contract.run_record import Array, RunRecord, times_of

QUANTITIES = ("attitude_error", "attitude_envelope", "normalised_error")
"""max_i |q_ev,i| of the pointing error, max_i ρ_q,i, and max_i |q_ev,i|/ρ_q,i of the law's own.

ρ_q is the column that bounds the attitude error, whatever the law calls it.
"""
TIME_BINS = 240
STEPS_PER_DECADE = 32
EDGES = np.array([10.0 ** (k / STEPS_PER_DECADE) for k in range(-208, 41)])
"""Levels 1 … 248 lie between these; 0 and 249 are below and above, `UNKNOWN` is not a number."""
UNKNOWN = 255

Levels = NDArray[np.uint8]


def time_bins(stamps_ns: NDArray[np.int64]) -> tuple[NDArray[np.intp], Array]:
    """First sample of each time bin, and the ends of the bins [s], one more than bins."""
    bins = min(TIME_BINS, stamps_ns.size)
    starts = np.arange(bins) * stamps_ns.size // bins
    return starts, times_of(np.append(stamps_ns[starts], stamps_ns[-1]))


def levels_of(record: RunRecord, sizes: Array) -> Levels:
    """Levels of one run, shape (len(QUANTITIES), bins), with the sizes of its pointing error.

    `UNKNOWN` in bins that hold a sample that is not finite, or for an envelope that the run does
    not have.
    """
    starts, _ = time_bins(record.stamps_ns)
    values = [sizes]
    if own := envelopes_of(record).get(ATTITUDE.error):
        envelope = record[own.bound].T
        envelope = np.where(envelope > 0.0, envelope, np.nan)  # none without an attitude
        error = np.abs(record[own.error][:, : envelope.shape[0]]).T
        values += [envelope.max(axis=0), (error / envelope).max(axis=0)]
    levels = np.full((len(QUANTITIES), starts.size), UNKNOWN, np.uint8)
    for row, value in zip(levels, values, strict=False):
        peaks = np.maximum.reduceat(value, starts)
        row[:] = np.where(np.isfinite(peaks), np.searchsorted(EDGES, peaks, "right"), UNKNOWN)
    return levels


class QuantileBands:
    """How many runs were at each level in each time bin, of given ends [s], shape (bins + 1,)."""

    def __init__(self, ends: Array) -> None:
        self.ends = ends
        self.counts = np.zeros((len(QUANTITIES), ends.size - 1, UNKNOWN + 1), np.int64)

    def add(self, levels: Levels) -> None:
        """Count one run."""
        quantities, bins = np.indices(levels.shape)
        self.counts[quantities, bins, levels] += 1

    def quantiles(self, quantity: str, share: float) -> Array:
        """Value below which a share of the runs lies, in each time bin; NaN where none is known.

        Within a level the logarithm is taken as uniform: exact to a level, 7 %.
        """
        counts = self.counts[QUANTITIES.index(quantity), :, : EDGES.size + 1]
        total = counts.sum(axis=1)
        below = np.cumsum(counts, axis=1)
        rank = np.maximum(share * total, 1.0)
        level = np.minimum((below < rank[:, None]).sum(axis=1), EDGES.size)
        bins = np.arange(level.size)
        inside = counts[bins, level]
        part = 1.0 - (below[bins, level] - rank) / np.maximum(inside, 1)
        exponent = (np.log10(EDGES[0]) * STEPS_PER_DECADE + level - 1 + part) / STEPS_PER_DECADE
        return np.where(total > 0, 10.0 ** np.clip(exponent, *np.log10(EDGES[[0, -1]])), np.nan)
