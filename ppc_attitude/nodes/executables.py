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

"""The executables of `ros2 run`: one function for each node.

Importing a node takes seconds on a slow machine. Meanwhile a request to end is granted at once;
afterwards the node handles it (`running.stop_requests`). So no start ends in a traceback.
"""

from collections.abc import Callable
from functools import partial
from importlib import import_module

from ppc_attitude.processes.child import end_at_once
from ppc_attitude.processes.imports import forget_current_folder
from ppc_attitude.processes.streams import prepare_streams


def _run(node: str) -> int:
    """Run a node and return its exit code."""
    end_at_once()
    forget_current_folder()
    prepare_streams()
    code: int = import_module(f"ppc_attitude.nodes.{node}").main()
    return code


def __getattr__(node: str) -> Callable[[], int]:
    """Return the function that runs a node of this name; `setup.py` tells the names."""
    if node.startswith("_"):
        raise AttributeError(node)
    return partial(_run, node)
