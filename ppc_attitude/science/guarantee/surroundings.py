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


"""Whether a scenario lies within what a certificate assumes, as far as its parameters tell."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.actuators import ideal
from ppc_attitude.science.environments import none
from ppc_attitude.science.environments import paper as environment
from ppc_attitude.science.environments.paper import ENVIRONMENT_BOUND, ENVIRONMENT_RATE_BOUND
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guarantee.assumptions import Assumptions
from ppc_attitude.science.kinds import (
    ACTUATORS,
    ENVIRONMENTS,
    NONE,
    REFERENCES,
    SENSORS,
    Kind,
)
from ppc_attitude.science.references import paper
from ppc_attitude.science.sensors import direct

_GRID = 1e-3  # [s] on which the reference is searched for its fastest instant
_HORIZON = 3600.0  # [s] for which a design looks at the reference
_NOISE = 6.0  # deviations that a design takes as the bound of an estimation error
_DEVIATIONS = 5.0  # a Gaussian error this often its deviation is taken as its bound


def reference_bounds(reference: Mapping[str, Any], duration: float) -> tuple[float, float, float]:
    """Bounds of ‖ω_d‖ [rad/s], ‖ω_d'‖ [rad/s²] and ‖ω_d''‖ [rad/s³] for a time [s].

    The first two are searched on a grid; what they may gain between two points is added.
    """
    amplitude, period = (np.array(reference[each]) for each in ("amplitude", "period_constant"))
    t = reference["begin"] + np.arange(0.0, duration + _GRID, _GRID)
    phases = [t / each for each in period]
    fastest = float(np.linalg.norm(amplitude / period))
    second = float(np.linalg.norm(amplitude / period**2))

    def largest(scale: NDArray[np.float64], functions: tuple[np.ufunc, ...], slope: float) -> float:
        pairs = zip(scale, functions, phases, strict=True)
        squares = sum((a * function(phase)) ** 2 for a, function, phase in pairs)
        return float(np.sqrt(np.max(squares))) + 0.5 * _GRID * slope

    return (
        largest(amplitude, (np.cos, np.sin, np.cos), fastest),
        largest(amplitude / period, (np.sin, np.cos, np.sin), second),
        second,
    )


def broken_assumptions(
    assumed: Assumptions,
    h: float,
    plant: Mapping[str, Any],
    reference: Mapping[str, Any],
    injector: Mapping[str, Any],
    duration: float,
) -> Iterator[str]:
    """Yield each assumption that the scenario does not keep, with both numbers.

    Parameters
    ----------
    assumed : Assumptions
        What the certificate assumes.
    h : float
        Sample time that it is for [s].
    plant, reference, injector : mapping
        Checked parameters of the nodes.
    duration : float
        How long the reference is followed [s].
    """
    if 1.0 / plant["rate"] > h * (1 + 1e-9):
        yield f"rate = {plant['rate']:g} Hz; the certificate is for at least {1.0 / h:g} Hz"
    error = inertia_error(np.array(assumed.inertia), np.array(plant["inertia"]))
    if error > assumed.e_S + 1e-12:
        yield f"the craft's inertia is {error:.3g} off; assumed: at most e_S = {assumed.e_S:g}"
    if plant["max_torque"] < assumed.eta * assumed.max_torque:
        yield (
            f"max_torque = {plant['max_torque']:g} N·m; "
            f"assumed: at least {assumed.eta * assumed.max_torque:g}"
        )
    if plant["min_torque"] > assumed.dead_band:
        yield f"min_torque = {plant['min_torque']:g} N·m; assumed: at most {assumed.dead_band:g}"
    if plant["late_command"] and assumed.late < 1.0:
        yield "late_command = true; assumed: a command acts with its own sample (late = 0)"
    for name, sigma, bound in (
        ("attitude_noise", plant["attitude_noise"], assumed.e_A),
        ("rate_noise", plant["rate_noise"], assumed.e_W),
    ):
        if _DEVIATIONS * sigma > bound:
            yield (
                f"{name} = {sigma:g}: {_DEVIATIONS:g} deviations pass the assumed bound {bound:g}"
            )
    yield from _unknown(plant, reference, injector)
    if _selected(REFERENCES, reference) != paper.COMPONENT.name:
        return
    for name, value in zip(("W", "W1", "W2"), reference_bounds(reference, duration), strict=True):
        if value > getattr(assumed, name):
            yield f"the reference reaches {value:.4g}; assumed: {name} = {getattr(assumed, name):g}"
    acts = _selected(ENVIRONMENTS, injector) == environment.COMPONENT.name
    if acts and assumed.d < ENVIRONMENT_BOUND:
        yield f"the environment reaches {ENVIRONMENT_BOUND:g} N·m; assumed: d = {assumed.d:g}"


def _unknown(
    plant: Mapping[str, Any], reference: Mapping[str, Any], injector: Mapping[str, Any]
) -> Iterator[str]:
    """Yield each selected component whose bounds are not known here."""
    for kind, values, known in (
        (REFERENCES, reference, (paper.COMPONENT,)),
        (SENSORS, plant, (direct.COMPONENT,)),
        (ACTUATORS, plant, (ideal.COMPONENT,)),
        (ENVIRONMENTS, injector, (environment.COMPONENT, none.COMPONENT)),
    ):
        name = _selected(kind, values)
        if name not in {each.name for each in known}:
            yield f"{kind.selector} = {name}: whether it keeps the assumed bounds is not known"


def _selected(kind: Kind, values: Mapping[str, Any]) -> str:
    """Name of the selected component of a kind."""
    found = kind.selected(values)
    return found.name if found else NONE


def inertia_error(known: NDArray[np.float64], true: NDArray[np.float64]) -> float:
    """‖S‖ with J = Ĵ^½ (I + S) Ĵ^½, of nine numbers each [kg·m²]."""
    moments, axes = np.linalg.eigh(known.reshape(3, 3))
    root = axes / np.sqrt(moments) @ axes.T
    return float(np.abs(np.linalg.eigvalsh(root @ true.reshape(3, 3) @ root - np.eye(3))).max())


def assumptions_from(
    plant: Mapping[str, Any],
    reference: Mapping[str, Any],
    injector: Mapping[str, Any],
    controller: Mapping[str, Any],
    declared: Mapping[str, float],
) -> Assumptions:
    """Read from the nodes' parameters what a design may assume.

    Parameters
    ----------
    plant, reference, injector, controller : mapping
        Checked parameters of the nodes.
    declared : mapping of str to float
        Assumptions by name that stand over what the parameters tell.
    """
    W, W1, W2 = reference_bounds(reference, _HORIZON)
    acts = _selected(ENVIRONMENTS, injector) == environment.COMPONENT.name
    needed = {"W": REFERENCES, "W1": REFERENCES, "W2": REFERENCES, "d": ENVIRONMENTS}
    values = {REFERENCES.name: reference, ENVIRONMENTS.name: injector}
    known = {paper.COMPONENT.name, environment.COMPONENT.name, none.COMPONENT.name}
    for name, kind in needed.items():
        selected = _selected(kind, values[kind.name])
        if selected not in known and name not in declared:
            raise ConfigurationError(
                f"{kind.selector} = {selected} tells no bound {name}: give it with "
                f"--assume {name}=VALUE"
            )
    found = {
        "dead_band": plant["min_torque"],
        "d": ENVIRONMENT_BOUND if acts else 0.0,
        "D1": ENVIRONMENT_RATE_BOUND if acts else 0.0,
        "W": _raised(W),
        "W1": _raised(W1),
        "W2": _raised(W2),
        "Omega": math.radians(3.0),
        "eta": 1.0,
        "e_S": 0.0,
        "e_A": _NOISE * plant["attitude_noise"],
        "e_W": _NOISE * plant["rate_noise"],
        "late": float(plant["late_command"]),
    }
    return Assumptions(
        inertia=tuple(controller["inertia"]),
        max_torque=min(plant["max_torque"], controller["max_torque"]),
        **{**found, **declared},
    )


def _raised(value: float) -> float:
    """Round up to four digits, so that a file says what was used."""
    if value == 0.0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) - 3)
    return float(f"{math.ceil(value / unit) * unit:.4g}")
