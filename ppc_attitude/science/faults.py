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

"""Faults of the craft's hardware: what fails, how, from when to when.

A fault is a text such as ``wheel/2 effectiveness 0.3 from 40 for 10``. A component declares which
of its parts can fail and how, keeps the faults that are its own in its configuration, and asks at
each step which of them act. Of several faults of one kind and one part the last one counts.
"""

import math
import re
from collections.abc import Iterable, Mapping
from enum import IntEnum, auto
from typing import Any, NamedTuple

import numpy as np

from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.hooks import PART
from ppc_attitude.science.kernel import kernel
from ppc_attitude.science.parameter import Parameter, exact_text, record_type
from ppc_attitude.science.stamps import LATEST, nanoseconds, span

MOST_FAULTS = 16
_FOR_EVER = np.iinfo(np.int64).max
_WORD = rf"({PART.pattern})"
_TEXT = re.compile(rf"{_WORD} {_WORD}((?: [\w.+-]+)*?)(?: from {_WORD})?(?: for {_WORD})?")
_ORDER = "PART KIND [NUMBERS] [from TIME] [for DURATION]"
FAULTS = Parameter(
    "faults",
    [""],
    f"what fails, up to {MOST_FAULTS} texts {_ORDER}, times in s, such as "
    "`wheel/2 effectiveness 0.3 from 40 for 10`; docs/faults.md lists parts and kinds",
)


class How(IntEnum):
    """Kinds of faults; texts have their names in small letters."""

    EFFECTIVENESS = auto()
    BIAS = auto()
    STUCK = auto()
    DRAG = auto()
    SEIZED = auto()
    FROZEN = auto()
    NOISE = auto()
    SATURATED = auto()
    DEAD = auto()
    BLIND = auto()
    OUTLIERS = auto()
    STUCK_CLOSED = auto()
    STUCK_OPEN = auto()


class Failure(NamedTuple):
    """A way in which a part can fail.

    Attributes
    ----------
    kind : How
        What happens to the part.
    numbers : int
        How many numbers the fault takes.
    low, high : float
        Range of these numbers.
    unit : str
        Their unit.
    multiplies : tuple of str
        Parameters that the fault multiplies: one of them at least must not be zero.
    """

    kind: How
    numbers: int = 0
    low: float = -1e6
    high: float = 1e6
    unit: str = ""
    multiplies: tuple[str, ...] = ()


Parts = Mapping[str, tuple[Failure, ...]]
OF_A_TORQUE = (
    Failure(How.EFFECTIVENESS, 1, 0.0, 1.0),
    Failure(How.BIAS, 1, unit="N·m"),
    Failure(How.STUCK, 1, unit="N·m"),
)
FAULT = record_type(
    ("part", np.int64),  # place among the component's parts
    ("kind", np.int64),  # of `How`
    ("start_ns", np.int64),  # first instant [ns] at which it acts
    ("end_ns", np.int64),  # first instant [ns] at which it no longer acts
    ("value", np.float64, (3,)),
)
RECORD = record_type(("count", np.int64), ("fault", FAULT, (MOST_FAULTS,)))


class Fault(NamedTuple):
    """A fault as its text says it."""

    part: str  # what fails
    kind: str  # how it fails
    numbers: tuple[str, ...]  # how much
    start_ns: int  # first instant [ns] at which it acts
    end_ns: int  # first instant [ns] at which it no longer acts

    @property
    def what(self) -> str:
        """The text without its times."""
        return " ".join((self.part, self.kind, *self.numbers))

    def acts(self, stamp_ns: int) -> bool:
        """True if it acts at an instant [ns], where no later one takes its place."""
        return self.start_ns <= stamp_ns < self.end_ns


def fault_of(text: str, shortest: float = 0.0) -> Fault:
    """Parse the text of a fault.

    Parameters
    ----------
    text : str
        The fault.
    shortest : float
        Least allowed duration [s].

    Raises
    ------
    ConfigurationError
        It is no such text, or a time is not allowed; the message names it.
    """
    found = _TEXT.fullmatch(" ".join(text.split()))
    if found is None:
        raise ConfigurationError(f"{FAULTS.name}: {text!r}; allowed: {_ORDER}")
    part, kind, numbers, since, duration = found.groups()
    start = 0.0 if since is None else _number(text, "from", since, 0.0, LATEST, "s")
    start_ns, end_ns = nanoseconds(start), _FOR_EVER
    if duration is not None:
        end_ns = span(start, _number(text, "for", duration, shortest, LATEST, "s"))[1]
    return Fault(part, kind, tuple(numbers.split()), start_ns, end_ns)


def _number(text: str, name: str, word: str, low: float, high: float, unit: str) -> float:
    try:
        number = float(word)
    except ValueError:
        number = math.nan
    if not low <= number <= high:
        allowed = f"a number from {exact_text(low)} to {exact_text(high)} {unit}".rstrip()
        raise ConfigurationError(f"{FAULTS.name}: {text!r}: {name} {word}; allowed: {allowed}")
    return number


