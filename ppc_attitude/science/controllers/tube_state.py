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

"""The momentum-tube law's memory, the columns that it gives, and its advice."""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.component import BODY, VECTOR, Advice, Column
from ppc_attitude.science.kernel import kernel

MEMORY = np.dtype(
    [
        ("started", np.float64),
        ("t", np.float64),  # [s] of the last sample
        ("tumbling", np.float64),
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
        ("events", np.float64),  # how many so far
        ("slips", np.float64),  # events that a weak actuator explains
        ("slipped_at", np.float64),  # [s] the last of them
        ("loss", np.float64),  # share of the torque that is no longer counted on
        ("unexplained", np.float64, (3,)),  # [N·m] of the last sample
        ("noise", np.float64),  # [N·m] of what is unexplained, beyond what the assumptions admit
        ("torque_before", np.float64, (3,)),  # [N·m] of the sample before the last
        ("at_limit", np.float64),  # [s] for which the disturbance estimate has been at its limit
        ("doubt", np.float64),  # which assumption was seen broken, as `DOUBTS` says
        ("doubted_at", np.float64),  # [s]
        ("told", np.float64),  # how many of them the user hears of: one a second
        ("told_at", np.float64),  # [s]
        ("certified", np.float64),  # as in the configuration
    ],
    align=True,
)
MOMENTUM_ERROR = Column(
    "momentum_error",
    "control/momentum_error",
    VECTOR,
    BODY,
    "N·m·s",
    "momentum error y = J (ω_e − v)",
    bound="momentum_tube",
)
MOMENTUM_TUBE = Column(
    "momentum_tube", "control/momentum_tube", VECTOR, BODY, "N·m·s", "tube Y of the momentum error"
)
TURN = Column(
    "turn",
    "control/turn",
    VECTOR,
    BODY,
    "rad",
    "angle φ that is left, the way round that was chosen",
    width=1,
    bound="turn_envelope",
)
TURN_ENVELOPE = Column(
    "turn_envelope", "control/turn_envelope", VECTOR, BODY, "rad", "envelope Φ of φ", width=1
)
PHASE = Column(
    "phase",
    "control/phase",
    VECTOR,
    BODY,
    "1",
    "0 tumbling, 1 stop, 2 speed up, 3 follow the brake; and how many events so far",
    width=2,
)
LOSS_LASTS = 120.0  # [s] without another slip
DOUBT_LASTS = 10.0  # [s] without another sign of it
NOISE, LATE, CRAFT, DISTURBANCE = 1.0, 2.0, 3.0, 4.0
DOUBTS = {
    NOISE: "the measurement is noisier than assumed (e_A, e_W)",
    LATE: "commands act later than assumed (late)",
    CRAFT: "the craft answers torque otherwise than assumed: actuator (eta) or inertia (e_S)",
    DISTURBANCE: "a disturbance beyond the assumed one acts (d)",
}


@kernel
def phase(memory: Any) -> float:
    """Number of the phase, as `PHASE` says."""
    if memory.tumbling != 0.0:
        return 0.0
    if memory.p > 0.0:
        return 1.0
    return 3.0 if memory.done != 0.0 and memory.r == 1.0 else 2.0


def advice(memory: Any) -> Advice:
    """Say what the law plans from, and whether its guarantee applies."""
    plan = f"from {math.degrees(memory['phi']):.1f} deg"
    if memory["loss"] > 0.0:
        return Advice(
            f"the guarantee is suspended: torque was short {memory['slips']:.0f} times, so "
            f"{100.0 * memory['loss']:.0f} % less is counted on for {LOSS_LASTS:g} s",
            warning=True,
        )
    if memory["doubt"] != 0.0 and memory["t"] - memory["doubted_at"] <= DOUBT_LASTS:
        told = f"the guarantee is suspended: {DOUBTS[float(memory['doubt'])]}"
        return Advice(told, warning=True)
    if memory["events"] > 1.0:
        return Advice(
            f"event {memory['events']:.0f} of the momentum tube: a torque beyond the assumed "
            f"ones; the guarantee begins anew {plan}",
            warning=True,
        )
    if memory["certified"] == 1.0:
        return Advice(f"the guarantee applies {plan}", warning=False)
    reason = "its certificate is for other numbers" if memory["certified"] else "no certificate"
    return Advice(f"nothing is guaranteed: {reason}; `ppc_attitude design` makes one", warning=True)


def advices(memory: Any) -> int:
    """Return the number of the latest advice."""
    return int(memory["told"])
