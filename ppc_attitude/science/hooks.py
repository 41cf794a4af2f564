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

"""The hooks of a component, and what each of them may return.

Anything else that a hook does becomes an error that names the hook and the component, because the
component may be of a package that its user did not write.
"""

import re
from collections.abc import Callable, Mapping
from functools import wraps
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ppc_attitude.science.conditions import Condition
from ppc_attitude.science.errors import ConfigurationError

PART = re.compile(r"[\w/.+-]+")
"""Form of the name of a part that can fail, which is one word in the text of a fault."""


class Advice(NamedTuple):
    """A component's advice to its user.

    Attributes
    ----------
    text : str
        The advice.
    warning : bool
        True if the user should act.
    failed : bool
        True if the component's outputs cannot be relied on any more.
    numbers : mapping of str to float
        What the component counts and measures of itself; each name contains its unit.
    """

    text: str
    warning: bool
    failed: bool = False
    numbers: Mapping[str, float] = MappingProxyType({})


def _advice(given: Any) -> Advice:
    if not isinstance(given, Advice) or not isinstance(given.text, str):
        raise TypeError(f"{given!r}; allowed: an Advice with a text")
    if not all(isinstance(name, str) for name in given.numbers):
        raise TypeError(f"numbers = {given.numbers!r}; allowed: a number for each name")
    return given._replace(numbers={name: float(n) for name, n in given.numbers.items()})


def _parts(given: Any) -> dict[str, Any]:
    for part, failures in dict(given).items():  # a Failure is a tuple, its fields are not
        if not PART.fullmatch(part) or not all(isinstance(each, tuple) for each in failures):
            raise ValueError(f"{part!r}: {failures!r}; allowed: a name without space and Failures")
    return dict(given)


def _size(given: Any) -> float:
    if not float(given) >= 0.0:  # so written, it also refuses NaN
        raise ValueError(f"{given!r}; allowed: a number ≥ 0")
    return float(given)


def _sizes(given: Any) -> tuple[float, float]:
    certain, most = map(_size, given)
    if certain > most:
        raise ValueError(f"{given!r}; allowed: a certain torque up to the largest one")
    return certain, most


def _impulses(given: Any) -> NDArray[np.float64]:
    impulses = np.asarray(given, np.float64)
    if impulses.ndim != 2 or impulses.shape[1] != 3 or not np.isfinite(impulses).all():
        raise ValueError(f"{given!r}; allowed: finite numbers [N·m·s], three for each part")
    return impulses


def _three_sizes(given: Any) -> tuple[float, float, float]:
    first, second, third = map(_size, given)
    return first, second, third


def _conditions(given: Any) -> tuple[Condition, ...]:
    found = tuple(given)
    if not all(isinstance(each, Condition) for each in found):
        raise TypeError(f"{found!r}; allowed: Conditions")
    return found


HOOKS: dict[str, Callable[[Any], Any]] = {
    "configure": lambda made: made,
    "advice": _advice,
    "advices": int,
    "exact": bool,
    "torque": _sizes,
    "faults": _parts,
    "least_impulse": _impulses,
    "period": _size,
    "bound": _size,
    "motion_bounds": _three_sizes,
    "noise": _three_sizes,
    "conditions": _conditions,
}
"""Each hook by name, with the function that checks and converts its answer."""


def named(component: str, hook: str, ask: Callable[..., Any]) -> Callable[..., Any]:
    """Return a hook that checks its answer, and whose errors name it and its component."""
    ask = getattr(ask, "asks", ask)  # unwrapped, if another component checked it before

    @wraps(ask)
    def asked(*given: Any) -> Any:
        try:
            return HOOKS[hook](ask(*given))
        except (ConfigurationError, KeyboardInterrupt):
            raise
        except BaseException as error:
            raise ConfigurationError(
                f"component {component}: {hook} raised {type(error).__name__}: {error}"
            ) from error

    vars(asked)["asks"] = ask
    return asked
