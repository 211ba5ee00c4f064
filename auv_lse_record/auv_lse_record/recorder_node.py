"""Records the topics of a mission, and others that it names, raw, into one rosbag2 directory (MCAP)."""

from __future__ import annotations

import auv_lse_common.node.executable  # noqa: F401  # first: prepares the process

# isort: split

import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.subscription import Subscription
from std_msgs.msg import String

from auv_lse_common.mission_file.parameters import ParameterError, section
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.mission import MissionConfig, MotionConfig
from auv_lse_common.mission_file.sections.record import RecordConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.node.base_node import BaseNode
from auv_lse_common.node.dive import is_simulation, vehicle_of
from auv_lse_common.node.entry_point import Main
from auv_lse_common.topics.quality import EVERY
from auv_lse_common.topics.ros_conversions import message_class
from auv_lse_common.topics.table import MISSION_TOPICS, Found, find_topic, recorded_topics
from auv_lse_msgs.msg import Dive, LockstepDone, LockstepTick
from auv_lse_record.bag_writer import BagWriter, RecorderError, message_types, unused_folder
from auv_lse_record.extra_topics import ExtraTopics
from auv_lse_record.guard import GuardedWriter, free_mb
from auv_lse_record.message_types import dive_in, frame_of
from auv_lse_record.ration import Ration
from auv_lse_record.recording import MISSION_FILE, SOFTWARE, TEXT
from auv_lse_record.size_estimate import estimate_size, lack_of_space
from auv_lse_record.software import mission_text, version

_DISCOVERY_PERIOD_S = 2.0
#: In lockstep only stamps matter, so messages are handled with this period (s): about once per tick.
_GATHER_S = 0.02
#: Period (s) of checks of the free space on the disk.
_SPACE_PERIOD_S = 2.0


