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

"""What a node says of its health: the levels, the message, the measured rate."""

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from ppc_attitude.contract.cdr import NANOSECONDS

OK, WARN, ERROR, STALE = (
    DiagnosticStatus.OK,
    DiagnosticStatus.WARN,
    DiagnosticStatus.ERROR,
    DiagnosticStatus.STALE,
)


def diagnostics(
    stamp_ns: int, node: str, level: bytes, summary: str, details: Mapping[str, Any]
) -> DiagnosticArray:
    """Message for `/diagnostics` of one node, given by its fully qualified name."""
    status = DiagnosticStatus(
        level=level,
        # Like diagnostic_updater's, but with the namespace: several craft, one /diagnostics.
        name=f"{node.lstrip('/')}: status",
        message=summary,
        hardware_id=node,
        values=[KeyValue(key=key, value=_text(value)) for key, value in details.items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)
    return message


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


class StepCounter:
    """Steps per second of simulated time, over what passed since the last look."""

    def __init__(self) -> None:
        self._since: int | None = None
        self._latest = -1
        self._count = 0

    def add(self, stamp_ns: int) -> None:
        """Count a step; a repeated one counts once."""
        if self._since is None:
            self._since = stamp_ns
        elif stamp_ns > self._latest:
            self._count += 1
        self._latest = stamp_ns

    def rate(self) -> float:
        """Rate [Hz] since the last call; 0 if no time has passed."""
        passed = self._latest - (self._latest if self._since is None else self._since)
        rate = self._count * NANOSECONDS / passed if passed > 0 else 0.0
        if passed > 0:
            self._since, self._count = self._latest, 0
        return rate
