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

"""The declaration of a part of the craft, whatever its kind: plant, sensors, law, and the others.

A part is a `Component`: parameters, a configuration built from them, what it remembers, the columns
it reads, the columns it gives, and one step. Loop, nodes, recorder, reader, replay, campaign and
figures take everything from these declarations; none of them lists fields.

This file and `kinds` import neither kernels nor Numba, so a program that only needs names is light.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.conditions import Condition, Task
from ppc_attitude.science.hooks import HOOKS, Advice, named
from ppc_attitude.science.parameter import Parameter, filled, record_type

INERTIAL, BODY, DESIRED, STAR_TRACKER = "inertial", "body", "desired", "star_tracker"
QUATERNION, VECTOR, WRENCH = "quaternion", "vector", "wrench"
POINT, MAGNETIC = "point", "magnetic"
GYRO, FIX, MOTION = "gyro", "fix", "motion"
POSITIONS, VELOCITIES, EFFORTS = "positions", "velocities", "efforts"
MAX_WHEELS, MAX_THRUSTERS = 8, 16
UNIT_TOLERANCE = 1e-3
"""How far the norm of a quaternion may be from 1; it is normalised."""
OWN_TOLERANCE = 1e-12
"""How far the norm of one of ours may be from 1: normalising it would change its last bits."""
FIX_VARIANCE = math.pi**2
"""Largest variance of a fix [rad²]: no attitude is further from another than π."""
GYRO_VARIANCE = 1e5
"""Largest variance of a rate [rad²/s²]; the noisiest gyro of ours, at 10 kHz, has 1e4."""


def norm_of(a: Any) -> float:
    """‖a‖ of the first four numbers of `a`; plain Python for nodes, compiled in `attitude`."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3])


JOINTS = (POSITIONS, VELOCITIES, EFFORTS)
"""Forms of a column with a number for each part of a sort: a sensor_msgs/JointState's lists."""
_MOST_JOINTS = 16
_TOPIC = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_LONGEST_TOPIC = 150  # DDS takes 247, with the namespace
_WIDTHS = {
    QUATERNION: (4,),
    VECTOR: (1, 2, 3),
    WRENCH: (3,),
    POINT: (3,),
    MAGNETIC: (3,),
    GYRO: (4,),
    FIX: (7,),
    MOTION: (19,),
    **dict.fromkeys(JOINTS, tuple(range(1, _MOST_JOINTS + 1))),
}


@dataclass(frozen=True)
class Column:
    """One quantity that a component gives at each instant.

    Attributes
    ----------
    name : str
        Name of its array in a `RunRecord` and of its field in a step's records.
    topic : str
        Relative name of the topic that carries it.
    form : str
        How it goes over the wire: ``quaternion`` (x y z w), ``vector`` (up to three numbers),
        ``wrench`` (a torque), ``point`` (a position), ``magnetic`` (a field), ``gyro`` (a rate and
        the variance of each of its numbers), ``fix`` (x y z w and the variances about three axes),
        ``motion`` (x y z w, the upper triangle of its covariance, a rate, the upper triangle of its
        covariance), ``positions``, ``velocities`` or ``efforts`` (the list of a JointState with a
        number for each of up to 16 parts of a sort, such as wheels).
    frame : str
        Frame in which the numbers are expressed.
    unit : str
        Unit of the numbers; "1" where they have none.
    meaning : str
        What the numbers are. Figures take what stands before its first comma as a short name.
    width : int
        How many numbers; by default as many as the form can have.
    bounds : str
        Name of the column of whose first numbers it bounds the magnitude, where there is one.
    late : bool
        True if it arrives at some instants only and was measured at an earlier one. Then it has one
        number more, its age [s], as the last; its message has the stamp of the measurement; a row
        of zeros is no message. Between nodes only an estimator may read it, one with the parameters
        ``star_tracker.rate``, ``star_tracker.latency`` and ``initial_fix``, which say when it
        arrives. Nodes wait for a message at each of these instants; a ``fix`` with a zero
        quaternion and −1 as its first variance says that there is no fix.
    part : str
        Of ``positions``, ``velocities`` and ``efforts``: name of a part, such as ``wheel``, to
        which the message appends _ and the part's index.
    """

    name: str
    topic: str
    form: str
    frame: str
    unit: str
    meaning: str
    width: int = 0
    bounds: str = ""
    late: bool = False
    part: str = ""

    def __post_init__(self) -> None:
        """Refuse what no record or no topic can have."""
        fits = self.name.isidentifier() and _TOPIC.fullmatch(self.topic)
        if not fits or len(self.topic) > _LONGEST_TOPIC:
            raise ValueError(
                f"column {self.name!r} with topic = {self.topic!r}; allowed: a name of letters, "
                "digits and _, and a relative topic of such names with / between them, "
                f"{_LONGEST_TOPIC} characters at most"
            )
        told = (self.frame, self.unit, self.meaning)
        if not all(told) or "$" in "".join(told):  # figures would take it for mathematics
            raise ValueError(
                f"column {self.name}: frame = {self.frame!r}, unit = {self.unit!r}, meaning = "
                f"{self.meaning!r}; allowed: texts, not empty, without $"
            )
        if self.form not in _WIDTHS:
            raise ValueError(
                f"column {self.name}: form = {self.form!r}; allowed: {', '.join(_WIDTHS)}"
            )
        if not self.width:
            object.__setattr__(self, "width", _WIDTHS[self.form][-1] + self.late)
        if self.width - self.late not in _WIDTHS[self.form]:
            raise ValueError(
                f"column {self.name}: width = {self.width}; allowed for a {self.form}: "
                f"{', '.join(map(str, _WIDTHS[self.form]))}"
            )
        if self.part.isidentifier() != (self.form in JOINTS):
            raise ValueError(
                f"column {self.name}: part = {self.part!r}; allowed: a name of letters, digits and "
                f"_ with a form of {', '.join(JOINTS)}, and none with another form"
            )

    @property
    def field(self) -> tuple[str, type[np.float64], tuple[int]]:
        """Its field in a step's records."""
        return self.name, np.float64, (self.width,)


