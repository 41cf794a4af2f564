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

"""Distributions that a campaign draws from: numbers, directions and attitudes, checked when read.

Numbers
    a bare number, or a mapping with ``distribution``:
    ``fixed`` (value), ``uniform`` (low, high), ``log_uniform`` (low, high),
    ``normal`` (mean, deviation; low and high cut it off, else the range of what is drawn does),
    ``choice`` (values).
Directions
    ``sphere``: every direction equally likely; or three numbers: that direction.
Attitudes
    ``so3``: every attitude equally likely; ``cone`` (angle): the configured attitude, turned about
    a random axis by an angle drawn uniformly up to `angle` [rad].
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from statistics import NormalDist
from typing import Any, TypeAlias

import numpy as np
from numpy.random import Generator

from ppc_attitude.contract.run_record import Array
from ppc_attitude.science.attitude import normalised, product
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guidance.cones import unit_vector
from ppc_attitude.science.guidance.rotation import about
from ppc_attitude.science.kernel import Quaternion, Vector
from ppc_attitude.science.parameter import Parameter

_LEAST_SHARE = 1e-3  # of a cut normal distribution that must remain: it is drawn by rejection


@dataclass(frozen=True)
class Number:
    """How a number is drawn, and between which extremes it is."""

    low: float
    high: float
    draw: Callable[[Generator], float]


def _uniform(low: float, high: float, stream: Generator) -> float:
    return low + (high - low) * stream.random()


def _log_uniform(low: float, high: float, stream: Generator) -> float:
    return float(min(low * (high / low) ** stream.random(), high))


def _normal(mean: float, deviation: float, low: float, high: float, stream: Generator) -> float:
    """Draw of a normal distribution that is cut off below `low` and above `high`."""
    while True:
        value = mean + deviation * stream.standard_normal()
        if low <= value <= high:
            return float(value)


def _choice(values: Sequence[float], stream: Generator) -> float:
    return values[int(stream.integers(len(values)))]  # for a single one nothing is drawn


def _one_of(values: Sequence[float]) -> Number:
    return Number(min(values), max(values), partial(_choice, values))


Direction: TypeAlias = Callable[[Generator], Vector]
"""How a unit vector is drawn."""


@dataclass(frozen=True)
class Attitudes:
    """Attitudes within a turn of `angle` [rad] from the configured one; any at all if None."""

    angle: float | None

    def draw(self, stream: Generator, configured: Quaternion) -> Quaternion:
        """Draw an attitude, x y z w."""
        if self.angle is None:
            x, y, z, w = stream.standard_normal(4).tolist()
            return normalised((x, y, z, w))
        angle = self.angle * stream.random()
        return normalised(product(configured, about(on_sphere(stream), angle)))


def _given(vector: Vector, _stream: Generator) -> Vector:
    return vector


def on_sphere(stream: Generator) -> Vector:
    """Draw a unit vector, every direction equally likely."""
    z = 2.0 * stream.random() - 1.0
    angle = 2.0 * math.pi * stream.random()
    radius = math.sqrt(max(0.0, 1.0 - z * z))
    return (radius * math.cos(angle), radius * math.sin(angle), z)


def random_axes(stream: Generator) -> Array:
    """Draw three orthonormal axes as the columns of a 3 × 3 array, every orientation alike."""
    axes, triangle = np.linalg.qr(stream.standard_normal((3, 3)))
    return np.asarray(axes * np.sign(np.diag(triangle)))


def number(name: str, declared: Any, allowed: Parameter) -> Number:
    """Read a distribution as it stands in the YAML, all of whose numbers a parameter must allow.

    An error calls it by the name.

    Raises
    ------
    ConfigurationError
        It is no distribution, or can give a number that is not allowed.
    """
    read = _read_number(name, declared, allowed)
    for end in (read.low, read.high):
        try:
            allowed.checked(end)
        except ConfigurationError:
            told = f"{allowed.allowed} {allowed.unit}".rstrip()
            raise ConfigurationError(f"{name} can become {end:g}; allowed: {told}") from None
    return read


def _read_number(name: str, declared: Any, allowed: Parameter) -> Number:
    if not isinstance(declared, Mapping):
        return _one_of([_finite(name, declared)])
    kind = declared.get("distribution")
    if kind == "fixed":
        return _one_of(_fields(name, declared, "value"))
    if kind in ("uniform", "log_uniform"):
        low, high = _fields(name, declared, "low", "high")
        _check_order(name, low, high)
        if kind == "log_uniform" and not (low > 0.0 and high / low < math.inf):
            fit = "> 0 for log_uniform, and high/low finite"
            raise ConfigurationError(f"{name}.low = {low:g}; allowed: {fit}")
        drawn = _log_uniform if kind == "log_uniform" else _uniform
        return Number(low, high, partial(drawn, low, high))
    if kind == "normal":
        return _read_normal(name, declared, allowed)
    if kind == "choice":
        values = keys(name, declared, ("distribution", "values")).get("values")
        if not isinstance(values, list) or not values:
            raise ConfigurationError(f"{name}.values = {values!r}; allowed: a list of numbers")
        return _one_of([_finite(f"{name}.values", each) for each in values])
    raise ConfigurationError(
        f"{name}.distribution = {kind!r}; allowed: fixed, uniform, log_uniform, normal, choice"
    )


def _read_normal(name: str, declared: Mapping[str, Any], allowed: Parameter) -> Number:
    least = max(allowed.low, math.nextafter(allowed.above, math.inf))
    whole = {"low": least, "high": allowed.high, **declared}
    mean, deviation, low, high = _fields(name, whole, "mean", "deviation", "low", "high")
    if deviation <= 0.0:
        raise ConfigurationError(f"{name}.deviation = {deviation:g}; allowed: > 0")
    _check_order(name, low, high)
    uncut = NormalDist(mean, deviation)
    share = uncut.cdf(high) - uncut.cdf(low)
    if share < _LEAST_SHARE:
        raise ConfigurationError(
            f"{name}: only {share:.2g} of the normal distribution lies between low = "
            f"{low:g} and high = {high:g}; allowed: at least {_LEAST_SHARE:g}"
        )
    return Number(low, high, partial(_normal, mean, deviation, low, high))


def direction(name: str, declared: Any) -> Direction:
    """Read a direction: ``sphere`` or three numbers.

    Raises
    ------
    ConfigurationError
        It is neither, or has no length.
    """
    if declared == "sphere":
        return on_sphere
    if not isinstance(declared, list) or len(declared) != 3:
        raise ConfigurationError(f"{name} = {declared!r}; allowed: sphere, or three numbers")
    x, y, z = unit_vector(name, [_finite(name, each) for each in declared]).tolist()
    return partial(_given, (x, y, z))


def attitudes(name: str, declared: Any) -> Attitudes:
    """Read a distribution of attitudes: ``so3`` or ``cone``.

    Raises
    ------
    ConfigurationError
        It is neither.
    """
    given = declared if isinstance(declared, Mapping) else {"distribution": declared}
    kind = given.get("distribution")
    if kind == "so3":
        _fields(name, given)
        return Attitudes(None)
    if kind == "cone":
        (angle,) = _fields(name, given, "angle")
        if not 0.0 <= angle <= math.pi:
            raise ConfigurationError(f"{name}.angle = {angle:g} rad; allowed: 0 to π")
        return Attitudes(angle)
    raise ConfigurationError(f"{name}.distribution = {kind!r}; allowed: so3, cone (with angle)")


def keys(name: str, declared: Any, allowed: tuple[str, ...]) -> Mapping[str, Any]:
    """Check that something is a mapping with no other keys than those allowed.

    Raises
    ------
    ConfigurationError
        It is not.
    """
    if not isinstance(declared, Mapping):
        raise ConfigurationError(
            f"{name} = {declared!r}; allowed: a mapping of {', '.join(allowed)}"
        )
    for key in declared:
        if key not in allowed:
            raise ConfigurationError(f"{name} has no {key}; allowed: {', '.join(allowed)}")
    return declared


def _fields(name: str, declared: Mapping[str, Any], *wanted: str) -> list[float]:
    """Return the numbers of a distribution: all that it needs and no others."""
    keys(name, declared, ("distribution", *wanted))
    for key in wanted:
        if key not in declared:
            raise ConfigurationError(f"{name} lacks {key}")
    return [_finite(f"{name}.{key}", declared[key]) for key in wanted]


def _check_order(name: str, low: float, high: float) -> None:
    if low > high:
        raise ConfigurationError(f"{name}.low = {low:g} is larger than high = {high:g}")


def _finite(name: str, declared: Any) -> float:
    found: Any = Parameter(name, 0.0, "a number of a distribution").checked(declared)
    return float(found)
