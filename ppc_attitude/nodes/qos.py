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

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_parameter_events

from ppc_attitude.contract.topics import (
    CLOCK_TOPIC,
    GUIDANCE_STATUS,
    PARAMETER_EVENTS_TOPIC,
    RECORDED_TOPIC,
    Topic,
)

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
