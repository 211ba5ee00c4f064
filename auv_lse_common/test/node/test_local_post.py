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


def test_only_what_a_node_of_the_process_alone_writes_is_carried() -> None:
    post = LocalPost()
    assert not post.carries(TOLD), "nobody shares the process"
    post.share(["gp_node"])
    assert not post.carries(TOLD), "a node alone has nobody to send to"
    post.share(["gp_node", "planner_node"])
    assert post.carries(TOLD)
    assert post.carries(VEHICLE_TOPICS["kernel_centers"])
    assert not post.carries(VEHICLE_TOPICS["team/plans"]), "modem_node is elsewhere"
    assert not post.carries(VEHICLE_TOPICS["odometry"]), "not the vehicle's own"


def test_messages_come_in_the_order_sent_and_never_within_a_reader_at_work() -> None:
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


def test_after_a_reader_has_failed_the_others_are_still_served() -> None:
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


def test_ros_carries_what_somebody_outside_reads_or_a_late_reader_is_to_get() -> None:
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


def test_a_node_is_known_by_the_module_that_makes_it() -> None:
    def make() -> Any: ...

    make.__module__ = "auv_lse_gp.gp_node"
    assert Main(make).name == "gp_node"
