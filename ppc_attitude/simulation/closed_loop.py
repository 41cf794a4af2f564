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

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import PLANT
from ppc_attitude.science.part import Part, first_raised
from ppc_attitude.science.stamps import NANOSECONDS, stamp_of
from ppc_attitude.simulation.diagram import Diagram, recorded_columns, selected
from ppc_attitude.simulation.scenario import Scenario


def stamps_of(rate: float, duration: float) -> NDArray[np.int64]:
    """Stamps [ns] of a run: both ends included."""
    steps = round(duration * rate)
    return np.array([stamp_of(k, rate) for k in range(steps + 1)], dtype=np.int64)


def new_samples(scenario: Scenario, size: int) -> Array:
    """Room for the samples of `size` instants: a row for each number, a column an instant.

    So the instants of a number lie side by side, and who reads one topic need not pass the others.
    """
    components = [component for _, component in selected(scenario.parameters)]
    widths = [column.width for component in components for column in component.outputs]
    return np.zeros((sum(widths), size))


def columns_of(
    scenario: Scenario, stamps_ns: NDArray[np.int64], samples: Array
) -> dict[str, Array]:
    """Return each recorded column, of shape (n, width), by its name: a view unless it is late."""
    found, start = {}, 0
    for column in recorded_columns(scenario.parameters):
        rows = samples[start : start + column.width]
        found[column.name] = (_where_valid(rows, stamps_ns) if column.late else rows).T
        start += column.width
    return found


def _where_valid(rows: Array, stamps_ns: NDArray[np.int64]) -> Array:
    """Put each sample of a late column at the instant of its validity; NaN where there is none."""
    came = np.flatnonzero(np.logical_or.reduce(rows))
    ages = np.rint(rows[-1, came] * NANOSECONDS).astype(np.int64)
    valid = np.searchsorted(stamps_ns, stamps_ns[came] - ages)
    found = np.full((len(rows) - 1, stamps_ns.size), np.nan)
    found[:, valid] = rows[:-1, came]
    return found


def timetable_of(scenario: Scenario, stamps_ns: NDArray[np.int64]) -> Array:
    """The columns that depend on time alone, at the stamps [ns]: a row for each number."""
    diagram = Diagram(scenario.parameters, ahead=True)
    timetable = np.zeros((sum(column.width for column in diagram.columns), stamps_ns.size))
    diagram.run(stamps_ns, timetable)
    return timetable


def run_samples(
    scenario: Scenario,
    stamps_ns: NDArray[np.int64],
    samples: Array | None = None,
    timetable: Array | None = None,
) -> Array:
    """Closed loop of a scenario over the stamps.

    Parameters
    ----------
    scenario : Scenario
        What to run.
    stamps_ns : ndarray of int64, shape (n,)
        Instants [ns].
    samples : ndarray, optional
        Where to write (`new_samples`), to use one buffer for many runs.
    timetable : ndarray, optional
        `timetable_of` this scenario and stamps, to compute it once for many runs.

    Returns
    -------
    ndarray
        The samples; `columns_of` tells them apart.

    Raises
    ------
    ConfigurationError
        A parameter is infeasible, or the selected components do not fit together.
    """
    if samples is None:
        samples = new_samples(scenario, stamps_ns.size)
    Diagram(scenario.parameters, timetable=timetable).run(stamps_ns, samples)
    return samples


def simulate(scenario: Scenario, duration: float) -> RunRecord:
    """Run a scenario in process for `duration` [s].

    Returns
    -------
    RunRecord
        The same samples that a recorded run of the nodes gives.
    """
    stamps_ns = stamps_of(scenario.number(PLANT, "rate"), duration)
    return record_of(scenario, stamps_ns, run_samples(scenario, stamps_ns))


def record_of(scenario: Scenario, stamps_ns: NDArray[np.int64], samples: Array) -> RunRecord:
    """Samples of `run_samples` as a record; copied are late columns only."""
    return RunRecord(
        source="simulate",
        controller=scenario.controller.name,
        stamps_ns=stamps_ns,
        columns=columns_of(scenario, stamps_ns, samples),
        # In process every instant waits for its answers, whatever the nodes would do.
        parameters={
            **scenario.parameters,
            PLANT: {**scenario.parameters[PLANT], "lockstep": True},
        },
    )


def warm_up(scenario: Scenario) -> None:
    """Compile every step of a scenario, so that processes started next find them cached."""
    run_samples(scenario, stamps_of(scenario.number(PLANT, "rate"), 0.1))


def first_instant(scenario: Scenario) -> dict[str, Part]:
    """Return every part after its step at t = 0, by the name of its kind.

    Raises
    ------
    ConfigurationError
        A parameter is infeasible, or the selected components do not fit together.
    """
    diagram = Diagram(scenario.parameters)
    diagram.run(np.zeros(1, np.int64), new_samples(scenario, 1))
    return diagram.parts


def raised_until(scenario: Scenario, stamps_ns: NDArray[np.int64]) -> str:
    """Say which step raised, if one did, at the last of the stamps [ns] or at the one before."""
    for stamps in (stamps_ns[:-1], stamps_ns):  # a plant that raises does so an instant later
        diagram = Diagram(scenario.parameters)
        diagram.run(stamps, new_samples(scenario, stamps.size))
        if told := first_raised(diagram.parts.values()):
            return told
    return ""
