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

"""The recorder: every topic of the run into a rosbag2 bag, and the truth about what is missing."""

import contextlib
import json
import os
import sys
import time
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, cast

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.validate_topic_name import validate_topic_name

from ppc_attitude.bags.custom_data import decode_custom_data, encode_custom_data
from ppc_attitude.bags.errors import BagError
from ppc_attitude.bags.writer import BagWriter, offered_qos
from ppc_attitude.contract.cdr import header_stamp
from ppc_attitude.contract.completeness import Completeness, promised
from ppc_attitude.contract.topics import ATTITUDE, BY_NAME, CONTROLLER, RECORDER, TOPICS, Topic
from ppc_attitude.contract.versions import versions
from ppc_attitude.nodes.base import EXIT_BROKEN, BaseNode
from ppc_attitude.nodes.health import OK, STALE
from ppc_attitude.nodes.messages import message_class
from ppc_attitude.nodes.parameter_survey import ParameterSurvey
from ppc_attitude.nodes.qos import published, recorded, relaxed
from ppc_attitude.nodes.running import run_node
from ppc_attitude.science.errors import ConfigurationError
from ppc_attitude.science.parameter import Value

_QUIET = 0.3  # [s] without a message after which all that was sent has arrived
_BATCH = 0.005  # [s] messages that arrive within this time are taken together
_LONGEST = 0.1  # [s] after which a recorder in full flow looks for signals and services