def fault_texts(values: Mapping[str, Any]) -> list[str]:
    """Texts of all faults, from parameter values, which may come from a bag of unknown origin."""
    given = values.get(FAULTS.name, [])
    return [str(text) for text in given if str(text).strip()] if isinstance(given, list) else []


def acting_of(texts: Iterable[str], stamp_ns: int) -> list[str]:
    """Faults that act at an instant [ns], without their times; other texts are left out."""
    found = {}
    for text in texts:
        try:
            fault = fault_of(text)
        except ConfigurationError:
            continue
        if fault.acts(stamp_ns):
            found[fault.part, fault.kind] = fault.what
    return list(found.values())


def see_that_parts_exist(values: Mapping[str, Any], parts: Parts) -> None:
    """Check that every fault is of one of the parts that the craft has.

    Raises
    ------
    ConfigurationError
        One is not; the message names it.
    """
    for text in fault_texts(values):
        if text.split()[0] not in parts:
            raise ConfigurationError(
                f"{FAULTS.name}: {text!r}: no selected component has a part {text.split()[0]}; "
                f"allowed: {', '.join(parts) or 'none'}"
            )


def faults_of(values: Mapping[str, Any], parts: Parts) -> Any:
    """Record of dtype `RECORD` of those faults that are of the given parts.

    Parameters
    ----------
    values : mapping
        Checked parameter values.
    parts : mapping of str to tuple of Failure
        Parts of a component, and how each can fail.

    Raises
    ------
    ConfigurationError
        A fault of one of the parts is invalid, or there are too many; the message names it.
    """
    record = np.zeros((), RECORD)[()]
    texts = fault_texts(values)
    if len(texts) > MOST_FAULTS:
        raise ConfigurationError(
            f"{FAULTS.name} has {len(texts)} texts; allowed: up to {MOST_FAULTS}"
        )
    names = list(parts)
    mine = [text for text in texts if text.split()[0] in parts]
    for i, text in enumerate(mine):
        fault = fault_of(text, 1.0 / values.get("rate", math.inf))
        how = _failure(text, fault, parts[fault.part], values)
        numbers = [
            _number(text, fault.kind, word, how.low, how.high, how.unit) for word in fault.numbers
        ]
        part, times = names.index(fault.part), (fault.start_ns, fault.end_ns)
        record["fault"][i] = (part, how.kind, *times, (*numbers, 0.0, 0.0, 0.0)[:3])
    record["count"] = len(mine)
    return record


def _failure(
    text: str, fault: Fault, possible: tuple[Failure, ...], values: Mapping[str, Any]
) -> Failure:
    """Return the failure that a fault names; check its numbers, and what it multiplies."""
    named = {each.kind.name.lower(): each for each in possible}
    if fault.kind not in named:
        raise ConfigurationError(
            f"{FAULTS.name}: {text!r}: {fault.part} has no fault {fault.kind}; "
            f"allowed: {', '.join(named)}"
        )
    how = named[fault.kind]
    if len(fault.numbers) != how.numbers:
        raise ConfigurationError(
            f"{FAULTS.name}: {text!r}: {fault.kind} has {len(fault.numbers)} numbers; allowed: "
            f"{how.numbers}{f' in {how.unit}' if how.unit else ''}, in a text {_ORDER}"
        )
    if how.multiplies and not any(values[name] for name in how.multiplies):
        raise ConfigurationError(
            f"{FAULTS.name}: {text!r}: {fault.kind} multiplies "
            f"{' and '.join(how.multiplies)}, which is 0; allowed: only where that is > 0"
        )
    return how


@kernel
def acting(faults: Any, part: int, kind: How, stamp_ns: int) -> int:
    """Place of the last fault of a kind of a part that acts at an instant [ns]; −1 if none does."""
    for i in range(faults.count - 1, -1, -1):
        fault = faults.fault[i]
        if fault.part == part and fault.kind == kind and fault.start_ns <= stamp_ns < fault.end_ns:
            return i
    return -1


@kernel
def number_of(faults: Any, part: int, kind: How, stamp_ns: int, without: float) -> float:
    """Return the first number of the fault that acts, or `without` if none does."""
    i = acting(faults, part, kind, stamp_ns)
    return float(faults.fault[i].value[0]) if i >= 0 else without


@kernel
def fails(faults: Any, part: int, stamp_ns: int) -> bool:
    """True if any fault of a part acts at an instant [ns]."""
    for i in range(faults.count):
        fault = faults.fault[i]
        if fault.part == part and fault.start_ns <= stamp_ns < fault.end_ns:
            return True
    return False


@kernel
def faulty(asked: float, limit: float, faults: Any, part: int, stamp_ns: int) -> float:
    """Output of an actuator with faults: `asked` times its effectiveness, plus a bias; or stuck.

    A fault does not make it exceed the limit.
    """
    weak = number_of(faults, part, How.EFFECTIVENESS, stamp_ns, 1.0) * asked
    biased = weak + number_of(faults, part, How.BIAS, stamp_ns, 0.0)
    given = number_of(faults, part, How.STUCK, stamp_ns, biased)
    return min(max(given, -limit), limit)
