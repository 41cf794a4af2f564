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

"""What the law keeps of broken assumptions, and when it tells of them."""

from record_helpers import configured, state_of

from ppc_attitude.science.controllers import momentum_tube
from ppc_attitude.science.controllers.tube_state import tell, watch


def test_a_doubt_that_comes_back_right_after_other_news_is_told_again() -> None:
    """It counted as told a second time although the user had heard of it long before only."""
    memory, gains = state_of(momentum_tube.COMPONENT), configured(momentum_tube.COMPONENT)
    beyond = (0.05, 0.0, 0.0)  # [N·m]
    for t, told in ((5.0, 1.0), (20.0, 2.0), (20.01, 2.0), (21.5, 3.0)):
        memory["t"] = t
        if t == 20.0:
            tell(memory)  # of an event
        else:
            watch(memory, gains, beyond, 0.01)
        assert memory["told"] == told