class RecorderNode(BaseNode):
    """recorder_node: writes the topics of the stack, and those of `record.topics`, to `record.folder`."""

    def __init__(self) -> None:
        super().__init__("recorder_node")
        config = section(RecordConfig, self.parameters, "record", self.where)
        mission = section(MissionConfig, self.parameters, "mission", self.where)
        if not config.folder:
            raise ParameterError(f"{self.where}: record.folder is missing; set it to the rosbag2 directory to write")
        self._share = {"auv_lse_msgs": Path(get_package_share_directory("auv_lse_msgs")) / "msg"}
        snapshot = {"software": version(), "seed": str(mission.seed)}
        try:
            folder = Path(config.folder)
            if vehicle_of(self.dive):  # started again in this dive: each start needs a folder of its own
                folder = unused_folder(folder)
            definitions = list(self._share.values())
            writer = BagWriter(folder, message_types(definitions), snapshot, config.flush_s)
            writer.use_definitions(definitions)
            self._bag = GuardedWriter(writer, folder, config.least_free_mb)
        except RecorderError as error:
            raise ParameterError(f"{self.where}: {error}") from error
        self._ration = Ration(config.map_bytes_per_s)
        self._extra = ExtraTopics(config.topics, config.topics_mb)
        self._refused: set[str] = set()
        self._topics: set[str] = set()
        self._written_ns = 0  # stamp of the last message
        self._ends = False
        self._held: list[Callable[[], None]] = []  # messages of senders that are not identified yet
        self._reliable: dict[str, tuple[Subscription, type, bool]] = {}  # subscription, message, latched
        self._write_text(MISSION_FILE, mission_text(sys.argv, self.parameters))
        self._write_text(SOFTWARE, version())
        for name, topic in recorded_topics(mission.vehicles).items():
            self._record(name, topic.kind, latched=topic.latched)
        if self.lockstep:
            self.gather_s = _GATHER_S
            self._done = self.create_publisher(LockstepDone, "/lockstep/done", EVERY)
            self.create_subscription(LockstepTick, "/lockstep/tick", self._on_tick, EVERY)
        self._reported = False
        self.create_timer(_DISCOVERY_PERIOD_S, self._discover)
        self.create_timer(_SPACE_PERIOD_S, self._check_space)
        self._log_size(config, mission, folder)

    def _log_size(self, config: RecordConfig, mission: MissionConfig, folder: Path) -> None:
        """Logs the expected size, with a warning if the disk lacks the room."""
        motion, area, gp, vehicle = (
            section(kind, self.parameters, name, self.where)
            for name, kind in (
                ("motion", MotionConfig),
                ("area", AreaConfig),
                ("gp", GpConfig),
                ("vehicle", VehicleConfig),
            )
        )
        size = estimate_size(mission, motion, area, gp, config, vehicle.speed_mps)
        expected_mb = size.vehicle_mb if vehicle_of(self.dive) else size.mission_mb
        self.get_logger().info(f"recording to {folder}, about {expected_mb:.0f} MB")
        if lack := lack_of_space(expected_mb, free_mb(folder), config.least_free_mb):
            self.get_logger().warning(lack)
            self.report_on_terminal(f"recorder: {lack}")

    def _write_text(self, topic: str, text: str) -> None:
        """Writes a text about the whole recording, which no node publishes."""
        self._bag.add_topic(topic, TEXT, latched=True)
        self._bag.write(topic, self.get_clock().now().nanoseconds, serialize_message(String(data=text)))
        self._topics.add(topic)

    def _record(self, topic: str, kind: str, latched: bool = False, best_effort: bool = False) -> None:
        message = message_class(kind)
        self._bag.add_topic(topic, kind, latched)
        self._subscribe(topic, message, latched, best_effort)
        self._topics.add(topic)

    def _subscribe(self, topic: str, message: type, latched: bool, best_effort: bool) -> None:
        qos = QoSProfile(
            depth=5000,
            reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        subscription = self.subscribe_with_sender(message, topic, self._writer_of(topic), qos, raw=True)
        if not best_effort:
            self._reliable[topic] = (subscription, message, latched)

    def _has_best_effort_writer(self, topic: str) -> bool:
        """Whether a reliable subscription would miss one of the topic's writers."""
        writers = self.get_publishers_info_by_topic(topic)
        return any(w.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT for w in writers)

    def _is_latched(self, topic: str) -> bool:
        """Whether every writer of the topic is latched, so that earlier messages can be recorded."""
        writers = self.get_publishers_info_by_topic(topic)
        return bool(writers) and all(w.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for w in writers)

    def _writer_of(self, topic: str) -> Callable[..., None]:
        clock, found = self.get_clock(), find_topic(topic)
        with_dive = found is not None and found.topic.decode is not None
        rationed, limited = self._ration.concerns(found), found is None and self._extra.concerns(topic)

        def write(data: bytes, participant: bytes | None = None, stamp_ns: int | None = None) -> None:
            stamp_ns = clock.now().nanoseconds if stamp_ns is None else stamp_ns
            sender = self._sender_of(found, data, participant) if with_dive else ""
            if sender is None and not self._ends:
                self._held.append(partial(write, data, participant, stamp_ns))
                return
            if with_dive and self._is_foreign(found, sender or ""):
                return
            if found is not None and found.topic.name == "dive":
                self.senders.introduce(deserialize_message(data, Dive), participant or b"")
                self._write_held()
                if self._is_foreign(found, dive_in(data)):
                    return
            if limited and not self._is_within_limit(topic, len(data)):
                return
            self._written_ns = stamp_ns
            if not rationed:
                self._bag.write(topic, self._written_ns, data)
                return
            for name, kept in self._ration.take(topic, found, data):
                self._bag.write(name, self._written_ns, kept)

        return write

    def _is_within_limit(self, topic: str, size: int) -> bool:
        """Whether a message of `record.topics` is recorded; logs once that the limit is reached."""
        before = self._extra.problem
        taken = self._extra.take(topic, size)
        if self._extra.problem != before:
            self.get_logger().warning(self._extra.problem)
        return taken

    def _sender_of(self, found: Found, data: bytes, participant: bytes | None) -> str | None:
        """The dive that has sent a message; None: its participant may still identify itself."""
        if not found.topic.is_standard:
            return dive_in(data)
        return self.senders.sender_of(frame_of(data), participant, time.monotonic())

    def _write_held(self) -> None:
        """Records the messages whose senders have identified themselves, or had the time for it."""
        held, self._held = self._held, []
        for write in held:
            write()

    def _is_foreign(self, found: Found, sender: str) -> bool:
        """Whether a message comes from another dive. Team mates in the same domain are recorded, too."""
        vehicle, own_vehicle = f"auv{found.vehicle}", vehicle_of(self.dive)
        if found.vehicle and own_vehicle not in ("", vehicle) and vehicle_of(sender) in ("", vehicle):
            return is_simulation(sender)
        return self.ignores_dive(found.topic, sender)

    def _discover(self) -> None:
        """Records new topics; subscribes with best effort where a driver publishes that way."""
        for topic in [] if self.lockstep else list(self._reliable):
            if self._has_best_effort_writer(topic):
                subscription, message, latched = self._reliable.pop(topic)
                self.destroy_subscription(subscription)
                self._subscribe(topic, message, latched, best_effort=True)
        for topic, kinds in self.get_topic_names_and_types():
            found = find_topic(topic)
            if topic in self._topics or topic in self._refused:
                continue
            if (not self._extra.wants(topic)) if found is None else found.topic.lockstep:
                continue
            try:
                package = kinds[0].split("/")[0]
                if package not in self._share:
                    self._share[package] = Path(get_package_share_directory(package)) / "msg"
                    self._bag.use_definitions(list(self._share.values()))
                self._record(topic, kinds[0], self._is_latched(topic), self._has_best_effort_writer(topic))
            except (RecorderError, PackageNotFoundError, ImportError, AttributeError) as error:
                self._refused.add(topic)
                self.get_logger().warning(f"{topic} ({', '.join(kinds)}) cannot be recorded: {error!r}")

    def _check_space(self) -> None:
        """Ends the recording if the disk is nearly full, and logs that once."""
        self._write_held()
        self._bag.check_space()
        self._report_problem()

    def _report_problem(self) -> None:
        if self._bag.problem and not self._reported:
            self._reported = True
            self.get_logger().error(self._bag.problem)
            self.report_on_terminal(f"recorder: {self._bag.problem}")

    def _on_tick(self, message: LockstepTick) -> None:
        if self.ignores(MISSION_TOPICS["/lockstep/tick"], message):
            return
        self._done.publish(LockstepDone(phase=LockstepDone.RECORDER, tick=message.tick, dive=self.dive))

    def destroy_node(self) -> None:
        """Records the last maps, closes the recording, then ends the node."""
        self._ends = True  # senders that are not identified yet are a user's drivers
        self._write_held()
        for topic, data in self._ration.rest():
            self._bag.write(topic, self._written_ns, data)
        self._bag.close()
        self._report_problem()
        super().destroy_node()


#: Entry point of `ros2 run auv_lse_record recorder_node`.
main = Main(RecorderNode)
