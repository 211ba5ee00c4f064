"""The quality of service of the stack's topics."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from auv_lse_common.topics.table import Topic

#: Every message counts: reliable, with room for a burst.
EVERY = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
#: For frequently updated states: also receives from drivers that publish with ROS's sensor QoS (best effort).
NEWEST = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
#: For writers: late readers also receive the last message (latched).
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
#: For readers of latched topics. All writers share a reader's queue: with room for one message, one of another dive, or
#: of another node, would displace an unread one.
LATCHED_READER = QoSProfile(
    depth=64, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


def writer_quality(topic: Topic) -> QoSProfile:
    """Quality of service of one of the stack's topics for its writer."""
    return LATCHED if topic.latched else EVERY


def reader_quality(topic: Topic, lockstep: bool = False) -> QoSProfile:
    """Quality of service of one of the stack's topics for a reader, which may miss no message in lockstep."""
    if topic.latched:
        return LATCHED_READER
    return NEWEST if topic.delivery == "newest" and not lockstep else EVERY
