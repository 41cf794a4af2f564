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

"""Which fix arrives at which instant, from the stamps alone, as an estimator's node must know."""

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from ppc_attitude.science.component import Component
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.sensors.gyro_star_tracker import INITIAL_FIX
from ppc_attitude.science.sensors.star_tracker import LATENCY, RATE, ROUNDING
from ppc_attitude.science.stamps import NANOSECONDS, nanoseconds

TOLERANCE = nanoseconds(ROUNDING)
"""How far a fix's stamp may be from its slot [ns]."""

_SAY_WHEN = (RATE, LATENCY, INITIAL_FIX)


def check_slots(component: Component) -> None:
    """Check that a component that reads a late column has the parameters that say when it comes.

    Raises
    ------
    ConfigurationError
        It lacks a parameter of which `Slots` are made, or it reads several late columns, or no
        other column.
    """
    lacking = [each.name for each in _SAY_WHEN if each.name not in component.defaults]
    late = [column for column in component.inputs if column.late]
    if late and not len(late) == 1 < len(component.inputs):
        raise ConfigurationError(
            f"{component.name} reads late {', '.join(each.name for each in late)}; allowed between "
            "nodes: one such column, beside others; `ppc_attitude simulate` can run this"
        )
    for column in late:
        if lacking:
            raise ConfigurationError(
                f"{component.name} reads {column.name}, which comes late, and has no parameter "
                f"{', '.join(lacking)}, which say when it comes between nodes; "
                "`ppc_attitude simulate` can run this"
            )


class Slots:
    """Which fix arrives when; the first one is valid at stamp zero.

    Parameters
    ----------
    values : mapping of str to value
        Parameters of an estimator: fixes per second, latency [s], and whether the first fix comes
        at once. A fix comes with the first instant that is not before its arrival.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        # Exact, as so many ns for so many slots: a time since 1970 has more digits than a float.
        self._ns, self._slots = (
            NANOSECONDS / Fraction(float(values[RATE.name]))
        ).as_integer_ratio()
        self._latency = nanoseconds(float(values[LATENCY.name])) - TOLERANCE
        self._initial = bool(values[INITIAL_FIX.name])

    def due(self, last_ns: int | None, stamp_ns: int) -> int | None:
        """Validity [ns] of the fix that arrives with a stamp [ns]; None if none does.

        Parameters
        ----------
        last_ns : int or None
            The stamp before; None if nobody knows it.
        stamp_ns : int
            The stamp.
        """
        if stamp_ns == 0 and self._initial:
            return 0
        slot = self._slot(stamp_ns - self._latency)
        known = slot == 0 and self._initial
        if slot < 0 or known or (last_ns is None and stamp_ns > 0):
            return None
        came_before = last_ns is not None and self._slot(last_ns - self._latency) >= slot
        return None if came_before else self._stamp(slot)

    def has(self, valid_ns: int) -> bool:
        """Whether a stamp of validity [ns] is that of a slot."""
        slot = self._slot(valid_ns + TOLERANCE)
        return slot >= 0 and abs(self._stamp(slot) - valid_ns) <= TOLERANCE

    def arrived(self, valid_ns: int, stamp_ns: int) -> bool:
        """Whether a fix that was valid at `valid_ns` should have come by the stamp `stamp_ns`."""
        return self._slot(stamp_ns - self._latency) >= self._slot(valid_ns + TOLERANCE)

    def _slot(self, time_ns: int) -> int:
        """Return the last slot that is not after a time [ns]."""
        return time_ns * self._slots // self._ns

    def _stamp(self, slot: int) -> int:
        return round(Fraction(slot * self._ns, self._slots))
