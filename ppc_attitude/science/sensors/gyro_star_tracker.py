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

"""A gyro and a star tracker: the sensors of a craft whose law is not told the truth.

The gyro gives one sample per instant, the mean rate since the previous instant. The tracker gives
one fix per slot, which arrives late: the fix that comes with an instant was valid some steps ago.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import exponential, normalised, product
from ppc_attitude.science.compiled_stamps import seconds, stamp_of, step_of
from ppc_attitude.science.component import BODY, FIX, GYRO, STAR_TRACKER, Column, Component
from ppc_attitude.science.conditions import Condition, Task, advisable
from ppc_attitude.science.faults import FAULTS, RECORD, Failure, How, acting, faults_of, number_of
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kernel import (
    ZERO,
    Quaternion,
    Vector,
    add,
    kernel,
    quaternion,
    scale,
    store,
    store_quaternion,
    vector,
)
from ppc_attitude.science.magnetorquers import B_DOT, LAW
from ppc_attitude.science.parameter import RATE, filled, record_type
from ppc_attitude.science.plants.rigid_body import INITIAL_RATE
from ppc_attitude.science.sensors import gyro, star_tracker
from ppc_attitude.science.sensors.direct import SEED
from ppc_attitude.science.signals import TRUTH

GYRO_SAMPLE = Column(
    "gyro",
    "imu/data_raw",
    GYRO,
    BODY,
    "rad/s",
    "measured mean rate of the interval that ends at the stamp, and its variance [rad²/s²], −1 if "
    "there is no rate",
)
STAR_FIX = Column(
    "star_fix",
    "star_tracker/attitude",
    FIX,
    STAR_TRACKER,
    "1",
    "measured attitude, tracker to inertial, x y z w, at the stamp of its validity; its variances "
    "[rad²] about the tracker's axes, the first one −1 if there is no fix",
    late=True,
)
_GYRO, _TRACKER = 0, 1
PARTS = {
    "gyro": (
        Failure(How.FROZEN),
        Failure(How.BIAS, 3, unit="rad/s"),
        Failure(
            How.NOISE,
            1,
            0.0,
            multiplies=(gyro.ANGULAR_RANDOM_WALK.name, gyro.RATE_RANDOM_WALK.name),
        ),
        Failure(How.SATURATED),
        Failure(How.DEAD),
    ),
    "star_tracker": (
        Failure(How.BLIND),
        Failure(How.BIAS, 3, unit="rad"),
        Failure(
            How.NOISE,
            1,
            0.0,
            multiplies=(star_tracker.CROSS_NOISE.name, star_tracker.BORESIGHT_NOISE.name),
        ),
        Failure(How.OUTLIERS, 1, 0.0, 1.0, multiplies=(star_tracker.OUTLIER_SIZE.name,)),
        Failure(How.DEAD),
    ),
}
_SLOTS = 1024  # pending fixes, more than MAX_DELAY
assert star_tracker.MAX_DELAY < _SLOTS
CONFIGURATION = record_type(
    RATE,
    star_tracker.INITIAL_FIX,
    ("gyro", gyro.GYRO),
    ("tracker", star_tracker.STAR_TRACKER),
    ("coarse", np.float64),  # ratio of the gyro's LSB to its noise, if above 1: a dead band; else 0
    ("faults", RECORD),
)
STATE = record_type(
    ("started", np.float64),
    ("coarse", np.float64),  # as in the configuration
    ("news", np.int64),
    ("stamp_ns", np.int64),  # of the last sample
    ("attitude", np.float64, (4,)),  # true attitude at it
    ("bias", np.float64, (3,)),  # [rad/s] of the gyro at it
    ("told", np.float64, (3,)),  # [rad/s] by the gyro, at it
    ("noise", gyro.NOISE),
    ("fixes", np.float64, (_SLOTS, 4)),  # of the recent slots, some still on their way
)


@kernel
def _failed_gyro(sample: Vector, state: Any, configuration: Any, stamp_ns: int) -> Vector:
    """Rate [rad/s] that the gyro gives with its faults, from the one without."""
    faults, most = configuration.faults, configuration.gyro.full_scale
    if acting(faults, _GYRO, How.SATURATED, stamp_ns) >= 0:
        sample = (
            math.copysign(most, sample[0]),
            math.copysign(most, sample[1]),
            math.copysign(most, sample[2]),
        )
    if acting(faults, _GYRO, How.FROZEN, stamp_ns) >= 0 and state.started != 0.0:
        sample = vector(state.told)
    return sample


@kernel
def _sense_rate(inputs: Any, state: Any, configuration: Any, outputs: Any, step: int) -> None:
    settings = configuration.gyro
    q = quaternion(inputs.truth_attitude)
    faults, stamp_ns = configuration.faults, inputs.stamp_ns
    louder = number_of(faults, _GYRO, How.NOISE, stamp_ns, 1.0)
    white, walk = gyro.gyro_noise(settings, step, state.noise)
    if state.started == 0.0:
        # Nothing to average over yet: the sample is the rate of the instant.
        h = 1.0 / configuration.rate
        rate = vector(inputs.truth_angular_velocity)
        bias = vector(settings.initial_bias)
        middle = bias
    else:
        h = seconds(inputs.stamp_ns - state.stamp_ns)
        rate = gyro.mean_rate(quaternion(state.attitude), q, h)
        before = vector(state.bias)
        bias = gyro.walked_bias(settings, before, scale(louder, walk), h)
        middle = scale(0.5, add(before, bias))
    i = acting(faults, _GYRO, How.BIAS, stamp_ns)
    if i >= 0:
        middle = add(middle, vector(faults.fault[i].value))
    sample = gyro.gyro_sample(settings, rate, middle, white, h, louder)
    sample = _failed_gyro(sample, state, configuration, stamp_ns)
    store(state.told, sample)
    store(outputs.gyro, sample)
    sigma_v, lsb, sigma_u = settings.white, settings.resolution, settings.walk
    outputs.gyro[3] = gyro.sample_variance(
        sigma_v * sigma_v, lsb * lsb / 12.0, sigma_u * sigma_u, h
    )
    if acting(faults, _GYRO, How.DEAD, stamp_ns) >= 0:
        store(outputs.gyro, ZERO)
        outputs.gyro[3] = -1.0  # REP 145: there is no such quantity
    store(state.bias, bias)
    store_quaternion(state.attitude, q)


@kernel
def _arriving(configuration: Any, step: int) -> int:
    """Step of validity of the fix that arrives at a step; −1 if none does."""
    if configuration.initial_fix != 0.0 and step == 0:
        return 0
    valid = step - configuration.tracker.delay
    known = configuration.initial_fix != 0.0 and valid == 0
    return valid if star_tracker.is_slot(configuration.tracker, valid) and not known else -1


@kernel
def _sensed_fix(inputs: Any, configuration: Any, step: int) -> Quaternion:
    """Fix of a slot, with the tracker's faults."""
    tracker, faults, stamp_ns = configuration.tracker, configuration.faults, inputs.stamp_ns
    q, omega = quaternion(inputs.truth_attitude), vector(inputs.truth_angular_velocity)
    for how in (How.BLIND, How.DEAD):
        if acting(faults, _TRACKER, how, stamp_ns) >= 0:
            return star_tracker.NO_FIX
    louder = number_of(faults, _TRACKER, How.NOISE, stamp_ns, 1.0)
    outliers = number_of(faults, _TRACKER, How.OUTLIERS, stamp_ns, 0.0)
    fix = star_tracker.star_fix(tracker, q, omega, stamp_ns, step, louder, outliers)
    i = acting(faults, _TRACKER, How.BIAS, stamp_ns)
    if i < 0 or fix == star_tracker.NO_FIX:
        return fix
    return normalised(product(fix, exponential(vector(faults.fault[i].value))))


