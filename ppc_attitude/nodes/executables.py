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

"""What `ros2 run` executes: one function for each node.

Importing a node takes seconds on a slow machine. Ctrl-C and SIGTERM wait until the node can end by
itself (`running.StopRequest`), so that no start ends in a traceback.
"""

import signal
from functools import partial
from importlib import import_module

from ppc_attitude.contract.topics import CONTROLLER, INJECTOR, MARKERS, PLANT, RECORDER, REFERENCE


def _run(node: str) -> int:
    """Run a node and return its exit code."""
    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    code: int = import_module(f"ppc_attitude.nodes.{node}").main()
    return code


spacecraft_plant = partial(_run, PLANT)
reference_generator = partial(_run, REFERENCE)
ppc_controller = partial(_run, CONTROLLER)
disturbance_injector = partial(_run, INJECTOR)
bag_recorder = partial(_run, RECORDER)
attitude_markers = partial(_run, MARKERS)