_NOTHING = np.dtype([("nothing", np.float64)])  # state or configuration of a part that has none


@dataclass(frozen=True, kw_only=True, eq=False)
class Component:
    """A part of the craft, or of what surrounds and steers it; what it lacks keeps its default.

    Hooks (`hooks.HOOKS`) are called through `hooks.named`. Components are compared by identity,
    because comparing all that they declare takes a while.

    Attributes
    ----------
    name : str
        Value of the parameter that selects it among those of its kind.
    parameters : tuple of Parameter
        What it can be configured with.
    configure : callable
        From the checked parameter values of its node to the record that the step reads; or to a
        tuple of that record and the arrays whose addresses are in it. Raises ConfigurationError.
    configuration : numpy.dtype
        What `configure` makes.
    state : numpy.dtype
        What it remembers between steps; all zero before the first.
    inputs : tuple of Column
        What it reads at each instant; nothing, if it is a function of time alone.
    outputs : tuple of Column
        What it gives at each instant.
    step : callable
        Kernel ``step(inputs, state, configuration, outputs)``, all of them records. The first has
        the fields `stamp_ns` and `t` [s], then one for each input; the last one for each output.
        If one of another package raises, or gives what no node takes (`given`), it gives NaN only.
    advice : callable
        From the state after a step to what the user should know.
    advices : callable
        From the state to the number of its latest advice, which rises with every new one.
    exact : callable
        Of our own sensors: from the parameter values to True if what they give is the truth itself,
        which is then not recorded. Beside sensors of another package the truth is always recorded.
    limits : tuple of str
        Of actuators: the parameters that limit its torque; a weaker one has all of them smaller.
    quiet : mapping of str to value
        Parameters with which it has no noise, no dead zone, no stiction and no motion of its own.
    torque : callable, optional
        Of actuators whose limits are not on axes: what `torques` gives, from parameter values.
    faults : callable
        From parameter values to its parts that can fail, by name, each with a tuple of `Failure`;
        a component with such parts has the parameter `faults`.
    least_impulse : callable, optional
        Of actuators that act in pulses: from parameter values to the angular impulse [N·m·s] of
        each part's shortest pulse, body, shape (n, 3).
    period : callable
        Of actuators that act in pulses: from parameter values to the time [s] from the beginning of
        a pulse to that of the next; 0 if it acts in each step.
    bound : callable, optional
        Of environments: from parameter values to the bound of the torque's norm [N·m].
    motion_bounds : callable, optional
        Of references: from parameter values and a duration [s] to bounds of ‖ω_d‖ [rad/s], ‖ω_d'‖
        [rad/s²] and ‖ω_d''‖ [rad/s³] for that time.
    noise : callable, optional
        Of sensors or an estimator that tell the law its motion: from parameter values and the steps
        per second [Hz] to variances of attitude [rad²] and bias of the rate [rad²/s²] on the worst
        axis, once they have settled, and σ of the rate's white noise [rad/√s]. `check` compares the
        envelopes with them, and a verdict what sensors told with the truth.
    conditions : callable
        From parameter values and a `Task` to the conditions that `check` tells.
    observes : bool
        Of laws: True if it has a rate observer of its own, so that none is put before it.
    """

    name: str
    parameters: tuple[Parameter, ...] = ()
    configure: Callable[[Mapping[str, Any]], Any] = lambda _: np.zeros((), _NOTHING)[()]
    configuration: np.dtype[Any] = _NOTHING
    state: np.dtype[Any] = _NOTHING
    inputs: tuple[Column, ...] = ()
    outputs: tuple[Column, ...]
    step: Callable[[Any, Any, Any, Any], None]
    advice: Callable[[Any], Advice] = lambda _: Advice("", warning=False)
    advices: Callable[[Any], int] = lambda _: 0
    exact: Callable[[Mapping[str, Any]], bool] = lambda _: False
    limits: tuple[str, ...] = ()
    quiet: Mapping[str, Any] = field(default_factory=dict)
    torque: Callable[[Mapping[str, Any]], tuple[float, float]] | None = None
    faults: Callable[[Mapping[str, Any]], Mapping[str, tuple[Any, ...]]] = lambda _: {}
    least_impulse: Callable[[Mapping[str, Any]], NDArray[np.float64]] | None = None
    period: Callable[[Mapping[str, Any]], float] = lambda _: 0.0
    bound: Callable[[Mapping[str, Any]], float] | None = None
    motion_bounds: Callable[[Mapping[str, Any], float], tuple[float, float, float]] | None = None
    noise: Callable[[Mapping[str, Any], float], tuple[float, float, float]] | None = None
    conditions: Callable[[Mapping[str, Any], Task], Iterable[Condition]] = lambda *_: ()
    observes: bool = False

    def __post_init__(self) -> None:
        """Refuse a declaration that contradicts itself; name each hook in its errors."""
        for hook in HOOKS:
            if ask := getattr(self, hook):
                object.__setattr__(self, hook, named(self.name, hook, ask))
        for columns in (self.inputs, self.outputs):
            names = ["stamp_ns", "t", *(column.name for column in columns)]
            twice = [name for name in names if names.count(name) > 1]
            if twice:
                raise ValueError(f"component {self.name}: two columns are named {twice[0]}")
        for name in ("configuration", "state"):
            if getattr(self, name).hasobject:
                raise ValueError(
                    f"component {self.name}: {name} = {getattr(self, name)}; allowed: a record of "
                    "numbers"
                )
        for parameter in self.parameters:
            parameter.demand_declarable()
        for name in ("limits", "quiet"):
            if unknown := set(getattr(self, name)) - set(self.defaults):
                raise ValueError(
                    f"component {self.name}: {name} = {getattr(self, name)}; it has no parameter "
                    f"{', '.join(sorted(unknown))}"
                )

    def extended(
        self,
        name: str,
        made: Mapping[str, tuple[Any, Callable[[Mapping[str, Any]], Any]]] = MappingProxyType({}),
        state: Iterable[Any] = (),
        *,
        parameters: Iterable[Parameter] = (),
        inputs: Iterable[Column] = (),
        outputs: Iterable[Column] = (),
        **others: Any,
    ) -> "Component":
        """Return this component with further fields and columns, so its step may call this one's.

        `made` has the type of each further field of the configuration, and the function that makes
        it from the parameter values; `state` has further fields of the state, as for `record_type`.
        Parameters and columns are appended. `others`, at least a step, replace attributes.
        """
        fields = ((field, kind) for field, (kind, _) in made.items())
        configuration = record_type(self.configuration, *fields)

        def configure(values: Mapping[str, Any]) -> Any:
            more = {field: make(values) for field, (_, make) in made.items()}
            ours = self.configure(values)
            if isinstance(ours, tuple):
                record, *kept = ours
                return (filled(configuration, record, **more), *kept)
            return filled(configuration, ours, **more)

        return replace(
            self,
            name=name,
            parameters=(*self.parameters, *parameters),
            configure=configure,
            configuration=configuration,
            state=record_type(self.state, *state),
            inputs=(*self.inputs, *inputs),
            outputs=(*self.outputs, *outputs),
            **others,
        )

    def torques(self, values: Mapping[str, Any]) -> tuple[float, float] | None:
        """Torque on an axis [N·m] that an actuator gives in any direction, and its largest one.

        None if the parameter values do not tell.
        """
        if self.torque is not None:
            return self.torque(values)
        told = [values.get(name) for name in self.limits]
        limits = [float(each) for each in told if isinstance(each, int | float)]
        return (min(limits), max(limits)) if limits else None

    @cached_property
    def defaults(self) -> dict[str, Any]:
        """Default of each parameter."""
        return {parameter.name: parameter.default for parameter in self.parameters}

    @cached_property
    def places(self) -> dict[str, slice]:
        """Where each output column is among the numbers that a step gives."""
        found, start = {}, 0
        for column in self.outputs:
            found[column.name] = slice(start, start + column.width)
            start += column.width
        return found

    @cached_property
    def input_record(self) -> np.dtype[Any]:
        """Record that the step reads: the instant [ns] and [s], then a field for each column."""
        return record_type(("stamp_ns", np.int64), ("t", np.float64), *self.inputs)

    @cached_property
    def output_record(self) -> np.dtype[Any]:
        """Record that the step fills: a field for each column."""
        return record_type(*self.outputs)


def read_from_elsewhere(components: Iterable[Component]) -> tuple[Column, ...]:
    """Columns that components read and that none of them gives, each once."""
    chosen = tuple(components)
    given = {column.name for component in chosen for column in component.outputs}
    needed = {column.name: column for component in chosen for column in component.inputs}
    return tuple(column for name, column in needed.items() if name not in given)
