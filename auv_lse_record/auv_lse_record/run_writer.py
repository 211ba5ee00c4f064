"""Writes a mission of the fleet engine as a recording for `read_run` and `ros2 bag play`, without ROS."""

import dataclasses
import heapq
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.parameter_file import parameter_text
from auv_lse_common.support.arrays import Array
from auv_lse_common.topics.codecs import Fields
from auv_lse_common.topics.columns import odometry_columns, sounding_columns, stamps_ns
from auv_lse_common.topics.records import BoundReport, Odometry, PlanReport, Reception
from auv_lse_common.topics.table import TRUTH_TOPIC, VEHICLE_TOPICS, Topic, full_name
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning
from auv_lse_common.vocabulary.sounding import Sounding
from auv_lse_record.bag_writer import BagWriter
from auv_lse_record.message_rows import MessageRows
from auv_lse_record.message_types import make_message, message_folder, project_types
from auv_lse_record.recording import MISSION_FILE, SOFTWARE, TEXT, RecordingError
from auv_lse_record.run_data import RunData, VehicleRun
from auv_lse_record.software import version

#: Messages of tracks and soundings that are made at once.
_AT_ONCE = 1000
#: Times (s) from here on are UTC since 1970; smaller ones count from the start of a simulation.
FIRST_UTC_S = 1e9
#: A message to write: time (ns), topic, bytes (CDR).
Message = tuple[int, str, bytes]
#: A message to serialize: time (s), topic, type, fields, latched.
Record = tuple[float, str, str, Fields, bool]


def write_mission_file(path: Path, parameters: Mapping[str, Mapping[str, Any]]) -> None:
    """Writes a mission's parameters as a ROS 2 parameter file."""
    path.write_text(parameter_text(parameters))


def write_run(run: RunData, folder: Path) -> None:
    """Writes `mission.yaml` and `bag/` of a run.

    Args:
        folder: Run folder without `bag`; created if needed.

    Raises:
        RecordingError: if there is a recording, or this project's message definitions are missing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / "bag").exists():
        raise RecordingError(f"{folder / 'bag'} exists. Choose a folder without a recording.")
    if message_folder() is None:
        raise RecordingError(
            "The .msg files of auv_lse_msgs are missing. Source the ROS workspace, or run from a checkout."
        )
    write_mission_file(folder / "mission.yaml", run.parameters)
    store = project_types()
    writer = BagWriter(folder / "bag", store, {}, flush_s=math.inf)
    tracks = [track for vehicle in run.vehicles for track in _tracks(store, vehicle, writer)]
    for stamp_ns, name, data in heapq.merge(_others(run, store, writer), *tracks, key=lambda message: message[0]):
        writer.write(name, stamp_ns, data)
    writer.close()


def _rows(name: str, stamps_s: Array, messages: MessageRows) -> Iterator[Message]:
    """The messages of a track."""
    for start in range(0, len(stamps_s), _AT_ONCE):
        stamps = stamps_ns(stamps_s[start : start + _AT_ONCE]).tolist()
        for stamp_ns, row in zip(stamps, messages.between(start, start + len(stamps)), strict=True):
            yield stamp_ns, name, row.tobytes()


def _others(run: RunData, store: Any, writer: BagWriter) -> Iterator[Message]:
    """All other messages of a run, whose topics it adds."""
    topics: set[str] = set()
    for stamp_s, name, kind, fields, latched in sorted(_records(run), key=lambda record: record[0]):
        if name not in topics:
            topics.add(name)
            writer.add_topic(name, kind, latched)
        yield round(stamp_s * 1e9), name, bytes(store.serialize_cdr(make_message(store, kind, fields), kind))


def _tracks(store: Any, run: VehicleRun, writer: BagWriter) -> Iterator[Iterator[Message]]:
    """The messages of a vehicle's tracks and soundings, in order of their stamps; adds their topics."""
    still = DeadReckoning(stamp_s=0.0, heading_rad=0.0, north_m=0.0, east_m=0.0, depth_m=0.0)
    placed = Odometry(stamp_s=0.0, heading_rad=0.0, north_m=0.0, east_m=0.0)
    odometry, stds = _in_order(run.odometry), np.zeros((len(run.odometry), 2))
    if len(run.position_std_m):
        stds = run.position_std_m[np.argsort(run.odometry[:, 0], kind="stable")]
    truth, raw, soundings = _in_order(run.truth), _in_order(run.dead_reckoning), run.soundings.in_order()
    for topic, value, stamps_s, columns in (
        (VEHICLE_TOPICS["odometry"], placed, odometry[:, 0], odometry_columns(odometry, stds)),
        (TRUTH_TOPIC, placed, truth[:, 0], odometry_columns(truth)),
        (VEHICLE_TOPICS["dead_reckoning"], still, raw[:, 0], odometry_columns(raw)),
        (VEHICLE_TOPICS["sounding"], Sounding(0.0, 0.0, 0.0, 0.0), soundings.stamp_s, sounding_columns(soundings)),
    ):
        if len(stamps_s):
            assert topic.encode is not None, f"{topic.name}: the table of topics does not encode it"
            messages = MessageRows(store, topic.kind, topic.encode(value, run.vehicle), columns)
            name = full_name(topic, run.vehicle)
            writer.add_topic(name, topic.kind)
            yield _rows(name, stamps_s, messages)


