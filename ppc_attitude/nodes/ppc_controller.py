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

"""The controller: computes the torque of every state; parameter `controller` selects the law."""

import sys
from collections.abc import Mapping
from functools import partial
from typing import Any

from std_srvs.srv import SetBool

from ppc_attitude.contract.topics import ATTITUDE, CONTROLLER, ENABLED
from ppc_attitude.nodes.component_node import ComponentNode
from ppc_attitude.nodes.running import run_node
from ppc_attitude.runtime.health import Status
from ppc_attitude.runtime.stamps import Values
from ppc_attitude.runtime.torque_gate import TorqueGate
from ppc_attitude.science.controllers.common import MAX_TORQUE

_KNOWN = (0.0, 0.0, 0.0, 1.0)  # to a law that reads no attitude


class PpcController(ComponentNode):
    """Runs the selected law; its torque can be disabled."""

    executable = CONTROLLER

    def __init__(self) -> None:
        super().__init__()
        self._gate = TorqueGate()
        self.create_service(SetBool, "~/enable", self._on_enable)

    def compute(self, stamp_ns: int, inputs: Mapping[str, Values]) -> dict[str, Values]:
        """Step the law."""
        if self._gate.has_switched():
            self.tell_changes(stamp_ns, {ENABLED: self._gate.enabled})
        outputs = super().compute(stamp_ns, inputs)
        self.say_all(self._gate.look(stamp_ns, inputs.get(ATTITUDE.column, _KNOWN)))
        if not self._gate.enabled:
            # The law's advice is dropped: the law misses its torque, and would name other causes.
            tuple(self.chain.news())
        return self._gate.passed(outputs, self.parameters[MAX_TORQUE.name])

    def _on_enable(self, request: Any, response: Any) -> Any:
        begins_anew, told = self._gate.turn(bool(request.data))
        if begins_anew:
            self.arm()
        self.get_logger().info(told)
        return SetBool.Response(success=True, message=told)

    def details(self) -> dict[str, Any]:
        """Numbers for `/diagnostics`."""
        law = {"controller": self.parameters["controller"]}
        return {**law, **super().details(), "steps in saturation": self._gate.saturated}

    def status(self) -> Status:
        """Disabled, or what every component node says."""
        return self._gate.status(super().status())


main = partial(run_node, PpcController)

if __name__ == "__main__":
    sys.exit(main())
