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

"""What programs that only look on see of a running stack: samples, health, latencies."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.node import Node

from ppc_attitude.contract.cdr import Sample, header_stamp
from ppc_attitude.contract.declared import BOUNDS, BY_COLUMN
from ppc_attitude.contract.topics import (
    ANGULAR_VELOCITY,
    APPLIED_TORQUE,
    ATTITUDE,
    DIAGNOSTICS_TOPIC,
    DISTURBANCE,
    TORQUE_COMMAND,
    Topic,
)
from ppc_attitude.nodes.messages import LatestSamples, recorded, subscribe
from ppc_attitude.nodes.visiting import listening, visiting
from ppc_attitude.runtime.health import STALE, Status
from ppc_attitude.science.stamps import NANOSECONDS, seconds

_SILENT = 3  # [s] behind the states after which a topic has gone, or a node that is as long silent
_LOOK = 0.05  # [s] for which messages are taken in before a measurement may end
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


class Latencies(NamedTuple):
    """Latencies from states to the torques that answer them, as any node on the graph sees them."""

    states: int  # that were seen
    period: float  # median time between their stamps [s]; NaN for fewer than two
    answered: NDArray[np.float64]  # [s] from the arrival of each answered state to its command's

    @property
    def missed(self) -> int:
        """States whose command came later than a period, or never."""
        return self.states - int(np.count_nonzero(self.answered <= self.period))


def measure(
    goes_on: Callable[[float | None], bool],
    namespace: str = "",
    joining: float = 0.0,
    now: Callable[[], float] = time.perf_counter,
) -> Latencies:
    """Listen to states and torque commands as long as `goes_on` is true.

    It gets the time at which the first state came, by `now` [s], or None before that.
    States that come within `joining` [s] after it do not count: a node that joins a running topic
    gets its first messages late and all at once, and those of another topic at another time.
    """
    arrivals: dict[int, float] = {}
    answers: dict[int, float] = {}

    def note(topic: Topic, times: dict[int, float], data: bytes) -> None:
        stamp = header_stamp(data, topic.msgtype)
        if stamp is not None:
            times.setdefault(stamp, now())

    with visiting("latency_probe", namespace) as node:
        for topic, times in ((ATTITUDE, arrivals), (TORQUE_COMMAND, answers)):
            subscribe(node, topic, partial(note, topic, times), recorded(topic), raw=True)
        with listening(node) as listen:
            while goes_on(next(iter(arrivals.values()), None)):
                listen(_LOOK)
    begin = min(arrivals.values(), default=0.0) + joining
    # The last state may be answered after the measurement.
    stamps = sorted(stamp for stamp, arrival in arrivals.items() if arrival >= begin)[:-1]
    steps = np.diff([seconds(stamp) for stamp in stamps])
    trips = [answers[stamp] - arrivals[stamp] for stamp in stamps if stamp in answers]
    period = float(np.median(steps)) if len(steps) else np.nan
    return Latencies(len(stamps), period, np.array(trips, np.float64))
