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

"""The paper's desired motion, with what lies ahead of it: how far the desired frame will turn.

A law that reads this can turn the way round on which the desired frame comes to meet the craft.
"""

import math
from typing import Any

import numpy as np

from ppc_attitude.science.kernel import Vector, kernel, store
from ppc_attitude.science.parameter import Parameter
from ppc_attitude.science.references import paper
from ppc_attitude.science.signals import TURN_AHEAD

AHEAD = Parameter(
    "ahead",
    62.0,
    "time over which reference/turn_ahead integrates ω_d; best is π/Ω_e, that of half a turn",
    "s",
    above=0.0,
    high=1e6,
)


@kernel
def turn_ahead(t: float, reference: Any) -> Vector:
    """∫ω_d [rad] from t [s] until `ahead` later, desired frame."""
    a, period = reference.amplitude, reference.period_constant
    begin = t + reference.begin
    end = begin + reference.ahead
    return (
        a[0] * period[0] * (math.sin(end / period[0]) - math.sin(begin / period[0])),
        -a[1] * period[1] * (math.cos(end / period[1]) - math.cos(begin / period[1])),
        -a[2] * period[2] * (math.sin(end / period[2]) - math.sin(begin / period[2])),
    )


@kernel
def step(inputs: Any, cursor: Any, reference: Any, outputs: Any) -> None:
    """Give what the paper's reference gives, and ∫ω_d [rad] of what lies ahead."""
    paper.step(inputs, cursor, reference, outputs)
    store(outputs.reference_turn_ahead, turn_ahead(inputs.t, reference))


COMPONENT = paper.COMPONENT.extended(
    "paper_ahead",
    {"ahead": (np.float64, lambda values: values[AHEAD.name])},
    parameters=(AHEAD,),
    outputs=(TURN_AHEAD,),
    step=step,
)
