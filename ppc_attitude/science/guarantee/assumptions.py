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

"""The assumptions of a guarantee about craft and surroundings, and the numbers of its law."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

from ppc_attitude.science.controllers.tube_parameters import ASSUMED, PREFIX
from ppc_attitude.science.guarantee.arithmetic import Arithmetic

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Assumptions:
    """The craft, its actuator, disturbance, reference and measurement, as far as they are known."""

    inertia: tuple[float, ...]  # [kg·m²] Ĵ, row-major, as the law knows it
    max_torque: float  # [N·m] actuator limit per axis
    dead_band: float  # [N·m] command below which the actuator gives no torque
    d: float  # [N·m] bound of the disturbance torque per axis
    momentum: float  # [N·m·s] bound of ‖Jω + h‖ of craft and wheels
    W: float  # [rad/s] bound of ‖ω_d‖
    W1: float  # [rad/s²] bound of ‖ω_d'‖
    W2: float  # [rad/s³] bound of ‖ω_d''‖
    Omega: float  # [rad/s] rate limit of the craft
    eta: float  # least fraction of the command that the actuator gives
    e_S: float  # relative error of the inertia, ‖S‖
    e_A: float  # [rad] estimation error of the attitude
    e_W: float  # [rad/s] estimation error of the rate
    late: float  # 1 if a command may act up to a sample late, else 0
    lead: float = 0.0  # [rad] largest angle beyond half a turn by which the law may go round


@dataclass(frozen=True)
class Law:
    """The numbers of the law; see `science.controllers.momentum_tube`."""

    h: float
    k: float
    kappa: float
    ell: float
    brake: Triple
    a_most: float
    a_rate: float
    Omega_e: float
    Y: Triple
    B: Triple
    B_ramp: float
    z_bar: float
    V_rate: float
    far: float
    w_far: float
    omega0: float
    d_max: float
    N: Triple


_Numbers = TypeVar("_Numbers", Assumptions, Law)


def exact(numbers: _Numbers, arithmetic: Arithmetic) -> _Numbers:
    """The same numbers, each of them exactly in an arithmetic."""
    number = arithmetic.number
    found: dict[str, Any] = {
        name: tuple(map(number, value)) if isinstance(value, tuple) else number(value)
        for name, value in vars(numbers).items()
    }
    return replace(numbers, **found)


# Parameter of each number.
_ASSUMED = {
    **{each: f"{PREFIX}assumed.{each}" for each in ASSUMED},
    "inertia": "inertia",
    "max_torque": "max_torque",
    "e_A": PREFIX + "e_A",
    "lead": PREFIX + "lead",
}
_LAW = {each.name: PREFIX + each.name for each in fields(Law)}


def assumptions_of(values: Mapping[str, Any]) -> Assumptions:
    """Read the assumptions from the controller's checked parameters."""
    return Assumptions(**_read(values, _ASSUMED))


def law_of(values: Mapping[str, Any]) -> Law:
    """Read the law's numbers from the controller's checked parameters."""
    return Law(**_read(values, _LAW))


def _read(values: Mapping[str, Any], names: Mapping[str, str]) -> dict[str, Any]:
    chosen = {each: values[parameter] for each, parameter in names.items()}
    return {name: tuple(v) if isinstance(v, list) else v for name, v in chosen.items()}


def parameters_of(assumed: Assumptions, law: Law) -> dict[str, Any]:
    """Parameters of the controller: what `assumptions_of` and `law_of` read."""
    numbers = {parameter: getattr(law, each) for each, parameter in _LAW.items()}
    numbers |= {parameter: getattr(assumed, each) for each, parameter in _ASSUMED.items()}
    return {name: list(v) if isinstance(v, tuple) else v for name, v in numbers.items()}
