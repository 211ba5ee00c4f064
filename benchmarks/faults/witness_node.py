"""The simulated water around one vehicle: moves it along its waypoints and checks what its nodes publish."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection
from types import TracebackType
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry

from auv_lse_common.mission_file.sections.acoustics import TdmaConfig
from auv_lse_common.process.dive import tagged_frame
from auv_lse_common.topics.quality import EVERY, LATCHED
from auv_lse_common.topics.ros_conversions import header
from auv_lse_comms.packet.tag import TRAILER_BYTES, Tagger
from auv_lse_comms.tdma import Tdma
from auv_lse_msgs.msg import Bound, MissionCommand, MissionState, ModemTx, Sounding, Waypoint

#: Depth (m) of the vehicle under way, and of the ground.
DEPTH_M, GROUND_M = 3.0, 15.0
_PERIOD_S = 0.1


class Witness:
    """A context that is a vehicle's water. Call `wait` all the time.

    Attributes:
        dive: Id of the dive, for the frames of messages.
        state: The last state of the mission; None after a start or kill until the next one.
        depth_m: The vehicle's depth.
        broken: Violated requirements, one sentence each.
        problems: What nodes have reported about their files since `forget`.
        last_step: Last step decided; -1 before the first.
        slots: Counters used by the packets: slot (s) and era.
    """

    def __init__(self, domain: int, tdma: TdmaConfig, tagger: Tagger) -> None:
        """Joins nothing yet; `tagger` has the team's key and session."""
        self.dive = ""
        self.state: MissionState | None = None
        self.depth_m = 0.0
        self.broken: list[str] = []
        self.problems: set[str] = set()
        self.last_step = -1
        self.slots: set[tuple[float, bytes]] = set()
        self._domain, self._tdma, self._tagger = domain, Tdma(tdma, 1, 2), tagger
        self._aborted = False
        self._pose = [0.0, 0.0, 0.0]  # heading (rad), north, east (m)
        self._waypoint: Any = None
        self._published_s = 0.0
        self._known: set[tuple[str, bytes]] = set()

    def __enter__(self) -> Witness:
        """Joins the vehicle's domain; signals stay the caller's."""
        self._context = rclpy.Context()
        none = rclpy.signals.SignalHandlerOptions.NO
        rclpy.init(context=self._context, domain_id=self._domain, signal_handler_options=none)
        self._node = rclpy.create_node("witness", context=self._context)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._odometry = self._node.create_publisher(Odometry, "/auv1/odometry", EVERY)
        self._sounding = self._node.create_publisher(Sounding, "/auv1/sounding", EVERY)
        self._command = self._node.create_publisher(MissionCommand, "/auv1/mission/command", EVERY)
        for kind, topic, take, quality in (
            (MissionState, "mission/state", self._on_state, LATCHED),
            (Bound, "planner/bound", self._on_bound, EVERY),
            (Waypoint, "waypoint", self._on_waypoint, EVERY),
            (ModemTx, "modem/tx", self._on_packet, EVERY),
            (DiagnosticArray, "diagnostics", self._on_diagnostics, EVERY),
        ):
            self._node.create_subscription(kind, f"/auv1/{topic}", take, quality)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leaves."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def new_dive(self) -> None:
        """A dive begins: nothing of the last one counts."""
        self.last_step, self._aborted, self._waypoint, self.depth_m = -1, False, None, 0.0
        self.forget()

    def forget(self) -> None:
        """Nodes were killed: waits for their next messages."""
        self.state = None
        self.problems.clear()
        self._known = self._nodes()

    def order(self, command: int) -> None:
        """Sends a command to the mission."""
        if command == MissionCommand.RESET:
            self._aborted = False
        self._command.publish(MissionCommand(header=self._header(), command=command, source="witness"))

    def wait(self, condition: Callable[[], Any], seconds: float) -> float:
        """Moves the vehicle until `condition` holds; returns how long it took (s), NaN if it does not in time."""
        began = time.monotonic()
        while not condition():
            if time.monotonic() - began > seconds:
                return math.nan
            self._executor.spin_once(timeout_sec=0.02)
            self._move()
        return time.monotonic() - began

    def spend(self, seconds: float) -> None:
        """Moves the vehicle for so long (s)."""
        self.wait(lambda: False, seconds)

    def back(self, nodes: Collection[str], seconds: float) -> float:
        """Waits for nodes that were started since `forget`; returns how long it took (s), NaN if not in time."""
        return self.wait(lambda: set(nodes) <= {name for name, _ in self._nodes() - self._known}, seconds)

    def _nodes(self) -> set[tuple[str, bytes]]:
        """Names of the vehicle's nodes, each with the id of its publisher of diagnostics."""
        found = self._node.get_publishers_info_by_topic("/auv1/diagnostics")
        return {(one.node_name, bytes(one.endpoint_gid)) for one in found}

    def is_in(self, *states: int) -> bool:
        """Whether the mission is in one of `states`."""
        return self.state is not None and self.state.state in states

    def _header(self) -> Any:
        found = header(time.time())
        found.frame_id = tagged_frame(self.dive, "map")
        return found

    def _move(self) -> None:
        now_s = time.monotonic()
        passed_s = min(now_s - self._published_s, 0.5)
        if passed_s < _PERIOD_S:
            return
        self._published_s = now_s
        travels = self.state is not None and self.state.action == MissionState.TRAVEL
        if travels:
            self.depth_m = DEPTH_M
        elif self.state is not None and self.state.action == MissionState.SURFACE:
            self.depth_m = 0.0
        if travels and self._waypoint is not None:
            end = (self._waypoint.end_north_m, self._waypoint.end_east_m)
            north_m, east_m = end[0] - self._pose[1], end[1] - self._pose[2]
            far_m, step_m = math.hypot(north_m, east_m), self._waypoint.speed_mps * passed_s
            if far_m > step_m:
                self._pose = [
                    math.atan2(east_m, north_m),
                    self._pose[1] + north_m / far_m * step_m,
                    self._pose[2] + east_m / far_m * step_m,
                ]
            else:
                self._pose = [self._waypoint.end_heading_rad, *end]
        message = Odometry(header=self._header())
        heading, north_m, east_m = self._pose
        place, turned = message.pose.pose.position, message.pose.pose.orientation
        place.x, place.y, place.z = east_m, north_m, -self.depth_m  # ROS: x east, y north, z up
        turned.z, turned.w = math.sin((math.pi / 2 - heading) / 2), math.cos((math.pi / 2 - heading) / 2)
        message.twist.twist.linear.x = 1.0 if travels else 0.0
        self._odometry.publish(message)
        if travels:
            depth_m = GROUND_M + 3.0 * math.sin(north_m / 40.0)
            self._sounding.publish(Sounding(header=self._header(), north_m=north_m, east_m=east_m, depth_m=depth_m))

    def _on_state(self, message: MissionState) -> None:
        self.state = message
        if message.state == MissionState.ABORTED:
            self._aborted = True
        elif self._aborted and message.action != MissionState.SURFACE:
            self.broken.append(f"un-aborted: state {message.state}, action {message.action}")
            self._aborted = False

    def _on_bound(self, message: Bound) -> None:
        if message.step <= self.last_step:
            self.broken.append(f"step {message.step} decided after step {self.last_step}")
        self.last_step = max(self.last_step, message.step)

    def _on_waypoint(self, message: Waypoint) -> None:
        self._waypoint = message

    def _on_packet(self, message: ModemTx) -> None:
        payload = bytes(message.payload)
        stamp_s = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        body, tag = payload[: -self._tagger.size], payload[-self._tagger.size :]
        found = self._tagger._slot_of(1, body, tag, self._tdma.around(stamp_s, 1))
        if found is None:
            self.broken.append("a packet's tag is that of no slot")
            return
        key = (found[0], body[-TRAILER_BYTES:][:4] if found[1] else b"")
        if key in self.slots:
            self.broken.append(f"counter {key} used twice")
        self.slots.add(key)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.problems.update(text for text in ("cannot be written", "not trusted") if text in status.message)
