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

"""A component at work: its configuration, what it remembers, and its step compiled once for all.

The step of every component is compiled alone, behind one binary interface: the addresses of its
four records. So the in-process loop calls any combination of components without being compiled
anew, and nodes, replay and loop run the same machine code.
"""

import hashlib
import re
import warnings
from collections.abc import Iterable, Mapping
from contextlib import suppress
from ctypes import CFUNCTYPE, c_void_p
from functools import cache
from inspect import signature
from math import isfinite, isnan
from struct import Struct
from typing import Any, TypeAlias

import numpy as np
from numba import from_dtype, types
from numba.core.ccallback import CFunc
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError, NumbaExperimentalFeatureWarning

from ppc_attitude.science.component import Component
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.given import misfit, misfit_text, rules_of
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kernel import OPTIONS, Cache, carray, pointer_to
from ppc_attitude.science.referred import digest_of, sources_of
from ppc_attitude.science.stamps import seconds

_OPTIONS = {**OPTIONS, "boundscheck": False}
_PACKAGE = __name__.partition(".")[0]
_call_type: Any = CFUNCTYPE(None, *[c_void_p] * 4)
_compiled: dict[str, Any] = {}  # steps, by their keys

Row: TypeAlias = tuple[float, ...]


def _compile(component: Component, key: str) -> Any:
    """Compile the step of a component as a C function of four addresses."""
    step = component.step
    function = vars(step)["py_func"] if _is_ours(component) else _guarded(component)
    read, given = component.input_record, component.output_record
    taken = tuple(map(from_dtype, (read, component.state, component.configuration, given)))
    compiled: Any = CFunc(function, (taken, types.void), {}, _OPTIONS)
    compiled._cache = Cache(function, step.__module__)
    with warnings.catch_warnings():
        # The output records of all laws begin alike, so Numba takes one for a subtype of another.
        warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
        # Numba's key of a closure contains the values that it encloses. A kernel is another object
        # in every process, but our key is the same in all.
        compiled._cache._index_key = lambda signature, codegen: (key, codegen.magic_tuple())
        compiled.compile()
    return compiled


