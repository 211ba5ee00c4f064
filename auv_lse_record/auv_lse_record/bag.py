"""A run's recording (rosbag2 directory with MCAP) to `RunData` and back, without ROS.

Writing is for missions of the fleet engine: their recordings play with `ros2 bag play` as those of the ROS wiring do.
Positions become ENU at this boundary, as in every other message (see docs/reference/frames.md).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from auv_lse_common.mission_file.parameter_file import parameters_for, parse_parameters, read_parameter_file
from auv_lse_common.topics.table import recorded_topics
from auv_lse_common.vocabulary.dead_reckoning import Fix, MateNavigation, raw_place
from auv_lse_common.vocabulary.frames import heading_from_quaternion, quaternion_from_heading
from auv_lse_common.vocabulary.plan import Plan, Tour
from auv_lse_common.vocabulary.sounding import Sounding, Soundings
from auv_lse_common.vocabulary.stamps import seconds
from auv_lse_record.recording import (
    MISSION_FILE,
    SOFTWARE,
    TEXT,
    Recording,
    RecordingError,
    message_folder,
    read_messages,
    recording_in,
)
from auv_lse_record.run_data import (
    DecisionRecord,
    GroundGrid,
    PacketReceived,
    PacketSent,
    RunData,
    VehicleRun,
    origin_of,
)
from auv_lse_record.software import version

Patterns = dict[str, dict[str, Any]]

#: Numbers of a fix and of a mate's navigation, beside what their messages' headers say: named alike in both.
FIX_FIELDS = tuple(field.name for field in fields(Fix) if field.name != "stamp_s")
MATE_FIELDS = tuple(field.name for field in fields(MateNavigation) if field.name not in ("stamp_s", "source"))

#: Messages of this project that a recording holds and this module writes.
OWN_MESSAGES = ("Bound", "Fix", "MateNavigation", "ModemRx", "ModemTx", "Plan", "SampleArray", "Sounding")


def read_run(
    path: Path, *, mission: Path | None = None, ground: GroundGrid | None = None, wall_s: float = math.nan
) -> RunData:
    """Reads the recording of a mission.

    Args:
        path: The run folder, the rosbag2 directory, or its file of messages.
        mission: The mission file that was flown, for a recording that does not hold it.
        ground: True ground on the evaluation grid, None if there is none.
        wall_s: Wall-clock time the mission took (s), NaN if not known.

    Raises:
        RecordingError: naming the recording and what is missing or broken in it.
        ParameterError: if the mission file is not a parameter file.
    """
    return read_bag(recording_in(path), flown_parameters(path, mission), ground=ground, wall_s=wall_s)


def flown_parameters(path: Path, mission: Path | None = None) -> Patterns:
    """The mission file as flown: the one given, else the recording's own, else `mission.yaml` beside it.

    Args:
        path: The run folder, the rosbag2 directory, or its file of messages.
        mission: A mission file that stands in for the recording's.

    Raises:
        RecordingError: if there is no recording, or none of the three.
        ParameterError: if it is not a parameter file.
    """
    if mission is not None:
        return read_parameter_file(mission)
    with Recording(recording_in(path)) as recording:
        text = recording.text(MISSION_FILE)
    if text is not None:
        return parse_parameters(text, f"{path}: {MISSION_FILE}")
    for folder in (path, path.parent):
        if (folder / "mission.yaml").is_file():
            return read_parameter_file(folder / "mission.yaml")
    raise RecordingError(
        f"{path}: holds no mission file (topic {MISSION_FILE}), and there is no mission.yaml beside it; expected the "
        f"mission file that was flown: --mission FILE"
    )


def read_bag(
    bag: Path,
    parameters: Mapping[str, Mapping[str, Any]],
    *,
    ground: GroundGrid | None = None,
    wall_s: float = math.nan,
) -> RunData:
    """Reads a rosbag2 directory.

    Args:
        bag: The directory with `metadata.yaml`.
        parameters: The mission file, as `read_parameter_file` gives it.
        ground: True ground on the evaluation grid, None if there is none.
        wall_s: Wall-clock time the mission took (s), NaN if not known.

    Raises:
        RecordingError: naming the bag and what is wrong.
    """
    logs: dict[int, _VehicleLog] = {}
    sent: list[PacketSent] = []
    received: list[PacketReceived] = []
    last_s = 0.0
    for topic, message in read_messages(bag, _NEEDED):
        match = re.fullmatch(r"(/truth)?/auv(\d+)/(.+)", topic)
        if match is None:
            continue
        vehicle, name = int(match[2]), ("truth/" if match[1] else "") + match[3]
        log = logs.setdefault(vehicle, _VehicleLog())
        stamp_s = seconds(message.header.stamp)
        last_s = max(last_s, stamp_s)
        if name in ("modem/tx", "modem/rx") and is_ping(message):
            continue  # team/navigation tells the answer as well
        if name == "modem/tx":
            sent.append(PacketSent(stamp_s=stamp_s, source=int(message.source), payload=bytes(message.payload)))
        elif name == "modem/rx":
            received.append(
                PacketReceived(
                    stamp_s=stamp_s,
                    receiver=vehicle,
                    source=int(message.source),
                    snr_db=float(message.snr_db),
                    payload=bytes(message.payload),
                    sent_s=float(getattr(message, "sent_s", math.nan)),  # older recordings know neither
                    arrival_s=float(getattr(message, "arrival_s", math.nan)),
                    travel_s=float(message.travel_s),
                )
            )
        else:
            log.take(name, stamp_s, message)
    if not logs:
        raise RecordingError(f"{bag}: holds no topic /auvN/...; expected the recording of a mission")
    vehicles = []
    for number in sorted(logs):
        method = str(parameters_for(parameters, f"/auv{number}/planner_node").get("planner", {}).get("method", ""))
        vehicles.append(logs[number].vehicle_run(number, method))
    return RunData(
        parameters=parameters,
        vehicles=vehicles,
        sent=sorted(sent, key=lambda p: (p.stamp_s, p.source)),
        received=sorted(received, key=lambda p: (p.stamp_s, p.receiver)),
        ground=ground,
        sim_s=last_s,
        wall_s=wall_s,
        origin=origin_of(parameters),
    )


class _VehicleLog:
    """Collects one vehicle's messages, topic by topic."""

    def __init__(self) -> None:
        self.truth: list[tuple[float, ...]] = []
        self.odometry: list[tuple[float, ...]] = []
        self.place_std: list[tuple[float, ...]] = []
        self.soundings: list[Sounding] = []
        self.dead_reckoning: list[tuple[float, ...]] = []
        self.fixes: list[Fix] = []
        self.mates: list[MateNavigation] = []
        self.samples: list[Soundings] = []
        self.plans: dict[float, Any] = {}
        self.bounds: dict[float, Any] = {}

    def take(self, name: str, stamp_s: float, message: Any) -> None:
        """Takes a message of the vehicle's topic `name`; other topics are ignored."""
        if name == "sounding":
            raw = raw_place(getattr(message, "raw_north_m", math.nan), getattr(message, "raw_east_m", math.nan))
            self.soundings.append(Sounding(stamp_s, message.north_m, message.east_m, message.depth_m, *raw))
        elif name in ("odometry", "truth/odometry", "dead_reckoning"):
            position, q = message.pose.pose.position, message.pose.pose.orientation
            row = (stamp_s, position.y, position.x, heading_from_quaternion(q.x, q.y, q.z, q.w))
            if name == "dead_reckoning":
                self.dead_reckoning.append((*row, -position.z))
            else:
                (self.odometry if name == "odometry" else self.truth).append(row)
            if name == "odometry":  # x is east, y is north
                east_m2, north_m2 = float(message.pose.covariance[0]), float(message.pose.covariance[7])
                self.place_std.append((stamp_s, math.sqrt(max(north_m2, 0.0)), math.sqrt(max(east_m2, 0.0))))
        elif name == "plan":
            self.plans[stamp_s] = message
        elif name == "planner/bound":
            self.bounds[stamp_s] = message
        elif name == "fix":
            self.fixes.append(Fix(stamp_s=stamp_s, **{key: getattr(message, key) for key in FIX_FIELDS}))
        elif name == "team/navigation":
            values = {key: getattr(message, key) for key in MATE_FIELDS}
            self.mates.append(MateNavigation(stamp_s=stamp_s, source=int(message.source), **values))
        elif name == "team/samples":
            points_m = np.column_stack([message.north_m, message.east_m, message.depth_m])
            self.samples.append(Soundings.of_packet(stamp_s, int(message.source), points_m))

    def vehicle_run(self, number: int, method: str) -> VehicleRun:
        """The collected messages as arrays, in order of time; a plan without its bound gets NaN values."""
        decisions = []
        # A decision publishes both with one stamp. The plan's own step is not the decision's: a plan that is kept
        # stays anchored where it began.
        for now_s in sorted(self.plans):
            plan, bound = self.plans[now_s], self.bounds.get(now_s)
            decisions.append(
                DecisionRecord(
                    now_s=now_s,
                    step=int(bound.step) if bound else int(plan.step),
                    plan=plan_of(plan),
                    jbar=float(bound.jbar) if bound else math.nan,
                    reward_so_far=float(bound.reward_so_far) if bound else math.nan,
                    lower_bound=float(bound.lower_bound) if bound else math.nan,
                    lower_bound_max=float(bound.lower_bound_max) if bound else math.nan,
                    wall_s=float(bound.planning_s) if bound else math.nan,
                    method=method,
                )
            )

        def rows(values: list[tuple[float, ...]], columns: int) -> Any:
            return np.array(sorted(values, key=lambda row: row[0]), dtype=float).reshape(-1, columns)

        return VehicleRun(
            vehicle=number,
            truth=rows(self.truth, 4),
            odometry=rows(self.odometry, 4),
            soundings=Soundings.from_rows(self.soundings).in_order(),
            received=Soundings.join(self.samples).in_order(),
            decisions=decisions,
            # All zero: the driver does not know it (nav_msgs has no other mark).
            place_std_m=rows(self.place_std, 3)[:, 1:] if np.any(rows(self.place_std, 3)[:, 1:]) else np.empty((0, 2)),
            dead_reckoning=rows(self.dead_reckoning, 5),
            fixes=sorted(self.fixes, key=lambda fix: fix.stamp_s),
            mates=sorted(self.mates, key=lambda mate: (mate.stamp_s, mate.source)),
        )