class BagRecorder(BaseNode):
    """Writes raw messages as they arrive; a bag with a missing message is never called complete.

    Messages are logged at the simulated time of their stamp, those without a stamp at the time of
    the latest state, so that two runs of one configuration give the same bag.
    """

    executable = RECORDER

    def __init__(self) -> None:
        super().__init__()
        self._run_info = _run_info(self.parameters["run_info"])
        self._path = Path(self.parameters["bag"] or _dated_folder())
        try:
            self._writer = BagWriter(
                self._path, storage=self.parameters["storage"], custom_data=self._custom_data()
            )
        except BagError as error:
            raise ConfigurationError(str(error)) from None
        self._now = 0
        self._count = 0
        self._announced: set[str] = set()
        self._completeness: dict[str, Completeness] = {}
        for namespace in dict.fromkeys(_tidy(name) for name in self.parameters["namespaces"]):
            self._completeness[namespace] = Completeness()
            self._subscribe_all(namespace)
        if not self._run_info:
            self._survey = ParameterSurvey(self, tuple(self._completeness), self._learn)
        self.get_logger().info(f"recording to {self._path}")

    def check(self, values: Mapping[str, Value]) -> None:
        """See that the facts about the run are JSON, and that the namespaces can be some."""
        _run_info(str(values["run_info"]))
        if not values["namespaces"]:
            raise ConfigurationError("namespaces = []; allowed: at least one, '' is the own one")
        for namespace in cast(list[str], values["namespaces"]):
            try:
                validate_topic_name(f"{_tidy(namespace)}{ATTITUDE.name}")
            except InvalidTopicNameException as error:
                reason = str(error).partition("\n")[0].rstrip(":")
                raise ConfigurationError(f"namespaces: {namespace!r}: {reason}") from None

    def _learn(self, parameters: dict[str, dict[str, Any]]) -> None:
        """Write down what the other nodes say of themselves."""
        self._run_info["parameters"] = parameters
        for key, value in self._custom_data().items():
            self._writer.set_custom_data(key, value)

    def _custom_data(self) -> dict[str, str]:
        parameters = self._run_info.get("parameters", {})
        metadata = {**versions(), **self._run_info.get("metadata", {})}
        controller = str(parameters.get(CONTROLLER, {}).get("controller", "unknown"))
        return encode_custom_data(controller, parameters, metadata)

    def _subscribe_all(self, namespace: str) -> None:
        for topic in TOPICS:
            absolute = topic.name.startswith("/")
            if absolute and len(self._completeness) > 1:
                continue  # one for all namespaces
            name = topic.name if absolute else f"{namespace}{topic.name}"
            full_name = self.resolve_topic_name(name)
            receive = self._receiver(topic, full_name, self._completeness[namespace])
            self._subscribe_to(topic, name, receive, recorded(topic))

    def _subscribe_to(
        self, topic: Topic, name: str, receive: Callable[[bytes], None], qos: QoSProfile
    ) -> None:
        """Take a topic; ask for less when a publisher cannot give so much, as a user's own may."""

        def ask_for_less(event: object) -> None:
            less = relaxed(qos)
            if less is not None:
                self.get_logger().info(f"{name}: a publisher offers less than ours do: taken as is")
                self.destroy_subscription(subscription)
                self._subscribe_to(topic, name, receive, less)

        subscription = self.create_subscription(
            message_class(topic.msgtype),
            name,
            receive,
            qos,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=ask_for_less),
        )

    def _receiver(
        self, topic: Topic, name: str, completeness: Completeness
    ) -> Callable[[bytes], None]:
        def receive(data: bytes) -> None:
            self._count += 1
            self.wake_at = 0.0  # there may be more
            stamp = header_stamp(data, topic.msgtype)
            self._write(name, topic, self._now if stamp is None or stamp < 0 else stamp, data)

        return self._sample_receiver(topic, name, completeness) if topic.column else receive

    def _sample_receiver(
        self, topic: Topic, name: str, completeness: Completeness
    ) -> Callable[[bytes], None]:
        leads = topic is ATTITUDE
        last = b""

        def receive(data: bytes) -> None:
            nonlocal last
            self._count += 1
            self.wake_at = 0.0  # there may be more
            if data == last:
                return  # a peer's repeated answer to a repeated state
            last = data
            stamp = header_stamp(data, topic.msgtype)
            if stamp is None or stamp < 0:
                stamp = self._now
            else:
                completeness.add(topic.name, stamp)
                if leads:
                    self._now = stamp
            self._write(name, topic, stamp, data)

        return receive

    def _write(self, name: str, topic: Topic, time_ns: int, data: bytes) -> None:
        if self.failure:
            return
        try:
            if name not in self._announced:
                self._announced.add(name)
                self._writer.add_topic(name, topic.msgtype, [_offered(topic)])
            self._writer.write(name, time_ns, data)
        except BagError as error:
            self.fail(self._now, str(error))
        else:
            if topic is ATTITUDE:
                self.report(time_ns)

    def new_executor(self) -> Executor:
        """Return an executor that only looks at messages when it is asked to.

        The recorder alone has nobody who waits for it. Waking up for every message costs more
        than all the rest of recording, so `wake` takes what has gathered.
        """
        return SingleThreadedExecutor()

    def _take_gathered(self) -> bool:
        """Take all that has arrived; False if there was nothing."""
        before = self._count
        for subscription in self.subscriptions:
            with subscription.handle:
                take = subscription.handle.take_message
                while (taken := take(subscription.msg_type, subscription.raw)) is not None:
                    subscription.callback(taken[0])
        return self._count != before

    def drain(self, executor: Executor) -> None:
        """Take all that was sent before the stop: until nothing has come for a while."""
        quiet_since = time.monotonic()
        while not self.failure and time.monotonic() - quiet_since < _QUIET:
            if self._take_gathered():
                quiet_since = time.monotonic()
            executor.spin_once(timeout_sec=_BATCH)

    def close(self) -> None:
        """Finish the bag, and say whether it is complete."""
        gaps = [gap for namespace in self._completeness for gap in self._gaps(namespace)]
        try:
            if not self.failure:
                self._writer.set_custom_data("ppc_attitude.gaps", json.dumps(gaps))
            self._writer.close()
        except BagError as error:
            if not self.failure:
                self.fail(self._now, str(error))
        if gaps:
            self.exit_code = EXIT_BROKEN
            for gap in gaps:
                self.get_logger().error(f"bag {self._path} is incomplete: {gap}")
        elif not self.failure:
            self.get_logger().info(f"closed {self._path}: {self._count} messages, none missing")

    def _gaps(self, namespace: str) -> list[str]:
        completeness = self._completeness[namespace]
        parameters = decode_custom_data(self._custom_data(), namespace.rstrip("/")).parameters
        seen = [BY_NAME[name] for name in completeness.seen()]
        expected = [topic.name for topic in promised(parameters, seen)]
        return [f"{namespace}{gap}" for gap in completeness.gaps(expected)]

    def wake(self) -> float:
        """Take what comes in batches."""
        end = time.monotonic() + _LONGEST
        while self._take_gathered() and time.monotonic() < end:
            time.sleep(_BATCH)
        return super().wake()

    def status(self) -> tuple[bytes, str, dict[str, Any]]:
        """Waiting, or recording."""
        details = {
            "bag": self._path,
            "storage": self.parameters["storage"],
        }
        if self.is_idle():
            return STALE, f"waiting for {ATTITUDE.name}", details
        return OK, "recording", details


def _offered(topic: Topic) -> Any:
    profile = published(topic)
    reliable = profile.reliability == ReliabilityPolicy.RELIABLE
    kept = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return offered_qos(
        reliability="reliable" if reliable else "best_effort",
        durability="transient_local" if kept else "volatile",
        depth=profile.depth,
    )


def _tidy(namespace: str) -> str:
    """Prefix of the topics of a namespace; empty for the recorder's own."""
    bare = namespace.rstrip("/")
    return f"{bare}/" if namespace else ""


def _run_info(text: str) -> dict[str, Any]:
    if not text:
        return {}
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise ConfigurationError(f"run_info is not JSON: {error}") from None
    if not isinstance(content, dict):
        raise ConfigurationError("run_info must be a JSON object")
    return content


def _dated_folder() -> str:
    return f"bags/{datetime.now():%Y-%m-%d_%H-%M-%S}_{os.getpid()}"


def main() -> int:
    """Run the executable `bag_recorder`."""
    _give_way()
    return run_node(BagRecorder)


def _give_way() -> None:
    """Let no thread of this process interrupt another: nobody waits for the recorder.

    It gets its share of the processor all the same, and takes more messages at a time.
    """
    if hasattr(os, "SCHED_BATCH"):
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


if __name__ == "__main__":
    sys.exit(main())
