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

"""Attitude and gyro bias from a gyro and a star tracker: a multiplicative extended Kalman filter.

`filter` has the mathematics, and `late_fixes` handles fixes that are late or do not fit. Here they
become a component, which also states how good its estimate is.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ppc_attitude.science.attitude import conjugate, logarithm, product, rotation_matrix
from ppc_attitude.science.compiled_stamps import nanoseconds, seconds
from ppc_attitude.science.component import BODY, MOTION, VECTOR, Column, Component
from ppc_attitude.science.conditions import Condition, Task, advisable
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.estimators.filter import NOTHING, Knowledge, diagonal, plus_diagonal
from ppc_attitude.science.estimators.late_fixes import (
    FILTER,
    INNOVATIONS,
    MEMORY,
    last_interval,
    newest,
    recalled,
    take_fix,
    take_sample,
)
from ppc_attitude.science.estimators.steady_state import settled_knowledge
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kernel import (
    NO_ATTITUDE,
    ZERO,
    kernel,
    norm,
    quaternion,
    store,
    store_quaternion,
    subtract,
    vector,
)
from ppc_attitude.science.parameter import Parameter, filled
from ppc_attitude.science.sensors.gyro import (
    ANGULAR_RANDOM_WALK,
    INITIAL_BIAS_SIGMA,
    RATE_RANDOM_WALK,
    RESOLUTION,
    sample_variance,
)
from ppc_attitude.science.sensors.gyro_star_tracker import GYRO_SAMPLE, STAR_FIX
from ppc_attitude.science.sensors.star_tracker import (
    BORESIGHT_NOISE,
    CROSS_NOISE,
    INITIAL_FIX,
    LATENCY,
    MOUNTING,
    NO_FIX,
    RATE,
    sigmas,
    unit_mounting,
)
from ppc_attitude.science.signals import TOLD

ESTIMATE = Column(
    "estimate",
    "estimator/state",
    MOTION,
    BODY,
    "1",
    "estimated attitude x y z w [1] and rate [rad/s], each with the covariance [rad², rad²/s²] of "
    "its error about the body's axes, q = q̂ ⊗ exp(δθ)",
)
GYRO_BIAS = Column(
    "gyro_bias", "estimator/gyro_bias", VECTOR, BODY, "rad/s", "estimated bias of the gyro"
)
GYRO_BIAS_SIGMA = Column(
    "gyro_bias_sigma",
    "estimator/gyro_bias_sigma",
    VECTOR,
    BODY,
    "rad/s",
    "standard deviation of the bias estimate",
)
INNOVATION = Column(
    "innovation",
    "estimator/innovation",
    VECTOR,
    BODY,
    "1",
    "normalised innovation of a fix, S^(−½) z; its square is the NIS",
    width=4,
    late=True,
)
PARAMETERS = (
    ANGULAR_RANDOM_WALK,
    RATE_RANDOM_WALK,
    INITIAL_BIAS_SIGMA,
    RESOLUTION,
    CROSS_NOISE,
    BORESIGHT_NOISE,
    MOUNTING,
    RATE,
    LATENCY,
    INITIAL_FIX,
    Parameter("gate", 25.0, "a fix with a larger squared innovation is refused", above=0.0),
    Parameter(
        "lost_sigma", 0.01, "3σ of the attitude from which on it counts as lost", "rad", above=0.0
    ),
)
_WORSE = 3.0  # times by which a noise, or σ by which the mounting, may be off the filter's number
_STALE_SLOTS = 5  # slots of the tracker without a fix after which the user hears of it
_SHARPEST = 1e-15  # [rad] its square is still far above the smallest float
_MOST_UNEVEN = 1e4  # largest ratio of the tracker's two noises
_LEAST_TOLD = 1e-12  # least share that a fix's variance may be of the attitude's before it
_MISSED = 100  # fixes in a row that may be missing before the first one
# If the filter is right, a hundred fixes have a mean NIS above it once in 10¹¹ times.
_MOST_NIS = 5.0
_GOOD, _WAITING, _DARK, _SURPRISED, _DOUBTFUL, _STALE, _LOST, _NO_RATE = range(8)


def filter_record(values: Mapping[str, Any]) -> Any:
    """Record of dtype `FILTER` from checked parameters.

    Raises
    ------
    ConfigurationError
        The mounting is not a unit quaternion, or a variance is zero where the filter divides by it.
    """
    mounting = unit_mounting(values)
    axes = np.array(rotation_matrix(mounting))  # tracker to body
    variances = np.square(sigmas(values))
    for parameter in (CROSS_NOISE, BORESIGHT_NOISE):
        if values[parameter.name] < _SHARPEST:
            raise ConfigurationError(
                f"{parameter.name} = {values[parameter.name]} rad; allowed: ≥ {_SHARPEST:g}, "
                "because the filter weighs a fix by its covariance"
            )
    low, high = sorted((values[CROSS_NOISE.name], values[BORESIGHT_NOISE.name]))
    if high > _MOST_UNEVEN * low:
        raise ConfigurationError(
            f"{CROSS_NOISE.name} and {BORESIGHT_NOISE.name} are {high / low:.3g} times apart; "
            f"allowed: up to {_MOST_UNEVEN:g}, beyond which rounding hides the smaller variance"
        )
    white = values[ANGULAR_RANDOM_WALK.name] ** 2
    gap = _MISSED / values[RATE.name]
    most = math.sqrt((low**2 + white * gap) / _LEAST_TOLD) / gap
    if values[INITIAL_BIAS_SIGMA.name] > most:
        raise ConfigurationError(
            f"{INITIAL_BIAS_SIGMA.name} = {values[INITIAL_BIAS_SIGMA.name]} rad/s; allowed: up to "
            f"{most:.3g} with these noises of tracker and gyro, beyond which rounding hides what a "
            f"fix tells of the bias, if {_MISSED} were missed before"
        )
    return filled(
        FILTER,
        values,
        white=white,
        rounding=values[RESOLUTION.name] ** 2 / 12.0,
        walk=values[RATE_RANDOM_WALK.name] ** 2,
        bias_variance=values[INITIAL_BIAS_SIGMA.name] ** 2,
        fix_covariance=(axes @ np.diag(variances) @ axes.T)[np.triu_indices(3)],
        fix_variance=variances.max(),
        unmounting=conjugate(mounting),
        stale=_STALE_SLOTS / values[RATE.name] + values[LATENCY.name],
    )


@kernel
def _judge(memory: Any, settings: Any, stamp_ns: int, known: Knowledge) -> None:
    """Say how good the estimate is."""
    variance = diagonal(known[2])
    memory.sigma = math.sqrt(max(variance[0], variance[1], variance[2]))
    memory.age = seconds(stamp_ns - memory.fix_ns)
    verdict = _GOOD
    if memory.count == 0:
        verdict = _NO_RATE
    elif memory.knows == 0.0:
        verdict = _DARK if memory.age > settings.stale else _WAITING
    elif 3.0 * memory.sigma > settings.lost_sigma:
        verdict = _LOST
    elif memory.age > settings.stale:
        verdict = _STALE
    elif memory.doubtful != 0.0:
        verdict = _DOUBTFUL
    elif memory.used >= INNOVATIONS and memory.mean_nis > _MOST_NIS:
        verdict = _SURPRISED
    if verdict != memory.verdict:
        memory.verdicts += 1
    memory.verdict = verdict


def advice(memory: Any) -> Advice:
    """Advice to the user about the estimate."""
    arcsec = 3.0 * float(memory["sigma"]) * 180.0 * 3600.0 / math.pi
    told, mean = min(int(memory["used"]), INNOVATIONS), float(memory["mean_nis"])
    age, verdict = float(memory["age"]), int(memory["verdict"])
    none = f"no fix for {age:.3g} s"
    if memory["doubtful"]:
        none = f"no fix used for {age:.3g} s, the last one was refused"
    elif memory["unmatched"]:
        stray = f"{int(memory['unmatched'])} fixes have the stamp of no gyro sample"
        none = f"no fix used for {age:.3g} s, {stray}"
    text = {
        _GOOD: "tracking",
        _WAITING: "no fix yet",
        _DARK: f"{none}, so no estimate",
        _SURPRISED: f"the last {told} fixes have a mean NIS of {mean:.3g}; expected: 3",
        _DOUBTFUL: "the last fix was refused",
        _STALE: none,
        _LOST: f"lost: {none}",
        _NO_RATE: "lost: the gyro gives no rate",
    }[verdict]
    if verdict not in (_WAITING, _DARK, _NO_RATE):
        text += f", 3σ = {arcsec:.4g}″"
    numbers = {
        "fixes": int(memory["fixes"]),
        "fixes refused": int(memory["refused"]),
        "fixes of no known instant": int(memory["unmatched"]),
        "begun anew": int(memory["begun_anew"]),
        "age of the last fix used [s]": age,
        "3σ of the attitude [arcsec]": arcsec,
        f"mean NIS of {told}": mean,
    }
    return Advice(text, verdict > _WAITING, failed=verdict in (_LOST, _NO_RATE), numbers=numbers)


@kernel
def _lose(stamp_ns: int, state: Any, settings: Any, outputs: Any) -> None:
    """Give no estimate, because there is no rate to propagate one; begin anew with the next."""
    state.count = 0
    state.knows = 0.0
    _judge(state, settings, stamp_ns, NOTHING)
    store_quaternion(outputs.attitude, NO_ATTITUDE)
    store(outputs.angular_velocity, ZERO)
    store(outputs.gyro_bias, ZERO)
    store(outputs.gyro_bias_sigma, ZERO)
    outputs.estimate[:] = 0.0
    outputs.estimate[4] = outputs.estimate[13] = -1.0  # REP 145: there is no such quantity


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Estimate the motion of an instant; an instant that is repeated is not filtered again."""
    if state.count > 0 and inputs.stamp_ns <= state.stamps_ns[newest(state)]:
        return
    outputs.innovation[:] = 0.0
    if inputs.gyro[3] < 0.0:
        _lose(inputs.stamp_ns, state, configuration, outputs)
        return
    rate = vector(inputs.gyro)
    take_sample(state, configuration, inputs.stamp_ns, rate)
    row = inputs.star_fix
    fix = quaternion(row)
    if fix != NO_FIX:
        valid_ns = inputs.stamp_ns - nanoseconds(row[7])
        whitened, told = take_fix(state, configuration, valid_ns, fix)
        if told:
            store(outputs.innovation, whitened)
            outputs.innovation[3] = row[7]
    known = recalled(state, newest(state))
    _judge(state, configuration, inputs.stamp_ns, known)
    q, b, theta, _, bias = known
    omega = subtract(rate, b)
    store_quaternion(outputs.attitude, q)
    store(outputs.angular_velocity, omega)
    store(outputs.gyro_bias, b)
    sigma = diagonal(bias)
    store(outputs.gyro_bias_sigma, (math.sqrt(sigma[0]), math.sqrt(sigma[1]), math.sqrt(sigma[2])))
    # x y z w, P_θθ, rate, its covariance P_bb + variance of a sample.
    message = outputs.estimate
    store_quaternion(message, q)
    store(message[10:], omega)
    variance, h = inputs.gyro[3], last_interval(state)
    if h > 0.0:  # from the filter's own parameters, once the interval is known
        white, rounding, walk = configuration.white, configuration.rounding, configuration.walk
        variance = sample_variance(white, rounding, walk, h)
    spread = plus_diagonal(bias, variance)
    for i in range(6):
        message[4 + i] = theta[i]
        message[13 + i] = spread[i]
    if state.knows == 0.0:
        message[4] = -1.0  # REP 145: there is no such quantity


