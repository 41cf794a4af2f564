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

"""Replay: the recorded inputs of a run through the control kernel once more."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.contract.cdr import seconds
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    ATTITUDE,
    CONTROLLER,
    REFERENCE_ACCELERATION,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    TORQUE_COMMAND,
)
from ppc_attitude.science.controllers.registry import CONTROLLERS
from ppc_attitude.science.controllers.runner import LawRunner
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.simulation.scenario import scenario

_INPUTS = (ATTITUDE, ANGULAR_VELOCITY, REFERENCE_ATTITUDE, REFERENCE_RATE, REFERENCE_ACCELERATION)


@dataclass(frozen=True)
class Replay:
    """What a replay found.

    Attributes
    ----------
    steps : int
        Instants that were computed again.
    skipped : int
        Instants without a recorded input or command.
    largest_difference : float
        Largest |recorded − computed| torque command on an axis [N·m].
    at : float
        When that was [s].
    """

    steps: int
    skipped: int
    largest_difference: float
    at: float


def replay(record: RunRecord) -> Replay:
    """Feed the recorded inputs to the run's control law and compare the torque commands.

    Raises
    ------
    ConfigurationError
        The record names no known law, has no parameters for it, or lacks an input.
    """
    if record.controller not in CONTROLLERS:
        raise ConfigurationError(
            f"{record.source}: controller {record.controller!r} is not one of "
            f"{', '.join(CONTROLLERS)}: it cannot be replayed"
        )
    if CONTROLLER not in record.parameters:
        raise ConfigurationError(f"{record.source}: the parameters of {CONTROLLER} are not in it")
    needed = (*_INPUTS, TORQUE_COMMAND)
    absent = [topic.name for topic in needed if topic.column not in record]
    if absent:
        raise ConfigurationError(f"{record.source}: no messages of {', '.join(absent)}")
    values = scenario({CONTROLLER: record.parameters[CONTROLLER]}).parameters[CONTROLLER]
    complete = np.all([np.isfinite(record[topic.column]).all(axis=1) for topic in needed], axis=0)
    rows = np.flatnonzero(complete)
    if rows.size == 0:
        raise ConfigurationError(f"{record.source}: no instant has all inputs and a command")
    largest, at = _largest_difference(record, rows, values)
    return Replay(int(rows.size), int(complete.size - rows.size), largest, at)


def _largest_difference(
    record: RunRecord, rows: NDArray[np.intp], values: Mapping[str, Any]
) -> tuple[float, float]:
    law = LawRunner(CONTROLLERS[record.controller], values)
    largest, at = 0.0, seconds(int(record.stamps_ns[rows[0]]))
    for row in rows:
        t = seconds(int(record.stamps_ns[row]))
        law.step(t, {topic.column: record[topic.column][row].tolist() for topic in _INPUTS})
        recorded = record[TORQUE_COMMAND.column][row]
        difference = float(np.max(np.abs(recorded - law.given(TORQUE_COMMAND.column))))
        if difference > largest:
            largest, at = difference, t
    return largest, at
