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

"""Requirements of a run: limits and deadlines, the paper's unless a file says otherwise."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import NoneType
from typing import Any, get_args

import numpy as np

from ppc_attitude.analysis.envelopes import ENVELOPES, Envelope
from ppc_attitude.contract.declared import BY_COLUMN
from ppc_attitude.contract.run_record import Array
from ppc_attitude.contract.yaml_file import read
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.parameter import nearest
from ppc_attitude.science.stamps import LATEST

ACTUATOR = "actuator"
DEGREES = "deg"


@dataclass(frozen=True)
class Accuracy:
    """A limit on an attitude error."""

    limit: float  # what the error must stay below
    unit: str = ""  # empty if max_i |q_ev,i| is meant, `deg` if the angle of the rotation is

    @property
    def component(self) -> float:
        """The limit on max_i |q_ev,i|; for an angle, the value that no smaller rotation exceeds."""
        return math.sin(math.radians(self.limit) / 2.0) if self.unit == DEGREES else self.limit

    @property
    def bounds(self) -> tuple[float, float]:
        """Limit of max_i |q_ev,i| and ‖q_ev‖; 1 is no bound."""
        return (1.0, self.component) if self.unit == DEGREES else (self.component, 1.0)

    def __str__(self) -> str:
        """As in a requirements file."""
        return f"{self.limit:g} {self.unit}".rstrip()


def component_size(rows: Array) -> Array:
    """Largest magnitude of the first three numbers of each row, shape (n,)."""
    return np.asarray(np.maximum.reduce(np.abs(rows[:, :3]).T))


@dataclass(frozen=True)
class Requirements:
    """The requirements that a run is judged by; the defaults are the paper's."""

    settled: Accuracy = Accuracy(5e-3)  # the attitude has settled while its error is below
    settling_deadline: float = 60.0
    """When it must have settled, and how long after a hit the terminal accuracy may take [s]."""
    terminal: Accuracy | None = Accuracy(5e-4)  # what the error must stay below at the end
    terminal_window: float = 20.0  # how long the end is [s]
    rate: float | None = 3.0  # largest ‖ω_s‖ before the first sudden disturbance [deg/s]
    torque: float | str | None = ACTUATOR
    """Largest applied torque on an axis [N·m]; `ACTUATOR`: the plant's own limit."""
    recovery: float = 10.0  # longest recovery from a sudden disturbance [s]
    outside_after_hit: float | None = 0.5
    """How long a sudden disturbance may put a rate error outside its envelope [s]."""
    chatter: float | None = None
    """Amplitude of torque that alternates from sample to sample, from the deadline on [N·m]."""
    momentum: float | None = None  # largest momentum of the wheels together [N·m·s]
    goal: float | None = None  # longest time from an order to its goal [s]
    knowledge: Accuracy | None = None  # how far what the controller is told may be from the truth
    limits: Mapping[str, float] = field(default_factory=dict)
    """Column of the record, such as `wheel_torque`, to what each of its numbers may reach."""

    def to_json(self) -> dict[str, Any]:
        """As in a requirements file."""
        return {each.name: _plain(getattr(self, each.name)) for each in fields(self)}


def _plain(value: Any) -> Any:
    if isinstance(value, Accuracy):
        return str(value) if value.unit else value.limit
    return dict(value) if isinstance(value, Mapping) else value


PAPER = Requirements()
_NAMES = tuple(each.name for each in fields(Requirements))
_ACCURACIES = ("settled", "terminal", "knowledge")
_TIMES = ("settling_deadline", "terminal_window", "recovery", "outside_after_hit", "goal")
_OPTIONAL = tuple(each.name for each in fields(Requirements) if NoneType in get_args(each.type))


def load_requirements(paths: Iterable[Path]) -> Requirements:
    """Read requirements from files; what no file names is the paper's, and later files win.

    Raises
    ------
    ConfigurationError
        A file cannot be read, or a name or value is not allowed; the message names all three.
    """
    required = PAPER
    for path in paths:
        content = read(path, "requirements file")
        if content is None:
            continue
        if not isinstance(content, Mapping):
            raise ConfigurationError(f"requirements file {path}: it must be `name: value` lines")
        try:
            named = {name: _checked(name, value) for name, value in content.items()}
        except ConfigurationError as error:
            raise ConfigurationError(f"requirements file {path}: {error}") from None
        if "limits" in named:
            named["limits"] = {**required.limits, **named["limits"]}
        required = replace(required, **named)
    return required


