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

from ppc_attitude.contract.topics import ATTITUDE, CONTROLLER, ENABLED, TORQUE_COMMAND
from ppc_attitude.nodes.component_node import ComponentNode
from ppc_attitude.nodes.running import run_node
from ppc_attitude.runtime.health import OK, STALE, WARN, Status
from ppc_attitude.runtime.stamps import Values
from ppc_attitude.science.controllers.common import MAX_TORQUE
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.stamps import seconds

_ZERO = (0.0, 0.0, 0.0)
_KNOWN = (0.0, 0.0, 0.0, 1.0)
_NO_ATTITUDE = f"{ATTITUDE.name} is all zeros, so the attitude is unknown: zero torque"
_UNSATURATED = "unsaturated_torque"  # of a law that has a limit


class PpcController(ComponentNode):
    """Runs the selected law; its torque can be disabled."""

    executable = CONTROLLER

    def __init__(self) -> None:
        super().__init__()
        self._enabled = True
        self._switched = False  # `_enabled` has changed, and the change is not yet on record
        self._saturated = 0
        self._sees = self._has_seen = False  # an attitude is known now; one has been known before
        self.create_service(SetBool, "~/enable", self._on_enable)

    def compute(self, stamp_ns: int, inputs: Mapping[str, Values]) -> dict[str, Values]:
        """Step the law."""
        if self._switched:
            self._switched = False
            self.tell_changes(stamp_ns, {ENABLED: self._enabled})
        outputs = super().compute(stamp_ns, inputs)
        sees = any(inputs.get(ATTITUDE.column, _KNOWN))
        if sees != self._sees and self._has_seen:  # a filter needs a while at first
            text = f"{ATTITUDE.name} is known again" if sees else _NO_ATTITUDE
            self.say_all([Advice(f"{text} from t = {seconds(stamp_ns):.3f} s on", not sees)])
        self._sees, self._has_seen = sees, self._has_seen or sees
        if not self._enabled:
            # The law's advice is dropped: the law misses its torque, and would name other causes.
            tuple(self.chain.news())
            return {**outputs, TORQUE_COMMAND.column: _ZERO}
        asked = max(map(abs, outputs.get(_UNSATURATED, _ZERO)))
        self._saturated += asked > self.parameters[MAX_TORQUE.name]
        return outputs

    def _on_enable(self, request: Any, response: Any) -> Any:
        enabled, was = bool(request.data), self._enabled
        self._enabled = enabled
        self._switched = self._switched or enabled != was
        if enabled and not was:
            self.arm()
            state = "enabled: re-armed from the present error"
        else:
            state = "enabled already: the law goes on" if enabled else "disabled: zero torque"
        self.get_logger().info(state)
        return SetBool.Response(success=True, message=state)

    def details(self) -> dict[str, Any]:
        """Numbers for `/diagnostics`."""
        law = {"controller": self.parameters["controller"]}
        return {**law, **super().details(), "steps in saturation": self._saturated}

    def status(self) -> Status:
        """Disabled, or what every component node says."""
        status = super().status()
        if not self._enabled and status.level != STALE:
            return Status(WARN, "disabled: zero torque", status.details)
        if not self._sees and status.level == OK:
            return Status(WARN, _NO_ATTITUDE, status.details)
        return status


main = partial(run_node, PpcController)

if __name__ == "__main__":
    sys.exit(main())
