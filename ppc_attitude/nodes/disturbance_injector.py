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

"""The disturbance injector: adds up environment torque, scheduled pulses and injected torques."""

import sys
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import parameter_value_to_python

from ppc_attitude.contract.topics import INJECT, INJECTOR
from ppc_attitude.nodes.component_node import ComponentNode
from ppc_attitude.nodes.running import run_node
from ppc_attitude.runtime.injection import Injections
from ppc_attitude.runtime.stamps import RefusedError, Values
from ppc_attitude.science.disturbances.pulses import configuration_of, scheduled_pulses
from ppc_attitude.science.parameter import Parameter, Value, resolved
from ppc_attitude.science.stamps import LATEST, NANOSECONDS, nanoseconds, seconds
from ppc_attitude.simulation.scenario import check_pulses

_START = Parameter("start", 0.0, "begin of the torque; a past time: now", "s", 0.0, LATEST)
_REQUEST = (
    Parameter("torque", [], "torque in body axes", "N·m", length=3),
    _START,
    Parameter("duration", 1.0, "how long the torque acts", "s", 1e-9, LATEST),
    Parameter("request", "", "name by which a repeated request is recognised"),
)
"""What a request may hold."""


class DisturbanceInjector(ComponentNode):
    """Gives the external torque [N·m] of every instant, body axes."""

    executable = INJECTOR

    def __init__(self) -> None:
        super().__init__()
        self._injections = Injections()
        self.listen(INJECT, self._on_message)
        # The service of ROS whose request has named numbers and whose answer has words.
        self.create_service(SetParametersAtomically, "~/inject", self._on_request)

    def check(self, values: Mapping[str, Value]) -> None:
        """See also that every scheduled pulse acts at an instant, once the instants are known."""
        super().check(values)
        if self._exchanges and self.answers.period_ns:
            check_pulses(values, NANOSECONDS / self.answers.period_ns)

    def apply_parameters(self, stamp_ns: int) -> None:
        """Take over parameters; torques that were injected go on."""
        super().apply_parameters(stamp_ns)
        self._hold()

    def compute(self, stamp_ns: int, inputs: Mapping[str, Values]) -> dict[str, Values]:
        """Sum up the torques that act at an instant."""
        if self._injections.at(stamp_ns):
            self._hold()
        return super().compute(stamp_ns, inputs)

    def _hold(self) -> None:
        """Give the component all scheduled and injected pulses."""
        pulses = [scheduled_pulses(self.parameters.values), *self._injections.pulses]
        record, self._kept = configuration_of(np.concatenate(pulses))
        self.chain.parts[-1].hold(record)

    def forget_orders(self) -> str:
        """Forget the torques that were injected before time began again."""
        forgotten = "injected torques" if self._injections.pending else ""
        self._injections.begin_again()
        return forgotten

    def _inject(self, torque: Values, start_ns: int, duration: float, request: str = "") -> str:
        limit = self.parameters["max_injected_torque"]
        stamps = self.answers.next_ns, self.answers.period_ns
        text = self._injections.accept(torque, start_ns, duration, limit, *stamps, request)
        self.mention(INJECT.name, f"injected torque {text}")
        return text

    def _on_message(self, stamp_ns: int, torque: Values) -> None:
        try:
            _START.checked(seconds(stamp_ns))
            self._inject(torque, stamp_ns, self.parameters["injection_duration"])
        except ValueError as reason:
            raise RefusedError(f"{INJECT.name}: {reason}") from None

    def _on_request(self, request: Any, response: Any) -> Any:
        """Answer the service: say from when to when the torque acts, or why it is refused."""
        try:
            given = {
                each.name: parameter_value_to_python(each.value) for each in request.parameters
            }
            default = {"duration": self.parameters["injection_duration"]}
            asked: dict[str, Any] = resolved(_REQUEST, {**default, **given}, "inject")
            torque, start, duration, name = (asked[each.name] for each in _REQUEST)
            text = self._inject(tuple(torque), nanoseconds(start), duration, name)
            response.result.reason, response.result.successful = text, True
        except (ValueError, RuntimeError) as reason:  # RuntimeError: a type that ROS does not have
            self.refuse("~/inject", f"~/inject: {reason}")
            response.result.reason = str(reason)
        return response

    def details(self) -> dict[str, Any]:
        """Numbers for `/diagnostics`."""
        return {
            **super().details(),
            "injections accepted": self._injections.accepted,
            "injections pending or active": self._injections.pending,
        }


main = partial(run_node, DisturbanceInjector)

if __name__ == "__main__":
    sys.exit(main())
