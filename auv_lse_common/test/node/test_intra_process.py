from typing import Any

from auv_lse_common.node.entry_point import Main
from auv_lse_common.node.intra_process import IntraProcessDelivery, TopicPublisher
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
    delivery = IntraProcessDelivery()
    assert not delivery.carries(TOLD), "nobody shares the process"
    delivery.share(["gp_node"])
    assert not delivery.carries(TOLD), "a node alone has nobody to send to"
    delivery.share(["gp_node", "planner_node"])
    assert delivery.carries(TOLD)
    assert delivery.carries(VEHICLE_TOPICS["kernel_centers"])
    assert not delivery.carries(VEHICLE_TOPICS["team/plans"]), "modem_node is elsewhere"
    assert not delivery.carries(VEHICLE_TOPICS["odometry"]), "not the vehicle's own"


def test_messages_keep_their_order_and_never_interrupt_a_reader() -> None:
    delivery = IntraProcessDelivery()
    told: list[str] = []

    def first(message: str) -> None:
        told.append(f"first {message} begins")
        if message == "a":
            delivery.send("topic", "b")
            delivery.deliver()
        told.append(f"first {message} ends")

    delivery.read("topic", first)
    delivery.read("topic", lambda message: told.append(f"second {message}"))
    delivery.send("topic", "a")
    delivery.send("other", "to nobody")
    assert told == []
    delivery.deliver()
    assert told == ["first a begins", "first a ends", "second a", "first b begins", "first b ends", "second b"]


def test_message_of_another_process_reaches_every_reader_with_its_sender() -> None:
    delivery = IntraProcessDelivery()
    told: list[tuple[str, str]] = []

    def first(message: str, sender: str = "unknown") -> None:
        told.append((message, sender))
        if message == "a":
            delivery.receive("topic", "b")

    delivery.read("topic", first)
    delivery.read("topic", lambda message, sender="unknown": told.append((message, sender)))
    delivery.receive("topic", "a", "sim_node")
    assert told == [("a", "sim_node"), ("a", "sim_node"), ("b", "unknown"), ("b", "unknown")]


def test_failing_reader_does_not_affect_the_others() -> None:
    delivery = IntraProcessDelivery()
    told: list[str] = []

    def fail(message: str) -> None:
        raise RuntimeError(message)

    delivery.read("topic", fail)
    delivery.read("topic", told.append)
    delivery.send("topic", "a")
    try:
        delivery.deliver()
    except RuntimeError:
        delivery.deliver()
    assert told == ["a"]


def test_ros_carries_topics_with_outside_readers_and_latched_ones() -> None:
    delivery = IntraProcessDelivery()
    told: list[str] = []
    for name in (TOLD.name, "kernel_centers"):
        delivery.read(name, told.append)
    for topic, readers, by_ros in ((TOLD, 0, []), (TOLD, 1, ["a"]), (VEHICLE_TOPICS["kernel_centers"], 0, ["a"])):
        ros = Ros(readers)
        TopicPublisher(ros, topic, delivery, str.lower).publish("A")
        assert ros.sent == by_ros
    delivery.deliver()
    assert told == ["a", "a", "a"]


def test_message_kept_back_stays_in_the_process_until_it_is_sent() -> None:
    delivery, ros = IntraProcessDelivery(), Ros(1)
    told: list[str] = []
    delivery.read("kernel_centers", told.append)
    publisher = TopicPublisher(ros, VEHICLE_TOPICS["kernel_centers"], delivery, str)
    publisher.send_kept_back()
    publisher.publish("a", keep_back=True)
    publisher.publish("b", keep_back=True)
    assert ros.sent == []
    publisher.send_kept_back()
    publisher.send_kept_back()
    assert ros.sent == ["b"]
    publisher.publish("c", keep_back=True)
    publisher.publish("d")
    publisher.send_kept_back()
    assert ros.sent == ["b", "d"], "the later one replaces it"
    delivery.deliver()
    assert told == ["a", "b", "c", "d"]


def test_node_name_is_that_of_its_module() -> None:
    def make() -> Any: ...

    make.__module__ = "auv_lse_gp.gp_node"
    assert Main(make).name == "gp_node"
