"""The quality of service of the stack's topics."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from auv_lse_common.topics.table import Topic

#: Every message counts: reliable, with room for a burst.
EVERY = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
#: For frequently updated states: also receives from drivers that publish with ROS's sensor QoS (best effort).
NEWEST = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
#: Late readers also receive the last message (latched).
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
#: Introductions of several nodes on one topic: a latched reader that keeps one message might miss some.
INTRODUCTIONS = QoSProfile(
    depth=64, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


def writer_quality(topic: Topic) -> QoSProfile:
    """Quality of service of one of the stack's topics for its writer, and for a reader that must not miss a message."""
    return LATCHED if topic.latched else EVERY


def reader_quality(topic: Topic) -> QoSProfile:
    """Quality of service for a reader without lockstep."""
    return NEWEST if topic.delivery == "newest" else writer_quality(topic)
