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

"""Messages in and out of a node: quality of service, executor, bytes to checked numbers and back.

Raw subscriptions and publishers carry CDR bytes; `contract.cdr` packs and unpacks them. What
arrives is checked here, once for all nodes: frame, finite numbers, unit quaternions.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_parameter_events
from rclpy.subscription import Subscription
from rclpy.time import Time
from std_msgs.msg import Header

from ppc_attitude.contract.cdr import LARGEST, CdrError, Codec, Sample, finite
from ppc_attitude.contract.topics import (
    ATTITUDE,
    CLOCK_TOPIC,
    GUIDANCE_STATUS,
    PARAMETER_EVENTS_TOPIC,
    RECORDED_TOPIC,
    Topic,
)
from ppc_attitude.runtime.health import Status
from ppc_attitude.runtime.stamps import RefusedError
from ppc_attitude.science.component import (
    FIX,
    FIX_VARIANCE,
    GYRO,
    GYRO_VARIANCE,
    OWN_TOLERANCE,
    QUATERNION,
    UNIT_TOLERANCE,
    WRENCH,
    norm_of,
)
from ppc_attitude.science.parameter import LARGEST as LARGEST_OF_OTHERS
from ppc_attitude.science.parameter import Value

Take = Callable[..., None]  # (message, about): rclpy gives the second, its type hints lack it
# A sensor without a measurement: a first variance of −1 says so, as sensor_msgs/Imu defines it.
_NOTHING = {GYRO: (0.0, 0.0, 0.0, -1.0), FIX: (0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0)}
_OF_MOTION = ("rad/s", "rad/s²", "N·m")
_NO_FORCE = bytes(24)  # as the numbers of a wrench begin, whose end is the torque
# Publishers keep so many messages for a recorder that lags; the plant in lock-step never runs
# further ahead of it (`runtime.pace`). A subscriber that joins late gets none of them.
_KEPT = 5000
# A peer reads all that is sent from now on. If it lags on a busy machine, this queue still holds
# the states to be answered, so the record has no gap.
PEER = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.VOLATILE
)
# A subscriber that joins late also gets what was kept; a volatile publisher does not match it.
LATE_PEER = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
# An onlooker never holds up a publisher, and needs the newest message only.
ONLOOKER = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE
)


def published(topic: Topic) -> QoSProfile:
    """QoS that our publisher of a topic offers."""
    depth = _KEPT if topic.column else 1 if topic in (CLOCK_TOPIC, RECORDED_TOPIC) else 10
    late = topic == GUIDANCE_STATUS  # a reader that comes late gets the last ones
    kept = DurabilityPolicy.TRANSIENT_LOCAL if late else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=kept)


def recorded(topic: Topic, reliable: bool = True) -> QoSProfile:
    """QoS with which the recorder reads a topic; reliable unless no publisher of it is."""
    if topic is PARAMETER_EVENTS_TOPIC:
        return qos_profile_parameter_events
    # Of a clock the latest is enough; its reader must not hold up anybody.
    best_effort = topic is CLOCK_TOPIC or not reliable
    return QoSProfile(
        depth=10 * _KEPT if topic.column else _KEPT,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
    )


def message_class(msgtype: str) -> Any:
    """Python class of a ROS type ``package/msg/Name``."""
    package, _, name = msgtype.split("/")
    return getattr(import_module(f"{package}.msg"), name)


def publisher_of(node: Node, topic: Topic) -> Publisher:
    """Let a node publish a topic as all of ours do."""
    return node.create_publisher(message_class(topic.msgtype), topic.name, published(topic))


def subscribe(
    node: Node,
    topic: Topic,
    handle: Callable[[Any], None],
    profile: QoSProfile = PEER,
    raw: bool = False,
) -> Subscription:
    """Let a node read a topic, by default as every peer does; a raw message is bytes."""
    kind = message_class(topic.msgtype)
    return node.create_subscription(kind, topic.name, handle, profile, raw=raw)


class Inbox:
    """Decode and check the messages of a stamped topic; one that anyone may send needs no frame."""

    def __init__(self, topic: Topic) -> None:
        self._topic = topic
        self._codec = Codec(topic)
        self._frames = {topic.frame_id} if topic.source else {topic.frame_id, ""}
        self._largest = LARGEST if topic.unit in _OF_MOTION else LARGEST_OF_OTHERS

    def read(self, data: bytes) -> Sample:
        """Checked sample; a quaternion is normalised.

        Raises
        ------
        RefusedError
            Not a message of the type, another frame, a number that is not finite or absurdly
            large, a quaternion that is not a unit one, an impossible variance, a negative stamp, a
            force without a torque.
        """
        try:
            sample = self._codec.decode(data)
        except CdrError as error:
            raise self._refusal(error) from None
        stamp_ns, frame_id, values = sample
        form = self._topic.form
        if form == WRENCH and data[-48:-24] != _NO_FORCE:
            force = self._codec.force(data)
            if any(force) and not any(values):
                told = "force without a torque; allowed: a torque, as forces are not used"
                raise self._refusal(told)
            if not finite(force):
                raise self._refusal(f"force {force}; allowed: finite numbers")
        if frame_id not in self._frames:
            raise self._refusal(f"frame_id {frame_id!r}; allowed: {self._topic.frame_id!r}")
        if stamp_ns < 0:
            raise self._refusal(f"stamp {stamp_ns} ns; allowed: ≥ 0")
        nothing = _NOTHING.get(form, ())
        if nothing and values[nothing.index(-1.0)] == -1.0:
            return Sample(stamp_ns, frame_id, nothing)
        if not finite(values):
            raise self._refusal(f"{values}; allowed: finite numbers")
        if self._topic.name == ATTITUDE.name and not any(values):
            return sample  # no estimate yet
        if form == QUATERNION:
            return Sample(stamp_ns, frame_id, self._unit(values))
        if form == FIX and any(values[:4]):
            if min(values[4:]) < 0.0 or max(values[4:]) > FIX_VARIANCE:
                told = "allowed: 0 to π², or −1 first, which says that there is no fix"
                raise self._refusal(f"variances {values[4:]} rad² of a fix; {told}")
            return Sample(stamp_ns, frame_id, (*self._unit(values[:4]), *values[4:]))
        if form == GYRO and not 0.0 <= values[3] <= GYRO_VARIANCE:
            raise self._refusal(
                f"variance {values[3]} (rad/s)²; allowed: 0 to {GYRO_VARIANCE:g}, or −1, which "
                "says that there is no rate"
            )
        if max(map(abs, values)) > self._largest:
            told = f"{values} {self._topic.unit}; allowed: magnitudes up to {self._largest:g}"
            raise self._refusal(told)
        return sample

    def _unit(self, values: tuple[float, ...]) -> tuple[float, ...]:
        length = norm_of(values)  # as the kernel `normalised`, to the last bit
        if abs(length - 1.0) <= OWN_TOLERANCE:
            return values
        if abs(length - 1.0) > UNIT_TOLERANCE:
            raise self._refusal(
                f"quaternion {values} has norm {length:.6g}; allowed: 1 within {UNIT_TOLERANCE:g}"
            )
        return tuple(value / length for value in values)

    def _refusal(self, reason: object) -> RefusedError:
        return RefusedError(f"{self._topic.name}: {reason}")


def new_executor() -> Executor:
    """Return the events executor where rclpy has it: it costs a fifth of the standard one."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def take_gathered(subscription: Any) -> bool:
    """Call a subscription's callback with each waiting message and what rclpy says about it.

    The messages are taken without the executor, which does not tell the number of a message by
    itself. Returns False if there was no message.
    """
    handle, kind, receive = subscription.handle, subscription.msg_type, subscription.callback
    found = False
    with handle:
        while (message := handle.take_message(kind, True)) is not None:
            found = True
            receive(*message)
    return found


