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

"""The latest samples and the health of a running stack, for programs that only look on."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from ppc_attitude.contract.cdr import Sample
from ppc_attitude.contract.declared import BOUNDS, BY_COLUMN
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE,
    DIAGNOSTICS_TOPIC,
    DISTURBANCE,
    TORQUE_COMMAND,
)
from ppc_attitude.nodes.messages import LatestSamples, subscribe
from ppc_attitude.runtime.health import STALE, Status
from ppc_attitude.science.stamps import NANOSECONDS

_SILENT = 3  # [s] behind the states after which a topic has gone, or a node that is as long silent
_ALWAYS = (ATTITUDE, ANGULAR_VELOCITY, APPLIED_TORQUE, TORQUE_COMMAND, DISTURBANCE)
BOUNDED = tuple((BY_COLUMN[error], BY_COLUMN[bound]) for error, bound in BOUNDS)
"""What some component bounds, and what bounds it."""
WATCHED = tuple(dict.fromkeys((*_ALWAYS, *(topic for pair in BOUNDED for topic in pair))))


@dataclass(frozen=True)
class Snapshot:
    """The state of a stack at one moment."""

    samples: dict[str, Sample] = field(default_factory=dict)  # the latest usable one of each topic
    health: dict[str, Status] = field(default_factory=dict)  # the latest, by the node's full name
    complete: bool = False  # true if nothing that somebody publishes is missing


class Onlooker:
    """Subscribes to what a person wants to see of the stack in the node's namespace."""

    now = staticmethod(time.monotonic)  # [s] by the wall clock; a test has a clock of its own

    def __init__(self, node: Node, listen: Callable[[float], None]) -> None:
        self._listen = listen
        self._count = node.count_publishers
        self._home = node.get_namespace()
        # The nodes themselves refuse what must not be used, and say so in their diagnostics.
        self._latest = LatestSamples(node, WATCHED, lambda name, reason: None)
        self._health: dict[str, tuple[float, int, Status]] = {}  # when it came, and its stamp [ns]
        subscribe(node, DIAGNOSTICS_TOPIC, self._on_health)

    def _on_health(self, message: DiagnosticArray) -> None:
        stamp_ns = message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec
        for status in message.status:
            if status.hardware_id.rpartition("/")[0] == self._home.rstrip("/"):
                details = {entry.key: entry.value for entry in status.values}
                told = Status(status.level, status.message, details)
                self._health[status.hardware_id] = self.now(), stamp_ns, told

    def look(self, duration: float) -> Snapshot:
        """Take in messages for some time [s], and return the latest of all.

        While states go on, a topic that has fallen silent is left out, and a silent node is stale.
        """
        self._listen(duration)
        samples = {each.name: sample for each in WATCHED if (sample := self._latest.get(each))}
        state = samples.get(ATTITUDE.name)
        now_ns, near = state.stamp_ns if state else 0, _SILENT * NANOSECONDS
        # A sample whose stamp is far ahead is from the time before a reset.
        old = [name for name, each in samples.items() if abs(each.stamp_ns - now_ns) > near]
        samples = {name: samples[name] for name in samples.keys() - old} if state else samples
        absent = [topic for topic in WATCHED if topic.name not in samples]
        lacks = any(topic in _ALWAYS or self._count(topic.name) for topic in absent)
        health = {}
        for node, (came, stamp_ns, told) in self._health.items():
            silent = self.now() - came
            gone = state and abs(stamp_ns - now_ns) > near and silent > _SILENT
            health[node] = Status(STALE, f"silent for {silent:.0f} s", {}) if gone else told
        return Snapshot(samples, health, bool(health) and not lacks)
