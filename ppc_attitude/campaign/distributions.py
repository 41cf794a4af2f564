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
    ``normal`` (mean, deviation; low and high cut it off), ``choice`` (values).
Directions
    ``sphere``: every direction equally likely; or three numbers: that direction.
Attitudes
    ``so3``: every attitude equally likely; ``cone`` (angle): the configured attitude, turned about
    a random axis by an angle drawn uniformly up to `angle` [rad].
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, TypeAlias

import numpy as np
from numpy.random import Generator

from ppc_attitude.science.attitude import normalised, product
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.kernel import Quaternion, Vector

_LEAST_SHARE = 1e-3  # of a cut normal distribution that must remain: it is drawn by rejection


@dataclass(frozen=True)
class Range:
    """Limits of a drawn number.

    Attributes
    ----------
    low, high : float
        Smallest and largest number allowed.
    unit : str
        Unit, for errors.
    open_low : bool
        True if the number must be larger than `low`.
    """

    low: float
    high: float
    unit: str = ""
    open_low: bool = False

    def __str__(self) -> str:
        """Say what is allowed."""
        least = f"{'>' if self.open_low else '≥'} {self.low:g}"
        return f"{least} and ≤ {self.high:g} {self.unit}".rstrip()

    def holds(self, value: float) -> bool:
        """True if the number is allowed."""
        return (value > self.low if self.open_low else value >= self.low) and value <= self.high


@dataclass(frozen=True)
class Fixed:
    """Always the same number."""

    value: float

    def draw(self, stream: Generator) -> float:
        """Return the number."""
        return self.value

    def support(self) -> tuple[float, ...]:
        """Extremes of what can be drawn."""
        return (self.value,)


@dataclass(frozen=True)
class Uniform:
    """Equally likely between two numbers; with `logarithmic`, their logarithms are."""

    low: float
    high: float
    logarithmic: bool = False

    def draw(self, stream: Generator) -> float:
        """Draw a number."""
        share = stream.random()
        if self.logarithmic:
            return float(min(self.low * (self.high / self.low) ** share, self.high))
        return self.low + (self.high - self.low) * share

    def support(self) -> tuple[float, ...]:
        """Extremes of what can be drawn."""
        return (self.low, self.high)


@dataclass(frozen=True)
class Normal:
    """Normal distribution, cut off below `low` and above `high`."""

    mean: float
    deviation: float
    low: float
    high: float

    def draw(self, stream: Generator) -> float:
        """Draw a number."""
        while True:
            value = self.mean + self.deviation * stream.standard_normal()
            if self.low <= value <= self.high:
                return float(value)

    def support(self) -> tuple[float, ...]:
        """Extremes of what can be drawn."""
        return (self.low, self.high)


@dataclass(frozen=True)
class Choice:
    """One of several numbers, equally likely."""

    values: tuple[float, ...]

    def draw(self, stream: Generator) -> float:
        """Draw a number."""
        return self.values[int(stream.integers(len(self.values)))]

    def support(self) -> tuple[float, ...]:
        """Extremes of what can be drawn."""
        return (min(self.values), max(self.values))


@dataclass(frozen=True)
class Direction:
    """A unit vector: the given one, or any on the sphere if there is none."""

    vector: Vector | None

    def draw(self, stream: Generator) -> Vector:
        """Draw a direction."""
        return self.vector or on_sphere(stream)


@dataclass(frozen=True)
class Attitudes:
    """Attitudes within a turn of `angle` [rad] from the configured one; any at all if None."""

    angle: float | None

    def draw(self, stream: Generator, configured: Quaternion) -> Quaternion:
        """Draw an attitude, x y z w."""
        if self.angle is None:
            x, y, z, w = stream.standard_normal(4).tolist()
            return normalised((x, y, z, w))
        half = 0.5 * self.angle * stream.random()
        x, y, z = on_sphere(stream)
        s = math.sin(half)
        return normalised(product(configured, (s * x, s * y, s * z, math.cos(half))))


Number: TypeAlias = Fixed | Uniform | Normal | Choice


def on_sphere(stream: Generator) -> Vector:
    """Draw a unit vector, every direction equally likely."""
    z = 2.0 * stream.random() - 1.0
    angle = 2.0 * math.pi * stream.random()
    radius = math.sqrt(max(0.0, 1.0 - z * z))
    return (radius * math.cos(angle), radius * math.sin(angle), z)


