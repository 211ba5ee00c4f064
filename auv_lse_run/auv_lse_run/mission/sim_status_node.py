"""Watches for the end of a simulated mission."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import TracebackType

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from auv_lse_common.node.dive import DIVE_VARIABLE
from auv_lse_common.support.ros_logs import init_arguments
from auv_lse_common.topics.quality import LATCHED_READER
from auv_lse_msgs.msg import SimStatus
from auv_lse_run.process.domain import temporary_environment

_ENDS = {SimStatus.FINISHED: "finished", SimStatus.FAILED: "failed"}
#: The end for a vehicle that starts, or starts again, during a mission in lockstep.
TOO_LATE = (
    "begun already, and in lockstep no vehicle can join it. Start the simulator and all vehicles again; with "
    "auv_lse sim --real-time-factor 1 a vehicle may restart"
)
#: The simulator is lost after this many failed checks in a row, since its last status may arrive after its end.
_CHECKS = 10


class SimStatusWatch:
    """A context manager; it provides a function that returns how the mission has ended, None until then.

    The function takes whether the vehicle's nodes may have joined: the mission is over for one that comes too late.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        """Does not join a ROS domain yet.

        Args:
            environment: Environment of the mission's nodes: ROS domain, discovery, id of the simulation.
        """
        self._environment = environment
        self._state: str | None = None
        self._begun = self._runs = False
        self._checks_gone = 0

    def __enter__(self) -> Callable[[bool], str | None]:
        """Joins the mission's ROS domain; the caller keeps handling signals."""
        with temporary_environment(self._environment):
            rclpy.init(args=init_arguments(), signal_handler_options=SignalHandlerOptions.NO)
            self._node = rclpy.create_node("vehicle_supervisor")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._node.create_subscription(SimStatus, "/sim/status", self._on_status, LATCHED_READER)
        return self._check

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leaves the ROS domain."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def _check(self, may_have_joined: bool) -> str | None:
        for _ in range(5):  # the status, and other work that may be ready
            self._executor.spin_once(timeout_sec=0.0)
        gone = self._begun and self._node.count_publishers("/sim/status") == 0
        self._checks_gone = self._checks_gone + 1 if gone else 0
        if self._state is None and self._checks_gone >= _CHECKS:
            self._state = "lost its simulator"
        if self._state is None and self._runs and not may_have_joined:
            self._state = TOO_LATE
        return self._state

    def _on_status(self, message: SimStatus) -> None:
        """Records the end of a mission that this watch has seen waiting or running; ignores earlier missions."""
        if message.dive != self._environment.get(DIVE_VARIABLE, ""):
            return
        self._begun, self._runs = self._begun or message.state not in _ENDS, message.state == SimStatus.RUNNING
        if self._begun:
            self._state = _ENDS.get(message.state)