def _guarded(component: Component) -> Any:
    step, count = component.step, component.output_record.itemsize // 8
    rules = rules_of(component.outputs)

    def guarded(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
        # An exception of a step that is called by its address reaches no caller: Numba prints it
        # and leaves the outputs as they were. Every reader notices NaN, so NaN stands for an
        # exception, and for numbers that no node would take.
        given = carray(pointer_to(outputs), count, np.float64)
        try:
            step(inputs, state, configuration, outputs)
            fits = misfit(given, rules) < 0
        except Exception:
            fits = False
        if not fits:
            given[:] = np.nan

    return guarded


def _is_ours(component: Component) -> bool:
    return str(component.step.__module__).partition(".")[0] == _PACKAGE


def kernel_of(component: Component) -> Any:
    """Step of a component, checked to be a kernel of four records.

    Raises
    ------
    ConfigurationError
        The step is no such kernel.
    """
    step, name = component.step, component.name
    if not isinstance(step, Dispatcher):
        told = "a kernel, and no NUMBA_DISABLE_JIT in the environment"
        raise ConfigurationError(f"component {name}: step = {step!r}; allowed: {told}")
    taken = signature(vars(step)["py_func"])
    if len(taken.parameters) != 4:
        raise ConfigurationError(
            f"component {name}: step takes {', '.join(taken.parameters) or 'nothing'}; allowed: "
            "inputs, state, configuration, outputs"
        )
    return step


@cache
def entry_point(component: Component) -> Any:
    """Compiled step of a component; `address` is where it takes the addresses of its records.

    Raises
    ------
    ConfigurationError
        The step is no kernel, or cannot be compiled or kept.
    """
    name = component.name
    kernel_of(component)
    key = _key_of(component)
    try:
        if key not in _compiled:
            _compiled[key] = _compile(component, key)
        return _compiled[key]
    except ConfigurationError:
        raise
    except Exception as error:  # not all that Numba raises is a NumbaError
        # Only the innermost reason is told: Numba wraps it in the calls that led there.
        told = f"{type(error).__name__}: {error}".rpartition("raised a specific error:")[2]
        reason = re.sub(r"\x1b\[\d+m", "", told.partition("During:")[0]).strip()  # no colours
        raise ConfigurationError(f"component {name}: step cannot be compiled: {reason}") from error


def _key_of(component: Component) -> str:
    """Text that tells a component from every other one, and is the same in all processes.

    The component's name is not enough: a component of another kind may have it too, and one step
    may fill different records. Nor is the step's name: all steps behind a rate observer share one.
    For a component of another package, the key covers all that its step refers to.
    """
    step, records = component.step, (component.input_record, component.output_record)
    rules = rules_of(component.outputs).tolist()
    layout = repr((*records, component.configuration, component.state, rules))
    layout += sources_of(step.__module__.partition(".")[0])
    if not _is_ours(component):
        layout += digest_of(step)
    digest = hashlib.sha256(layout.encode()).hexdigest()[:16]
    return f"{step.__module__}.{step.__qualname__}.{component.name}.{digest}"


def configured(component: Component, values: Mapping[str, Any]) -> tuple[Any, list[Any]]:
    """Record that a component makes of parameter values, and the arrays that it points to.

    Raises
    ------
    ConfigurationError
        A parameter is infeasible, or `configure` fails, returns no such record, or one with NaN.
    """
    made = component.configure(values)
    record, *kept = made if isinstance(made, tuple) and made else (made,)
    if not isinstance(record, np.generic | np.ndarray) or (record.dtype, record.shape) != (
        component.configuration,
        (),
    ):
        raise ConfigurationError(
            f"component {component.name}: configure made {record!r}, "
            f"which is no record of {component.configuration}"
        )
    if field := _field_with_nan(record):
        raise ConfigurationError(
            f"component {component.name}: configure made {field} = NaN; allowed: numbers"
        )
    return record, kept


def _field_with_nan(record: Any) -> str:
    for name in record.dtype.names or ():
        value = record[name]
        if value.dtype.names:
            if field := _field_with_nan(value):
                return f"{name}.{field}"
        elif value.dtype.kind == "f" and np.isnan(value).any():
            return str(name)
    return ""


class Part:
    """One component with its configuration, its memory and its compiled step.

    Parameters
    ----------
    component : Component
        Its declaration.
    values : mapping of str to value
        The parameters of its node.
    signals : ndarray of float64, optional
        Memory of its input and its output record, in this order; of length `signals_of`.

    Attributes
    ----------
    inputs, outputs : ndarray of one record
        What the next step reads, and what the last one gave.
    configuration, state : ndarray of one record
        What it is configured with, and what it remembers.
    places : dict of str to slice
        Where each output column is among the numbers that a step gives.
    told : int
        Number of the latest advice that its user has heard.

    Raises
    ------
    ConfigurationError
        A parameter is infeasible, or the component's step cannot be compiled.
    """

    def __init__(
        self,
        component: Component,
        values: Mapping[str, Any],
        signals: np.ndarray[Any, np.dtype[np.float64]] | None = None,
    ) -> None:
        self.component = component
        self.signals = np.zeros(signals_of(component)) if signals is None else signals
        split = component.input_record.itemsize // 8
        self.inputs = self.signals[:split].view(component.input_record)
        self.outputs = self.signals[split:].view(component.output_record)
        self.places = component.places
        self._memory = self.signals.data
        self._written = Struct(f"=q{split - 1}d")
        self._given = Struct(f"={self.signals.size - split}d")
        self._given_at = 8 * split
        self.state = np.zeros(1, component.state)
        self.told = 0
        self._entry = entry_point(component)
        self._call = _call_type(self._entry.address)
        self.configure(values)

    def configure(self, values: Mapping[str, Any]) -> None:
        """Take other parameters from the next step on; the memory stays.

        Raises
        ------
        ConfigurationError
            A parameter is infeasible, or the component makes no configuration.
        """
        record, self._kept = configured(self.component, values)
        self.hold(record)

    def hold(self, record: Any) -> None:
        """Take a record of configuration that was made elsewhere."""
        self._held = np.array([record], self.component.configuration)
        self.configuration = self._held.copy()
        self.addresses = (
            self._entry.address,
            self.inputs.ctypes.data,
            self.state.ctypes.data,
            self.configuration.ctypes.data,
            self.outputs.ctypes.data,
        )
        self._records = self.addresses[1:]

    def forget(self) -> None:
        """Begin anew, as at the first step.

        Outputs are cleared because a step need not write all of them; the configuration is restored
        because a step may have written to it.
        """
        self.signals[:] = 0.0
        self.state.view(np.uint8).fill(0)
        self.configuration[:] = self._held
        self.told = 0

    def step(self, stamp_ns: int, values: Iterable[float] = ()) -> Row:
        """Take one step.

        Parameters
        ----------
        stamp_ns : int
            The instant [ns].
        values : iterable of float
            The numbers of all input columns, one after the other.

        Returns
        -------
        tuple of float
            The numbers of all output columns, one after the other; `places` tells them apart.
        """
        self._written.pack_into(self._memory, 0, stamp_ns, seconds(stamp_ns), *values)
        self._call(*self._records)
        return self._given.unpack_from(self._memory, self._given_at)

    def output(self, column: str) -> Row:
        """One column as the last step gave it."""
        return tuple(self.outputs[0][column].tolist())

    @property
    def advices(self) -> int:
        """Number of the component's latest advice; −1 if its hook fails."""
        with suppress(ConfigurationError):
            return self.component.advices(self.state[0])
        return -1

    @property
    def advice(self) -> Advice:
        """The component's advice after the last step; a warning if its hook fails.

        A hook that fails must not end a run.
        """
        try:
            self.component.advices(self.state[0])  # so that an error of this hook is told, too
            return self.component.advice(self.state[0])
        except ConfigurationError as error:
            return Advice(str(error), warning=True)

    def raised(self) -> str:
        """Why the last step failed, found by taking it again; empty if no reason shows.

        A step that runs by its address loses its exception (`_guarded`). If it has read numbers
        that are not finite, it failed because of these, and is not taken again.
        """
        given = self._given.unpack_from(self._memory, self._given_at)
        _, *read = self._written.unpack_from(self._memory)
        failed = all(map(isnan, given)) and all(map(isfinite, read))
        if _is_ours(self.component) or not failed:
            return ""
        records = (self.inputs, self.state, self.configuration, self.outputs)
        copied = [each.copy() for each in records]
        try:
            self.component.step(*(each[0] for each in copied))
        except NumbaError:  # the step cannot be compiled for this call, which is not why it failed
            return ""
        except Exception as error:
            return f"raised {type(error).__name__}: {error}"
        told = misfit_text(self.component.outputs, copied[-1].view(np.float64))
        return f"gave {told}" if told else ""

    def normalised_errors(self) -> dict[str, float]:
        """Largest |column|/bound by name of the bound, for every bound of a column that is here.

        Above 1 the column is outside its bound.
        """
        told, found = self.outputs[0], {}
        for each in self.component.outputs:
            bound = told[each.name]
            if each.bounds in self.places and np.all(bound > 0.0):
                found[each.name] = float(np.max(np.abs(told[each.bounds][: bound.size]) / bound))
        return found


def first_raised(parts: Iterable[Part]) -> str:
    """End of a message about numbers that are not finite: which step failed, and why; or empty."""
    for part in parts:
        if what := part.raised():
            return f"; the step of component {part.component.name} {what}"
    return ""


def signals_of(component: Component) -> int:
    """Count the float64 that a component's inputs and outputs take."""
    return (component.input_record.itemsize + component.output_record.itemsize) // 8
