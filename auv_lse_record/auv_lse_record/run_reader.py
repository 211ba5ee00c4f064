"""Reads a mission's recording as `RunData`, without ROS."""

import contextlib
import dataclasses
import math
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.degrees import AreaReader
from auv_lse_common.mission_file.parameter_file import parameters_for, parse_parameters, read_parameter_file
from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.mission_file.retired import notes_on_retired, without_retired
from auv_lse_common.support.arrays import Array
from auv_lse_common.topics.records import BoundReport, HealthReport, PlanReport, RunReport
from auv_lse_common.vocabulary.health import BATTERY_LASTS, LEGS_LEFT, LEGS_PLANNED
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import RunState
from auv_lse_common.vocabulary.sounding import Sounding, Soundings
from auv_lse_record.recording import MISSION_FILE, Recording, RecordingError, recording_in
from auv_lse_record.run_data import DecisionRecord, GroundGrid, PacketReceived, RunData, VehicleRun, origin_of

Patterns = dict[str, dict[str, Any]]

_TOPICS = {
    "truth/odometry",
    "sounding",
    "odometry",
    "dead_reckoning",
    "fix",
    "plan",
    "waypoint",
    "planner/bound",
    "modem/tx",
    "modem/rx",
    "team/samples",
    "team/navigation",
    "diagnostics",
    "mission/state",
}
#: Those of them that only yield notes.
_NOTES = {"diagnostics", "mission/state"}
#: Topics with a message per second or more, kept as rows of numbers: the numbers of a message, and their count.
_ROWS: dict[str, tuple[Callable[[Any], Iterable[float]], int]] = {
    "truth/odometry": (lambda o: (o.stamp_s, o.north_m, o.east_m, o.heading_rad), 4),
    "odometry": (lambda o: (o.stamp_s, o.north_m, o.east_m, o.heading_rad, *o.position_std_m), 6),
    "dead_reckoning": (lambda o: (o.stamp_s, o.north_m, o.east_m, o.heading_rad, o.depth_m), 5),
    "sounding": (lambda sounding: sounding, len(Sounding._fields)),
}
#: Values of a decision in its bound report.
_VALUES = ("jbar", "reward_so_far", "lower_bound", "lower_bound_max")


def read_run(
    path: Path,
    *,
    mission: Path | None = None,
    ground: GroundGrid | None = None,
    wall_s: float = math.nan,
    read_area: AreaReader | None = None,
) -> RunData:
    """Reads the recording of a mission.

    Args:
        path: The run folder, the rosbag2 directory, or its file of messages.
        mission: The mission file, if the recording does not contain it.
        ground: True ground on the evaluation grid; None if unknown.
        wall_s: Wall-clock duration of the mission (s); NaN if unknown.
        read_area: Reads the `area.file` of a mission file that is not the recording's own; None: it is refused.

    Raises:
        RecordingError: naming the recording and the missing or damaged part.
        ParameterError: if the mission file is not a parameter file.
    """
    if mission is not None:
        return read_bag(recording_in(path), read_parameter_file(mission, read_area), ground=ground, wall_s=wall_s)
    with Recording(recording_in(path)) as recording:
        parameters, _ = mission_file_of(recording.path, recording.text(MISSION_FILE), read_area)
        run = _run_in(recording, parameters, ground, wall_s)
        return dataclasses.replace(run, notes=[*run.notes, *_on_another_file(recording, path, read_area)])


def recorded_parameters(path: Path, mission: Path | None = None, read_area: AreaReader | None = None) -> Patterns:
    """The mission file of a recording: `mission` if given, else the recording's own, else `mission.yaml` beside it.

    It may have parameters and values of earlier versions (`retired.py`).

    Args:
        mission: A mission file that replaces the recording's.
        read_area: As for `read_run`.

    Raises:
        RecordingError: if there is no recording, or none of the three.
        ParameterError: if it is not a parameter file.
    """
    if mission is not None:
        return read_parameter_file(mission, read_area)
    with Recording(recording_in(path)) as recording:
        return mission_file_of(recording.path, recording.text(MISSION_FILE), read_area)[0]


