"""The executor over real rclpy, in one process: all that rclpy's executor serves, it serves as well."""

from __future__ import annotations

import importlib.util
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

if importlib.util.find_spec("rclpy") is None:
    pytest.skip("needs rclpy (scripts/test sets it up)", allow_module_level=True)

import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import ClockType
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Int32
from std_srvs.srv import Trigger

from auv_lse_common.node import executor as executor_module
from auv_lse_common.node.executor import StandingExecutor, make_executor

pytestmark = pytest.mark.ros

EVERY = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
PATIENCE_S = 20.0  # a loaded machine; each wait below ends when what it waits for is there


@pytest.fixture
def node() -> Iterator[Node]:
    rclpy.init()
    node = Node("served", namespace="/executor_test")
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def executor(node: Node) -> Iterator[StandingExecutor]:
    executor = make_executor()
    assert isinstance(executor, StandingExecutor), "the installed rclpy has all that is needed"
    executor.add_node(node)
    yield executor
    executor.shutdown()


def spin_until(executor: StandingExecutor, reached: Callable[[], bool], *, for_s: float = PATIENCE_S) -> bool:
    end = time.monotonic() + for_s
    while not reached() and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    return reached()


def test_messages_arrive_once_and_in_order_with_timers_and_services(node: Node, executor: StandingExecutor) -> None:
    heard: dict[str, list[int]] = {"a": [], "b": []}
    ticks: list[float] = []
    for topic, numbers in heard.items():
        node.create_subscription(Int32, topic, lambda m, numbers=numbers: numbers.append(m.data), EVERY)
    publishers = [node.create_publisher(Int32, topic, EVERY) for topic in heard]
    node.create_timer(0.01, lambda: ticks.append(time.monotonic()))
    node.create_service(Trigger, "ask", lambda request, response: Trigger.Response(success=True, message="heard"))
    client = node.create_client(Trigger, "ask")
    assert spin_until(executor, lambda: all(p.get_subscription_count() for p in publishers))
    assert spin_until(executor, client.service_is_ready)
    for first in range(0, 3000, 300):  # 300 messages at a time: more than are taken in one round
        for number in range(first, first + 300):
            for publisher in publishers:
                publisher.publish(Int32(data=number))
        before = len(ticks)
        time.sleep(0.011)  # the timer is due
        executor.spin_once(timeout_sec=1.0)
        assert len(ticks) > before, "messages that wait do not keep a timer waiting"
        assert spin_until(executor, lambda n=first + 300: len(heard["a"]) == len(heard["b"]) == n)
    assert heard == {"a": list(range(3000)), "b": list(range(3000))}
    answer = client.call_async(Trigger.Request())
    assert spin_until(executor, answer.done)
    assert answer.result().message == "heard"


def test_service_is_served_despite_continuous_messages(node: Node, executor: StandingExecutor) -> None:
    publisher = node.create_publisher(Int32, "busy", EVERY)
    node.create_subscription(Int32, "busy", publisher.publish, EVERY)  # each message brings the next
    node.create_service(Trigger, "ask", lambda request, response: Trigger.Response(success=True))
    client = node.create_client(Trigger, "ask")
    assert spin_until(executor, lambda: client.service_is_ready() and bool(publisher.get_subscription_count()))
    publisher.publish(Int32())
    for _ in range(3):
        answer, end = client.call_async(Trigger.Request()), time.monotonic() + PATIENCE_S
        while not answer.done() and time.monotonic() < end:
            executor.spin_once()  # without a timeout, as `spin` does it
        assert answer.result().success


def test_entities_created_and_destroyed_in_callbacks_are_handled(node: Node, executor: StandingExecutor) -> None:
    heard: list[int] = []
    made: list[Any] = []
    publisher = node.create_publisher(Int32, "late", EVERY)

    def make() -> None:
        timer.cancel()
        made.append(node.create_subscription(Int32, "late", lambda m: heard.append(m.data), EVERY))

    timer = node.create_timer(0.01, make)
    assert spin_until(executor, lambda: publisher.get_subscription_count() == 1)
    publisher.publish(Int32(data=7))
    assert spin_until(executor, lambda: heard == [7])
    node.create_timer(0.01, lambda: made and node.destroy_subscription(made.pop()))
    assert spin_until(executor, lambda: publisher.get_subscription_count() == 0), "its handle is no longer in use"
    publisher.publish(Int32(data=8))
    assert not spin_until(executor, lambda: len(heard) > 1, for_s=0.2)


