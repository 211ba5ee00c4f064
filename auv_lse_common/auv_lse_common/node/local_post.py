"""Messages between the nodes of one process: handed over as they are, without ROS.

A vehicle's nodes share a process in lockstep. What one of them alone writes (`Topic.writer`) reaches those beside it
through the process's `POST`, without being serialized, sent, waited for, taken and made anew; DDS carries it only to
whoever reads it from outside. Messages are delivered one after another in the order in which they were sent, and never
from within a node that is at work: a callback that sends is over before what it sent is read.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from typing import Any, Protocol

from auv_lse_common.node.lockstep import Answers
from auv_lse_common.topics.table import Topic

Take = Callable[[Any], None]


class LocalPost:
    """The messages that wait between the nodes of one process, and who reads them.

    Attributes:
        nodes: Names of the nodes that share this process; empty where a node is alone.
        answers: What they tell the simulator together.
    """

    def __init__(self) -> None:
        """Nobody shares the process yet."""
        self.nodes: frozenset[str] = frozenset()
        self.answers = Answers()
        self._readers: dict[str, list[Take]] = {}
        self._waiting: deque[tuple[Take, Any]] = deque()
        self._delivering = False

    def share(self, nodes: Collection[str]) -> None:
        """These nodes, of one namespace, are going to share the process; one alone shares nothing."""
        self.nodes = frozenset(nodes) if len(nodes) > 1 else frozenset()

    def carries(self, topic: Topic) -> bool:
        """Whether the topic's messages come to its readers in this process without ROS."""
        return topic.writer in self.nodes

    def read(self, name: str, take: Take) -> None:
        """`take` gets every message that is sent to topic `name` from now on."""
        self._readers.setdefault(name, []).append(take)

    def send(self, name: str, message: Any) -> None:
        """Puts a message into the post of every reader of topic `name`; nobody may change it any more."""
        for take in self._readers.get(name, ()):
            self._waiting.append((take, message))

    def deliver(self) -> None:
        """Hands over all that waits, and what is sent meanwhile. Within a delivery nothing: that one goes on."""
        if self._delivering:
            return
        self._delivering = True
        try:
            while self._waiting:
                take, message = self._waiting.popleft()
                take(message)
        finally:
            self._delivering = False


#: The post of this process.
POST = LocalPost()


class Publisher(Protocol):
    """What an outlet needs of a publisher of rclpy's."""

    def publish(self, msg: Any) -> None:
        """Sends a message."""
        ...

    def get_subscription_count(self) -> int:
        """How many readers it has."""
        ...


class Outlet:
    """Where a node publishes one topic: to the nodes beside it, and by ROS to everybody else."""

    def __init__(self, publisher: Publisher, topic: Topic, post: LocalPost, make: Callable[[Any], Any]) -> None:
        """Args: publisher: of the topic. post: of the process. make: makes the message that carries a value."""
        self._publisher = publisher
        self._topic = topic
        self._post = post
        self._make = make

    def publish(self, value: Any) -> None:
        """Publishes the message that carries a value."""
        self.publish_message(self._make(value))

    def publish_message(self, message: Any) -> None:
        """Publishes a message, which must not change afterwards; by ROS only if somebody reads it or may come late."""
        self._post.send(self._topic.name, message)
        if self._topic.latched or self._publisher.get_subscription_count():
            self._publisher.publish(message)
