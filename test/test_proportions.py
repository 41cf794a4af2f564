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

"""Numbers of what `check` compares with the craft, against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from craft_helpers import case, conditions

from ppc_attitude.analysis.requirements import PAPER, Accuracy
from ppc_attitude.contract.topics import PLANT


@pytest.mark.parametrize("angle", [1.0, 0.03])  # [rad] it may still turn fast where it arrives
def test_the_least_time_to_turn_is_that_of_the_largest_component(angle: float) -> None:
    craft = case()
    wish = replace(PAPER, settled=Accuracy(5e-3), rate=None)
    half = math.sin(0.5 * angle)
    found = conditions(craft, wish, (0.6 * half, 0.8 * half, 0.0, math.cos(0.5 * angle)))
    near = 2.0 * math.asin(5e-3 / 0.8)
    inertia = np.reshape(craft.parameters[PLANT]["inertia"], (3, 3))
    acceleration = 0.05 / np.abs(inertia @ [0.6, 0.8, 0.0]).max()
    if angle > 3.0 * near:  # speed up, slow down, and arrive as fast as the other side allows
        needs = math.sqrt(4.0 * (angle + near) / acceleration)
        needs -= math.sqrt(4.0 * near / acceleration)
    else:
        needs = math.sqrt(2.0 * (angle - near) / acceleration)
    assert found["time to turn"].value == pytest.approx(needs)
