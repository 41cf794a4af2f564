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

"""The reference generator: answers every state with the desired motion of the same instant."""

import sys
from collections.abc import Mapping
from typing import Any

from ppc_attitude.contract.cdr import seconds
from ppc_attitude.contract.topics import (
    ATTITUDE,
    REFERENCE,
    REFERENCE_ACCELERATION,
    REFERENCE_ATTITUDE,
    REFERENCE_RATE,
)
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.health import OK, STALE
from ppc_attitude.nodes.lockstep import StampGuard, Verdict
from ppc_attitude.nodes.messages import out_of_order
from ppc_attitude.nodes.running import run_node
from ppc_attitude.science.kernel import one
from ppc_attitude.science.parameter import Value
from ppc_attitude.science.reference import motion_at, new_cursor
from ppc_attitude.simulation.scenario import reference_record


class ReferenceGenerator(BaseNode):
    """Desired attitude, rate and acceleration: functions of the stamp alone."""

    executable = REFERENCE

    def __init__(self) -> None:
        super().__init__()
        self._apply_parameters()
        self._guard = StampGuard()
        self._send_attitude = self.sender(REFERENCE_ATTITUDE)
        self._send_rate = self.sender(REFERENCE_RATE)
        self._send_acceleration = self.sender(REFERENCE_ACCELERATION)
        self.listen(ATTITUDE, self._on_state)

    def check(self, values: Mapping[str, Value]) -> None:
        """See that the initial attitude is a unit quaternion."""
        reference_record(values)

    def _apply_parameters(self) -> None:
        self._reference = one(reference_record(self.parameters.values))
        self._cursor = one(new_cursor())
        self.parameters.changed = False

    def _on_state(self, stamp_ns: int, attitude: tuple[float, ...]) -> None:
        if self.parameters.changed:
            self._apply_parameters()
        verdict = self._guard.judge(stamp_ns)
        if verdict is Verdict.STALE:
            raise out_of_order(ATTITUDE.name, stamp_ns)
        if verdict is Verdict.RESTART:
            self.restart_report()
        q_d, omega_d, acceleration_d = motion_at(seconds(stamp_ns), self._reference, self._cursor)
        self._send_attitude(stamp_ns, q_d)
        self._send_rate(stamp_ns, omega_d)
        self._send_acceleration(stamp_ns, acceleration_d)
        self.report(stamp_ns)

    def status(self) -> tuple[bytes, str, dict[str, Any]]:
        """Waiting for states, or running."""
        if self.is_idle():
            return STALE, f"waiting for {ATTITUDE.name}", {}
        return OK, "running", {}


def main() -> int:
    """Run the executable `reference_generator`."""
    return run_node(ReferenceGenerator)


if __name__ == "__main__":
    sys.exit(main())
