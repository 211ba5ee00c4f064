"""Messages between the nodes of one process, without ROS.

In lockstep a vehicle's nodes share a process. Topics with a single writer among them (`Topic.writer`) reach the other
nodes of the process through `INTRA_PROCESS`, without serialization. DDS carries them only to other processes. A topic
that is written elsewhere is subscribed to once, for all nodes of the process that read it.
Messages are delivered in the order in which they were sent, and never during a callback: the callback that sends a
message ends before the message is read.
"""

from collections import deque
from collections.abc import Callable, Collection
from typing import Any, Protocol

from auv_lse_common.node.lockstep import Answers
from auv_lse_common.topics.table import Topic

Take = Callable[..., None]

#: Set to "1" where the nodes of each vehicle, its drivers excepted, share a process: writers in other processes then
#: wait for one reader of the vehicle and not for each node.
TOGETHER_VARIABLE = "AUV_LSE_TOGETHER"


class IntraProcessDelivery:
    """Passes messages between the nodes of one process.

    Attributes:
        nodes: Names of the nodes that share this process; empty where a node is alone.
        answers: Their common answers to the simulator.
    """

    def __init__(self) -> None:
        self.nodes: frozenset[str] = frozenset()
        self.answers = Answers()
        self._readers: dict[str, list[Take]] = {}
        self._waiting: deque[tuple[Take, tuple[Any, ...]]] = deque()
        self._delivering = False

    def share(self, nodes: Collection[str]) -> None:
        """Sets the nodes, of one namespace, that share the process; a single node shares nothing."""
        self.nodes = frozenset(nodes) if len(nodes) > 1 else frozenset()

    def carries(self, topic: Topic) -> bool:
        """Whether readers in this process get the topic's messages without ROS."""
        return topic.writer in self.nodes

    def read(self, name: str, take: Take) -> None:
        """Passes every further message on topic `name` to `take`."""
        self._readers.setdefault(name, []).append(take)

    def has_readers(self, name: str) -> bool:
        """Whether a node of this process reads topic `name`."""
        return bool(self._readers.get(name))

    def send(self, name: str, *message: Any) -> None:
        """Queues a message for every reader of topic `name`, maybe with its sender; it must not change afterwards."""
        for take in self._readers.get(name, ()):
            self._waiting.append((take, message))

    def receive(self, name: str, *message: Any) -> None:
        """Delivers a message that another process has sent; arguments as of `send`."""
        self.send(name, *message)
        self.deliver()

    def deliver(self) -> None:
        """Delivers all queued messages, and those sent meanwhile. Does nothing during a delivery."""
        if self._delivering:
            return
        self._delivering = True
        try:
            while self._waiting:
                take, message = self._waiting.popleft()
                take(*message)
        finally:
            self._delivering = False


#: The delivery between the nodes of this process.
INTRA_PROCESS = IntraProcessDelivery()


class Publisher(Protocol):
    """The part of an rclpy publisher that a `TopicPublisher` needs."""

    def publish(self, msg: Any) -> None:
        """Sends a message."""
        ...

    def get_subscription_count(self) -> int:
        """Number of its readers."""
        ...


class TopicPublisher:
    """Publishes one topic: directly to the nodes in the same process, and with ROS to all others."""

    def __init__(
        self, publisher: Publisher, topic: Topic, delivery: IntraProcessDelivery, make: Callable[[Any], Any]
    ) -> None:
        """Args: publisher: of the topic. delivery: of the process. make: returns the message for a value."""
        self._publisher = publisher
        self._topic = topic
        self._delivery = delivery
        self._make = make
        self._kept_back: Any = None  # the last message, if readers in other processes have not got it

    @property
    def readers(self) -> int:
        """Number of its readers in other processes."""
        return self._publisher.get_subscription_count()

    def publish(self, value: Any, *, keep_back: bool = False) -> None:
        """Publishes a value as a message, which is built only if it has readers, or the topic is latched.

        Args:
            keep_back: Whether readers in other processes do not get it before `send_kept_back`, or never, if a later
                message replaces it.
        """
        if self.has_readers():
            self.publish_message(self._make(value), keep_back=keep_back)

    def publish_message(self, message: Any, *, keep_back: bool = False) -> None:
        """Publishes a message, which must not change afterwards; with ROS only if it has readers or is latched."""
        self._delivery.send(self._topic.name, message)
        self._kept_back = message if keep_back else None
        if not keep_back and self._has_outside_readers():
            self._publisher.publish(message)

    def send_kept_back(self) -> None:
        """Sends the last message to readers in other processes, if it was kept back."""
        if self._kept_back is not None:
            self._publisher.publish(self._kept_back)
            self._kept_back = None

    def has_readers(self) -> bool:
        """Whether the topic has readers, or may have later ones of its last message."""
        return self._has_outside_readers() or self._delivery.has_readers(self._topic.name)

    def _has_outside_readers(self) -> bool:
        return self._topic.latched or self._publisher.get_subscription_count() > 0