def random_axes(stream: Generator) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Draw three orthonormal axes as the columns of a 3 × 3 array, every orientation alike."""
    axes, triangle = np.linalg.qr(stream.standard_normal((3, 3)))
    return np.asarray(axes * np.sign(np.diag(triangle)))


def number(name: str, declared: Any, allowed: Range) -> Number:
    """Read a distribution of numbers.

    Parameters
    ----------
    name : str
        What to call it in an error.
    declared : number or mapping
        As it stands in the YAML.
    allowed : Range
        Where all its numbers must lie.

    Raises
    ------
    ConfigurationError
        It is no distribution, or can give a number that is not allowed.
    """
    read = _read_number(name, declared)
    for end in read.support():
        if not allowed.holds(end):
            raise ConfigurationError(f"{name} can become {end:g}; allowed: {allowed}")
    return read


def _read_number(name: str, declared: Any) -> Number:
    if not isinstance(declared, Mapping):
        return Fixed(_finite(name, declared))
    kind = declared.get("distribution")
    if kind == "fixed":
        return Fixed(*_fields(name, declared, "value"))
    if kind in ("uniform", "log_uniform"):
        low, high = _fields(name, declared, "low", "high")
        _check_order(name, low, high)
        if kind == "log_uniform" and low <= 0.0:
            raise ConfigurationError(f"{name}.low = {low:g}; allowed: > 0 for log_uniform")
        return Uniform(low, high, kind == "log_uniform")
    if kind == "normal":
        return _read_normal(name, declared)
    if kind == "choice":
        values = keys(name, declared, ("distribution", "values")).get("values")
        if not isinstance(values, list) or not values:
            raise ConfigurationError(f"{name}.values = {values!r}; allowed: a list of numbers")
        return Choice(tuple(_finite(f"{name}.values", each) for each in values))
    raise ConfigurationError(
        f"{name}.distribution = {kind!r}; allowed: fixed, uniform, log_uniform, normal, choice"
    )


def _read_normal(name: str, declared: Mapping[str, Any]) -> Normal:
    keys(name, declared, ("distribution", "mean", "deviation", "low", "high"))
    mean, deviation = (_finite(f"{name}.{key}", declared.get(key)) for key in ("mean", "deviation"))
    low = _finite(f"{name}.low", declared["low"]) if "low" in declared else -math.inf
    high = _finite(f"{name}.high", declared["high"]) if "high" in declared else math.inf
    if deviation <= 0.0:
        raise ConfigurationError(f"{name}.deviation = {deviation:g}; allowed: > 0")
    _check_order(name, low, high)
    whole = NormalDist(mean, deviation)
    share = whole.cdf(high) - whole.cdf(low)
    if share < _LEAST_SHARE:
        raise ConfigurationError(
            f"{name}: only {share:.2g} of the normal distribution lies between low = "
            f"{low:g} and high = {high:g}; allowed: at least {_LEAST_SHARE:g}"
        )
    return Normal(mean, deviation, low, high)


def direction(name: str, declared: Any) -> Direction:
    """Read a direction: ``sphere`` or three numbers.

    Raises
    ------
    ConfigurationError
        It is neither, or has no length.
    """
    if declared == "sphere":
        return Direction(None)
    if not isinstance(declared, list) or len(declared) != 3:
        raise ConfigurationError(f"{name} = {declared!r}; allowed: sphere, or three numbers")
    x, y, z = (_finite(name, each) for each in declared)
    length = math.sqrt(x * x + y * y + z * z)
    if not 0.0 < length < math.inf:
        raise ConfigurationError(f"{name} = {declared} has no direction")
    return Direction((x / length, y / length, z / length))


def attitudes(name: str, declared: Any) -> Attitudes:
    """Read a distribution of attitudes: ``so3`` or ``cone``.

    Raises
    ------
    ConfigurationError
        It is neither.
    """
    kind = declared.get("distribution") if isinstance(declared, Mapping) else declared
    if kind == "so3":
        if isinstance(declared, Mapping):
            _fields(name, declared)
        return Attitudes(None)
    if kind == "cone" and isinstance(declared, Mapping):
        (angle,) = _fields(name, declared, "angle")
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
    is_number = isinstance(declared, int | float) and not isinstance(declared, bool)
    if not is_number or not math.isfinite(declared):
        raise ConfigurationError(f"{name} = {declared!r}; allowed: a finite number")
    return float(declared)
