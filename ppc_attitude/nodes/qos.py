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

"""Quality of service of every topic, in one place."""

from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
    qos_profile_parameter_events,
)

from ppc_attitude.contract.topics import (
    CLOCK_TOPIC,
    PARAMETER_EVENTS_TOPIC,
    Topic,
)

# Publishers keep ten seconds of a 100 Hz run for a recorder that is discovered late or lags; the
# plant in lock-step never runs further ahead of it (`_ACKNOWLEDGED_EVERY`).
_KEPT = 5000
# A peer that lags on a busy machine still answers so many states, so the record has no gap.
_BACKLOG = 100


def published(topic: Topic) -> QoSProfile:
    """QoS that our publisher of a topic offers."""
    if topic is CLOCK_TOPIC:
        return QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
    if topic.column:
        return QoSProfile(
            depth=_KEPT,
            history=HistoryPolicy.KEEP_LAST,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
    return QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)


def subscribed(topic: Topic) -> QoSProfile:
    """QoS with which a peer reads a topic: only what is sent from now on."""
    return QoSProfile(
        depth=_BACKLOG,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.VOLATILE,
    )


def recorded(topic: Topic) -> QoSProfile:
    """QoS with which the recorder reads a topic: all that its publisher still has."""
    if topic is PARAMETER_EVENTS_TOPIC:
        return qos_profile_parameter_events
    if topic.column:
        return QoSProfile(
            depth=10 * _KEPT,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
    # Anyone may publish these, with whatever reliability; best effort matches all of them.
    reliability = (
        ReliabilityPolicy.BEST_EFFORT if topic is CLOCK_TOPIC else ReliabilityPolicy.RELIABLE
    )
    return QoSProfile(depth=_KEPT, reliability=reliability)


def relaxed(profile: QoSProfile) -> QoSProfile | None:
    """QoS that asks a publisher for less: nothing kept, then best effort; None after that."""
    if profile.durability == DurabilityPolicy.TRANSIENT_LOCAL:
        reliability = ReliabilityPolicy.RELIABLE
    elif profile.reliability == ReliabilityPolicy.RELIABLE:
        reliability = ReliabilityPolicy.BEST_EFFORT
    else:
        return None
    return QoSProfile(depth=profile.depth, reliability=reliability)