def _in_order(rows: Array) -> Array:
    return rows[np.argsort(rows[:, 0], kind="stable")]


def _records(run: RunData) -> Iterator[Record]:
    """Every message of a run, except those of tracks and soundings."""
    start_s = _start_s(run)
    for name, text in ((MISSION_FILE, parameter_text(run.parameters)), (SOFTWARE, version())):
        yield start_s, name, TEXT, {"data": text}, True
    for vehicle in run.vehicles:
        for topic, stamp_s, value in _values(vehicle):
            yield _record(topic, stamp_s, value, vehicle.vehicle)
    for sent in run.sent:
        yield _record(VEHICLE_TOPICS["modem/tx"], sent.stamp_s, sent, sent.source)
    for heard in run.received:
        reception = Reception(**{field.name: getattr(heard, field.name) for field in dataclasses.fields(Reception)})
        yield _record(VEHICLE_TOPICS["modem/rx"], heard.stamp_s, reception, heard.receiver)


def _start_s(run: RunData) -> float:
    """When the recording starts: at 0, or with the first track or sounding of a survey in UTC."""
    columns = [c for v in run.vehicles for c in (v.odometry[:, 0], v.soundings.stamp_s) if len(c)]
    first_s = min((float(column.min()) for column in columns), default=0.0)
    return first_s if first_s > FIRST_UTC_S else 0.0


def _record(topic: Topic, stamp_s: float, value: Any, vehicle: int) -> Record:
    assert topic.encode is not None, f"{topic.name}: the table of topics does not encode it"
    return stamp_s, full_name(topic, vehicle), topic.kind, topic.encode(value, vehicle), topic.latched


def _values(run: VehicleRun) -> Iterator[tuple[Topic, float, Any]]:
    """The contents of one vehicle's other messages: topic, stamp (s), value."""
    topics = VEHICLE_TOPICS
    for fix in run.fixes:
        yield topics["fix"], fix.stamp_s, fix
    for mate in run.mates:
        yield topics["team/navigation"], mate.stamp_s, mate
    for packet in run.received.packets():
        yield topics["team/samples"], float(packet.stamp_s[0]), packet
    for d in run.decisions:
        yield topics["plan"], d.now_s, PlanReport(stamp_s=d.now_s, vehicle=run.vehicle, plan=d.plan)
        bound = BoundReport(
            stamp_s=d.now_s,
            step=d.step,
            jbar=d.jbar,
            reward_so_far=d.reward_so_far,
            lower_bound=d.lower_bound,
            lower_bound_max=d.lower_bound_max,
            planning_s=d.wall_s,
        )  # without the used inputs, which ticks determine
        yield topics["planner/bound"], d.now_s, bound
