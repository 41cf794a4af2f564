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

"""The momentum-tube law watches its assumptions: hits, missing torque, and other doubts."""

from typing import Any

from ppc_attitude.science.controllers.tube_state import (
    CRAFT,
    DISTURBANCE,
    DOUBT_LASTS,
    LATE,
    NOISE,
)
from ppc_attitude.science.kernel import Vector, kernel, largest, subtract, vector

_HIT = 0.4  # torque beyond the declared one, of max_torque, that makes a hit
_FAR_OUTSIDE = 5.0  # of the tube: an event without a hit
# Outside the assumptions events may follow each other: then less torque is counted on, for a while.
_LOSS = 0.2  # of what is counted on, at each slip after the first
_LARGEST_LOSS = 0.7
_GAIN = 0.6  # of the last torque: what a weak actuator or a wrong inertia may leave unexplained
_AT_LIMIT = 1.0  # [s] of the disturbance estimate at its limit that the assumed one does not make
_HEARD = 30.0  # [s] in which noise that is no longer heard is forgotten
_NEWS = 1.0  # [s] between two advices


@kernel
def is_hit(y: Vector, unexplained: Vector, memory: Any, gains: Any, h: float) -> bool:
    """Tell whether y is outside its tube by a torque that nobody declared, or far outside."""
    for i in range(3):
        tube = gains.Y[i] + gains.N[i] + 2.0 * h * memory.noise
        threshold = _HIT * gains.max_torque + 2.0 * (gains.N[i] / h + memory.noise)
        if abs(y[i]) > tube and abs(unexplained[i]) > threshold:
            return True
        if abs(y[i]) > _FAR_OUTSIDE * tube:
            return True
    return False


@kernel
def hear(memory: Any, gains: Any, unexplained: Vector, h: float) -> None:
    """Keep the largest noise that is heard, for some seconds: it must not be taken for hits.

    Within the assumptions it is zero, because torque that nobody explains [N·m] is then admitted.
    """
    memory.noise -= memory.noise * min(h / _HEARD, 1.0)
    for i in range(3):
        both = min(abs(unexplained[i]), abs(memory.unexplained[i]))  # a hit begins from little
        excess = both - gains.admitted[i] - 2.0 * gains.N[i] / h
        if memory.unexplained[i] * unexplained[i] < 0.0:
            memory.noise = max(memory.noise, excess)


@kernel
def slip(memory: Any) -> None:
    """Count on less torque if it is found short again: no limit cycle of events."""
    if memory.slips > 0.0:
        memory.loss = min(memory.loss + _LOSS * (1.0 - memory.loss), _LARGEST_LOSS)
    memory.slips += 1.0
    memory.slipped_at = memory.t


@kernel
def watch(memory: Any, gains: Any, unexplained: Vector, h: float) -> None:
    """See whether torque that nobody explains [N·m] is more than the assumptions admit, and why.

    The law's own telemetry does not prove the cause: the pattern says which is the likely one.
    """
    held = 0.0
    for i in range(3):
        if abs(memory.d_hat[i]) >= gains.d_max:
            held = memory.at_limit + h
    memory.at_limit = held
    doubt = _pattern(memory, gains, unexplained, h)
    if doubt == 0.0 and held > _AT_LIMIT and gains.d_max > 0.0:
        doubt = DISTURBANCE
    if doubt == 0.0:
        return
    is_new = memory.doubt != doubt or memory.t - memory.doubted_at > DOUBT_LASTS
    if is_new and (memory.told == 0.0 or memory.t - memory.told_at >= _NEWS):
        memory.told += 1.0
        memory.told_at = memory.t
        memory.doubt = doubt
    memory.doubted_at = memory.t


@kernel
def _pattern(memory: Any, gains: Any, unexplained: Vector, h: float) -> float:
    """Likeliest cause of torque beyond what C1 admits; 0 if there is none beyond it."""
    late = subtract(vector(memory.torque_before), vector(memory.torque))
    beyond, explained = 0.0, True
    doubt = 0.0
    for i in range(3):
        admitted = gains.admitted[i] + 2.0 * gains.N[i] / h
        explained = explained and abs(unexplained[i] - late[i]) <= admitted
        excess = abs(unexplained[i]) - admitted
        if excess > beyond:
            beyond = excess
            doubt = DISTURBANCE
            if abs(unexplained[i]) <= _GAIN * abs(memory.torque[i]):
                doubt = CRAFT
            if memory.unexplained[i] * unexplained[i] < 0.0:
                doubt = NOISE  # white noise of y comes back with the other sign
    return LATE if doubt != 0.0 and explained and largest(late) > 0.0 else doubt
