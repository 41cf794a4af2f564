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

"""No environment at all: free space."""

from typing import Any

from ppc_attitude.science.component import Component
from ppc_attitude.science.kernel import ZERO, kernel, store
from ppc_attitude.science.signals import ENVIRONMENT_TORQUE


@kernel
def step(inputs: Any, state: Any, configuration: Any, outputs: Any) -> None:
    """Give no torque."""
    store(outputs.environment_torque, ZERO)


COMPONENT = Component(name="none", outputs=(ENVIRONMENT_TORQUE,), step=step, bound=lambda _: 0.0)