def mission_file_of(recording: Path, text: str | None, read_area: AreaReader | None) -> tuple[Patterns, str]:
    """The mission file of a recording and where it is: in the recording, else in its folder or beside that.

    Args:
        recording: The path that `recording_in` returns.
        text: The mission file in the recording; None: it has none.
        read_area: As for `read_run`.

    Raises:
        RecordingError: if there is none.
        ParameterError: if it is not a parameter file.
    """
    if text is not None:
        where = f"{recording} ({MISSION_FILE})"
        return parse_parameters(text, where, is_recorded=True), where
    inside = recording if recording.is_dir() else recording.parent
    for folder in (inside, inside.parent):
        if (path := folder / "mission.yaml").is_file():
            return read_parameter_file(path, read_area, is_recorded=True), str(path)
    raise RecordingError(
        f"{recording} has no mission file (topic {MISSION_FILE}), and there is no mission.yaml beside it. Copy the "
        f"mission's file to {inside / 'mission.yaml'}."
    )


def _on_another_file(recording: Recording, path: Path, read_area: AreaReader | None) -> list[str]:
    """A note if the mission file beside a recording, which is not read, differs from the recorded one."""
    text, beside = recording.text(MISSION_FILE), path / "mission.yaml"
    if text is None or not beside.is_file():
        return []
    with contextlib.suppress(ParameterError):
        own = parse_parameters(text, str(beside), is_recorded=True)
        if read_parameter_file(beside, read_area, is_recorded=True) == own:
            return []
    return [f"{beside} is not the mission file in the recording and is ignored; copy it elsewhere to fly it"]


def read_bag(
    bag: Path,
    parameters: Mapping[str, Mapping[str, Any]],
    *,
    ground: GroundGrid | None = None,
    wall_s: float = math.nan,
) -> RunData:
    """Reads a rosbag2 directory; other arguments as in `read_run`.

    Args:
        parameters: The mission file, from `recorded_parameters`.

    Raises:
        RecordingError: naming the bag and the error.
    """
    with Recording(recording_in(bag)) as recording:
        return _run_in(recording, parameters, ground, wall_s)


def _run_in(
    recording: Recording, parameters: Mapping[str, Mapping[str, Any]], ground: GroundGrid | None, wall_s: float
) -> RunData:
    """The run of an open recording."""
    notes, parameters = notes_on_retired(parameters), without_retired(parameters)
    logs: dict[int, _Log] = {}
    last_s = 0.0
    for topic, vehicle, _, stamp_s, value in recording.values(_TOPICS, optional=_NOTES):
        logs.setdefault(vehicle, _Log()).add(topic.name, value)
        if topic.writer:  # any node may publish health, with any clock
            last_s = max(last_s, stamp_s)
    if not logs:
        raise RecordingError(f"{recording.path} has no topic /auvN/...: it is not the recording of a mission.")
    sent = [packet for log in logs.values() for packet in log.values["modem/tx"] if not packet.ping]
    received = [
        PacketReceived(receiver=number, **dataclasses.asdict(packet))
        for number, log in logs.items()
        for packet in log.values["modem/rx"]
        if not packet.ping
    ]
    return RunData(
        parameters=parameters,
        vehicles=[_vehicle_run(number, logs[number], _method(parameters, number)) for number in sorted(logs)],
        sent=sorted(sent, key=lambda p: (p.stamp_s, p.source)),
        received=sorted(received, key=lambda p: (p.stamp_s, p.receiver)),
        ground=ground,
        end_s=last_s,
        wall_s=wall_s,
        origin=origin_of(parameters),
        notes=notes,
    )


def _method(parameters: Mapping[str, Mapping[str, Any]], vehicle: int) -> str:
    return str(parameters_for(parameters, f"/auv{vehicle}/planner_node").get("planner", {}).get("method", ""))


class _Log:
    """The messages of one vehicle: rows of numbers on the topics of `_ROWS`, values on others."""

    def __init__(self) -> None:
        self.values: defaultdict[str, list[Any]] = defaultdict(list)
        self._numbers: defaultdict[str, array[float]] = defaultdict(lambda: array("d"))

    def add(self, topic: str, value: Any) -> None:
        """Adds the value of a message."""
        if topic in _ROWS:
            self._numbers[topic].extend(_ROWS[topic][0](value))
        else:
            self.values[topic].append(value)

    def rows(self, topic: str) -> Array:
        """The rows of a topic, the stamp first, in order of time (stable)."""
        table = np.array(self._numbers[topic], dtype=float).reshape(-1, _ROWS[topic][1])
        return table[np.argsort(table[:, 0], kind="stable")]


