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

"""A filter's memory of its recent steps: samples, late fixes, refusals and restarts.

A fix arrives late. The filter goes back to the step at which the fix was valid, updates its
estimate of then, and repeats the steps since. So its estimate is, to the last bit, that of a filter
that got the same fixes without latency.

Fixes that do not fit are refused. If refused fixes agree with each other (`refusals`), the estimate
is wrong rather than they, and the filter begins anew.
"""

from typing import Any

import numpy as np

from ppc_attitude.science.attitude import product
from ppc_attitude.science.compiled_stamps import seconds
from ppc_attitude.science.estimators.filter import (
    NOTHING,
    Knowledge,
    Symmetric,
    begun,
    innovation,
    propagated,
    residual,
    updated,
)
from ppc_attitude.science.estimators.refusals import (
    BIAS_IS_WRONG,
    EARLY,
    NOTHING_YET,
    REFUSALS,
    bias_error,
    heard,
)
from ppc_attitude.science.kernel import (
    ZERO,
    Quaternion,
    Vector,
    add,
    dot,
    inlined,
    kernel,
    matrix,
    quaternion,
    store,
    store_quaternion,
    vector,
)
from ppc_attitude.science.parameter import record_type
from ppc_attitude.science.sensors.star_tracker import MAX_DELAY, TOLERANCE

FILTER = record_type(
    ("white", np.float64),  # σ_v² [rad²/s]
    ("rounding", np.float64),  # LSB²/12 [rad²/s²]: σ_v,eff² = σ_v² + Δt LSB²/12
    ("walk", np.float64),  # σ_u² [rad²/s³]
    ("bias_variance", np.float64),  # [rad²/s²] of each axis at the start
    ("fix_covariance", np.float64, (6,)),  # R [rad²] in body axes, upper triangle
    ("fix_variance", np.float64),  # largest eigenvalue of R [rad²]
    ("unmounting", np.float64, (4,)),  # body to tracker, x y z w
    ("gate", np.float64),
    ("lost_sigma", np.float64),  # [rad] of 3σ
    ("stale", np.float64),  # [s] since the last fix's validity that the user hears of
)
_STEP = record_type(
    ("rate", np.float64, (3,)),  # [rad/s] sample of the gyro
    ("interval", np.float64),  # [s] of the sample; 0 for the first one, where it is unknown
    # What was known at its end, as `Knowledge` has it.
    ("attitude", np.float64, (4,)),
    ("bias", np.float64, (3,)),
    ("theta", np.float64, (6,)),
    ("cross", np.float64, (3, 3)),
    ("bias_covariance", np.float64, (6,)),
)
STEPS = 1024  # a power of two above MAX_DELAY
assert MAX_DELAY < STEPS
INNOVATIONS = 100
# Accepted fixes after which another wrong estimate has another cause. A small jump of the bias
# about the boresight, of which fixes tell least, lets hundreds pass between two restarts.
_CALM = 1000
_WIDEST = 1e-2  # [rad²/s²] up to which restarts in a row widen the variance of the bias
MEMORY = record_type(
    ("knows", np.float64),  # 1 from the first estimate on
    ("count", np.int64),  # gyro samples so far
    ("stamps_ns", np.int64, (STEPS,)),  # of the remembered steps
    ("steps", _STEP, (STEPS,)),
    ("accepted", np.int64),  # fixes since the filter began (anew)
    ("refusals", REFUSALS),
    ("bias_variance", np.float64),  # [rad²/s²] with which it last began anew without a bias
    ("fix_ns", np.int64),  # validity [ns] of the last accepted fix; before it, the first sample
    ("fixes", np.int64),  # in all, also refused ones
    ("refused", np.int64),  # by the gate
    ("unmatched", np.int64),  # of no remembered stamp, or not newer than the last used one
    ("begun_anew", np.int64),
    ("doubtful", np.float64),  # 1 while the last fix was refused
    ("verdict", np.int64),  # of the filter on its own estimate: see `mekf`
    ("verdicts", np.int64),  # how often it changed
    ("age", np.float64),  # [s] since `fix_ns`
    ("sigma", np.float64),  # [rad] largest of the attitude's three
    ("nis", np.float64, (INNOVATIONS,)),  # of the last fixes that were used
    ("used", np.int64),  # how many there were
    ("mean_nis", np.float64),  # of those that are remembered
)


@kernel
def _symmetric(a: Any) -> Symmetric:
    return (a[0], a[1], a[2], a[3], a[4], a[5])


@kernel
def newest(memory: Any) -> int:
    """Slot of the last step."""
    return int((memory.count - 1) % STEPS)


@kernel
def last_interval(memory: Any) -> float:
    """Interval [s] of the last step's gyro sample; 0 for the first one, where it is unknown."""
    return float(memory.steps[newest(memory)].interval)


@kernel
def recalled(memory: Any, slot: int) -> Knowledge:
    """The estimate at the end of a remembered step."""
    step = memory.steps[slot]
    return (
        quaternion(step.attitude),
        vector(step.bias),
        _symmetric(step.theta),
        matrix(step.cross),
        _symmetric(step.bias_covariance),
    )


