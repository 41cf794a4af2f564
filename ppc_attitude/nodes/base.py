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

"""What all five nodes share: parameters, links, refusals, diagnostics."""

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rclpy.executors import Executor
from rclpy.node import Node

from ppc_attitude.contract.cdr import NANOSECONDS, Codec, seconds
from ppc_attitude.contract.parameters import WAIT_FOR_RECORDER
from ppc_attitude.contract.topics import (
    DIAGNOSTICS_TOPIC,
    PARAMETER_EVENTS_TOPIC,
    RECORDER,
    Topic,
)
from ppc_attitude.nodes.executors import new_executor
from ppc_attitude.nodes.health import ERROR, OK, WARN, StepCounter, diagnostics
from ppc_attitude.nodes.messages import Inbox, RefusedError, message_class
from ppc_attitude.nodes.parameters import NodeParameters
from ppc_attitude.nodes.qos import published, subscribed
from ppc_attitude.science.parameter import Value

EXIT_OK, EXIT_CONFIGURATION, EXIT_BROKEN = 0, 2, 3
_LOG_PERIOD = 1.0  # [s] the same complaint is logged at most this often
_GRAPH_PERIOD = 0.01  # [s] between two looks for the recorder
_SAY_WAITING = 5.0  # [s] between two messages about what a node waits for
_IDLE_WAIT = 0.1  # [s] longest wait for a message before a node looks around
_IDLE_DIAGNOSTICS = 2.0  # [s] of silence after which diagnostics follow the wall clock
# [s] how long a stopping node waits for its last messages to arrive: a peer that was paused asks
# for what it missed when it hears a heartbeat; without our profile those come every 3 s.
_ACKNOWLEDGE = 8.0


