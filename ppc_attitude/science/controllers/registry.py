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

"""The control laws by name. A new law is one file beside this one, and one line here."""

from ppc_attitude.science.controllers import log_barrier, ppc, quaternion_feedback
from ppc_attitude.science.controllers.interface import Controller
from ppc_attitude.science.parameter import Parameter

CONTROLLERS: dict[str, Controller] = {
    law.name: law
    for law in (
        ppc.CONTROLLER,
        log_barrier.CONTROLLER,
        quaternion_feedback.CONTROLLER,
    )
}


def all_parameters() -> tuple[Parameter, ...]:
    """Parameters of all laws, each once: what the controller node declares."""
    merged: dict[str, Parameter] = {}
    for law in CONTROLLERS.values():
        for parameter in law.parameters:
            if merged.setdefault(parameter.name, parameter) != parameter:
                raise AssertionError(f"two laws declare {parameter.name} differently")
    return tuple(merged.values())
