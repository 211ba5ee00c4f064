"""The progress display reads the state of its own mission, also while another one publishes in the same domain."""

from __future__ import annotations

import importlib.util
import time

import pytest

if importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("auv_lse_msgs") is None:
    pytest.skip("needs rclpy and the built workspace (scripts/test sets both up)", allow_module_level=True)

import rclpy
from rclpy.context import Context
from rclpy.node import Node

from auv_lse_common.node.dive import DIVE_VARIABLE
from auv_lse_common.topics.quality import LATCHED
from auv_lse_msgs.msg import SimStatus
from auv_lse_run.mission.display import MissionProgress
from auv_lse_run.mission.sim_status_node import TOO_LATE, SimStatusWatch
from auv_lse_run.mission.watch_node import MissionWatch
from auv_lse_run.process.domain import node_environment, own_domain

pytestmark = pytest.mark.ros

OWN, OTHER = "sim-1123-184534-3f2a", "sim-1123-184534-aaaa"


def test_the_end_of_a_mission_is_read_among_messages_of_another_one() -> None:
    progress = MissionProgress(vehicles=1, steps_total=1)
    with own_domain() as domain:
        watch, context = MissionWatch(progress, node_environment(domain) | {DIVE_VARIABLE: OWN}), Context()
        rclpy.init(context=context, domain_id=domain)
        node = Node("writer", context=context)
        status, stranger = (node.create_publisher(SimStatus, "/sim/status", LATCHED) for _ in range(2))
        try:
            with watch:
                until = time.monotonic() + 30.0
                while not (status.get_subscription_count() and stranger.get_subscription_count()):
                    assert time.monotonic() < until, "the watch is not discovered"
                    time.sleep(0.05)
                status.publish(SimStatus(dive=OWN, state=SimStatus.FINISHED, message="complete"))
                for _ in range(20):  # `ros2 bag play`, while the watch waits
                    stranger.publish(SimStatus(dive=OTHER, state=SimStatus.RUNNING))
                found = [watch.wait(0.1) for _ in range(20)]
        finally:
            node.destroy_node()
            rclpy.shutdown(context=context)
    assert found[-1] == ("finished", "complete")


def test_a_vehicle_that_starts_during_a_mission_in_lockstep_is_too_late() -> None:
    """The simulator waited 60 s for its answers, and neither explained why."""
    with own_domain() as domain:
        context = Context()
        rclpy.init(context=context, domain_id=domain)
        node = Node("writer", context=context)
        status = node.create_publisher(SimStatus, "/sim/status", LATCHED)
        try:
            status.publish(SimStatus(dive=OWN, state=SimStatus.RUNNING))
            with SimStatusWatch(node_environment(domain) | {DIVE_VARIABLE: OWN}) as mission_end:
                until = time.monotonic() + 30.0
                while mission_end(False) is None:
                    assert time.monotonic() < until, "the status is not received"
                    time.sleep(0.05)
                assert mission_end(False) == TOO_LATE
            with SimStatusWatch(node_environment(domain) | {DIVE_VARIABLE: OWN}) as mission_end:
                assert [mission_end(True) for _ in range(20) if not time.sleep(0.05)] == [None] * 20
        finally:
            node.destroy_node()
            rclpy.shutdown(context=context)
