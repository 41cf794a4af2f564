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

"""The three attitude errors of a run, kept apart.

- *control*: what the controller was told against the reference;
- *knowledge*: the truth against what the controller was told;
- *pointing*: the truth against the reference, which is what a run is judged by.

A record has the truth as columns of its own where the controller may be told something else.
Without them, `attitude` is taken for the truth, and `truth_of` says whether that is known.
"""

import math
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ppc_attitude.analysis.requirements import DEGREES, Accuracy, component_size
from ppc_attitude.analysis.series import has, is_finite, once, samples, topic_of, vectors
from ppc_attitude.contract.declared import BY_COLUMN, is_told_the_truth
from ppc_attitude.contract.run_record import Array, RunRecord
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    ATTITUDE,
    ESTIMATOR,
    PLANT,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    TRUE_ATTITUDE,
    TRUE_RATE,
)
from ppc_attitude.science.attitude import attitude_errors, rotation_angles, vectors_to_body
from ppc_attitude.science.kernel import STRAIGHT
from ppc_attitude.science.kinds import ESTIMATORS, SENSORS
from ppc_attitude.science.parameter import NodeParameters

RECORDED, EXACT, UNKNOWN = "recorded", "exact", "unknown"
STANDING = {
    RECORDED: "judged by the recorded truth",
    EXACT: "judged by `attitude`, which is the truth: sensing is exact",
    UNKNOWN: "judged by `attitude`: no truth is recorded, and nothing says that sensing is exact",
}


@dataclass(frozen=True)
class Errors:
    """Errors of one kind: base⁻¹ ⊗ attitude at each instant, NaN where it is not known."""

    quaternions: Array  # shape (n, 4), x y z w

    @cached_property
    def angles(self) -> Array:
        """Angle [rad] at each instant, shape (n,)."""
        angles = np.empty(len(self.quaternions))
        rotation_angles(np.ascontiguousarray(self.quaternions.T), angles)
        return angles

    @cached_property
    def sizes(self) -> Array:
        """max_i |q_ev,i| at each instant, shape (n,)."""
        return component_size(self.quaternions)

    def in_unit_of(self, limit: Accuracy) -> Array:
        """Size at each instant as a limit means it, shape (n,)."""
        return np.asarray(np.rad2deg(self.angles)) if limit.unit == DEGREES else self.sizes


@dataclass(frozen=True)
class Truth:
    """Where the truth of a record is."""

    attitude: str  # column
    angular_velocity: str  # column
    standing: str  # a key of `STANDING`


@once
def truth_of(record: RunRecord) -> Truth:
    """Find the truth of a record, or what stands for it."""
    if has(record, TRUE_ATTITUDE.column):  # then what was told of the rate is no truth either
        return Truth(TRUE_ATTITUDE.column, TRUE_RATE.column, RECORDED)
    rate = TRUE_RATE if has(record, TRUE_RATE.column) else ANGULAR_VELOCITY
    plant = record.parameters.get(PLANT, {})
    exact = bool(plant) and is_told_the_truth(plant)
    return Truth(ATTITUDE.column, rate.column, EXACT if exact else UNKNOWN)


def pointing_errors(record: RunRecord) -> Errors:
    """Truth against reference.

    Raises
    ------
    AnalysisError
        If the record has no attitude, or no reference.
    """
    return errors_between(record, truth_of(record).attitude, REFERENCE_ATTITUDE.column)


def control_errors(record: RunRecord) -> Errors:
    """Told attitude against the reference; raises as `pointing_errors`."""
    return errors_between(record, ATTITUDE.column, REFERENCE_ATTITUDE.column)


@once
def knowledge_errors(record: RunRecord) -> Errors:
    """Truth against what the controller was told.

    Raises
    ------
    AnalysisError
        If the record has no truth of its own, or no told attitude.
    """
    errors = errors_between(record, TRUE_ATTITUDE.column, ATTITUDE.column)
    truth, told = samples(record, TRUE_ATTITUDE.column), samples(record, ATTITUDE.column)
    # An attitude times its own inverse is off by rounding: if told and truth are equal, it is 0.
    exact = (truth == told).all(axis=1) & truth.any(axis=1)
    return Errors(np.where(exact[:, None], STRAIGHT, errors.quaternions)) if exact.any() else errors


@once
def errors_between(record: RunRecord, column: str, base: str) -> Errors:
    """base⁻¹ ⊗ column, by the kernel of the control laws.

    Raises
    ------
    AnalysisError
        If the record has no sample of a column.
    """
    return errors_of(samples(record, column), samples(record, base))


def errors_of(attitudes: Array, bases: Array) -> Errors:
    """Errors of attitudes against others, both x y z w, shape (n, 4); NaN where not known."""
    # By component, as the loop gives them: then nothing is copied.
    first, second = (np.ascontiguousarray(each.T) for each in (attitudes, bases))
    quaternions = np.empty_like(first)
    attitude_errors(first, second, quaternions)
    return Errors(quaternions.T)


def told_noise(parameters: NodeParameters) -> float:
    """σ of the attitude [rad] that the sensors tell the law, as they declare it; 0 if they do not.

    It is 0 too where an estimator stands between them.
    """
    plant, estimator = parameters.get(PLANT, {}), parameters.get(ESTIMATOR, {})
    sensors = None if ESTIMATORS.selected(estimator) else SENSORS.selected(plant)
    if sensors is not None and sensors.noise is not None:
        with suppress(KeyError, TypeError, ValueError, OverflowError):  # a bag may hold anything
            rate = float(plant.get("rate", 1.0))
            return math.sqrt(sensors.noise({**sensors.defaults, **plant}, rate)[0])
    return 0.0


def reference_rates_in_body(record: RunRecord) -> Array:
    """Desired angular velocity in body axes, C_e ω_d [rad/s], shape (n, 3); NaN where not known.

    Raises
    ------
    AnalysisError
        If the run lacks the attitude, the reference's attitude or its rate.
    """
    errors, rates = pointing_errors(record).quaternions, vectors(record, REFERENCE_RATE.column)
    turned = np.empty_like(rates)
    vectors_to_body(rates, errors, turned)
    return turned


def lost(record: RunRecord) -> int:
    """Messages that are missing, and samples that are there but not finite.

    What a run is judged by is always known: an attitude of zeros says as little as NaN. What is
    told beside a recorded truth may be unknown, while a filter has no estimate.
    """
    attitudes = (truth_of(record).attitude, REFERENCE_ATTITUDE.column)
    count = record.missing_messages
    for column, rows in record.columns.items():
        known = is_finite(record, column)
        if column not in attitudes and known.all():
            continue
        lacks = ~known
        if column in attitudes:
            lacks |= ~np.logical_or.reduce(rows.T)
        late = column in BY_COLUMN and BY_COLUMN[column].late
        if late or column in record.held:  # it comes with some instants only
            lacks &= ~np.logical_and.reduce(np.isnan(rows.T))
        count += max(int(np.count_nonzero(lacks)) - record.missing.get(topic_of(column), 0), 0)
    return count
