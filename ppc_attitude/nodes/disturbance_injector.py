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

"""The disturbance injector: environment torque, scheduled pulses, and what anyone injects."""

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from ppc_attitude.contract.cdr import seconds
from ppc_attitude.contract.topics import ATTITUDE, DISTURBANCE, INJECT, INJECTOR
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.health import OK, STALE
from ppc_attitude.nodes.lockstep import StampGuard, Verdict
from ppc_attitude.nodes.messages import RefusedError, out_of_order
from ppc_attitude.nodes.running import run_node
from ppc_attitude.science.disturbance import PULSE, external_torque
from ppc_attitude.science.parameter import Value
from ppc_attitude.simulation.scenario import pulse, pulses

_MAX_INJECTED = 1000  # pulses that may be pending or active at a time


class DisturbanceInjector(BaseNode):
    """Answers every state with the external torque of the same instant."""

    executable = INJECTOR

    def __init__(self) -> None:
        super().__init__()
        self._guard = StampGuard()
        self._stamp = -1
        self._last: tuple[float, ...] = (0.0, 0.0, 0.0)
        self._injected: list[Any] = []
        # Torque and duration of what acts from the next state on.
        self._beginning: list[tuple[tuple[float, ...], float]] = []
        self._accepted = 0
        self._apply_parameters()
        self._send = self.sender(DISTURBANCE)
        self.listen(ATTITUDE, self._on_state)
        self.listen(INJECT, self._on_inject, any_frame=True)

    def check(self, values: Mapping[str, Value]) -> None:
        """See that times, durations and torques of the pulses are equally many."""
        pulses(values)

    def _apply_parameters(self) -> None:
        self._scheduled = pulses(self.parameters.values)
        self._collect()
        self.parameters.changed = False

    def _collect(self) -> None:
        """Put scheduled and injected pulses that have not ended into the kernel's array."""
        self._collected = self._stamp  # until the next state none can end
        self._injected = [item for item in self._injected if item["end_ns"][0] > self._stamp]
        self._pulses = np.concatenate([self._scheduled, np.zeros(0, PULSE), *self._injected])

    def _on_state(self, stamp_ns: int, attitude: tuple[float, ...]) -> None:
        verdict = self._guard.judge(stamp_ns)
        if verdict is Verdict.REPEATED:
            self._send(stamp_ns, self._last)
            return
        if verdict is Verdict.STALE:
            raise out_of_order(ATTITUDE.name, stamp_ns)
        if verdict is Verdict.RESTART:
            self._injected.clear()
            self.restart_report()
        self._stamp = stamp_ns
        if self.parameters.changed:
            self._apply_parameters()
        if self._beginning or verdict is Verdict.RESTART:
            self._begin_injected(stamp_ns)
        self._last = external_torque(
            stamp_ns, seconds(stamp_ns), self.parameters["environment"], self._pulses
        )
        self._send(stamp_ns, self._last)
        self.report(stamp_ns)

    def _begin_injected(self, stamp_ns: int) -> None:
        self._injected += [pulse(stamp_ns, each[1], each[0]) for each in self._beginning]
        self._beginning.clear()
        self._collect()

    def _on_inject(self, stamp_ns: int, torque: tuple[float, ...]) -> None:
        limit = self.parameters["max_injected_torque"]
        if max(map(abs, torque)) > limit:
            raise RefusedError(f"{INJECT.name}: {torque} N·m; allowed: up to {limit} N·m per axis")
        if self._is_full() and self._stamp > self._collected:
            self._collect()
        if self._is_full():
            raise RefusedError(f"{INJECT.name}: {_MAX_INJECTED} pulses are pending already")
        self._accepted += 1
        duration = self.parameters["injection_duration"]
        if stamp_ns > self._stamp:
            self._injected.append(pulse(stamp_ns, duration, torque))
            self._collect()
            when = f"from t = {seconds(stamp_ns):.3f} s on"
        else:
            self._beginning.append((torque, duration))
            when = "from the next state on"
        self.mention(INJECT.name, f"injected torque {torque} N·m acts {when}")

    def _is_full(self) -> bool:
        return len(self._injected) + len(self._beginning) >= _MAX_INJECTED

    def status(self) -> tuple[bytes, str, dict[str, Any]]:
        """Waiting for states, or running."""
        details = {
            "injections accepted": self._accepted,
            "injections pending or active": len(self._injected) + len(self._beginning),
        }
        if self.is_idle():
            return STALE, f"waiting for {ATTITUDE.name}", details
        return OK, "running", details


def main() -> int:
    """Run the executable `disturbance_injector`."""
    return run_node(DisturbanceInjector)


if __name__ == "__main__":
    sys.exit(main())
