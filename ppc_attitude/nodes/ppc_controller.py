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

"""The controller: computes the torque from each new state and the reference of its instant."""

import sys
from collections.abc import Callable, Mapping
from typing import Any

from std_srvs.srv import SetBool

from ppc_attitude.contract.cdr import seconds
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    ATTITUDE,
    BY_COLUMN,
    CONTROLLER,
    REFERENCE_ACCELERATION,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
    TORQUE_COMMAND,
    Topic,
)
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.health import OK, STALE, WARN
from ppc_attitude.nodes.lockstep import Instant, StampGuard, Values, Verdict
from ppc_attitude.nodes.messages import out_of_order
from ppc_attitude.nodes.running import run_node
from ppc_attitude.science.controllers.registry import CONTROLLERS
from ppc_attitude.science.controllers.runner import LawRunner
from ppc_attitude.science.parameter import Value

_INPUTS = (ATTITUDE, ANGULAR_VELOCITY, REFERENCE_ATTITUDE, REFERENCE_RATE, REFERENCE_ACCELERATION)
_ZERO = (0.0, 0.0, 0.0)


class PpcController(BaseNode):
    """Runs the selected law on the stamps of its inputs; remembers nothing but the law's memory."""

    executable = CONTROLLER

    def __init__(self) -> None:
        super().__init__()
        law = CONTROLLERS[self.parameters["controller"]]
        self._law = LawRunner(law, self.parameters.values)
        self._announced = 0
        self._guard = StampGuard()
        self._instant = Instant(topic.column for topic in _INPUTS)
        self._enabled = True
        self._saturated = 0
        self._steps = 0

        self._send_torque = self.sender(TORQUE_COMMAND)
        self._telemetry = [
            (column, self.sender(BY_COLUMN[column]))
            for column in law.columns
            if column != TORQUE_COMMAND.column
        ]
        for topic in _INPUTS:
            self.listen(topic, self._receiver(topic))
        self.create_service(SetBool, "~/enable", self._on_enable)

    def check(self, values: Mapping[str, Value]) -> None:
        """See that inertia and envelopes are feasible, for whatever law is selected."""
        for law in CONTROLLERS.values():
            law.configure(values)

    def _arm(self) -> None:
        """Forget the past: the next step plans from the present error."""
        self._law.forget()
        self._announced = 0

    def _receiver(self, topic: Topic) -> Callable[[int, Values], None]:
        column = topic.column

        def receive(stamp_ns: int, values: Values) -> None:
            parts = self._instant.add(column, stamp_ns, values)
            if parts is not None:
                self._on_instant(stamp_ns, parts)

        return receive

    def _on_instant(self, stamp_ns: int, parts: Mapping[str, Values]) -> None:
        verdict = self._guard.judge(stamp_ns)
        if verdict is Verdict.STALE:
            raise out_of_order("state", stamp_ns)
        if verdict is Verdict.RESTART:
            text = f"time has begun again at {seconds(stamp_ns):.3f} s: re-armed"
            self.mention("restart", text)
            self._arm()
            self.restart_report()
        if verdict is not Verdict.REPEATED:
            self._compute(stamp_ns, parts)
        self._publish(stamp_ns)
        self._announce_plan()
        self.report(stamp_ns)

    def _compute(self, stamp_ns: int, parts: Mapping[str, Values]) -> None:
        if self.parameters.changed:
            self._law.configure(self.parameters.values)
            self.parameters.changed = False
        self._law.step(seconds(stamp_ns), parts)
        self._steps += 1
        self._saturated += self._law.saturated

    def _publish(self, stamp_ns: int) -> None:
        """Publish the torque first: the plant waits for it, the telemetry has time."""
        given = self._law.given
        self._send_torque(stamp_ns, given(TORQUE_COMMAND.column) if self._enabled else _ZERO)
        for column, send in self._telemetry:
            send(stamp_ns, given(column))

    def _announce_plan(self) -> None:
        if self._law.plans != self._announced:
            self._announced = self._law.plans
            advice = self._law.advice
            # Two lines of source: rclpy ties a severity to each.
            if advice.warning:
                self.get_logger().warning(advice.text)
            else:
                self.get_logger().info(advice.text)

    def _on_enable(self, request: Any, response: Any) -> Any:
        if request.data and not self._enabled:
            self._arm()
        self._enabled = bool(request.data)
        state = (
            "enabled: re-armed from the present error" if self._enabled else "disabled: zero torque"
        )
        self.get_logger().info(state)
        response.success = True
        response.message = state
        return response

    def status(self) -> tuple[bytes, str, dict[str, Any]]:
        """Waiting for inputs, disabled, outside an envelope, or running."""
        details: dict[str, Any] = {
            "controller": self._law.law.name,
            "steps": self._steps,
            "steps in saturation": self._saturated,
            "instants incomplete": self._instant.dropped,
        }
        fill = self._law.fill()
        details.update({f"{name} margin": 1.0 - value for name, value in fill.items()})
        if self.is_idle():
            missing = ", ".join(BY_COLUMN[column].name for column in self._instant.missing())
            return STALE, f"waiting for {missing}", details
        if not self._enabled:
            return WARN, "disabled: zero torque", details
        outside = [name for name, value in fill.items() if value > 1.0]
        if outside:
            return WARN, f"outside: {', '.join(outside)}", details
        return OK, "running", details


def main() -> int:
    """Run the executable `ppc_controller`."""
    return run_node(PpcController)


if __name__ == "__main__":
    sys.exit(main())
