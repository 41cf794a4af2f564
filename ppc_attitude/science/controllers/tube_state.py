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

"""The momentum-tube law's memory, its columns, its advice, and how it watches its assumptions.

It looks for hits, missing torque, and other signs that an assumption is broken.
"""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.component import BODY, VECTOR
from ppc_attitude.science.controllers.common import of_law
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.kernel import Vector, kernel, largest, subtract, vector
from ppc_attitude.science.parameter import record_type

MEMORY = record_type(
    ("numbers", np.float64),  # as in the configuration with which it began; 0 before
    ("t", np.float64),  # [s] of the last sample
    ("tumbling", np.float64),
    ("error", np.float64, (4,)),  # q_e of the last sample, whose sign goes on
    ("way", np.float64),  # s = ±1: the way round, kept between events
    ("ahead", np.float64, (3,)),  # Θ [rad]: how far the desired frame will turn, if told
    ("p", np.float64),  # share of ω_res that is left, 1 to 0
    ("r", np.float64),  # share of the brake that acts, 0 to 1
    ("sigma", np.float64),  # σ [rad/s]: speed while it rises to V
    ("done", np.float64),  # 1 if the cap is V itself
    ("p_rate", np.float64),  # [1/s] of the last sample, as the next two
    ("r_rate", np.float64),
    ("sigma_rate", np.float64),
    ("cap", np.float64),  # V_e [rad/s] of the last sample
    ("a", np.float64),  # [rad/s²] of the brake in the last sample
    ("residual", np.float64, (3,)),  # ω_res [rad/s]
    ("y_hat", np.float64, (3,)),  # [N·m·s]
    ("d_hat", np.float64, (3,)),  # [N·m]
    ("y", np.float64, (3,)),  # of the last sample, as the next two
    ("feedforward", np.float64, (3,)),  # F = M0 − J v' [N·m]
    ("torque", np.float64, (3,)),
    ("phi", np.float64),  # φ [rad]
    ("envelope", np.float64),  # Φ [rad]
    ("events", np.float64),  # how many so far with these numbers
    ("slips", np.float64),  # events that a weak actuator explains
    ("slipped_at", np.float64),  # [s] the last of them
    ("loss", np.float64),  # share of the torque that is no longer counted on
    ("unexplained", np.float64, (3,)),  # [N·m] of the last sample
    ("noise", np.float64),  # [N·m] unexplained torque of changing sign, beyond what is admitted
    ("torque_before", np.float64, (3,)),  # [N·m] of the sample before the last
    ("at_limit", np.float64),  # [s] for which the disturbance estimate has been at its limit
    ("doubt", np.float64),  # which assumption was seen broken, as `DOUBTS` says
    ("doubted_at", np.float64),  # [s]
    ("told", np.float64),  # number of advices so far, at most one a second
    ("told_at", np.float64),  # [s]
    ("certified", np.float64),  # as in the configuration at the last event
)
MOMENTUM_ERROR = of_law("momentum_error", VECTOR, BODY, "N·m·s", "momentum error y = J (ω_e − v)")
MOMENTUM_TUBE = of_law(
    "momentum_tube",
    VECTOR,
    BODY,
    "N·m·s",
    "tube Y + N of the momentum error as the law sees it",
    bounds="momentum_error",
)
TURN = of_law("turn", VECTOR, BODY, "rad", "remaining angle φ, in the chosen way round", width=1)
TURN_ENVELOPE = of_law(
    "turn_envelope", VECTOR, BODY, "rad", "envelope Φ of φ", width=1, bounds="turn"
)
PHASE = of_law(
    "phase",
    VECTOR,
    BODY,
    "1",
    "phase (0 tumbling, 1 stop, 2 speed up, 3 follow the brake), and number of events so far",
    width=2,
)
STOP = 1.0  # phase in which the rate of the event fades
HIT = 0.4  # share of max_torque: more torque beyond the declared one is a hit
_FAR_OUTSIDE = 5.0  # times the tube: where y begins an event without a hit
# Outside the assumptions events may follow each other: then less torque is counted on, for a while.
_LOSS = 0.2  # of what is counted on, at each slip after the first
_LARGEST_LOSS = 0.7
LOSS_LASTS = 120.0  # [s] without another slip
_GAIN = 0.6  # of the last torque: what a weak actuator or a wrong inertia may leave unexplained
_HELD = 1.0  # [s] for which the assumed disturbance alone does not hold the estimate at its limit
_HEARD = 30.0  # [s] time constant with which noise that is no longer heard is forgotten
_NEWS = 1.0  # [s] between two advices
DOUBT_LASTS = 10.0  # [s] without another sign of it
NOISE, LATE, CRAFT, DISTURBANCE, AT_LIMIT = 1.0, 2.0, 3.0, 4.0, 5.0
DOUBTS = {
    NOISE: "the measurement is noisier than assumed (e_A, e_W)",
    LATE: "commands act later than assumed (late)",
    CRAFT: "the craft answers torque otherwise than assumed: actuator (eta), inertia (e_S)",
    DISTURBANCE: "a disturbance beyond the assumed one acts (d)",
    AT_LIMIT: "the disturbance estimate stays at its limit: more than assumed may act (d)",
}