class BaseNode(Node):
    """A node of the stack.

    Subclasses override `check`, `status`, `wake` and `close` as they need.
    """

    executable = ""

    def __init__(self) -> None:
        super().__init__(self.executable)
        self.parameters = NodeParameters(self, self.executable, self.check)
        self.finished = False
        self.exit_code = EXIT_OK
        self.failure = ""
        self.wake_at = 0.0  # on the monotonic clock [s]
        self.waits = bool(self.parameters.values.get(WAIT_FOR_RECORDER.name, False))
        self._subscribe: list[Callable[[], None]] = []  # put off until the recorder listens
        self._born = time.monotonic()
        self.refused: Counter[str] = Counter()
        self._last_log: dict[str, float] = {}
        self._outgoing: list[Any] = []
        self._diagnostics = self.create_publisher(
            DiagnosticArray, DIAGNOSTICS_TOPIC.name, published(DIAGNOSTICS_TOPIC)
        )
        self._next_diagnostics_ns = 0
        self._time_ns = 0  # the latest stamp that was reported
        self._last_activity = time.monotonic()
        self._step_counter = StepCounter()
        self._reported_refusals = 0

    def check(self, values: Mapping[str, Value]) -> None:
        """Raise ConfigurationError if the parameters do not fit together."""

    def status(self) -> tuple[bytes, str, dict[str, Any]]:
        """Level, summary and details for `/diagnostics`."""
        return OK, "running", {}

    def wake(self) -> float:
        """Do what is due by the wall clock; return the time [s] until the next call."""
        self.report_if_idle()
        return _IDLE_WAIT

    def wake_now(self) -> None:
        """Let `wake` be called after the present message, whatever it returned last."""
        self.wake_at = 0.0

    def new_executor(self) -> Executor:
        """Return the executor that runs this node."""
        return new_executor()

    def drain(self, executor: Executor) -> None:
        """Take what has already arrived, before the node ends."""

    def close(self) -> None:
        """Release what the node holds, after the last message."""

    def sender(self, topic: Topic) -> Callable[[int, Sequence[float]], None]:
        """Return a function that publishes (stamp [ns], numbers) on a topic."""
        publisher = self.create_publisher(
            message_class(topic.msgtype), topic.name, published(topic)
        )
        self._outgoing.append(publisher)
        # What `Publisher.publish` calls for bytes, without its look at the type of every message.
        publish, encode = publisher.handle.publish_raw, Codec(topic).encode

        def send(stamp_ns: int, values: Sequence[float]) -> None:
            publish(encode(stamp_ns, values))

        return send

    def listen(
        self,
        topic: Topic,
        handle: Callable[[int, tuple[float, ...]], None],
        any_frame: bool = False,
    ) -> None:
        """Call `handle(stamp [ns], numbers)` for every message that passes the checks."""
        read = Inbox(topic, any_frame).read

        def receive(data: bytes) -> None:
            try:
                sample = read(data)
                handle(sample.stamp_ns, sample.values)
            except RefusedError as reason:
                self.refuse(topic.name, str(reason))

        def subscribe() -> None:
            self.create_subscription(
                message_class(topic.msgtype), topic.name, receive, subscribed(topic), raw=True
            )

        if self.waits:
            self._subscribe.append(subscribe)
        else:
            subscribe()

    def await_recorder(self) -> float:
        """Begin to listen once the recorder does; return the time [s] until the next look."""
        if self.is_recorded(RECORDER):
            self.waits = False
            for subscribe in self._subscribe:
                subscribe()
            return 0.0
        self.say_waiting(self._born, lambda: f"waiting for {RECORDER} to listen")
        self.report_if_idle()
        return _GRAPH_PERIOD

    def say_waiting(self, since: float, text: Callable[[], str]) -> None:
        """Log every few seconds what is waited for since a time [s] of the monotonic clock."""
        if time.monotonic() - since >= _SAY_WAITING and self._may_log("waiting", _SAY_WAITING):
            self.get_logger().warning(text())

    def refuse(self, kind: str, reason: str) -> None:
        """Count a refusal and log it, at most once a second for each kind."""
        self.refused[kind] += 1
        self.complain(kind, f"refused {reason}")

    def complain(self, kind: str, text: str) -> None:
        """Log a warning, at most once a second for each kind."""
        if self._may_log(kind):
            self.get_logger().warning(text)

    def mention(self, kind: str, text: str) -> None:
        """Log what anyone may cause, at most once a second for each kind."""
        if self._may_log(f"{kind} (accepted)"):
            self.get_logger().info(text)

    def _may_log(self, kind: str, period: float = _LOG_PERIOD) -> bool:
        now = time.monotonic()
        due = now - self._last_log.get(kind, -period) >= period
        if due:
            self._last_log[kind] = now
        return due

    def report(self, stamp_ns: int, at_once: bool = False) -> None:
        """Publish diagnostics once per simulated second, or at once."""
        self._last_activity = time.monotonic()
        self._step_counter.add(stamp_ns)
        self._time_ns = stamp_ns
        if at_once or stamp_ns >= self._next_diagnostics_ns:
            self._publish_diagnostics()
            self._next_diagnostics_ns = stamp_ns + NANOSECONDS

    def fail(self, stamp_ns: int, reason: str) -> None:
        """End the node as a broken one, and say so in its last diagnostics."""
        self.get_logger().error(reason)
        self.exit_code, self.failure, self.finished = EXIT_BROKEN, reason, True
        self.report(stamp_ns, at_once=True)
        if self._diagnostics.get_subscription_count():
            self._diagnostics.wait_for_all_acked(Duration(seconds=_ACKNOWLEDGE))

    def restart_report(self) -> None:
        """Let the diagnostics begin again after time has gone back."""
        self._next_diagnostics_ns = self._time_ns = 0
        self._step_counter = StepCounter()

    def is_idle(self) -> bool:
        """True if no step has come for a while."""
        return time.monotonic() - self._last_activity > 0.5 * _IDLE_DIAGNOSTICS

    def report_if_idle(self) -> None:
        """Publish diagnostics by the wall clock when no step has come for a while."""
        if time.monotonic() - self._last_activity > _IDLE_DIAGNOSTICS:
            self._last_activity = time.monotonic() - _IDLE_DIAGNOSTICS + 1.0
            self._publish_diagnostics()

    def _publish_diagnostics(self) -> None:
        level, summary, details = self.status()
        refusals = {f"refused {name}": count for name, count in sorted(self.refused.items())}
        newly_refused = self.refused.total() - self._reported_refusals
        self._reported_refusals += newly_refused
        if level == OK and newly_refused:
            level, summary = WARN, f"{summary}; refused {newly_refused} since the last report"
        if self.failure:
            level, summary = ERROR, self.failure
        pace = {
            "time [s]": seconds(self._time_ns),
            "measured rate [Hz]": self._step_counter.rate(),
        }
        name = self.get_fully_qualified_name()
        message = diagnostics(self._time_ns, name, level, summary, {**pace, **details, **refusals})
        self._diagnostics.publish(message)

    def flush(self, patience: float = _ACKNOWLEDGE) -> bool:
        """Wait until every peer has what this node has sent; False after `patience` [s]."""
        end = time.monotonic() + patience
        waited = [
            publisher.wait_for_all_acked(Duration(seconds=max(end - time.monotonic(), 0.0)))
            for publisher in self._outgoing
            if publisher.get_subscription_count()
        ]
        return all(waited)

    def is_recorded(self, recorder: str) -> bool:
        """True if a node of this name listens to every topic that this node sends."""
        sent = [publisher.topic_name for publisher in self._outgoing]
        return all(
            any(end.node_name == recorder for end in self.get_subscriptions_info_by_topic(topic))
            for topic in (*sent, PARAMETER_EVENTS_TOPIC.name)
        )
