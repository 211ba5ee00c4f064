from typing import Any

from auv_lse_common.node.entry_point import Main
from auv_lse_common.node.local_post import LocalPost, Outlet
from auv_lse_common.topics.table import VEHICLE_TOPICS, Topic

TOLD = Topic(name="told", kind="std_msgs/msg/String", writer="gp_node")


class Ros:
    """A publisher with so many readers."""

    def __init__(self, readers: int = 0) -> None:
        self.readers = readers
        self.sent: list[Any] = []

    def publish(self, msg: Any) -> None:
        self.sent.append(msg)

    def get_subscription_count(self) -> int:
        return self.readers


def test_only_topics_with_a_single_writer_in_the_process_are_carried() -> None:
    post = LocalPost()
    assert not post.carries(TOLD), "nobody shares the process"
    post.share(["gp_node"])
    assert not post.carries(TOLD), "a node alone has nobody to send to"
    post.share(["gp_node", "planner_node"])
    assert post.carries(TOLD)
    assert post.carries(VEHICLE_TOPICS["kernel_centers"])
    assert not post.carries(VEHICLE_TOPICS["team/plans"]), "modem_node is elsewhere"
    assert not post.carries(VEHICLE_TOPICS["odometry"]), "not the vehicle's own"


def test_messages_keep_their_order_and_never_interrupt_a_reader() -> None:
    post = LocalPost()
    told: list[str] = []

    def first(message: str) -> None:
        told.append(f"first {message} begins")
        if message == "a":
            post.send("topic", "b")
            post.deliver()
        told.append(f"first {message} ends")

    post.read("topic", first)
    post.read("topic", lambda message: told.append(f"second {message}"))
    post.send("topic", "a")
    post.send("other", "to nobody")
    assert told == []
    post.deliver()
    assert told == ["first a begins", "first a ends", "second a", "first b begins", "first b ends", "second b"]


def test_failing_reader_does_not_affect_the_others() -> None:
    post = LocalPost()
    told: list[str] = []

    def fail(message: str) -> None:
        raise RuntimeError(message)

    post.read("topic", fail)
    post.read("topic", told.append)
    post.send("topic", "a")
    try:
        post.deliver()
    except RuntimeError:
        post.deliver()
    assert told == ["a"]


def test_ros_carries_topics_with_outside_readers_and_latched_ones() -> None:
    post = LocalPost()
    told: list[str] = []
    for name in (TOLD.name, "kernel_centers"):
        post.read(name, told.append)
    for topic, readers, by_ros in ((TOLD, 0, []), (TOLD, 1, ["a"]), (VEHICLE_TOPICS["kernel_centers"], 0, ["a"])):
        ros = Ros(readers)
        Outlet(ros, topic, post, str.lower).publish("A")
        assert ros.sent == by_ros
    post.deliver()
    assert told == ["a", "a", "a"]


def test_node_name_is_that_of_its_module() -> None:
    def make() -> Any: ...

    make.__module__ = "auv_lse_gp.gp_node"
    assert Main(make).name == "gp_node"
