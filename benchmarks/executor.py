"""Processor time with the stack's executor and with rclpy's: of a message in one process, and of a short mission."""

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from auv_lse_common.node.executor import CHOICE, make_executor
from auv_lse_common.topics.quality import EVERY
from auv_lse_run.process.domain import node_environment, own_domain
from benchmarks.mission import fly
from benchmarks.rows import Row, row

#: As many publishers and subscriptions as planner_node has, and some more.
_TOPICS = 12
#: Messages published at a time, as many as a node receives in a tick of a mission.
_BURST = 4


def run(*, smoke: bool = False) -> list[Row]:
    """Sends messages through a node with as many topics as one of the stack's, by either executor.

    Unless it is a smoke run, also flies a mission with each.

    Raises:
        RuntimeError: if a mission failed, with its output.
    """
    messages = 400 if smoke else 100_000
    few = 400 if smoke else 5000  # rclpy's takes long
    with own_domain() as domain:
        os.environ.update(node_environment(domain))
        plain_s, plain_lost = _measure(SingleThreadedExecutor, few)
        ours_s, ours_lost = _measure(make_executor, messages)
    rows = [
        row("executor: processor time of a message", 1e6 * ours_s, "us", "rclpy's executor", plain_s / ours_s),
        row("executor: messages sent, reliably", messages),
        row("executor: lost or out of order", ours_lost, goal="0", holds=ours_lost == 0),
        row("executor: lost or out of order by rclpy's", plain_lost),
    ]
    if not smoke:
        plain_s, ours_s = _flying_s("rclpy"), _flying_s("standing")
        name = "executor: processor time of a mission of 10 steps, flying"
        rows.append(row(name, ours_s, "cpu s", "rclpy's executor", plain_s / ours_s))
    return rows


def _flying_s(executor: str) -> float:
    """Processor time (s) of all nodes of a short mission with an executor, without their start."""
    with tempfile.TemporaryDirectory() as parent:
        flight = fly(Path(parent) / "run", "--steps", "10", "--no-report", **{CHOICE: executor})
    return sum(flight.processor_s.values()) - sum(flight.start_s.values())


def _measure(make: Callable[[], Executor], messages: int) -> tuple[float, int]:
    """Processor time (s) of taking one message, publishing aside, and how many were lost or came out of order."""
    rclpy.init()
    node = Node("measured")
    heard: list[int] = []
    for number in range(1, _TOPICS):
        node.create_subscription(Clock, f"quiet_{number}", lambda message: None, EVERY)
        node.create_publisher(Clock, f"other_{number}", EVERY)
    node.create_subscription(Clock, "busy", lambda message: heard.append(message.clock.sec), EVERY)
    publisher = node.create_publisher(Clock, "busy", EVERY)
    executor = make()
    executor.add_node(node)
    try:
        while publisher.get_subscription_count() == 0:
            executor.spin_once(timeout_sec=0.05)
        spent_s = 0.0
        message = Clock()
        for first in range(0, messages, _BURST):
            for number in range(first, first + _BURST):
                message.clock.sec = number
                publisher.publish(message)
            began = time.process_time()
            until = time.monotonic() + 10.0
            while len(heard) < first + _BURST and time.monotonic() < until:
                executor.spin_once()
            spent_s += time.process_time() - began
        wrong = sum(a != b for a, b in zip(heard, range(messages), strict=False)) + messages - len(heard)
        return spent_s / messages, wrong
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
