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

"""The disturbance injector: environment torque, scheduled pulses, and injected torques."""

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python

from ppc_attitude.contract.cdr import finite
from ppc_attitude.contract.topics import INJECT, INJECTOR
from ppc_attitude.nodes.component_node import ComponentNode
from ppc_attitude.nodes.parameters import type_name
from ppc_attitude.nodes.running import run_node
from ppc_attitude.runtime.injection import Injections
from ppc_attitude.runtime.stamps import RefusedError, Values
from ppc_attitude.science.disturbances.pulses import configuration_of, scheduled_pulses
from ppc_attitude.science.parameter import Value
from ppc_attitude.science.stamps import LATEST, NANOSECONDS, nanoseconds, seconds
from ppc_attitude.simulation.scenario import check_pulses

_NUMBER = (RosParameter.Type.DOUBLE.name, RosParameter.Type.INTEGER.name)
_TYPES = {
    "torque": (RosParameter.Type.DOUBLE_ARRAY.name, RosParameter.Type.INTEGER_ARRAY.name),
    "start": _NUMBER,
    "duration": _NUMBER,
    "request": (RosParameter.Type.STRING.name,),
}
"""What a request may hold, and of which types."""


class DisturbanceInjector(ComponentNode):
    """Gives the external torque of every instant."""

    executable = INJECTOR

    def __init__(self) -> None:
        super().__init__()
        self._injections = Injections()
        self.listen(INJECT, self._on_message)
        # The service of ROS whose request has named numbers and whose answer has words.
        self.create_service(SetParametersAtomically, "~/inject", self._on_request)

    def check(self, values: Mapping[str, Value]) -> None:
        """See too that every scheduled pulse acts, as far as the instants are known."""
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
        """Let scheduled and injected pulses act."""
        pulses = [scheduled_pulses(self.parameters.values), *self._injections.pulses]
        record, self._kept = configuration_of(np.concatenate(pulses))
        self.chain.parts[-1].hold(record)

    def forget_orders(self) -> None:
        """Forget the torques that were injected before time began again."""
        self._injections.begin_again()

    def _inject(self, torque: Values, start_ns: int, duration: float, request: str = "") -> str:
        limit = self.parameters["max_injected_torque"]
        stamps = self.answers.next_ns, self.answers.period_ns
        text = self._injections.accept(torque, start_ns, duration, limit, *stamps, request)
        self.mention(INJECT.name, f"injected torque {text}")
        return text

    def _on_message(self, stamp_ns: int, torque: Values) -> None:
        try:
            _seconds("start", seconds(stamp_ns), lowest=0.0)
            self._inject(torque, stamp_ns, self.parameters["injection_duration"])
        except RefusedError as reason:
            raise RefusedError(f"{INJECT.name}: {reason}") from None

    def _on_request(self, request: Any, response: Any) -> Any:
        """Answer the service: say from when to when the torque acts, or why it is refused."""
        try:
            torque, start, duration, name = _asked(request.parameters)
            duration = self.parameters["injection_duration"] if duration is None else duration
            response.result.reason = self._inject(torque, nanoseconds(start), duration, name)
            response.result.successful = True
        except RefusedError as reason:
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


def _asked(parameters: Sequence[Parameter]) -> tuple[Values, float, float | None, str]:
    """Torque [N·m], start [s], duration [s] and name of a request; the last two may be left out."""
    fields: dict[str, Any] = {}
    for each in parameters:
        if each.name not in _TYPES:
            raise RefusedError(f"{each.name} is unknown; allowed: {', '.join(_TYPES)}")
        if each.name in fields:
            raise RefusedError(f"{each.name} is given twice; allowed: once")
        given = type_name(each.value)
        if given not in _TYPES[each.name]:
            allowed = " or ".join(_TYPES[each.name])
            raise RefusedError(f"{each.name} is of type {given}; allowed: {allowed}")
        fields[each.name] = parameter_value_to_python(each.value)
    torque = tuple(map(float, fields.get("torque", ())))
    if len(torque) != 3:
        raise RefusedError(f"torque = {torque}; allowed: three numbers [N·m]")
    if not finite(torque):
        raise RefusedError(f"torque = {torque} N·m must be finite")
    start = _seconds("start", fields.get("start", 0.0), lowest=0.0)
    name = fields.get("request", "")
    if "duration" not in fields:
        return torque, start, None, name
    return torque, start, _seconds("duration", fields["duration"], lowest=1e-9), name


def _seconds(name: str, value: float, lowest: float) -> float:
    if not lowest <= value <= LATEST:
        allowed = f"{lowest:g} to {LATEST:g} of simulated time"
        raise RefusedError(f"{name} = {value:g} s; allowed: {allowed}")
    return float(value)


main = partial(run_node, DisturbanceInjector)

if __name__ == "__main__":
    sys.exit(main())