def _vehicle_run(number: int, log: _Log, method: str) -> VehicleRun:
    """One vehicle's values as arrays, in order of time."""
    odometry, values = log.rows("odometry"), log.values
    stds, states = odometry[:, 4:], values["mission/state"]
    return VehicleRun(
        vehicle=number,
        truth=log.rows("truth/odometry"),
        odometry=odometry[:, :4].copy(),
        soundings=Soundings.from_rows(log.rows("sounding")).in_order(),
        received=Soundings.join(values["team/samples"]).in_order(),
        decisions=_decisions(values["plan"], values["planner/bound"], method),
        position_std_m=stds.copy() if stds.any() else np.empty((0, 2)),  # all 0: unknown (nav_msgs has no other mark)
        dead_reckoning=log.rows("dead_reckoning"),
        fixes=sorted(values["fix"], key=lambda fix: fix.stamp_s),
        mates=sorted(values["team/navigation"], key=lambda mate: (mate.stamp_s, mate.source)),
        ended_early=why_ended_early(states),
        unfinished_legs=unfinished_legs(states, [waypoint.leg for waypoint in values["waypoint"]], odometry),
        battery=battery_of(values["diagnostics"]),
    )


def why_ended_early(states: Sequence[RunReport]) -> str:
    """Why a mission, whose states are in order of time, ended or was aborted before its last leg; "" if it was not."""
    end = _end(states)
    return end.status.reason if end is not None and end.status.ended_early else ""


def unfinished_legs(states: Sequence[RunReport], legs: Sequence[Leg], odometry: Array) -> int:
    """How many of the legs that were decided last a mission did not complete.

    Args:
        states: Its states in order of time; without any it is complete.
        legs: The legs decided.
        odometry: Rows that begin with time (s), north, east (m), in order of time.
    """
    end = _end(states)
    if not states or (end is not None and not end.status.ended_early):
        return 0
    track = odometry if end is None else odometry[odometry[:, 0] <= end.stamp_s]
    if not legs or not len(track):
        return 1
    has_begun = max(legs, key=lambda leg: leg.step).progress_m(track[-1, 1], track[-1, 2]) > 0.0
    return 1 if has_begun else 2


def _end(states: Sequence[RunReport]) -> RunReport | None:
    """The state with which a mission ended or was aborted; None if it runs."""
    end: RunReport | None = None
    for report in states:
        if report.status.state not in (RunState.ENDED, RunState.ABORTED):
            end = None
        elif end is None:  # later states, such as a mate's abort, do not end it again
            end = report
    return end


def battery_of(messages: Sequence[list[HealthReport]]) -> dict[str, str]:
    """Last values about the battery while the mission ran; empty without a battery."""
    found: dict[str, str] = {}
    for report in sorted((r for reports in messages for r in reports), key=lambda r: r.stamp_s):
        if report.values.get("state", RunState.RUNNING.name) == RunState.RUNNING.name:
            found |= {k: report.values[k] for k in (LEGS_LEFT, LEGS_PLANNED, BATTERY_LASTS) if k in report.values}
    return found if LEGS_LEFT in found else {}


def _decisions(plans: Sequence[PlanReport], bounds: Sequence[BoundReport], method: str) -> list[DecisionRecord]:
    """Decisions in order of time; a plan without its bound gets NaN values.

    A decision publishes both with one stamp. The step of a kept plan may be less than the decision's.
    """
    bound_at = {bound.stamp_s: bound for bound in bounds}
    decisions: list[DecisionRecord] = []
    for now_s, report in sorted({report.stamp_s: report for report in plans}.items()):
        bound = bound_at.get(now_s)
        values = {name: math.nan if bound is None else getattr(bound, name) for name in _VALUES}
        decisions.append(
            DecisionRecord(
                now_s=now_s,
                step=report.plan.step if bound is None else bound.step,
                plan=report.plan,
                wall_s=math.nan if bound is None else bound.planning_s,
                method=method,
                void=bool(decisions) and bound is not None and math.isnan(bound.incumbent_value),
                **values,
            )
        )
    return decisions