class Flow(ReentrantCallbackGroup):
    """Messages that the executor leaves to the node itself while there are many of them.

    The standard executor takes messages first, so that in full flow no service has its turn.
    """

    full = False

    def can_execute(self, entity: Any) -> bool:
        """True if the executor may take what has come; events that are no messages always."""
        return not (self.full and isinstance(entity, Subscription))


class LatestSamples:
    """The latest sample of some stamped topics, kept as it came and decoded when asked for.

    `refuse` gets the topic's name and the reason, once, if the latest message must not be used.
    """

    def __init__(
        self, node: Node, topics: Sequence[Topic], refuse: Callable[[str, str], None]
    ) -> None:
        self._refuse = refuse
        self._inboxes = {topic: Inbox(topic) for topic in topics}
        self._raw: dict[Topic, bytes] = {}  # what has not been asked for
        self._samples: dict[Topic, Sample] = {}
        for topic in topics:
            subscribe(node, topic, partial(self._keep, topic), ONLOOKER, raw=True)

    def _keep(self, topic: Topic, data: bytes) -> None:
        self._raw[topic] = data

    def get(self, topic: Topic) -> Sample | None:
        """Latest sample of a topic; None if none has come, or if the latest was refused."""
        data = self._raw.pop(topic, None)
        if data is not None:
            self._samples.pop(topic, None)
            try:
                self._samples[topic] = self._inboxes[topic].read(data)
            except RefusedError as reason:
                self._refuse(topic.name, str(reason))
        return self._samples.get(topic)


def diagnostics(stamp_ns: int, node: str, what: str, status: Status) -> DiagnosticArray:
    """Message with one status of a node, given by its fully qualified name, at a stamp [ns]."""
    said = DiagnosticStatus(
        level=status.level,
        # Like diagnostic_updater's, but with the namespace: several craft, one /diagnostics.
        name=f"{node.lstrip('/')}: {what}",
        message=status.summary,
        hardware_id=node,
        values=[KeyValue(key=key, value=_text(value)) for key, value in status.details.items()],
    )
    return _stamped(stamp_ns, said)


def changed(stamp_ns: int, node: str, values: Mapping[str, Value]) -> DiagnosticArray:
    """Message with values that a node's parameters have from a stamp [ns] on."""
    told = [KeyValue(key=key, value=json.dumps(value)) for key, value in values.items()]
    return _stamped(stamp_ns, DiagnosticStatus(name=node, values=told))


def _stamped(stamp_ns: int, said: DiagnosticStatus) -> DiagnosticArray:
    return DiagnosticArray(header=Header(stamp=Time(nanoseconds=stamp_ns).to_msg()), status=[said])


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
