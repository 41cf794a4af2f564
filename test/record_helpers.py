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

"""Records as the kernels take them, and what the tests of laws write their equations in."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.science.component import Component
from ppc_attitude.science.parameter import resolved

quaternions = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 4)
    .filter(lambda q: np.linalg.norm(q) > 1e-2)
    .map(lambda q: tuple(float(x) for x in np.array(q) / np.linalg.norm(q)))
)
"""Unit quaternions."""


def f_matrix(q: ArrayLike) -> Array:
    """F = ½ (q0 I + q×) of an attitude error x y z w, whose vector part changes by F ω."""
    *vector, scalar = np.asarray(q)
    return np.asarray(0.5 * (scalar * np.eye(3) + np.cross(np.eye(3), vector)))


def derivative(at: Callable[[float], Array], h: float) -> Array:
    """Derivative at 0 of a function of time, by four points: its error is of fourth order in h."""
    return (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h)


def new_record(dtype: Any) -> Any:
    return np.zeros((), dtype)[()]


def configured(component: Component, values: Mapping[str, Any] | None = None) -> Any:
    """Return what a component's step is configured by, from parameters beside the defaults."""
    return component.configure(resolved(component.parameters, values or {}, "node"))


def inputs_of(component: Component) -> Any:
    """Return what a component's step reads, all zero."""
    return new_record(component.input_record)


def state_of(component: Component) -> Any:
    """Return what a component remembers before its first step."""
    return new_record(component.state)


def outputs_of(component: Component) -> Any:
    """Return what a component's step fills, all zero."""
    return new_record(component.output_record)


def records_of(component: Component) -> tuple[Any, Any, Any]:
    """Return what a component's step reads, remembers and fills, all zero."""
    return inputs_of(component), state_of(component), outputs_of(component)


def settled_after(record: RunRecord, start: float = 0.0) -> float:
    """Last instant with an error of 5e-3 or more, counted from `start` [s]."""
    error = np.abs(record["attitude_error"][:, :3]).max(axis=1)
    return float(record.t[np.flatnonzero(error >= 5e-3)[-1]] - start)
