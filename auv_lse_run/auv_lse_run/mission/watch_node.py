"""Follows a running mission for the progress display."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import partial

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.signals import SignalHandlerOptions

from auv_lse_common.node.dive import DIVE_VARIABLE
from auv_lse_common.node.executor import make_executor
from auv_lse_common.support.ros_logs import init_arguments
from auv_lse_common.topics.quality import EVERY, LATCHED_READER
from auv_lse_common.vocabulary.health import LEGS_LEFT
from auv_lse_common.vocabulary.stamps import seconds
from auv_lse_msgs.msg import Bound, MapQuality, SimStatus
from auv_lse_run.mission.display import MissionProgress
from auv_lse_run.process.domain import temporary_environment

_STATES = {
    SimStatus.WAITING: "waiting",
    SimStatus.RUNNING: "running",
    SimStatus.FINISHED: "finished",
    SimStatus.FAILED: "failed",
}


class MissionWatch:
    """A node that reads /sim/status and the planners' bounds into a MissionProgress; a context manager."""

    def __init__(self, progress: MissionProgress, environment: Mapping[str, str]) -> None:
        """Joins nothing yet.

        Args:
            progress: Updated with what the simulator and the planners publish.
            environment: Environment of the mission's nodes: ROS domain, discovery, id of the simulation.
        """
        self._environment = environment
        self._progress = progress
        self._state, self._message = "waiting", "the simulator has not published its state yet"

    def __enter__(self) -> MissionWatch:
        """Joins the mission's ROS domain; the caller keeps handling Ctrl-C."""
        with temporary_environment(self._environment):
            rclpy.init(args=init_arguments(), signal_handler_options=SignalHandlerOptions.NO)
            self._node = rclpy.create_node("mission_display")
        self._executor = make_executor()
        self._executor.add_node(self._node)
        self._node.create_subscription(SimStatus, "/sim/status", self._on_status, LATCHED_READER)
        for vehicle in range(1, self._progress.vehicles + 1):
            topic = f"/auv{vehicle}/planner/bound"
            self._node.create_subscription(Bound, topic, partial(self._on_bound, vehicle), EVERY)
            topic = f"/auv{vehicle}/map/quality"
            self._node.create_subscription(MapQuality, topic, partial(self._on_quality, vehicle), LATCHED_READER)
            topic = f"/auv{vehicle}/diagnostics"
            self._node.create_subscription(DiagnosticArray, topic, partial(self._on_health, vehicle), EVERY)
        return self

    def __exit__(self, *_: object) -> None:
        """Leaves the domain."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def wait(self, seconds_: float) -> tuple[str, str]:
        """Waits `seconds_`, then handles all waiting messages; returns the state ("waiting", ...) and its message."""
        time.sleep(seconds_)
        self._executor.spin_once(timeout_sec=0.0)
        return self._state, self._message

    def _is_own(self, message: SimStatus | Bound | MapQuality) -> bool:
        return bool(message.dive == self._environment.get(DIVE_VARIABLE, ""))

    def _on_status(self, message: SimStatus) -> None:
        if not self._is_own(message):
            return
        self._state, self._message = _STATES[message.state], message.message
        p = self._progress
        p.sim_s = seconds(message.header.stamp)
        p.steps = list(message.steps)
        p.sent, p.received, p.lost = message.packets_sent, message.packets_received, message.packets_lost
        p.speed = message.speed
        p.held = message.message if self._state == "running" else ""

    def _on_bound(self, vehicle: int, message: Bound) -> None:
        if not self._is_own(message):
            return
        p = self._progress
        p.rewards[vehicle] = message.reward_so_far
        p.expected[vehicle] = message.reward_so_far + message.jbar
        if message.lower_bound > message.reward_so_far:  # without a bound, it equals the reward so far
            p.bounds[vehicle] = message.lower_bound_max

    def _on_quality(self, vehicle: int, message: MapQuality) -> None:
        if self._is_own(message):
            quality = message.found_share, message.undiscovered_m, message.deviation_m
            self._progress.qualities[vehicle] = quality

    def _on_health(self, vehicle: int, message: DiagnosticArray) -> None:
        values = (value for status in message.status for value in status.values)
        legs = next((int(value.value) for value in values if value.key == LEGS_LEFT), None)
        if legs is not None:
            self._progress.battery_legs[vehicle] = legs
