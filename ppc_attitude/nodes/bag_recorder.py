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

"""The recorder: writes every topic of a run into a rosbag2 bag, and tells what is missing."""

import json
import sys
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.qos import ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock

from ppc_attitude.bags.custom_data import (
    GAPS_KEY,
    UNKNOWN_CONTROLLER,
    encode_custom_data,
    of_namespace,
    read_run_info,
)
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.writer import BagWriter, offered_qos
from ppc_attitude.contract.cdr import encode_clock, header_stamp
from ppc_attitude.contract.topics import (
    ATTITUDE,
    CHANGES_TOPIC,
    CONTROLLER,
    ENABLED,
    EVENTS,
    INJECTOR,
    OWNED,
    PLANT,
    RECORDED_TOPIC,
    RECORDER,
    REFERENCE,
    STANDARD,
    Topic,
)
from ppc_attitude.contract.versions import versions
from ppc_attitude.contract.whole_file import dated
from ppc_attitude.nodes.base import BaseNode
from ppc_attitude.nodes.messages import (
    Flow,
    Take,
    changed,
    message_class,
    published,
    recorded,
    take_gathered,
)
from ppc_attitude.nodes.publisher_watch import publishing_nodes
from ppc_attitude.nodes.run_graph import (
    ParameterSurvey,
    RunGraph,
    comes_with_state,
    homes_of,
    telling,
)
from ppc_attitude.nodes.running import run_node
from ppc_attitude.processes.child import come_last, give_way
from ppc_attitude.processes.exits import BROKEN
from ppc_attitude.processes.telling import BAG, tell, tell_broken
from ppc_attitude.runtime.health import OK, STALE, Status
from ppc_attitude.runtime.recording import Drain, Recording
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.parameter import Value
from ppc_attitude.science.stamps import seconds

_BATCH = 0.005  # [s] messages that arrive within this time are taken together
_CALM = 0.05  # [s] of silence after which the executor waits for the next message, at 0.5 ms each
_LONGEST = 0.1  # [s] after which a recorder in full flow looks for signals and services
_CALLS = 5  # of the executor at each such look: for clock, services and answers
_LOOK_EARLY, _LOOK = 0.1, 0.25  # [s] between two looks at the graph: before a run, and during it


class _Ear(NamedTuple):
    """How one topic of one run is heard."""

    home: str
    topic: Topic
    subscription: Any


