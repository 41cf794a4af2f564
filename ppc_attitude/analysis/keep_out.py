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

"""How near the craft came to its keep-out cones: the truth, so its error is in it."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ppc_attitude.analysis.series import finite, has
from ppc_attitude.analysis.truth import truth_of
from ppc_attitude.contract.run_record import RunRecord
from ppc_attitude.contract.topics import REFERENCE
from ppc_attitude.science.guidance.cones import DIRECTIONS, HALF_ANGLES
from ppc_attitude.science.guidance.goals import closest_angles
from ppc_attitude.science.kinds import REFERENCES
from ppc_attitude.science.orbit import CURSOR
from ppc_attitude.science.references import goal


class Approach(NamedTuple):
    """The nearest that a body axis came to the direction of its cone.

    Attributes
    ----------
    direction : str
        What the cone is about.
    angle, half_angle : float
        The smallest angle reached, and the smallest allowed [rad].
    """

    direction: str
    angle: float
    half_angle: float


def approaches_of(record: RunRecord) -> list[Approach]:
    """Nearest approach to each keep-out cone; none if the run had no cones or no attitude."""
    values: Mapping[str, Any] = record.parameters.get(REFERENCE, {})
    attitude = truth_of(record).attitude
    if REFERENCES.selected(values) is not goal.COMPONENT or not values.get(HALF_ANGLES.name):
        return []
    if not has(record, attitude):
        return []
    known = {parameter.name: parameter.default for parameter in goal.COMPONENT.parameters}
    record_of_goals, _ = goal.configure({**known, **values})
    seen = finite(record[attitude])
    angles = closest_angles(
        np.ascontiguousarray(record.stamps_ns[seen]),
        np.ascontiguousarray(record[attitude][seen], float),
        record_of_goals,
        np.zeros((), CURSOR)[()],
    )
    names, half_angles = values[DIRECTIONS.name], values[HALF_ANGLES.name]
    names = list(names) * len(half_angles) if len(names) == 1 else names
    return [Approach(*each) for each in zip(names, angles.tolist(), half_angles, strict=True)]
