"""A node in this process, spun by hand; needs rclpy and the built workspace."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile

from auv_lse_common.topics.quality import EVERY

_LOGS = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Spun:
    """A node with its parameters, and a second node beside it.

    `logs` has every line of /rosout: the subscription precedes the node, because /rosout keeps a line for 10 s only
    and a busy computer may match a later subscription too late.
    """

    def __init__(self, make: Callable[[], Any], file: Path, namespace: str) -> None:
        rclpy.init(args=["--ros-args", "-r", f"__ns:={namespace}", "--params-file", str(file)])
        self.executor = SingleThreadedExecutor()
        self.bench = rclpy.create_node("bench", use_global_arguments=False)
        self.logs: list[Log] = self.collect(Log, "/rosout", _LOGS)
        self.node = make()
        self.executor.add_node(self.bench)
        self.executor.add_node(self.node)

    def collect(self, kind: type, topic: str, quality: QoSProfile = EVERY) -> list[Any]:
        messages: list[Any] = []
        self.bench.create_subscription(kind, topic, messages.append, quality)
        return messages

    def until(self, condition: Callable[[], Any], each: Callable[[], None] = lambda: None) -> None:
        end = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < end, f"did not happen in time; logged: {[log.msg for log in self.logs]}"
            each()
            self.executor.spin_once(timeout_sec=0.05)


@contextlib.contextmanager
def spun(make: Callable[[], Any], file: Path, parameters: str, namespace: str = "/auv2") -> Iterator[Spun]:
    """`make()` in its namespace with the parameters (YAML, below ros__parameters)."""
    file.write_text("/**:\n  ros__parameters:\n" + "".join(f"    {line}\n" for line in parameters.splitlines()))
    found = None
    try:
        found = Spun(make, file, namespace)
        yield found
    finally:
        if found is not None:
            found.executor.shutdown()
            found.node.destroy_node()
            found.bench.destroy_node()
        rclpy.try_shutdown()