def test_parameter_services_and_async_callbacks_work(node: Node, executor: StandingExecutor) -> None:
    node.declare_parameter("depth_m", 4.5)
    found: list[float] = []
    client = node.create_client(GetParameters, "served/get_parameters")
    assert spin_until(executor, client.service_is_ready)

    async def ask() -> None:
        timer.cancel()
        response = await client.call_async(GetParameters.Request(names=["depth_m"]))
        found.append(response.values[0].double_value)

    timer = node.create_timer(0.01, ask, callback_group=ReentrantCallbackGroup())
    assert spin_until(executor, lambda: found == [4.5])
    plain: list[bool] = []
    node.create_timer(0.01, lambda: plain.append(True))
    assert spin_until(executor, lambda: bool(plain)), "after it, rounds are the executor's own again"


def test_guard_condition_and_task_of_another_thread_end_the_wait(node: Node, executor: StandingExecutor) -> None:
    seen: list[str] = []
    guard = node.create_guard_condition(lambda: seen.append("guard"))
    executor.spin_once(timeout_sec=0.0)
    threading.Timer(0.05, guard.trigger).start()
    threading.Timer(0.15, lambda: executor.create_task(lambda: seen.append("task"))).start()
    assert spin_until(executor, lambda: seen == ["guard", "task"])


def test_timer_of_simulated_time_follows_the_clock(node: Node, executor: StandingExecutor) -> None:
    fired: list[int] = []
    assert node.set_parameters([Parameter("use_sim_time", value=True)])[0].successful
    publisher = node.create_publisher(Clock, "/clock", 10)
    assert spin_until(executor, lambda: publisher.get_subscription_count() > 0)
    node.create_timer(10.0, lambda: fired.append(node.get_clock().now().nanoseconds // 10**9))
    assert node.get_clock().clock_type == ClockType.ROS_TIME
    for second in (1, 5, 12, 15, 22):
        message = Clock()
        message.clock.sec = second
        publisher.publish(message)
        assert spin_until(executor, lambda s=second: node.get_clock().now().nanoseconds == s * 10**9)
        executor.spin_once(timeout_sec=0.0)
    assert [second for second in fired if second > 1] == [12, 22]


def test_incompatible_reader_is_reported(
    node: Node, executor: StandingExecutor, capfd: pytest.CaptureFixture[str]
) -> None:
    node.create_publisher(Int32, "mismatch", QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
    node.create_subscription(Int32, "mismatch", lambda m: None, EVERY)
    node.create_timer(0.001, lambda: None)  # never idle
    told = ""

    def warned() -> bool:
        nonlocal told
        told += capfd.readouterr().err
        return "requesting incompatible QoS" in told and "offering incompatible QoS" in told

    assert spin_until(executor, warned)


def test_callback_exception_and_shutdown_end_spin(node: Node, executor: StandingExecutor) -> None:
    def fail() -> None:
        timer.cancel()
        raise RuntimeError("no bottom echo")

    timer = node.create_timer(0.01, fail)
    with pytest.raises(RuntimeError, match="no bottom echo"):
        executor.spin()
    threading.Timer(0.05, rclpy.shutdown).start()
    with pytest.raises(ExternalShutdownException):
        executor.spin()
    executor.spin()  # returns at once


def test_wait_ends_by_timeout_and_shutdown(node: Node, executor: StandingExecutor) -> None:
    executor.spin_once(timeout_sec=0.0)
    began = time.monotonic()
    while time.monotonic() - began < 0.05:  # what happened at start may end the first waits
        executor.spin_once(timeout_sec=0.05)
    began = time.monotonic()
    executor.spin_once(timeout_sec=0.2)
    assert time.monotonic() - began >= 0.19, "nothing is ready: the whole time is waited"
    threading.Timer(0.05, executor.shutdown).start()
    executor.spin()
    assert executor._entities is None, "the thread that spins has given up its handles"


def test_unsupported_rclpy_uses_its_own_executor_with_one_warning(
    node: Node, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(executor_module, "_EXECUTOR_NEEDS", ("_context", "_no_such_thing"))
    executor = make_executor()
    assert type(executor) is SingleThreadedExecutor
    executor.shutdown()
    assert capfd.readouterr().err.count("this rclpy has no Executor._no_such_thing") == 1
