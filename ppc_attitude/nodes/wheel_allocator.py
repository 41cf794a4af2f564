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

"""The wheel allocator: shares the torque among the wheels, and may unload them.

A run has it only with an `allocator`; then the craft's actuators take what it sends.
"""

import sys
from functools import partial

from ppc_attitude.contract.topics import ALLOCATOR
from ppc_attitude.nodes.component_node import ComponentNode
from ppc_attitude.nodes.running import run_node


class WheelAllocator(ComponentNode):
    """Runs the selected allocator."""

    executable = ALLOCATOR
    tells_advice = True  # such as which wheels are lost


main = partial(run_node, WheelAllocator)

if __name__ == "__main__":
    sys.exit(main())
