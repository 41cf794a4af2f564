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

"""The momentum-tube law for a reference that tells what lies ahead: the shorter way in time.

With ‖w_d − f n‖ = Ω_e the error falls at about Ω_e + n·ω_d, so a way round with φ to go takes until
φ = Ω_e T + n·Θ(T), Θ = ∫ω_d. Both ways take the same T ≈ π/Ω_e where φ = π + n·Θ.
"""

from typing import Any

from ppc_attitude.science.controllers import momentum_tube
from ppc_attitude.science.controllers.tube_parameters import LAW_AHEAD
from ppc_attitude.science.kernel import kernel, store, vector
from ppc_attitude.science.signals import TURN_AHEAD


@kernel
def step(measurement: Any, memory: Any, gains: Any, command: Any) -> None:
    """One sample of the momentum-tube law that goes by Θ where it chooses a way round."""
    store(memory.ahead, vector(measurement.reference_turn_ahead))
    momentum_tube.step(measurement, memory, gains, command)


COMPONENT = momentum_tube.COMPONENT.extended(LAW_AHEAD, inputs=(TURN_AHEAD,), step=step)