def is_ping(message: Any) -> bool:
    """Whether a recorded ModemTx or ModemRx is a ping or its answer; older recordings tell by an empty payload."""
    return bool(getattr(message, "ping", len(message.payload) == 0))


def plan_of(message: Any) -> Plan:
    """The plan of a recorded Plan message. Older recordings call its naive path "heuristic" and know no tours."""
    return Plan(
        step=int(message.step),
        heading_rad=float(message.heading_rad),
        north_m=float(message.north_m),
        east_m=float(message.east_m),
        actions=tuple(message.actions),
        naive_path=int(message.naive_path if hasattr(message, "naive_path") else message.heuristic),
        tour=Tour.from_fields(getattr(message, "segment_legs", 0), getattr(message, "bearings", ())),
    )


_NEEDED = re.compile(
    r"(/truth)?/auv\d+/"
    r"(sounding|odometry|dead_reckoning|fix|plan|planner/bound|modem/tx|modem/rx|team/samples|team/navigation)"
)


# Writing ------------------------------------------------------------------------------------------------------------


def write_mission_file(path: Path, parameters: Mapping[str, Mapping[str, Any]]) -> None:
    """Writes a mission's parameters as the ROS 2 parameter file they were read from."""
    path.write_text(_mission_text(parameters))


def _mission_text(parameters: Mapping[str, Mapping[str, Any]]) -> str:
    body = {pattern: {"ros__parameters": dict(values)} for pattern, values in parameters.items()}
    text: str = yaml.safe_dump(body, sort_keys=False, allow_unicode=True, width=110)
    return text