@kernel
def phase(memory: Any) -> float:
    """Number of the phase, as `PHASE` says."""
    if memory.tumbling != 0.0:
        return 0.0
    if memory.p > 0.0:
        return STOP
    return 3.0 if memory.done != 0.0 and memory.r == 1.0 else 2.0


def advice(memory: Any) -> Advice:
    """Say what the law plans from, and whether its guarantee applies."""
    plan = f"from {math.degrees(memory['phi']):.1f} deg"
    if memory["loss"] > 0.0:
        return Advice(
            "the guarantee is suspended: the actuator gave too little torque "
            f"{memory['slips']:.0f} times, so the law counts on {100.0 * memory['loss']:.0f} % "
            f"less of it for {LOSS_LASTS:g} s",
            warning=True,
        )
    if memory["doubt"] != 0.0 and memory["t"] - memory["doubted_at"] <= DOUBT_LASTS:
        # Dead band, errors and sampling may hold the estimate at its limit without any violation.
        certain = "may be" if memory["doubt"] == AT_LIMIT else "is"
        told = f"the guarantee {certain} suspended: {DOUBTS[float(memory['doubt'])]}"
        return Advice(told, warning=True)
    if memory["events"] > 1.0:
        return Advice(
            f"event {memory['events']:.0f} of the momentum tube: a torque beyond the assumed "
            f"ones; the guarantee begins anew {plan}",
            warning=True,
        )
    if memory["tumbling"] != 0.0:
        return Advice("nothing is guaranteed while the craft tumbles", warning=True)
    if memory["certified"] == 1.0:
        return Advice(f"the guarantee applies {plan}", warning=False)
    reason = "its certificate is for other numbers" if memory["certified"] else "no certificate"
    return Advice(f"nothing is guaranteed: {reason}; `ppc_attitude design` makes one", warning=True)


@kernel
def is_hit(y: Vector, unexplained: Vector, memory: Any, gains: Any, h: float) -> bool:
    """Tell whether y is outside its tube by an undeclared torque, or far outside by any."""
    for i in range(3):
        tube = gains.Y[i] + gains.N[i] + 2.0 * h * memory.noise
        threshold = HIT * gains.max_torque + 2.0 * (gains.N[i] / h + memory.noise)
        if abs(y[i]) > tube and abs(unexplained[i]) > threshold:
            return True
        if abs(y[i]) > _FAR_OUTSIDE * tube:
            return True
    return False


@kernel
def hear(memory: Any, gains: Any, unexplained: Vector, h: float) -> None:
    """Keep the largest noise in the unexplained torque [N·m] for a while: it is no hit.

    Within the assumptions it is zero, because they admit that much unexplained torque.
    """
    memory.noise -= memory.noise * min(h / _HEARD, 1.0)
    for i in range(3):
        both = min(abs(unexplained[i]), abs(memory.unexplained[i]))  # before a hit there was little
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
def tell(memory: Any) -> bool:
    """Count one more advice, unless the user heard the last one less than a second ago."""
    if memory.told != 0.0 and memory.t - memory.told_at < _NEWS:
        return False
    memory.told += 1.0
    memory.told_at = memory.t
    return True


@kernel
def watch(memory: Any, gains: Any, unexplained: Vector, h: float) -> None:
    """See whether the unexplained torque [N·m] is more than the assumptions admit, and why.

    The law's own telemetry does not prove the cause: the pattern says which is the likely one.
    """
    held = memory.at_limit + h if largest(vector(memory.d_hat)) >= gains.d_max else 0.0
    memory.at_limit = held
    doubt = _pattern(memory, gains, unexplained, h)
    if doubt == 0.0 and held > _HELD and gains.d_max > 0.0:
        doubt = AT_LIMIT
    if doubt == 0.0:
        return
    if memory.doubt != doubt or memory.t - memory.doubted_at > DOUBT_LASTS:
        if not tell(memory):
            return  # it is told at a later sample, if it is still seen then
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
