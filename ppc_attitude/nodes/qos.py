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
    INJECT,
    PARAMETER_EVENTS_TOPIC,
    Topic,
)

# Publishers keep ten seconds of a 100 Hz run for a recorder that is discovered late or lags.
_KEPT = 1000


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
    depth = 100 if topic is INJECT else 10
    return QoSProfile(
        depth=depth,
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
