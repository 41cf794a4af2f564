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

"""How near a run came to its keep-out cones: by the truth, so that the craft's error is in it."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from ppc_attitude.analysis.measure import Measured
from ppc_attitude.analysis.series import has, is_finite, samples
from ppc_attitude.analysis.truth import truth_of
from ppc_attitude.analysis.verdict import Requirement
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import REFERENCE
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.guidance.cones import (
    CONE_PARAMETERS,
    DIRECTIONS,
    HALF_ANGLES,
    one_for_each,
)
from ppc_attitude.science.guidance.sight import cone_angles
from ppc_attitude.science.kinds import REFERENCES
from ppc_attitude.science.orbit import CURSOR
from ppc_attitude.science.references import goal


class Approach(NamedTuple):
    """The nearest that a body axis came to the direction of its cone."""

    direction: str  # what the cone is about
    angle: float  # the smallest reached [rad]
    half_angle: float  # the smallest allowed [rad]


def guidance_values(record: RunRecord) -> dict[str, Any] | None:
    """Parameters of a run's guidance, complete; None if it followed no goals."""
    configured: Mapping[str, Any] = record.parameters.get(REFERENCE, {})
    if REFERENCES.selected(configured) is not goal.COMPONENT:
        return None
    return {**goal.COMPONENT.defaults, **configured}


def cone_names(values: Mapping[str, Any]) -> list[str]:
    """The direction that each keep-out cone is about."""
    names = values[DIRECTIONS.name]
    return list(one_for_each(DIRECTIONS.name, names, len(values[HALF_ANGLES.name])))


def angles_to_cones(record: RunRecord, column: str, values: Mapping[str, Any]) -> Array:
    """Angle [rad] between body axis and direction of each keep-out cone, shape (n, count).

    By the attitudes, x y z w, in a column of a run, and the parameters of its guidance; NaN where
    an attitude is missing, or of zeros.

    Raises
    ------
    AnalysisError
        As of `samples`.
    ConfigurationError
        The parameters are infeasible.
    """
    attitudes = samples(record, column)
    configuration, *_kept = goal.configure(values)
    angles = np.full((record.stamps_ns.size, int(configuration["cones"]["count"])), np.nan)
    seen = is_finite(record, column) & attitudes.any(axis=1)
    angles[seen] = cone_angles(
        np.ascontiguousarray(record.stamps_ns[seen]),
        np.ascontiguousarray(attitudes[seen], float),
        configuration,
        np.zeros((), CURSOR)[()],
    )
    return angles


def approaches_of(record: RunRecord) -> list[Approach]:
    """Nearest approach to each keep-out cone; none if the run had no cones or no attitude."""
    values, attitude = guidance_values(record), truth_of(record).attitude
    if values is None or not values[HALF_ANGLES.name] or not has(record, attitude):
        return []
    angles = angles_to_cones(record, attitude, values)
    seen = angles[np.isfinite(angles).all(axis=1)]
    if not seen.size:  # of an estimator that never had a fix
        return []
    told = cone_names(values), seen.min(axis=0).tolist(), values[HALF_ANGLES.name]
    return [Approach(*each) for each in zip(*told, strict=True)]


def judge_cones(run: Measured) -> Iterator[Requirement]:
    """Judge how far the craft came into its worst keep-out cone; negative: it stayed out."""
    why = run.changed(REFERENCE, *(each.name for each in CONE_PARAMETERS))
    try:
        approaches = approaches_of(run.record)
    except ConfigurationError as error:  # a bag may hold any parameters
        approaches, why = [], str(error)
    if approaches:
        worst = max(approaches, key=lambda each: each.half_angle - each.angle)
        angle, half_angle = np.rad2deg([worst.angle, worst.half_angle])
        note = f"came within {angle:.4g}° of {worst.direction}, allowed {half_angle:.4g}°"
        yield run.row("keep_out", float(half_angle - angle), 0.0, "deg", why, note=note)
    elif why:  # cones that came in flight
        yield run.row("keep_out", None, 0.0, "deg", why)
