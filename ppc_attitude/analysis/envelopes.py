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

"""Which errors of a record have an envelope: errors and bounds that its columns declare."""

from dataclasses import dataclass

import numpy as np

from ppc_attitude.analysis.series import Mask, finite, has, is_finite, once
from ppc_attitude.contract.declared import (
    ATTITUDE_ENVELOPE,
    ATTITUDE_ERROR,
    BOUNDS,
    BY_COLUMN,
    RATE_ENVELOPE,
    RATE_ERROR,
    bounds_of,
)
from ppc_attitude.contract.run_record import Array, RunRecord


@dataclass(frozen=True)
class Envelope:
    """The columns of an error and of what bounds the magnitude of its first numbers."""

    error: str
    bound: str

    @property
    def name(self) -> str:
        """The error in words."""
        return self.error.replace("_", " ")

    @property
    def title(self) -> str:
        """The quantity of an axis."""
        return BY_COLUMN[self.error].meaning.partition(",")[0]

    @property
    def parts(self) -> tuple[str, ...]:
        """What the numbers of the error are of; empty if they are of axes."""
        return BY_COLUMN[self.error].parts

    @property
    def unit(self) -> str:
        """Unit of both."""
        return BY_COLUMN[self.error].unit

    @property
    def jumps(self) -> bool:
        """True if a sudden torque throws the error out at once: a rate, but no angle."""
        return self.unit not in ("1", "rad")


@once
def outside(record: RunRecord, envelope: Envelope) -> Mask:
    """Instants, finite in both, with a component of the error beyond its bound, shape (n,)."""
    error, bound = record[envelope.error], record[envelope.bound]
    return beyond(error[:, : bound.shape[1]], bound) & is_finite(record, envelope.error)


def beyond(error: Array, bound: Array) -> Mask:
    """Rows, finite in both, with a component beyond its bound, shape (n,)."""
    larger = np.asarray(np.logical_or.reduce(np.abs(error).T > bound.T))
    rows = np.flatnonzero(larger)  # few, if any
    larger[rows] = finite(error[rows]) & finite(bound[rows])
    return larger


ATTITUDE = Envelope(ATTITUDE_ERROR.column, ATTITUDE_ENVELOPE.column)
RATE = Envelope(RATE_ERROR.column, RATE_ENVELOPE.column)
ENVELOPES = tuple(Envelope(error, bound) for error, bound in BOUNDS)
"""Every one that some component declares."""


@once
def declared(record: RunRecord) -> dict[str, Envelope]:
    """Envelopes that the components of a run declare, by the error; it may lack their columns."""
    pairs = bounds_of(record.controller, record.parameters)
    return {error: Envelope(error, bound) for error, bound in pairs}


def bound_of(record: RunRecord, error: str) -> str:
    """Column that bounds an error in a run; empty if the components declare none."""
    found = declared(record).get(error)
    return found.bound if found else ""


@once
def envelopes_of(record: RunRecord) -> dict[str, Envelope]:
    """Envelopes of which the record has both columns, by the error."""
    pairs = declared(record).items()
    return {error: own for error, own in pairs if has(record, error) and has(record, own.bound)}