def _checked(name: Any, value: Any) -> Any:
    _known(name, _NAMES, "requirement")
    if value is None and name in _OPTIONAL:
        return None
    if name == "torque" and value == ACTUATOR:
        return value
    if name == "limits":
        if not isinstance(value, Mapping):
            raise ConfigurationError(f"limits = {value!r}; allowed: a mapping of column to number")
        return {
            _known(column, BY_COLUMN, "column"): _positive(f"limits: {column}", each)
            for column, each in value.items()
        }
    if name in _ACCURACIES:
        return _accuracy(name, value)
    if name in _TIMES:
        return _positive(name, value, LATEST, " s")
    return _positive(name, value, also=f" or {ACTUATOR!r}" if name == "torque" else "")


def names_of(required: Requirements) -> dict[str, str]:
    """`Requirement.key` to name of all that a run may be judged by, in the order of a verdict."""
    return {
        "settling_time": "settling time",
        "error_after_deadline": f"attitude error from {required.settling_deadline:g} s on",
        "terminal_error": f"attitude error in the last {required.terminal_window:g} s",
        "rate": "angular rate (norm)",
        "applied_torque": "applied torque on an axis",
        **{key: name for each in ENVELOPES for key, name in outside_names(each).items()},
        "recovery": "recovery from a sudden disturbance",
        **{f"limit_{column}": column.replace("_", " ") for column in required.limits},
        "chatter": "torque that alternates from sample to sample",
        "momentum": "momentum of the wheels (norm)",
        "wheel_speed": "speed of a wheel, share of its limit",
        "fuel": "fuel that the thrusters used",
        "refused_orders": "orders that the guidance refused",
        "goal_time": "time from an order to its goal",
        "keep_out": "angle inside a keep-out cone",
        "certificate": "certificate held: time outside its bounds",
        "reported_error": "difference in the reported attitude error",
        "knowledge": "knowledge error (truth against estimate)",
        "knowledge_outside": "share of knowledge errors outside 3σ, worst axis",
        "nis": "mean NIS of the fixes, distance from 3",
        "refused_fixes": "good fixes refused",
        "lost_messages": "messages missing or not finite",
    }


def outside_names(envelope: Envelope) -> dict[str, str]:
    """Names of what an envelope is judged by, as of `names_of`: after a hit apart, if it jumps."""
    key, name = f"outside_{envelope.bound}", f"{envelope.name} outside its envelope"
    after_hit = {f"{key}_after_hit": f"{name}, after a hit"} if envelope.jumps else {}
    return {key: name, **after_hit}


def _known(name: Any, names: Iterable[str], what: str) -> str:
    """Name of a requirement, or of a column: whatever is installed declares all that can be."""
    known = tuple(names)
    if name not in known:
        hint = nearest(str(name), known) or f"; allowed: {', '.join(known)}"
        raise ConfigurationError(f"there is no {what} {name}{hint}")
    return str(name)


def _accuracy(name: str, value: Any) -> Accuracy:
    text = str(value).strip()
    if text.endswith(DEGREES):
        angle = text.removesuffix(DEGREES).rstrip()
        return Accuracy(_positive(name, angle, 180.0, " deg"), DEGREES)
    return Accuracy(_positive(name, value, 1.0, ", or an angle such as `0.1 deg`"))


def _positive(name: str, value: Any, high: float = math.inf, also: str = "") -> float:
    """Check a number from YAML, or from the text before a unit."""
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (0.0 < number <= high and math.isfinite(number)):
        most = f", ≤ {high:g}" if math.isfinite(high) else ""
        none = "; null for no such requirement" if name in _OPTIONAL else ""
        raise ConfigurationError(f"{name} = {value!r}; allowed: a number > 0{most}{also}{none}")
    return number
