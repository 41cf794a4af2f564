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

"""A control law at work: its memory, its gains, and the step from one measurement to the next."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import overload

from ppc_attitude.science.controllers.interface import COMMAND, MEASUREMENT, Advice, Controller
from ppc_attitude.science.controllers.registry import CONTROLLERS
from ppc_attitude.science.kernel import OPTIONS, one

INPUTS = tuple(name for name in MEASUREMENT.names or () if name != "t")


def _step(name: str, measurement: Any, memory: Any, configuration: Any, command: Any) -> None:
    """Stand for the step of the law of a name in what `_array_step` compiles."""


@overload(_step, prefer_literal=True)
def _step_of(name: Any, measurement: Any, memory: Any, configuration: Any, command: Any) -> Any:
    step = CONTROLLERS[name.literal_value].step

    def call(name: Any, measurement: Any, memory: Any, configuration: Any, command: Any) -> None:
        step(measurement, memory, configuration, command)

    return call


@cache
def _array_step(name: str) -> Any:
    """Compile a law's step for arrays of one record (`kernel.one`).

    Numba finds a closure in its cache by what it encloses. A kernel is another in every process, a
    name is the same in all: hence `_step`.
    """

    def run(measurement: Any, memory: Any, configuration: Any, command: Any) -> None:
        _step(name, measurement[0], memory[0], configuration[0], command[0])

    signature = types.void(*(record[::1] for record in CONTROLLERS[name].signature.args))
    return numba.njit(signature, **OPTIONS)(run)


def _slices(dtype: np.dtype[Any]) -> dict[str, slice]:
    """Where each field is, in a record of float64 and nothing else."""
    assert dtype.fields is not None
    return {
        name: slice(field[1] // 8, (field[1] + field[0].itemsize) // 8)
        for name, field in dtype.fields.items()
    }


_COMMAND_SLICES = _slices(COMMAND)


class LawRunner:
    """One law with the gains it runs with and what it remembers.

    Parameters
    ----------
    law : Controller
        The law.
    values : mapping of str to value
        Its parameters.

    Raises
    ------
    ConfigurationError
        A parameter is infeasible.
    """

    def __init__(self, law: Controller, values: Mapping[str, Any]) -> None:
        self.law = law
        self._step = _array_step(law.name)
        self._measurement = np.zeros(1, MEASUREMENT)
        self._inputs = self._measurement.view(np.float64)
        self._memory = np.zeros(1, law.memory)
        self._command = np.zeros(1, COMMAND)
        self._outputs = self._command.view(np.float64)
        self._given = self._outputs.tolist()
        self.configure(values)

    def configure(self, values: Mapping[str, Any]) -> None:
        """Take other gains from the next step on; the memory stays.

        Raises
        ------
        ConfigurationError
            A parameter is infeasible.
        """
        self._configuration = one(self.law.configure(values))

    def forget(self) -> None:
        """Begin anew, as at the first step."""
        self._memory = np.zeros(1, self.law.memory)

    def step(self, t: float, inputs: Mapping[str, Sequence[float]]) -> None:
        """Compute one sample of the law.

        Parameters
        ----------
        t : float
            Time [s].
        inputs : mapping of str to sequence of float
            The fields of `MEASUREMENT` other than t.
        """
        row = [t]
        for name in INPUTS:
            row += inputs[name]
        self._inputs[:] = row
        self._step(self._measurement, self._memory, self._configuration, self._command)
        self._given = self._outputs.tolist()

    def given(self, column: str) -> list[float]:
        """One field of `COMMAND` as the last step gave it."""
        return self._given[_COMMAND_SLICES[column]]

    @property
    def saturated(self) -> bool:
        """True if the last torque was limited."""
        return self.given("torque_command") != self.given("unsaturated_torque")

    @property
    def plans(self) -> int:
        """Number of the law's latest advice."""
        return self.law.plans(self._memory[0])

    @property
    def advice(self) -> Advice:
        """What the law has to say after the last step."""
        return self.law.advice(self._memory[0])

    def fill(self) -> dict[str, float]:
        """Largest |error|/envelope of each envelope after the last step."""
        return self.law.fill(self._command[0])
