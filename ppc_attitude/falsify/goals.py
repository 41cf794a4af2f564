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

"""The goals of the adversary: numbers that it makes as large as it can.

Errors and rate are the true ones. Any other column that has a bound is as recorded.
"""

from dataclasses import dataclass

import numpy as np

from ppc_attitude.analysis.envelopes import bound_of
from ppc_attitude.analysis.requirements import PAPER
from ppc_attitude.analysis.truth import RECORDED, pointing_errors, truth_of
from ppc_attitude.contract.declared import ATTITUDE_ERROR, bounds_of, columns_of
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.science.controllers.tube_state import TURN
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.stamps import nanoseconds
from ppc_attitude.simulation.scenario import Scenario

RATE = 3.0  # [deg/s] the paper's limit
SETTLED = PAPER.settled.limit
_LAST = nanoseconds(PAPER.terminal_window)  # [ns] over which the error in the end is judged
_UNITS = {"settling": "s", "terminal": "", "rate": "deg/s"}  # of goals that are no column


@dataclass(frozen=True)
class Goal:
    """One quantity of a run."""

    name: str  # `settling`, `terminal`, `rate`, or a column that has a bound
    accuracy: float = SETTLED  # settled means |q_ev,i| below this
    after: float = 0.0  # [s] instants before this are not judged
    rate: float = RATE  # [deg/s] that no run should pass

    @property
    def has_accuracy(self) -> bool:
        """True if it is judged by `accuracy`; the other goals are judged from `after` on."""
        return self.name in ("settling", "terminal")

    @property
    def limit(self) -> float:
        """The limit that no run should pass; infinite where there is none."""
        limits = {"settling": np.inf, "terminal": self.accuracy, "rate": self.rate}
        return limits.get(self.name, 1.0)

    def text(self, value: float, duration: float) -> str:
        """Value of a run of so long [s] for a reader."""
        if self.name == "settling" and value > duration:
            return f"not settled at {duration:g} s (error {value - duration:.3g})"
        return f"{value:.6g} {_UNITS.get(self.name, 'times its bound')}".rstrip()

    def value(self, record: RunRecord) -> float:
        """Value of a run, [s], [1], [deg/s] or by its bound; infinite if the run is not finite."""
        judged = record.t >= self.after
        if self.name == "settling":
            value = self._settling(record)
        elif self.name == "terminal":
            last = record.stamps_ns >= record.stamps_ns[-1] - _LAST
            value = float(pointing_errors(record).sizes[last].max())
        elif self.name == "rate":
            rates = record[truth_of(record).angular_velocity][judged]
            value = float(np.degrees(np.linalg.norm(rates, axis=1).max()))
        else:
            bound = record[bound_of(record, self.name)][judged]
            error = np.abs(_true(record, self.name)[judged][:, : bound.shape[1]])
            # There is no bound without an attitude.
            shares = np.divide(error, bound, out=np.zeros_like(error), where=bound != 0.0)
            value = float(shares.max())
        return value if np.isfinite(value) else np.inf

    def _settling(self, record: RunRecord) -> float:
        """Last instant outside the accuracy; of a run that ends outside, the end plus its error."""
        error = pointing_errors(record).sizes
        outside = np.flatnonzero(~(error < self.accuracy))  # NaN is not settled either
        if not outside.size:
            return 0.0
        time = float(record.t[outside[-1]])
        return time + float(error[-1]) if outside[-1] == error.size - 1 else time


def _true(record: RunRecord, name: str) -> Array:
    """Column of a run; of an attitude error the true one, where the law was told another."""
    told = record[name]
    if name not in (ATTITUDE_ERROR.column, TURN.name) or truth_of(record).standing != RECORDED:
        return told
    errors = pointing_errors(record)
    if name == ATTITUDE_ERROR.column:
        return errors.quaternions
    angles = errors.angles[:, None]
    return np.where(told > np.pi, 2.0 * np.pi - angles, angles)  # in the law's way round


def goal_of(
    name: str, scenario: Scenario, accuracy: float, after: float, rate: float = RATE
) -> Goal:
    """Goal by its name; the rest as in `Goal`.

    Raises
    ------
    ConfigurationError
        No component of the scenario gives such a column, or the column has no bound.
    """
    nodes = scenario.parameters
    given = {column.name for node in nodes for column in columns_of(node, nodes[node])}
    law = scenario.controller.name
    bounded = [each for each, bound in bounds_of(law, nodes) if {each, bound} <= given]
    if name not in (*_UNITS, *bounded):
        raise ConfigurationError(
            f"goal = {name}; allowed for {law}: {', '.join((*_UNITS, *bounded))}"
        )
    return Goal(name, accuracy, after, rate)