@kernel
def _sense_stars(inputs: Any, state: Any, configuration: Any, outputs: Any, step: int) -> None:
    tracker = configuration.tracker
    if star_tracker.is_slot(tracker, step):
        fix = _sensed_fix(inputs, configuration, step)
        store_quaternion(state.fixes[step // tracker.every % _SLOTS], fix)
    row = outputs.star_fix
    valid = _arriving(configuration, step)
    if valid < 0:
        row[:] = 0.0
        return
    fix = quaternion(state.fixes[valid // tracker.every % _SLOTS])
    store_quaternion(row, fix)
    for i in range(3):
        row[4 + i] = tracker.sigma[i] * tracker.sigma[i]
    if fix == star_tracker.NO_FIX:
        row[4] = -1.0
    row[7] = seconds(inputs.stamp_ns - stamp_of(valid, configuration.rate))


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Measure the motion of an instant; an instant that is repeated is not measured again."""
    if state.started != 0.0 and inputs.stamp_ns <= state.stamp_ns:
        return
    state.news += configuration.coarse != state.coarse
    state.coarse = configuration.coarse
    number = step_of(inputs.stamp_ns, configuration.rate)
    _sense_rate(inputs, state, configuration, outputs, number)
    _sense_stars(inputs, state, configuration, outputs, number)
    state.stamp_ns = inputs.stamp_ns
    state.started = 1.0


def _coarse(values: Mapping[str, Any]) -> float:
    """Ratio of the gyro's LSB to the noise of a sample, if above 1: a dead band; else 0."""
    white, lsb = values[gyro.ANGULAR_RANDOM_WALK.name], values[gyro.RESOLUTION.name]
    noise = white * math.sqrt(values[RATE.name])
    if lsb <= noise:
        return 0.0
    return lsb / noise if noise else math.inf


def advice(state: Any) -> Advice:
    """Warn of a gyro that rounds its own noise away."""
    times = float(state["coarse"])
    if not times:
        told = "the gyro's rounding acts as white noise again" if state["news"] else ""
        return Advice(told, warning=False)
    beside = f"{times:.3g} times the noise of a sample" if np.isfinite(times) else "without noise"
    return Advice(
        f"gyro.resolution is {beside}: rounding acts as a dead band, not as the white noise that "
        "a filter assumes",
        warning=True,
    )


def conditions(values: Mapping[str, Any], task: Task) -> Iterator[Condition]:
    """Compare the rates of craft and reference with the largest at which fixes come."""
    most = values[star_tracker.MAX_RATE.name]
    if INITIAL_RATE.name in task.craft and task.craft.get(LAW.name) != B_DOT:
        yield advisable(
            "rate at the start",
            float(np.linalg.norm(task.craft[INITIAL_RATE.name])),
            most,
            "rad/s",
            "a first fix comes up to star_tracker.max_rate only: without one there is no estimate, "
            f"so the law gives no torque, and only {LAW.name} {B_DOT} stops the craft",
        )
    if task.desired_rate is not None:
        yield advisable(
            "rate of the reference",
            task.desired_rate,
            most,
            "rad/s",
            "fixes come while the reference turns no faster than star_tracker.max_rate: beyond it "
            "only the gyro tells the attitude",
        )


COMPONENT = Component(
    name="gyro_star_tracker",
    parameters=(*gyro.PARAMETERS, *star_tracker.PARAMETERS, star_tracker.INITIAL_FIX, SEED, FAULTS),
    configure=lambda values: filled(
        CONFIGURATION,
        values,
        gyro=gyro.gyro_record(values),
        tracker=star_tracker.star_tracker_record(values),
        coarse=_coarse(values),
        faults=faults_of(values, PARTS),
    ),
    configuration=CONFIGURATION,
    state=STATE,
    inputs=TRUTH,
    outputs=(GYRO_SAMPLE, STAR_FIX),
    step=step,
    quiet={**gyro.QUIET, **star_tracker.QUIET},
    advice=advice,
    advices=lambda state: int(state["news"]),
    faults=lambda values: PARTS,
    conditions=conditions,
)
