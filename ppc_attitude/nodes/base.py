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

"""The base of all nodes: parameters, links, refusals, diagnostics."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from rclpy.duration import Duration
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.task import Future

from ppc_attitude.contract.cdr import Codec
from ppc_attitude.contract.parameters import WAIT_FOR_RECORDER
from ppc_attitude.contract.topics import (
    CHANGES_TOPIC,
    DIAGNOSTICS_TOPIC,
    OF_A_RUN,
    PARAMETER_EVENTS_TOPIC,
    RECORDER,
    STANDARD,
    Topic,
)
from ppc_attitude.nodes.messages import (
    Inbox,
    changed,
    diagnostics,
    new_executor,
    publisher_of,
    subscribe,
)
from ppc_attitude.nodes.parameters import NodeParameters
from ppc_attitude.nodes.publisher_watch import PublisherWatch, node_of, publishing_nodes
from ppc_attitude.processes.exits import BROKEN, DONE
from ppc_attitude.processes.telling import LINGERS, WAITING, tell, tell_broken
from ppc_attitude.runtime.health import ERROR, OK, STALE, Health, Status
from ppc_attitude.runtime.stamps import RefusedError
from ppc_attitude.science.hooks import Advice
from ppc_attitude.science.parameter import Value
from ppc_attitude.science.stamps import nanoseconds, seconds

_GRAPH_PERIOD = 0.01  # [s] between two looks for the recorder
_SAY_WAITING = 5.0  # [s] between two messages about what a node waits for
_IDLE_WAIT = 0.1  # [s] longest wait for a message before a node looks around
# [s] how long a stopping node waits for its last messages to arrive: a peer that was paused asks
# for what it missed when it hears a heartbeat; without our profile those come every 3 s.
_ACKNOWLEDGE = 8.0
_SOON = 1.0  # [s] within which every living node of the run has acknowledged its messages
_GLANCE = Duration(seconds=0.1)  # between two looks at the readers that are left


class BaseNode(Node):
    """A node of the stack.

    Subclasses override `check`, `status`, `wake` and `close` as they need.
    """

    executable = ""
    now = staticmethod(time.monotonic)  # [s] by the wall clock; a test has a clock of its own
    is_asked_to_end = staticmethod(lambda: False)  # `running` replaces it by a look at signals

    def __init__(self) -> None:
        super().__init__(self.executable, start_parameter_services=False)
        self.parameters = NodeParameters(self, self.executable, self.check)
        self.finished = False
        self.exit_code = DONE
        self.failure = ""
        self.wake_at = 0.0  # on the monotonic clock [s]
        self.heard = 0  # messages on topics that it listens to
        self._turn = Future()  # done when the node has something to do by itself
        self.waits = bool(self.parameters.values.get(WAIT_FOR_RECORDER.name, False))
        self.health = Health(self.now())
        self._subscribe: list[Callable[[], Any]] = []  # put off until the recorder listens
        self._born = self.now()
        self.told: dict[str, Value] = {}  # changes that are on record, by name
        self._incoming: list[str] = []
        self._outgoing: list[Any] = []
        self._diagnostics = publisher_of(self, DIAGNOSTICS_TOPIC)
        self._changes = publisher_of(self, CHANGES_TOPIC)
        self._watch = PublisherWatch(self, self._born)

    def check(self, values: Mapping[str, Value]) -> None:
        """Raise ConfigurationError if the parameters do not fit together."""

    def status(self) -> Status:
        """The status for `/diagnostics`."""
        return Status(OK, "running", {})

    def wake(self) -> float:
        """Do what is due by the wall clock; return the time [s] until the next call."""
        now = self.now()
        if self.health.idle_report_is_due(now):
            self._publish_diagnostics()
        self._look_for_others(now)
        return _IDLE_WAIT

    def wake_now(self) -> None:
        """Let `wake` be called after the present message, whatever it returned last."""
        self.wake_at = 0.0
        self._turn.set_result(None)

    def finish(self) -> None:
        """End after the present message."""
        self.finished = True
        self.wake_now()

    def new_turn(self) -> Future:
        """Return a new future that `wake_now` completes; until then the executor takes messages."""
        self._turn = Future()
        return self._turn

    def new_executor(self) -> Executor:
        """Return the executor that runs this node."""
        return new_executor()

    def drain(self, executor: Executor) -> None:
        """Take the messages that have already arrived, before the node ends."""

    def close(self) -> None:
        """Release the node's resources after its last message, and say why it ends."""
        self._watch.close()
        end = "the run is complete" if self.finished else "it was asked to end"
        self.get_logger().info(f"the node ends: {self.failure or end}")

    def take_changes(self, stamp_ns: int) -> None:
        """Take over the parameters that were set, from a stamp [ns] on, and tell it."""
        changes = self.parameters.take_changes()
        self.tell_changes(stamp_ns, changes)
        if alike := ", ".join(filter(self.parameters.is_agreed, changes)):
            text = "every node with this parameter needs the same value; set it in each of them"
            self.complain("alike", f"{alike}: {text}")

    def tell_changes(self, stamp_ns: int, changes: Mapping[str, Value]) -> None:
        """Publish parameters that hold from a stamp [ns] on, so that they are on record."""
        self.told |= changes
        self._changes.publish(changed(stamp_ns, self.get_name(), changes))
        text = ", ".join(f"{name} = {value}" for name, value in changes.items())
        self.get_logger().info(f"from t = {seconds(stamp_ns):.6f} s on: {text}")

    def tell_again(self, stamp_ns: int) -> None:
        """Publish all changes again, because time and the record begin anew at a stamp [ns]."""
        if self.told:
            self.tell_changes(stamp_ns, self.told)

    def sender(self, topic: Topic) -> Callable[[int, Sequence[float]], None]:
        """Return a function that publishes (stamp [ns], numbers) on a topic."""
        publisher = publisher_of(self, topic)
        self._outgoing.append(publisher)
        self._watch.add(topic, publisher.topic_name)
        # `Publisher.publish` calls this for bytes; so it spares a check of every message's type.
        publish, encode = publisher.handle.publish_raw, Codec(topic).encode

        def send(stamp_ns: int, values: Sequence[float]) -> None:
            publish(encode(stamp_ns, values))

        def send_late(stamp_ns: int, values: Sequence[float]) -> None:
            valid_ns = stamp_ns - nanoseconds(values[-1])
            if any(values) and valid_ns >= 0:  # a row of zeros is no message; a run begins at zero
                publish(encode(valid_ns, values[:-1]))

        return send_late if topic.late else send

    def listen(self, topic: Topic, handle: Callable[[int, tuple[float, ...]], None]) -> None:
        """Call `handle(stamp [ns], numbers)` for every message that passes the checks."""
        self._incoming.append(self.resolve_topic_name(topic.name))
        read = Inbox(topic).read

        def receive(data: bytes) -> None:
            if self.waits:
                return
            self.heard += 1
            try:
                sample = read(data)
                handle(sample.stamp_ns, sample.values)
            except RefusedError as reason:
                self.refuse(topic.name, str(reason))

        begin = partial(subscribe, self, topic, receive, raw=True)
        # The recorder finds other topics by their readers in the graph: so this one reads at once.
        if self.waits and topic in STANDARD:
            self._subscribe.append(begin)
        else:
            begin()

    def await_recorder(self) -> float:
        """Begin to listen once the recorder does; return the time [s] until the next look."""
        told = self._unrecorded()
        if not told:
            self.waits = False
            tell(WAITING, "")
            for begin in self._subscribe:
                begin()
            return 0.0
        self.say_waiting(self._born, lambda: told)
        BaseNode.wake(self)
        return _GRAPH_PERIOD

    def _unrecorded(self) -> str:
        """Say to which of this node's topics no recorder listens yet; empty if it does to all."""
        sent = [publisher.topic_name for publisher in self._outgoing]
        unheard = [
            topic
            for topic in (*sent, *self._incoming, PARAMETER_EVENTS_TOPIC.name)
            if not any(
                end.node_name == RECORDER for end in self.get_subscriptions_info_by_topic(topic)
            )
        ]
        return f"waiting for {RECORDER} to listen to {', '.join(unheard)}" if unheard else ""

    def say_waiting(self, since: float, text: Callable[[], str]) -> None:
        """Log every few seconds what the node waits for since a time [s] of the monotonic clock.

        The text is empty if the node waits for nothing.
        """
        now = self.now()
        long = now - since >= _SAY_WAITING
        if long and (told := text()) and self.health.may_log("waiting", now, _SAY_WAITING):
            tell(WAITING, told)
            self.get_logger().warning(told)

    def refuse(self, kind: str, reason: str) -> None:
        """Count a refusal and log it, at most once a second for each kind, such as a topic.

        If several nodes publish the topic, they are named: their stamps in turns look out of order,
        and such messages do not prove to a `PublisherWatch` that two publishers are alive.
        """
        self.health.refused[kind] += 1
        if self.health.may_log(kind, self.now()):
            nodes = sorted(filter(None, publishing_nodes(self, kind).values()))
            named = f"; this topic's publishers are {', '.join(nodes)}" if len(nodes) > 1 else ""
            self.get_logger().warning(f"refused {reason}{named}")

    def complain(self, kind: str, text: str) -> None:
        """Log a warning, at most once a second for each kind."""
        if self.health.may_log(kind, self.now()):
            self.get_logger().warning(text)

    def mention(self, kind: str, text: str) -> None:
        """Log an event that a user can trigger from outside, at most once a second."""
        if self.health.may_log(f"{kind} (accepted)", self.now()):
            self.get_logger().info(text)

    def say_all(self, news: Iterable[Advice]) -> None:
        """Log advice, of the node's components or its own, as errors, warnings or neither."""
        for advice in news:  # rclpy allows one severity for each line of source
            if advice.failed:
                self.get_logger().error(advice.text)
            elif advice.warning:
                self.get_logger().warning(advice.text)
            else:
                self.get_logger().info(advice.text)

    def report(self, stamp_ns: int, at_once: bool = False) -> None:
        """Publish diagnostics once per simulated second, or at once."""
        if self.health.step(stamp_ns, self.now()) or at_once:
            self._publish_diagnostics()

    def fail(self, stamp_ns: int, reason: str) -> None:
        """End the node as a broken one, and say so in its last diagnostics."""
        self.get_logger().error(reason)
        tell_broken(reason)
        self.exit_code, self.failure = BROKEN, reason
        self.finish()
        self.report(stamp_ns, at_once=True)
        self._await_readers([self._diagnostics])

    def is_idle(self) -> bool:
        """True if no step has come for a while."""
        return self.health.is_idle(self.now())

    def _look_for_others(self, now: float) -> None:
        """Fail if another node publishes on the same topics; the one that came first goes on."""
        self._watch.look(now)
        others = self._watch.found
        if not others:
            return
        tell_broken(others)
        self.exit_code = BROKEN
        if self._watch.gives_way:
            self.fail(self.health.time_ns, f"{others}; this node is the newer one and ends")
        else:
            self.complain("others", others)

    def _publish_diagnostics(self) -> None:
        status = self.status()
        if self.waits:
            status = Status(STALE, self._unrecorded(), status.details)
        if self._watch.found:
            status = Status(ERROR, self._watch.found, status.details)
        name, said = self.get_fully_qualified_name(), self.health.report(status, self.failure)
        self._diagnostics.publish(diagnostics(self.health.time_ns, name, "status", said))

    def flush(self) -> None:
        """Wait until every peer has all messages of this node; name those that have not."""
        self._await_readers(self._outgoing)

    def _await_readers(self, publishers: Sequence[Any]) -> None:
        """Wait until all readers have the messages; for strangers alone only `_SOON`."""
        home = self.get_namespace().rstrip("/")
        ours = {f"{home}/{name}" for name in OF_A_RUN}
        begin = self.now()
        for publisher in publishers:
            while publisher.get_subscription_count() and not publisher.wait_for_all_acked(_GLANCE):
                readers = self.get_subscriptions_info_by_topic(publisher.topic_name)
                names = set(map(node_of, readers))
                # One recorder may record several craft; then its namespace is another.
                ours |= {name for name in names if name.endswith(f"/{RECORDER}")}
                waited = self.now() - begin
                if waited < _SOON:
                    continue
                if names - ours:
                    tell(LINGERS, True)
                if waited > _ACKNOWLEDGE or not names & ours:
                    slow = ", ".join(sorted(names - ours or names))
                    text = f"{slow} did not take all of {publisher.topic_name}: this node ends"
                    self.get_logger().warning(text)
                    return