def write_run(run: RunData, folder: Path) -> None:
    """Writes `mission.yaml` and `bag/` of a run flown by the fleet engine, readable by `read_run` and ROS.

    Args:
        run: The mission.
        folder: Run folder; made if needed. It must hold no `bag` yet.

    Raises:
        RecordingError: if there is a recording already, or this project's message definitions are not found.
    """
    from auv_lse_record.recorder import BagWriter  # needs rosbags, which reading names if it is missing

    folder.mkdir(parents=True, exist_ok=True)
    if (folder / "bag").exists():
        raise RecordingError(f"{folder / 'bag'}: exists; expected a folder without a recording")
    write_mission_file(folder / "mission.yaml", run.parameters)
    store = _types()
    topics = recorded_topics(max((v.vehicle for v in run.vehicles), default=0))
    latched = {MISSION_FILE, SOFTWARE, *(name for name, topic in topics.items() if topic.latched)}
    writer = BagWriter(folder / "bag", store, {})
    known: set[str] = set()
    for stamp_s, topic, kind, message in sorted(_records(run, store.types), key=lambda record: record[0]):
        if topic not in known:
            known.add(topic)
            writer.add_topic(topic, kind, topic in latched)
        writer.write(topic, round(stamp_s * 1e9), bytes(store.serialize_cdr(message, kind)))
    writer.close()