class BagRecorder(BaseNode):
    """Writes raw messages as they arrive; a bag with a missing message is never called complete.

    Messages are logged at the simulated time of their stamp, those without a stamp at the time of
    the latest state, so that two runs of one configuration give the same bag.
    """

    executable = RECORDER

    def __init__(self) -> None:
        super().__init__()
        self._run_info = read_run_info(self.parameters["run_info"])
        self._path = Path(self.parameters["bag"] or dated("bags"))
        try:
            self._writer = BagWriter(
                self._path, storage=self.parameters["storage"], custom_data=self._custom_data()
            )
        except BagError as error:
            raise ConfigurationError(str(error)) from error.__cause__
        self._flow, self._executor = Flow(), SingleThreadedExecutor()
        self._heard_at = 0.0  # time of the last look that found any message
        self._about: Mapping[str, Any] = {}  # what rclpy says about the last message
        self._written, self._now = 0, 0.0
        self._looked = -_LOOK
        self._ears: dict[str, _Ear] = {}  # by the full name of the topic
        self._names: dict[tuple[str, str], str] = {}  # that name, for each topic of each run
        self._announced, self._incompatible = set[str](), set[str]()
        self._recordings: dict[str, Recording] = {}  # by the namespace that is the run's home
        self._progress: dict[str, Any] = {}
        self._restarted: dict[tuple[str, str], tuple[float, dict[str, Any]]] = {}
        for home in homes_of(self, self.parameters["namespaces"]):
            self._follow(home)
        samples = self._run_info.get("samples", {})
        told = {home: of_namespace(samples, home) for home in self._recordings}
        if all(self._is_waited_for(home) for home in self._recordings):
            come_last()
        self._graph = RunGraph(self, told)
        self._survey = None if self._run_info else ParameterSurvey(self, self._graph, self._learn)
        tell(BAG, str(self._path))
        self.get_logger().info(f"recording to {self._path}")

    def check(self, values: Mapping[str, Value]) -> None:
        """See that the facts about the run can be read, and that the namespaces are valid."""
        read_run_info(str(values["run_info"]))
        homes_of(self, cast(list[str], values["namespaces"]))

    def _follow(self, home: str) -> None:
        """Record the run in a namespace; subscribe to the contract's topics before any is sent."""
        self._recordings[home] = Recording(partial(self._write, home))
        name = f"{home}/{RECORDED_TOPIC.name}"
        self._progress[home] = self.create_publisher(Clock, name, published(RECORDED_TOPIC))
        self._watch.add_shared(self._progress[home].topic_name)
        for topic in (*STANDARD, *EVENTS):
            self._record_topic(home, topic)

    def _learn(self, home: str, node: str, values: dict[str, Any], since: float) -> None:
        """Write down the parameters that another node has told."""
        full, parameters = f"{home}/{node}", self._run_info.setdefault("parameters", {})
        if full in parameters and self._recordings[home].now >= 0:
            self._restarted[home, node] = since, values
            return
        parameters[full] = values
        try:
            for key, value in self._custom_data().items():
                self._writer.set_custom_data(key, value)
        except BagError as error:
            self.fail(self._recordings[home].now, str(error))
        else:
            self.get_logger().info(f"the parameters of {full} are on record")

    def _tell_restarted(self, ends: bool = False) -> None:
        """Record the parameters of restarted nodes as changes, from the first stamp of each on."""
        for (home, node), (since, values) in tuple(self._restarted.items()):
            recording, ears = self._recordings[home], self._ears.values()
            names = telling([own for where, own, _ in ears if (where, own.source) == (home, node)])
            begun = recording.began(names, since)
            if begun is None and (ends or not names):
                begun = recording.now + ends  # the last state was answered by the one before
            if begun is not None:
                del self._restarted[home, node]
                data = serialize_message(changed(begun, node, {**values, ENABLED: True}))
                recording.event(CHANGES_TOPIC.name, begun, data)
                text = f"from t = {seconds(begun):.6f} s on, when the node was started again"
                self.get_logger().info(f"the parameters of {home}/{node} are on record {text}")

    def _is_waited_for(self, home: str) -> bool:
        """True if a plant sends no further state while this recorder is behind."""
        plant = of_namespace(self._run_info.get("parameters", {}), home).get(PLANT, {})
        return bool(plant.get("lockstep") and plant.get("wait_for_recorder"))

    def _custom_data(self) -> dict[str, str]:
        parameters = self._run_info.get("parameters", {})
        metadata = {**versions(), **self._run_info.get("metadata", {})}
        controller = str(parameters.get(CONTROLLER, {}).get("controller", UNKNOWN_CONTROLLER))
        return encode_custom_data(controller, parameters, metadata)

    def _record_topic(self, home: str, topic: Topic, reliable: bool = True) -> None:
        absolute = topic.name.startswith("/")
        name = self.resolve_topic_name(topic.name if absolute else f"{home}/{topic.name}")
        old = self._ears.get(name)
        if old is not None and reliable:
            return
        subscription = self.create_subscription(
            message_class(topic.msgtype),
            name,
            self._receiver(home, topic),
            recorded(topic, reliable),
            callback_group=self._flow,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                incompatible_qos=lambda event: self._incompatible.add(name)
            ),
        )
        self._ears[name] = _Ear(home, topic, subscription)
        self._names[home, topic.name] = name
        if old is not None:
            self.destroy_subscription(old.subscription)

    def _receiver(self, home: str, topic: Topic) -> Take:
        recording, name, msgtype = self._recordings[home], topic.name, topic.msgtype
        ahead = topic.source in (REFERENCE, INJECTOR)  # they may send before the state has come
        with_state, owned = comes_with_state(topic), topic in OWNED

        # To a callback of two arguments rclpy also tells the publisher's number of the message.
        # Its events executor fails at such a callback.
        def receive_event(data: bytes, about: Mapping[str, Any]) -> None:
            self._about, stamp_ns = about, header_stamp(data, msgtype)
            number = about["publication_sequence_number"]
            if not with_state:
                recording.event(name, stamp_ns, data)
                if owned:
                    recording.hear(name, stamp_ns, number, self._now)
                return
            recording.event_with_state(name, stamp_ns, data, number, self._now)

        def receive(data: bytes, about: Mapping[str, Any]) -> None:
            self._about = about
            if self.wake_at:  # the executor took the first after a silence: `wake` takes the others
                self.wake_now()
            number, stamp_ns = about["publication_sequence_number"], header_stamp(data, msgtype)
            if stamp_ns == 0 and name != ATTITUDE.name:  # the states tell if time begins again
                take_gathered(self._ears[self._names[home, ATTITUDE.name]].subscription)
            recording.sample(name, stamp_ns, data, number, self._now, ahead)

        return receive if topic.column else receive_event

    def _write(self, home: str, name: str, time_ns: int, data: bytes) -> None:
        if self.failure:
            return
        full = self._names[home, name]
        try:
            if full not in self._announced:
                self._announced.add(full)
                topic = self._ears[full].topic
                qos = published(topic)
                offered = offered_qos(qos.reliability.name, qos.durability.name, qos.depth)
                self._writer.add_topic(full, topic.msgtype, [offered])
            self._writer.write(full, time_ns, data)
            self._written += 1
        except BagError as error:
            self.fail(self._recordings[home].now, str(error))
        else:
            if name == ATTITUDE.name:
                self.report(self._recordings[home].now)

    def _look_around(self) -> None:
        """Find the other topics of the run's nodes, and strangers that publish on its topics."""
        runs = any(recording.now >= 0 for recording in self._recordings.values())
        if self._now - self._looked < (_LOOK if runs else _LOOK_EARLY):
            return
        self._looked = self._now
        for home, topic in self._graph.look():
            self._record_topic(home, topic)
        if self._survey:
            self._survey.ask(self._now)
        self._tell_restarted()
        for full, (home, topic, _) in self._ears.items():
            if (topic.column or topic in OWNED) and self.count_publishers(full) > 1:
                self._recordings[home].see(topic.name, publishing_nodes(self, full), self._now)
        for home, recording in self._recordings.items():
            lacking = ", ".join(recording.missing(self._graph.awaited[home]))
            self.say_waiting(self._born, partial(str, lacking and f"waiting for {lacking}"))
        while runs and self._incompatible:
            self._take_less(self._incompatible.pop())

    def _take_less(self, name: str) -> None:
        """Read a topic at best effort if no publisher offers more, such as a user's own node."""
        ends = self.get_publishers_info_by_topic(name)
        offered = [end.qos_profile.reliability == ReliabilityPolicy.RELIABLE for end in ends]
        nodes = ", ".join(sorted(publishing_nodes(self, name).values()))
        if offered and not any(offered):
            self.get_logger().info(f"{name}: {nodes} sends at best effort; so it is recorded")
            home, topic, _ = self._ears[name]
            self._record_topic(home, topic, reliable=False)
        elif offered:
            text = f"{name}: messages sent at best effort are not recorded; publishers: {nodes}"
            self.get_logger().warning(text)

    def new_executor(self) -> Executor:
        """Return an executor that only looks at messages when it is asked to.

        No node waits for a single answer of the recorder. Waking up for every message costs more
        than all the rest of recording, so `wake` takes what has gathered.
        """
        return self._executor

    def _take_gathered(self) -> None:
        """Take all that has arrived."""
        self._now = self.now()
        heard = [ear for ear in self._ears.values() if take_gathered(ear.subscription)]
        for home, recording in self._recordings.items():
            if (stamp := recording.progress(self._graph.awaited[home])) is not None:
                self._progress[home].publish(encode_clock(stamp))
        if heard:
            self._heard_at = self._now

    def drain(self, executor: Executor) -> None:
        """Take all that was sent before the stop: until nothing has come for a while."""
        self._now = self.now()
        drain = Drain(self._now, time.time_ns())
        while not self.failure and drain.goes_on(self._now, self._heard_at):
            self._take_gathered()
            last = self._about  # its sender's clock may be wrong
            sent = min(last.get("source_timestamp", 0), last.get("received_timestamp", 0))
            if drain.runs_on(self._now, sent):
                for recording in self._recordings.values():
                    recording.end(self._now)
            executor.spin_once(timeout_sec=_BATCH)

    def close(self) -> None:
        """Finish the bag, and say whether it is complete."""
        self._tell_restarted(ends=True)
        homes = () if self.failure else self._recordings  # the counts go on when the bag does not
        gaps = [gap for home in homes for gap in self._gaps(home)]
        try:
            if not self.failure:
                self._writer.set_custom_data(GAPS_KEY, json.dumps(gaps))
            self._writer.close()
        except BagError as error:
            if not self.failure:
                self.fail(self.health.time_ns, str(error))
        for home, recording in self._recordings.items():
            for name, count in recording.surplus().items():
                text = f"{count} messages of {self._names[home, name]} are not judged: their stamps"
                why = "are not later than an earlier one; only at stamp 0 may time begin again"
                self.get_logger().warning(f"{text} {why}")
        if any(recording.unnumbered() for recording in self._recordings.values()):
            text = "this middleware numbers no messages: a second publisher would go unnoticed"
            self.get_logger().warning(text)
        if self._survey:
            self._survey.close()
        if gaps:
            self.exit_code = BROKEN
            tell_broken(f"bag {self._path} is incomplete: {'; '.join(gaps)}")
            for gap in gaps:
                self.get_logger().error(f"bag {self._path} is incomplete: {gap}")
            self.failure = self.failure or f"bag {self._path} is incomplete: {gaps[0]}"
        elif not self.failure:
            known = "" if self._run_info.get("samples") else " of the topics that every run has"
            text = f"closed {self._path}: {self._written} messages, none missing{known}"
            self.get_logger().info(text)
        super().close()

    def _gaps(self, home: str) -> list[str]:
        gaps = self._recordings[home].gaps(sorted(self._graph.promised[home]))
        return [f"{home}/{gap}" if len(self._recordings) > 1 else gap for gap in gaps]

    def wake(self) -> float:
        """Take messages in batches until none has come for a while."""
        end = self.now() + _LONGEST
        self._take_gathered()
        while self._now - self._heard_at < _CALM and self._now < end:
            time.sleep(_BATCH)
            self._take_gathered()
        self._flow.full = self._now - self._heard_at < _CALM
        for _ in range(_CALLS if self._flow.full else 0):
            self._executor.spin_once(timeout_sec=0.0)
        self._look_around()
        return super().wake()

    def status(self) -> Status:
        """Waiting, or recording."""
        details = {"bag": self._path, "storage": self.parameters["storage"]}
        if self.is_idle():
            return Status(STALE, f"waiting for {ATTITUDE.name}", details)
        return Status(OK, "recording", details)


def main() -> int:
    """Run the executable `bag_recorder`."""
    give_way()
    return run_node(BagRecorder)


if __name__ == "__main__":
    sys.exit(main())
