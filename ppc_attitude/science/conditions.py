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

"""Conditions on parameters, which `check` prints, and the task that they are checked against."""

import math
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from numbers import Real
from typing import Any

_RELATIONS: dict[str, Callable[[float, float], bool]] = {
    ">": operator.gt,
    "≥": operator.ge,
    "≤": operator.le,
}


@dataclass(frozen=True)
class Condition:
    """One condition.

    Attributes
    ----------
    name : str
        Short name, the paper's where it has one.
    value, limit : float
        The number, and what it is compared with.
    relation : str
        ``>``, ``≥`` or ``≤``: how value and limit must compare.
    unit : str
        Of both; empty if they have none.
    necessary : bool
        False for one that may be violated.
    meaning : str
        What it says.
    sufficient : bool, optional
        True if it promises something, which a run may keep without it, too: that it does not hold
        is told, and is no warning.
    """

    name: str
    value: float
    limit: float
    relation: str
    unit: str
    necessary: bool
    meaning: str
    sufficient: bool = False

    def __post_init__(self) -> None:
        """Refuse what compares nothing or cannot be printed; make NumPy's numbers plain ones."""
        texts, numbers = (self.name, self.unit, self.meaning), (self.value, self.limit)
        if (
            self.relation not in _RELATIONS
            or not all(isinstance(each, str) for each in texts)
            or not all(isinstance(each, Real) for each in numbers)
        ):
            between = ", ".join(_RELATIONS)
            raise ValueError(f"{self}; allowed: numbers, {between} between them, and texts")
        for name, plain in (("value", float), ("limit", float), ("necessary", bool)):
            object.__setattr__(self, name, plain(getattr(self, name)))

    @property
    def holds(self) -> bool:
        """True if the condition is met."""
        return bool(_RELATIONS[self.relation](self.value, self.limit))


def advisable(name: str, value: float, limit: float, unit: str, meaning: str) -> Condition:
    """Condition ``value ≤ limit`` that may be violated, with a warning: it is advice."""
    return Condition(name, value, limit, "≤", unit, False, meaning)


def promised(
    name: str, value: float, limit: float, relation: str, unit: str, meaning: str
) -> Condition:
    """Condition that suffices for what its meaning says; a run may keep that without it, too."""
    return Condition(name, value, limit, relation, unit, False, meaning, sufficient=True)


@dataclass(frozen=True)
class Task:
    """The rest of the craft and its requirements, which a component's conditions may look at.

    Attributes
    ----------
    craft : mapping of str to value
        Checked values of the parameters that the selected parts of the craft have, by name.
    error : tuple of float
        Attitude error q_e at the start, x y z w.
    duration : float
        Length of the run [s]; 0 if it has no end.
    desired_rate : float or None
        Largest ‖ω_d‖ [rad/s]; None if nobody knows it. With goals it is that of a whole slew, which
        a slew that is broken off may exceed.
    slews_from : float or None
        When the first slew begins [s], infinite if none is scheduled; None without slews.
    actuator_torque : float
        Torque on an axis [N·m] that the actuator gives in any direction; if the actuator does not
        tell, the limit of what the law may ask for.
    torque : float
        The lesser of `actuator_torque` and what the law may ask for [N·m].
    environment : float
        Largest norm of the environment's torque [N·m], as far as it is known.
    attitude_sigma, rate_sigma : float
        σ of the noise in q_ev [1], and in z2 [rad/s] of a law with `k`, `M_omega` and `beta` of
        `ppc`, on the worst axis; 0 if nobody knows it.
    rate_limit : float or None
        Required bound of ‖ω_s‖ [deg/s].
    settled : tuple of float
        Required limits of max_i |q_ev,i| and ‖q_ev‖.
    deadline : float
        When the error must be within these limits [s].
    wish : str
        The requirement, in words.
    """

    craft: Mapping[str, Any]
    error: tuple[float, float, float, float]
    duration: float
    desired_rate: float | None
    slews_from: float | None
    actuator_torque: float
    torque: float
    environment: float
    attitude_sigma: float
    rate_sigma: float
    rate_limit: float | None
    settled: tuple[float, float]
    deadline: float
    wish: str

    def settles(self, name: str, needs: float, who: str) -> Iterator[Condition]:
        """Compare the time [s] that a law or limit needs to settle from rest with the deadline.

        It is advice: a craft that turns at the start, or about another axis, may be faster. Nothing
        is asked of a craft that starts within the required accuracy.
        """
        x, y, z, _ = self.error
        component, whole = self.settled
        if max(abs(x), abs(y), abs(z)) <= component and math.hypot(x, y, z) <= whole:
            return
        rest = self.deadline - needs
        left = f"which leaves {rest:.3g} s" if rest >= 0.0 else f"which is {-rest:.3g} s too few"
        asked = f"the requirement is {self.deadline:g} s"
        meaning = f"{self.wish} needs {needs:.3g} s {who}; {asked}, {left}"
        if math.isinf(needs):
            meaning = f"{self.wish} is not reached within an hour {who}; {asked}"
        yield advisable(name, needs, self.deadline, "s", meaning)