def _types() -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    for name in OWN_MESSAGES:
        store.register(get_types_from_msg(_definition(name).read_text(), f"auv_lse_msgs/msg/{name}"))
    return store


def _definition(name: str) -> Path:
    """The `.msg` file of a message."""
    return message_folder() / f"{name}.msg"


def _records(run: RunData, types: Mapping[str, Callable[..., Any]]) -> Iterator[tuple[float, str, str, Any]]:
    """Every message of a run: (stamp s, topic, message type, message)."""

    def header(stamp_s: float) -> Any:
        total = round(stamp_s * 1e9)
        stamp = types["builtin_interfaces/msg/Time"](sec=total // 10**9, nanosec=total % 10**9)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="map")

    def odometry(row: Any, child: str, place_std_m: Any = (0.0, 0.0), depth_m: float = 0.0) -> Any:
        x, y, z, w = quaternion_from_heading(float(row[3]))
        point, quaternion = types["geometry_msgs/msg/Point"], types["geometry_msgs/msg/Quaternion"]
        vector = types["geometry_msgs/msg/Vector3"]
        pose = types["geometry_msgs/msg/Pose"](
            position=point(x=float(row[2]), y=float(row[1]), z=-depth_m), orientation=quaternion(x=x, y=y, z=z, w=w)
        )
        zero = vector(x=0.0, y=0.0, z=0.0)
        covariance = np.zeros(36)
        covariance[[0, 7]] = place_std_m[1] ** 2, place_std_m[0] ** 2
        return types["nav_msgs/msg/Odometry"](
            header=header(row[0]),
            child_frame_id=child,
            pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=covariance),
            twist=types["geometry_msgs/msg/TwistWithCovariance"](
                twist=types["geometry_msgs/msg/Twist"](linear=zero, angular=zero), covariance=np.zeros(36)
            ),
        )

    for topic, text in ((MISSION_FILE, _mission_text(run.parameters)), (SOFTWARE, version())):
        yield 0.0, topic, TEXT, types[TEXT](data=text)
    own = "auv_lse_msgs/msg/"
    for vehicle in run.vehicles:
        ns = f"/auv{vehicle.vehicle}"
        child = f"auv{vehicle.vehicle}/base_link"
        stds = vehicle.place_std_m if len(vehicle.place_std_m) else np.zeros((len(vehicle.odometry), 2))
        for row, std in zip(vehicle.odometry, stds, strict=True):
            yield float(row[0]), ns + "/odometry", "nav_msgs/msg/Odometry", odometry(row, child, std)
        for row in vehicle.truth:
            yield float(row[0]), f"/truth{ns}/odometry", "nav_msgs/msg/Odometry", odometry(row, child)
        for row in vehicle.dead_reckoning:
            message = odometry(row, child, depth_m=float(row[4]))
            yield float(row[0]), ns + "/dead_reckoning", "nav_msgs/msg/Odometry", message
        for s in vehicle.soundings:
            message = types[own + "Sounding"](
                header=header(s.stamp_s),
                north_m=s.north_m,
                east_m=s.east_m,
                depth_m=s.depth_m,
                raw_north_m=s.raw_north_m,
                raw_east_m=s.raw_east_m,
            )
            yield s.stamp_s, ns + "/sounding", own + "Sounding", message
        for fix in vehicle.fixes:
            values = {key: getattr(fix, key) for key in FIX_FIELDS}
            yield fix.stamp_s, ns + "/fix", own + "Fix", types[own + "Fix"](header=header(fix.stamp_s), **values)
        for mate in vehicle.mates:
            values = {key: getattr(mate, key) for key in MATE_FIELDS}
            message = types[own + "MateNavigation"](
                header=header(mate.stamp_s), source=mate.source, has_fix=mate.has_fix, **values
            )
            yield mate.stamp_s, ns + "/team/navigation", own + "MateNavigation", message
        for samples in vehicle.received.packets():
            stamp_s = float(samples.stamp_s[0])
            message = types[own + "SampleArray"](
                header=header(stamp_s),
                source=int(samples.vehicle[0]),
                **{key: getattr(samples, key).astype(np.float32) for key in ("north_m", "east_m", "depth_m")},
            )
            yield stamp_s, ns + "/team/samples", own + "SampleArray", message
        for d in vehicle.decisions:
            segment_legs, bearings = d.plan.tour_fields
            plan = types[own + "Plan"](
                header=header(d.now_s),
                vehicle=vehicle.vehicle,
                step=d.plan.step,
                heading_rad=d.plan.heading_rad,
                north_m=d.plan.north_m,
                east_m=d.plan.east_m,
                actions=np.array(d.plan.actions, dtype=np.uint8),
                segment_legs=segment_legs,
                bearings=np.array(bearings, dtype=np.uint8),
                naive_path=d.plan.naive_path,
            )
            yield d.now_s, ns + "/plan", own + "Plan", plan
            bound = types[own + "Bound"](
                header=header(d.now_s),
                step=d.step,
                jbar=d.jbar,
                reward_so_far=d.reward_so_far,
                lower_bound=d.lower_bound,
                lower_bound_max=d.lower_bound_max,
                incumbent_value=math.nan,
                incumbent_kept=False,
                iterations=0,
                planning_s=d.wall_s,
                deadline_hit=False,
                map_revision=0,  # not told: ticks settle what was at hand
                plans_heard=0,
                odometry_taken=header(0.0).stamp,
            )
            yield d.now_s, ns + "/planner/bound", own + "Bound", bound
    for sent in run.sent:
        payload = np.frombuffer(sent.payload, dtype=np.uint8)
        message = types[own + "ModemTx"](
            header=header(sent.stamp_s), source=sent.source, destination=0, ping=False, payload=payload
        )
        yield sent.stamp_s, f"/auv{sent.source}/modem/tx", own + "ModemTx", message
    for heard in run.received:
        message = types[own + "ModemRx"](
            header=header(heard.stamp_s),
            source=heard.source,
            destination=0,
            snr_db=heard.snr_db,
            sent_s=heard.sent_s,
            arrival_s=heard.arrival_s,
            travel_s=heard.travel_s,
            ping=False,
            payload=np.frombuffer(heard.payload, dtype=np.uint8),
        )
        yield heard.stamp_s, f"/auv{heard.receiver}/modem/rx", own + "ModemRx", message
