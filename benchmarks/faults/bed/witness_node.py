"""The simulated water around one vehicle: moves it along its waypoints and takes what its nodes publish."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection
from functools import partial
from types import TracebackType
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from auv_lse_common.support.arrays import Array
from auv_lse_common.topics.quality import EVERY, LATCHED
from auv_lse_common.topics.ros_conversions import header
from auv_lse_common.vocabulary.stamps import seconds
from auv_lse_msgs.msg import (
    Bound,
    KernelCenters,
    MissionCommand,
    MissionState,
    ModemRx,
    ModemTx,
    Plan,
    Sounding,
    Waypoint,
)
from benchmarks.faults.bed.ledger import Ledger

#: Depth (m) of the vehicle under way, and of the ground.
DEPTH_M, GROUND_M = 3.0, 15.0
#: A moving vehicle measures the depth at least this often (m).
SOUNDING_M = 1.5
_PERIOD_S = 0.1
#: Outcomes of a sounding, in the diagnostics of gp_node.
_OUTCOMES = ("kept", "too_close", "merged", "outliers", "full", "refused")
#: The last message of a writer that starts before it is discovered, and then every message.
_LATCHED_EVERY = QoSProfile(
    depth=1000, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


class Witness:
    """The water around a vehicle, as a context. Call `spin` continuously.

    Attributes:
        ledger: What its nodes have published.
        dive: Id of the dive, for the frames of messages.
        send: Called with each packet that the vehicle sends.
        state: The last state of the mission; None after a start or kill until the next one.
        depth_m: The vehicle's depth.
        problems: Problems with their files that nodes have reported since `forget`.
        since_s: When nodes died last (s since 1970), see `note_death`.
        published_s: First message on each topic that was sent since then (s); "map size": diagnostics with that.
        heard_s: When the vehicle published a mate's plan last, by mate (s).
    """

    def __init__(self, vehicle: int, domain: int, start_m: tuple[float, float], ledger: Ledger) -> None:
        """Joins nothing yet. Args: start_m: where the vehicle starts, north and east (m)."""
        self.vehicle, self.ledger = vehicle, ledger
        self.send: Callable[[bytes], None] = lambda payload: None
        self.state: Any = None
        self.depth_m = 0.0
        self.problems: set[str] = set()
        self.since_s = 0.0
        self.published_s: dict[str, float] = {}
        self.heard_s: dict[int, float] = {}
        self._domain = domain
        self._aborted = False
        self._pose = [0.0, *start_m]  # heading (rad), north, east (m)
        self._waypoint: Any = None
        self._moved_s = self._sent_s = 0.0
        self._centers = b""
        self._known: set[tuple[str, bytes]] = set()

    def __enter__(self) -> Witness:
        """Joins the vehicle's domain; signals stay the caller's."""
        self._context = rclpy.Context()
        none = rclpy.signals.SignalHandlerOptions.NO
        rclpy.init(context=self._context, domain_id=self._domain, signal_handler_options=none)
        self._node = rclpy.create_node(f"witness{self.vehicle}", context=self._context)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        own = f"/auv{self.vehicle}"
        self._odometry = self._node.create_publisher(Odometry, f"{own}/odometry", EVERY)
        self._raw = self._node.create_publisher(Odometry, f"{own}/dead_reckoning", EVERY)
        self._sounding = self._node.create_publisher(Sounding, f"{own}/sounding", EVERY)
        self._heard = self._node.create_publisher(ModemRx, f"{own}/modem/rx", EVERY)
        self._command = self._node.create_publisher(MissionCommand, f"{own}/mission/command", EVERY)
        for kind, topic, take, quality in (
            (MissionState, "mission/state", self._on_state, LATCHED),
            (Bound, "planner/bound", self._on_bound, EVERY),
            (Waypoint, "waypoint", self._on_waypoint, _LATCHED_EVERY),
            (ModemTx, "modem/tx", self._on_packet, EVERY),
            (Plan, "team/plans", self._on_plan, EVERY),
            (DiagnosticArray, "diagnostics", self._on_diagnostics, EVERY),
            (KernelCenters, "kernel_centers", self._on_centers, LATCHED),
        ):
            raw = kind is KernelCenters  # large, and rarely needed
            self._node.create_subscription(kind, f"{own}/{topic}", partial(self._take, topic, take), quality, raw=raw)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leaves."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def new_dive(self) -> None:
        """Begins a dive: nothing of the last one counts."""
        self.ledger.new_dive()
        self._aborted, self._waypoint, self.depth_m, self._centers = False, None, 0.0, b""
        self.forget()

    def forget(self) -> None:
        """Forgets state and problems, because nodes are about to be killed."""
        self.state = None
        self.problems.clear()
        self._known = self._nodes()

    def note_death(self) -> None:
        """Notes that the nodes are dead: messages sent from now on come from restarted ones."""
        self.since_s = time.time()
        self.published_s.clear()

    def order(self, command: int) -> None:
        """Sends a command to the mission."""
        if command == MissionCommand.RESET:
            self._aborted = False
        self._command.publish(MissionCommand(header=self._header(), command=command, source="witness"))

    def receive(self, source: int, payload: bytes) -> None:
        """Delivers a mate's packet to the vehicle's modem, which does not measure its travel time."""
        unknown = math.nan
        message = ModemRx(source=source, payload=payload, sent_s=unknown, arrival_s=unknown, travel_s=unknown)
        message.header = self._header()
        self._heard.publish(message)

    def spin(self, seconds: float) -> None:
        """Handles a message, waiting at most `seconds` for it, and moves the vehicle."""
        self._executor.spin_once(timeout_sec=seconds)
        self._move()

    def has_restarted(self, nodes: Collection[str]) -> bool:
        """Whether nodes with these names have started since `forget`."""
        return set(nodes) <= {name for name, _ in self._nodes() - self._known}

    def _nodes(self) -> set[tuple[str, bytes]]:
        """Names of the vehicle's nodes, each with the id of its publisher of diagnostics."""
        found = self._node.get_publishers_info_by_topic(f"/auv{self.vehicle}/diagnostics")
        return {(one.node_name, bytes(one.endpoint_gid)) for one in found}

    def is_in(self, *states: int) -> bool:
        """Whether the mission is in one of `states`."""
        return self.state is not None and self.state.state in states

    def centers_m(self) -> Array:
        """North, east (m) of the centers of the map published last, (n, 2)."""
        if not self._centers:
            return np.zeros((0, 2))
        message = deserialize_message(self._centers, KernelCenters)
        return np.column_stack([message.north_m, message.east_m])

    def _header(self, ago_s: float = 0.0) -> Any:
        return header(time.time() - ago_s)

    def _move(self) -> None:
        now_s = time.monotonic()
        passed_s = min(now_s - self._moved_s, 0.5)
        if passed_s < _PERIOD_S:
            return
        self._moved_s = now_s
        travels = self.state is not None and self.state.action == MissionState.TRAVEL
        if travels:
            self.depth_m = DEPTH_M
        elif self.state is not None and self.state.action == MissionState.SURFACE:
            self.depth_m = 0.0
        _, *before_m = self._pose
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
        message = self._odometry_message(travels)
        self._odometry.publish(message)
        self._raw.publish(message)
        if travels:
            self._sound(before_m, passed_s)

    def _odometry_message(self, travels: bool) -> Odometry:
        message = Odometry(header=self._header())
        heading, north_m, east_m = self._pose
        position, turned = message.pose.pose.position, message.pose.pose.orientation
        position.x, position.y, position.z = east_m, north_m, -self.depth_m  # ROS: x east, y north, z up
        turned.z, turned.w = math.sin((math.pi / 2 - heading) / 2), math.cos((math.pi / 2 - heading) / 2)
        message.twist.twist.linear.x = 1.0 if travels else 0.0
        return message

    def _sound(self, before_m: list[float], passed_s: float) -> None:
        """Soundings between two positions, at least one."""
        _, *after_m = self._pose
        number = max(1, round(math.dist(before_m, after_m) / SOUNDING_M))
        for i in range(1, number + 1):
            share = i / number
            north_m, east_m = (a + share * (b - a) for a, b in zip(before_m, after_m, strict=True))
            depth_m = GROUND_M + 3.0 * math.sin(north_m / 40.0)
            message = Sounding(north_m=north_m, east_m=east_m, depth_m=depth_m, raw_north_m=north_m, raw_east_m=east_m)
            message.header = self._header((1.0 - share) * passed_s)
            self._sounding.publish(message)

    def _take(self, topic: str, take: Callable[[Any], None], message: Any, info: Any) -> None:
        self._sent_s = 1e-9 * info["source_timestamp"]
        self._note(topic)
        take(message)

    def _note(self, topic: str) -> None:
        if self._sent_s > self.since_s:
            self.published_s.setdefault(topic, self._sent_s)

    def _on_state(self, message: MissionState) -> None:
        self.state = message
        if message.state == MissionState.ABORTED:
            self._aborted = True
        elif self._aborted and message.action != MissionState.SURFACE:
            self.ledger.broken.append(f"un-aborted: state {message.state}, action {message.action}")
            self._aborted = False

    def _on_bound(self, message: Bound) -> None:
        self.ledger.take_record(message.step)

    def _on_waypoint(self, message: Waypoint) -> None:
        self.ledger.take_leg(message.step, (message.end_north_m, message.end_east_m))
        self._waypoint = message

    def _on_packet(self, message: ModemTx) -> None:
        payload = bytes(message.payload)
        self.ledger.take_packet(seconds(message.header.stamp), payload)
        self.send(payload)

    def _on_plan(self, message: Plan) -> None:
        self.heard_s[message.vehicle] = self._sent_s

    def _on_centers(self, data: bytes) -> None:
        self._centers = data

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.problems.update(text for text in ("cannot be written", "not trusted") if text in status.message)
            found = {entry.key: entry.value for entry in status.values}
            if status.name.endswith("gp_node") and set(_OUTCOMES) <= set(found):
                self.ledger.map_sizes.append(sum(int(found[key]) for key in _OUTCOMES))
                self._note("map size")
