"""A bench for nodes under test: processes of their own on a ROS domain of their own, and a node that talks to them."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from auv_lse_common.topics.quality import EVERY
from auv_lse_run.process.domain import node_environment, own_domain
from auv_lse_run.process.keeper import ProcessKeeper, node_task
from auv_lse_run.process.processes import Process

ROOT = Path(__file__).resolve().parents[2]


class Bench:
    """Starts nodes, publishes to them, and collects what they publish."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.folder = folder
        self.environment = node_environment(domain)
        self.keepers: list[ProcessKeeper] = []
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node: Node = rclpy.create_node("bench", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def start(self, package: str, executable: str, parameters: str, namespace: str = "/auv1") -> None:
        path = self.folder / f"{executable}.yaml"
        path.write_text(parameters)
        task = node_task(Process(package=package, executable=executable, namespace=namespace), path)
        self.keepers.append(ProcessKeeper([task], self.folder, self.environment, print, restart=False))
        self.keepers[-1].tick(time.monotonic())

    def collect(self, kind: type, topic: str, qos: Any = EVERY) -> list[Any]:
        """A list that fills with the messages of a topic."""
        messages: list[Any] = []
        self.node.create_subscription(kind, topic, messages.append, qos)
        return messages

    def publisher(self, kind: type, topic: str, qos: Any = EVERY, readers: int = 1) -> Any:
        """A publisher whose readers are already there."""
        publisher = self.node.create_publisher(kind, topic, qos)
        self.until(lambda: publisher.get_subscription_count() >= readers, f"a reader of {topic}")
        return publisher

    def until(self, condition: Callable[[], Any], what: str, timeout_s: float = 30.0) -> None:
        """Handles messages until `condition` holds."""
        end = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < end, f"{what} did not come within {timeout_s:g} s; {self.words()}"
            self.executor.spin_once(timeout_sec=0.05)

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def words(self) -> str:
        return "; ".join(f"{p.name}: {p.read_text()[-500:]}" for p in sorted(self.folder.glob("*.log")))

    def close(self) -> None:
        for keeper in self.keepers:
            keeper.stop()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@contextlib.contextmanager
def bench(folder: Path) -> Iterator[Bench]:
    with own_domain() as domain:
        b = Bench(folder, domain)
        try:
            yield b
        finally:
            b.close()