def conditions(values: Mapping[str, Any], task: Task) -> Iterator[Condition]:
    """Compare the sensors with what the filter takes them for, where these are not the same."""
    for each in PARAMETERS:
        true, taken = task.craft.get(each.name), values[each.name]
        if true in (None, taken):
            continue
        both = f"{each.name} = {_short(true)} of the sensors, {_short(taken)} of the filter: "
        if each is MOUNTING:
            turn = product(conjugate(unit_mounting(task.craft)), unit_mounting(values))
            value, most, unit = norm(logarithm(turn)), _WORSE * values[CROSS_NOISE.name], "rad"
            what = f"a fix is off by less than {_WORSE:g}σ of its noise across the boresight"
        else:
            value, most, unit = (true / taken if taken else math.inf), _WORSE, ""
            what = "the sensor is not much worse than the filter takes it for"
        yield advisable(each.name, float(value), most, unit, both + what)


def _short(value: float | Sequence[float]) -> str:
    """Write a number, or numbers, for a reader."""
    if isinstance(value, Sequence):
        return f"[{', '.join(map(_short, value))}]"
    return f"{value:g}"


COMPONENT = Component(
    name="mekf",
    parameters=PARAMETERS,
    configure=filter_record,
    configuration=FILTER,
    state=MEMORY,
    inputs=(GYRO_SAMPLE, STAR_FIX),
    outputs=(*TOLD, ESTIMATE, GYRO_BIAS, GYRO_BIAS_SIGMA, INNOVATION),
    step=step,
    advice=advice,
    advices=lambda memory: int(memory["verdicts"]),
    noise=settled_knowledge,
    conditions=conditions,
)