@kernel
def _remember(memory: Any, slot: int, known: Knowledge) -> None:
    step = memory.steps[slot]
    q, b, theta, cross, bias = known
    store_quaternion(step.attitude, q)
    store(step.bias, b)
    for i in range(3):
        store(step.cross[i], cross[i])
    for i in range(6):
        step.theta[i] = theta[i]
        step.bias_covariance[i] = bias[i]


@inlined
def _carried(memory: Any, slot: int, known: Knowledge, settings: Any) -> Knowledge:
    """Propagate over a remembered step."""
    step = memory.steps[slot]
    white = settings.white + settings.rounding * step.interval
    return propagated(known, vector(step.rate), step.interval, white, settings.walk)


@kernel
def take_sample(memory: Any, settings: Any, stamp_ns: int, rate: Vector) -> None:
    """Propagate to a stamp [ns] with the gyro's mean rate [rad/s] since the last one."""
    last = newest(memory)
    slot = memory.count % STEPS
    step, known = memory.steps[slot], NOTHING
    store(step.rate, rate)
    if memory.count == 0:
        memory.fix_ns = stamp_ns
        step.interval = 0.0
    else:
        step.interval = seconds(stamp_ns - memory.stamps_ns[last])
    memory.stamps_ns[slot] = stamp_ns
    if memory.knows != 0.0 and memory.count > 0:
        known = _carried(memory, slot, recalled(memory, last), settings)
    _remember(memory, slot, known)
    memory.count += 1


@kernel
def _steps_since(memory: Any, stamp_ns: int) -> int:
    """How many steps ago a remembered stamp [ns] was, to rounding; −1 if it is not remembered."""
    for ago in range(min(memory.count, STEPS)):
        if abs(memory.stamps_ns[(memory.count - 1 - ago) % STEPS] - stamp_ns) <= TOLERANCE:
            return ago
    return -1


@kernel
def take_fix(memory: Any, settings: Any, valid_ns: int, fix: Quaternion) -> tuple[Vector, bool]:
    """Take a fix (tracker to inertial) that was valid at a remembered stamp [ns].

    Returns
    -------
    innovation : Vector
        S^(−½) z; its square is NIS.
    told : bool
        True if there is an innovation. There is none for a fix from which the filter begins, also
        anew, for one of no remembered step, or for one that comes after a newer one was accepted,
        because late fixes are exact only in their order.
    """
    memory.fixes += 1
    ago = _steps_since(memory, valid_ns)
    slot = (memory.count - 1 - ago) % STEPS
    valid_ns = memory.stamps_ns[slot]
    refusals = memory.refusals
    repeated = refusals.agreeing > 0 and valid_ns == refusals.valid_ns  # it would agree with itself
    if ago < 0 or repeated or (memory.knows != 0.0 and valid_ns <= memory.fix_ns):
        memory.unmatched += 1
        return ZERO, False
    covariance = _symmetric(settings.fix_covariance)
    attitude = product(fix, quaternion(settings.unmounting))
    whitened, told, begins = ZERO, False, memory.knows == 0.0
    known = begun(attitude, covariance, ZERO, settings.bias_variance)
    if not begins:
        before = recalled(memory, slot)
        z = residual(before, attitude)
        whitened, told = innovation(before, z, covariance), True
        nis = dot(whitened, whitened)
        if nis <= settings.gate:
            known = updated(before, z, covariance)
            memory.nis[memory.used % INNOVATIONS] = nis
            memory.used += 1
            memory.mean_nis = 0.0
            for k in range(min(memory.used, INNOVATIONS)):
                memory.mean_nis += memory.nis[k] / min(memory.used, INNOVATIONS)
            memory.accepted += 1
            refusals.agreeing = 0
        else:
            white = settings.white + settings.rounding * last_interval(memory)
            says = heard(refusals, settings, white, attitude, before[0], valid_ns, memory.accepted)
            if says == NOTHING_YET:
                memory.refused += 1
                memory.doubtful = 1.0
                return whitened, told
            if says == BIAS_IS_WRONG:
                jump, variance = bias_error(refusals, settings, white)
                bias = add(before[1], jump)
                known = begun(attitude, covariance, bias, settings.bias_variance + variance)
            else:
                # A filter that is wrong again so soon knows the bias less well than its parameters
                # say.
                variance = settings.bias_variance
                if memory.accepted < _CALM:
                    variance = max(variance, min(4.0 * memory.bias_variance, _WIDEST))
                memory.bias_variance = variance
                known = begun(attitude, covariance, ZERO, variance)
            begins, told = True, False
            memory.begun_anew += 1
    if begins:
        # A filter that begins anew because refused fixes agreed does not doubt the last of them.
        memory.accepted = EARLY if memory.knows != 0.0 else 1
        memory.knows = 1.0
        refusals.agreeing = 0
    memory.doubtful = 0.0
    memory.fix_ns = valid_ns
    _remember(memory, slot, known)
    for later in range(ago - 1, -1, -1):
        slot = (memory.count - 1 - later) % STEPS
        known = _carried(memory, slot, known, settings)
        _remember(memory, slot, known)
    return whitened, told
