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

"""The closed loop in process: the components of the nodes, run in the order of the lock-step.

The nodes do the same over topics, with the same compiled steps and the same stamps, so both give
the same numbers to the last bit. What depends on time alone (desired motion, torque of the
environment) can be computed before, so that a campaign does it once for all its runs.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science.component import Column
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.part import Part, first_raised
from ppc_attitude.science.stamps import NANOSECONDS, stamp_of
from ppc_attitude.simulation.diagram import Diagram, selected
from ppc_attitude.simulation.scenario import Scenario

_LONGEST = 2.0**62 / NANOSECONDS  # age [s] whose difference to a stamp [ns] an int64 holds


def stamps_of(rate: float, duration: float) -> NDArray[np.int64]:
    """Stamps [ns] of a run: both ends included.

    Raises
    ------
    ConfigurationError
        The duration [s] is negative or not finite.
    """
    if not 0.0 <= duration < math.inf:
        raise ConfigurationError(f"duration = {duration:g} s; allowed: finite, ≥ 0")
    steps = round(duration * rate)
    return np.array([stamp_of(k, rate) for k in range(steps + 1)], dtype=np.int64)


class Loop:
    """The closed loop over some stamps, run for one scenario or for many that differ in numbers.

    Parameters
    ----------
    scenario : Scenario
        Whose components run.
    stamps_ns : ndarray of int64, shape (n,)
        Instants [ns].
    timetable : ndarray, optional
        `timetable_of` all scenarios and the stamps, to compute it once.

    Raises
    ------
    ConfigurationError
        A parameter is infeasible, or the selected components do not fit together.
    """

    def __init__(
        self, scenario: Scenario, stamps_ns: NDArray[np.int64], timetable: Array | None = None
    ) -> None:
        self._stamps_ns = stamps_ns
        self._diagram = Diagram(scenario.parameters, timetable=timetable)
        # Parameter values decide which columns go on record, so there is room for all of them.
        components = [component for _, component in selected(scenario.parameters)]
        widths = [column.width for component in components for column in component.outputs]
        self._samples = np.zeros((sum(widths), stamps_ns.size))

    def run(self, scenario: Scenario) -> RunRecord:
        """Run a scenario that selects the same components.

        Returns
        -------
        RunRecord
            Samples that hold until the next run, which are the same as a recorded run of the nodes
            gives.

        Raises
        ------
        ConfigurationError
            A parameter is infeasible.
        """
        self._diagram.restart(scenario.parameters)
        samples = self._diagram.run(self._stamps_ns, self._samples)
        columns = by_column(self._diagram.columns, self._stamps_ns, samples)
        for each in self._diagram.columns:
            if each.late and np.isnan(columns[each.name]).all():
                del columns[each.name]  # of which a bag has no message either
        return RunRecord(
            source="simulate",
            controller=scenario.controller.name,
            stamps_ns=self._stamps_ns,
            columns=columns,
            # In process every instant waits for its answers, whatever the nodes would do.
            parameters={
                **scenario.parameters,
                PLANT: {**scenario.parameters[PLANT], "lockstep": True},
            },
        )

    @property
    def whole(self) -> frozenset[str]:
        """Columns of the last run that are finite throughout."""
        late = {column.name for column in self._diagram.columns if column.late}
        return self._diagram.whole - late


def by_column(
    columns: Sequence[Column], stamps_ns: NDArray[np.int64], samples: Array
) -> dict[str, Array]:
    """Views of the samples of each column, of shape (n, width), by its name.

    Samples of a late column are moved, in place, to the instants of their validity, without age.
    """
    found, start = {}, 0
    for column in columns:
        rows = samples[start : start + column.width]
        if column.late:
            _put_where_valid(rows, stamps_ns)
            rows = rows[:-1]
        found[column.name] = rows.T
        start += column.width
    return found


def _put_where_valid(rows: Array, stamps_ns: NDArray[np.int64]) -> None:
    """Put each sample of a late column at the instant of its validity; NaN where there is none.

    One that belongs to no instant of the run is on no record of the nodes either. Of several that
    belong to one instant the first counts, as it does in a bag.
    """
    near = np.abs(rows[-1]) <= _LONGEST  # False for NaN
    came = np.flatnonzero(np.logical_or.reduce(rows) & near)[::-1]  # the last written stays
    valid = stamps_ns[came] - np.rint(rows[-1, came] * NANOSECONDS).astype(np.int64)
    places = np.searchsorted(stamps_ns[:-1], valid)
    known = stamps_ns[places] == valid
    told = rows[:, came[known]]
    rows[:] = np.nan
    rows[:, places[known]] = told


def timetable_of(scenario: Scenario, stamps_ns: NDArray[np.int64]) -> Array:
    """The columns that depend on time alone, at n stamps [ns]; shape (m, n), a row a number."""
    return Diagram(scenario.parameters, ahead=True).run(stamps_ns)


def simulate(scenario: Scenario, duration: float) -> RunRecord:
    """Run a scenario in process for `duration` [s]; raises as `Loop`."""
    return Loop(scenario, stamps_of(scenario.number(PLANT, "rate"), duration)).run(scenario)


def warm_up(scenario: Scenario) -> None:
    """Compile every step of a scenario, so that processes started next find them cached."""
    simulate(scenario, 0.1)


def first_instant(scenario: Scenario) -> dict[str, Part]:
    """Return every part after its step at t = 0, by the name of its kind.

    Raises
    ------
    ConfigurationError
        A parameter is infeasible, the selected components do not fit together, or a step fails.
    """
    diagram = Diagram(scenario.parameters)
    diagram.run(np.zeros(1, np.int64))
    if told := first_raised(diagram.parts.values()):
        raise ConfigurationError(f"the first instant fails{told}")
    return diagram.parts


def raised_until(scenario: Scenario, stamps_ns: NDArray[np.int64]) -> str:
    """Say which step raised, if one did, at the last of the stamps [ns] or at the one before."""
    diagram = Diagram(scenario.parameters)
    for stamps in (stamps_ns[:-1], stamps_ns[-1:]):  # a plant that raises does so an instant later
        diagram.run(stamps)
        if told := first_raised(diagram.parts.values()):
            return told
    return ""
