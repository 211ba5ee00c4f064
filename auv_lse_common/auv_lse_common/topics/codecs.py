"""Encodes values as the fields of messages, and decodes messages.

*Encode* returns a message's fields as nested dicts, which `ros_conversions.to_message` turns into a ROS message and
`auv_lse_record.message_types.make_message` into a recorded one. *Decode* reads any object with the attributes of the
message's type, so it takes both. Only here north, east, heading become x, y, yaw (ENU, docs/reference/frames.md), and
back.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import MISSING, fields, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.safety.watch import AutopilotReport
from auv_lse_common.topics.records import (
    Altitude,
    CentersReport,
    FieldReport,
    HealthReport,
    MissionOrder,
    Odometry,
    PlanReport,
    Pressure,
    Reception,
    RunReport,
    Transmission,
    Waypoint,
)
from auv_lse_common.vocabulary.dead_reckoning import DeadReckoning, MateNavigation, raw_place
from auv_lse_common.vocabulary.frames import heading_from_quaternion, quaternion_from_heading
from auv_lse_common.vocabulary.leg import Leg
from auv_lse_common.vocabulary.mission_run import Action, RunState, RunStatus, Stop
from auv_lse_common.vocabulary.plan import Plan, Tour
from auv_lse_common.vocabulary.sounding import Sounding, Soundings
from auv_lse_common.vocabulary.stamps import seconds

Fields = dict[str, Any]
Encode = Callable[[Any, int], Fields]
Decode = Callable[[Any], Any]


def time_fields(time_s: float) -> Fields:
    """Fields of a ROS time, to the nearest nanosecond."""
    nanoseconds = round(time_s * 1e9)
    return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}


def header_fields(stamp_s: float, frame: str = "map") -> Fields:
    """Fields of a header in the map frame (ENU)."""
    return {"stamp": time_fields(stamp_s), "frame_id": frame}


# Records whose fields are the message's ----------------------------------------------------------------------------

_FROM_MESSAGE: dict[str, Callable[[Any], Any]] = {
    "float": float,
    "int": int,
    "bool": bool,
    "str": str,
    "bytes": bytes,
    "Time": seconds,
    "tuple[int, ...]": lambda values: tuple(map(int, values)),
    "tuple[str, ...]": lambda values: tuple(map(str, values)),
}
_TO_MESSAGE: dict[str, Callable[[Any], Any]] = {
    **_FROM_MESSAGE,
    "Time": time_fields,
    "tuple[int, ...]": list,
    "tuple[str, ...]": list,
}


def encode_record(record: Any, vehicle: int = 0) -> Fields:
    """Fields of a message that has those of a dataclass; `stamp_s` goes into the header."""
    values = {f.name: _TO_MESSAGE[str(f.type)](getattr(record, f.name)) for f in fields(record) if f.name != "stamp_s"}
    return {"header": header_fields(record.stamp_s), **values}


def record_decoder(kind: type) -> Decode:
    """What decodes messages that have the fields of the dataclass `kind`."""
    columns = [(f.name, _FROM_MESSAGE[str(f.type)], f.default) for f in fields(kind) if f.name != "stamp_s"]
    stamped = any(f.name == "stamp_s" for f in fields(kind))

    def decode(message: Any) -> Any:
        values: Fields = {"stamp_s": seconds(message.header.stamp)} if stamped else {}
        for name, convert, default in columns:
            if default is MISSING or hasattr(message, name):
                values[name] = convert(getattr(message, name))
        return kind(**values)

    return decode


# Where vehicles are ------------------------------------------------------------------------------------------------


def encode_odometry(value: Any, vehicle: int, frame: str = "auv") -> Fields:
    """Odometry of anything with the attributes of `DeadReckoning`, and of `Odometry` as far as it has them."""
    x, y, z, w = quaternion_from_heading(float(value.heading_rad))
    pose = {
        "position": {"x": float(value.east_m), "y": float(value.north_m), "z": -float(value.depth_m)},
        "orientation": {"x": x, "y": y, "z": z, "w": w},
    }
    matrix = np.zeros((6, 6))
    if (covariance := getattr(value, "covariance", None)) is not None:
        to_enu = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # x east, y north, yaw = pi/2 - heading
        enu = np.array([0, 1, 5])
        matrix[np.ix_(enu, enu)] = to_enu @ np.asarray(covariance) @ to_enu.T
    speed, yaw_rate = getattr(value, "speed_mps", 0.0), getattr(value, "yaw_rate_radps", 0.0)
    twist = {"linear": {"x": float(speed)}, "angular": {"z": 0.0 - float(yaw_rate)}}
    return {
        "header": header_fields(value.stamp_s),
        "child_frame_id": f"{frame}{vehicle}",
        "pose": {"pose": pose, "covariance": matrix.ravel()},
        "twist": {"twist": twist},
    }


def encode_truth(value: Any, vehicle: int) -> Fields:
    """Odometry of where a simulated vehicle really is."""
    return encode_odometry(value, vehicle, "truth/auv")


def decode_dead_reckoning(message: Any) -> DeadReckoning:
    """The place in an Odometry."""
    position, q = message.pose.pose.position, message.pose.pose.orientation
    return DeadReckoning(
        stamp_s=seconds(message.header.stamp),
        heading_rad=heading_from_quaternion(q.x, q.y, q.z, q.w),
        north_m=position.y,
        east_m=position.x,
        depth_m=-position.z,
    )


def decode_odometry(message: Any) -> Odometry:
    """Place, motion and covariance in an Odometry."""
    position, q, c = message.pose.pose.position, message.pose.pose.orientation, message.pose.covariance
    east, north, heading = float(c[0]), float(c[7]), float(c[35])
    north_east, heading_north, heading_east = float(c[1]), -float(c[11]), -float(c[5])
    return Odometry(
        stamp_s=seconds(message.header.stamp),
        heading_rad=heading_from_quaternion(q.x, q.y, q.z, q.w),
        north_m=position.y,
        east_m=position.x,
        depth_m=-position.z,
        speed_mps=message.twist.twist.linear.x,
        yaw_rate_radps=-message.twist.twist.angular.z,
        covariance=(
            (heading, heading_north, heading_east),
            (heading_north, north, north_east),
            (heading_east, north_east, east),
        ),
    )


def encode_mate_navigation(mate: MateNavigation, vehicle: int) -> Fields:
    """MateNavigation."""
    return {**encode_record(mate), "has_fix": mate.has_fix}


_decode_mate = record_decoder(MateNavigation)


def decode_mate_navigation(message: Any) -> MateNavigation:
    """Navigation that a packet reported; without `has_fix` the fix is NaN whatever the fields hold."""
    mate: MateNavigation = _decode_mate(message)
    if message.has_fix or not mate.has_fix:
        return mate
    nan = math.nan
    return replace(mate, fix_raw_north_m=nan, fix_raw_east_m=nan, fix_north_m=nan, fix_east_m=nan)


# What they measure -------------------------------------------------------------------------------------------------


def encode_sounding(sounding: Sounding, vehicle: int) -> Fields:
    """Sounding."""
    names = ("north_m", "east_m", "depth_m", "raw_north_m", "raw_east_m")
    values = {name: float(getattr(sounding, name)) for name in names}
    return {"header": header_fields(sounding.stamp_s), **values}


def decode_sounding(message: Any) -> Sounding:
    """The sounding of a message; older recordings hold no raw place."""
    raw = raw_place(getattr(message, "raw_north_m", math.nan), getattr(message, "raw_east_m", math.nan))
    return Sounding(seconds(message.header.stamp), message.north_m, message.east_m, message.depth_m, *raw)


def encode_altitude(altitude: Any, vehicle: int) -> Fields:
    """Range; no ground in reach (NaN) is +inf (REP 117)."""
    return {
        "header": header_fields(altitude.stamp_s, f"auv{vehicle}/dvl"),
        "radiation_type": 0,  # ultrasound
        "field_of_view": 0.07,
        "min_range": float(altitude.min_m),
        "max_range": float(altitude.max_m),
        "range": math.inf if math.isnan(altitude.altitude_m) else float(altitude.altitude_m),
    }


def decode_altitude(message: Any) -> Altitude:
    """Height over ground."""
    return Altitude(
        stamp_s=seconds(message.header.stamp),
        altitude_m=float(message.range),
        min_m=float(message.min_range),
        max_m=float(message.max_range),
    )


def encode_pressure(pressure: Any, vehicle: int) -> Fields:
    """FluidPressure."""
    header = header_fields(pressure.stamp_s, f"auv{vehicle}/pressure")
    return {"header": header, "fluid_pressure": float(pressure.pressure_pa)}


def decode_pressure(message: Any) -> Pressure:
    """Absolute pressure."""
    return Pressure(stamp_s=seconds(message.header.stamp), pressure_pa=float(message.fluid_pressure))


def encode_autopilot(state: Any, vehicle: int) -> Fields:
    """AutopilotStatus of anything with `stamp_s`, `report` (an AutopilotReport) and `battery_v`."""
    report: AutopilotReport = state.report
    values = {f.name: getattr(report, f.name) for f in fields(report)}
    return {"header": header_fields(state.stamp_s), **values, "battery_v": float(state.battery_v)}


def encode_samples(samples: Soundings, vehicle: int) -> Fields:
    """SampleArray of the samples of one packet."""
    return {
        "header": header_fields(float(samples.stamp_s[0])),
        "source": int(samples.vehicle[0]),
        **{name: getattr(samples, name).astype(np.float32) for name in ("north_m", "east_m", "depth_m")},
    }


def decode_samples(message: Any) -> Soundings:
    """The samples of a packet, stamped with its arrival.

    Raises:
        ValueError: if the message's fields differ in length.
    """
    columns = _columns(message, "SampleArray", ("north_m", "east_m", "depth_m"))
    points_m = np.column_stack([column.astype(float) for column in columns])
    return Soundings.of_packet(seconds(message.header.stamp), int(message.source), points_m)


def _columns(message: Any, kind: str, names: tuple[str, ...]) -> list[NDArray[Any]]:
    columns = [np.asarray(getattr(message, name)) for name in names]
    if len({len(column) for column in columns}) != 1:
        raise ValueError(
            f"{kind}: {', '.join(names)} have {[len(column) for column in columns]} values; expected the same number "
            "of each"
        )
    return columns


# Maps --------------------------------------------------------------------------------------------------------------


def encode_centers(report: CentersReport, vehicle: int) -> Fields:
    """KernelCenters."""
    effect = report.place_effect_m
    return {
        "header": header_fields(report.stamp_s),
        "revision": report.revision,
        "north_m": report.places_m[:, 0],
        "east_m": report.places_m[:, 1],
        "depth_m": report.depths_m,
        "noise_std_m": report.noise_std_m,
        "place_modes": 0 if effect is None else effect.shape[1],
        "place_effect_m": np.zeros(0) if effect is None else effect.ravel(),
    }


def decode_centers(message: Any) -> CentersReport:
    """Kernel centers; older recordings hold no effects of place errors.

    Raises:
        ValueError: if the message's fields differ in length.
    """
    north, east, depth, noise = _columns(message, "KernelCenters", ("north_m", "east_m", "depth_m", "noise_std_m"))
    modes = int(getattr(message, "place_modes", 0))
    effect = np.asarray(getattr(message, "place_effect_m", ()), dtype=float)
    if len(effect) != modes * len(north):
        raise ValueError(
            f"KernelCenters: place_effect_m has {len(effect)} values; expected place_modes = {modes} for each of "
            f"{len(north)} centers"
        )
    return CentersReport(
        stamp_s=seconds(message.header.stamp),
        revision=int(message.revision),
        places_m=np.column_stack([north, east]),
        depths_m=depth,
        noise_std_m=noise,
        place_effect_m=effect.reshape(-1, modes) if modes else None,
    )


def _resolution(north_m: NDArray[Any], east_m: NDArray[Any]) -> float:
    axis = north_m if len(north_m) > 1 else east_m
    return float(axis[1] - axis[0])


def encode_field(report: FieldReport, vehicle: int) -> Fields:
    """LevelSetField."""
    return {
        "header": header_fields(report.stamp_s),
        "south_m": float(report.north_m[0]),
        "west_m": float(report.east_m[0]),
        "resolution_m": _resolution(report.north_m, report.east_m),
        "rows": len(report.north_m),
        "columns": len(report.east_m),
        "level_m": report.level_m,
        "variance_scale": report.variance_scale,
        **{name: getattr(report, name).ravel() for name in ("mean_m", "std_m", "risk", "p_safe")},
    }


def decode_field(message: Any) -> FieldReport:
    """A map; older recordings hold no `variance_scale`, which counts as 1."""
    shape = (int(message.rows), int(message.columns))
    names = ("mean_m", "std_m", "risk", "p_safe")
    layers = {name: np.asarray(getattr(message, name), dtype=np.float32).reshape(shape) for name in names}
    return FieldReport(
        stamp_s=seconds(message.header.stamp),
        north_m=message.south_m + message.resolution_m * np.arange(shape[0]),
        east_m=message.west_m + message.resolution_m * np.arange(shape[1]),
        level_m=message.level_m,
        variance_scale=getattr(message, "variance_scale", 0.0) or 1.0,
        **layers,
    )


def encode_risk_map(value: tuple[FieldReport, float], vehicle: int) -> Fields:
    """OccupancyGrid of a map's risk and the largest risk possible: 0 no risk, 100 the largest, -1 outside."""
    field, largest_risk = value
    resolution = _resolution(field.north_m, field.east_m)
    percent = np.clip(np.round(100.0 * np.nan_to_num(field.risk) / largest_risk), 0, 100)
    corner = {"x": float(field.east_m[0]) - resolution / 2.0, "y": float(field.north_m[0]) - resolution / 2.0}
    return {
        "header": header_fields(field.stamp_s),
        "info": {
            "map_load_time": time_fields(field.stamp_s),
            "resolution": resolution,
            "width": len(field.east_m),
            "height": len(field.north_m),
            "origin": {"position": corner, "orientation": {"w": 1.0}},
        },
        "data": np.where(np.isnan(field.risk), -1, percent).astype(np.int8).ravel(),
    }


#: Lines of an isobath's markers: attribute of the isobath, color (red, green, blue).
MARKERS = (("lines", (0.0, 0.0, 0.0)), ("shallow_edge", (0.9, 0.6, 0.0)), ("deep_edge", (0.0, 0.45, 0.7)))


def encode_isobath(value: tuple[float, int, Any, float], vehicle: int) -> Fields:
    """Marker (LINE_LIST at z = -level) of stamp (s), index in `MARKERS`, an isobath with those lines, level (m)."""
    stamp_s, index, isobath, level_m = value
    name, (red, green, blue) = MARKERS[index]
    points: list[Fields] = []
    for line in getattr(isobath, name):
        places = [{"x": east, "y": north, "z": -level_m} for north, east in line.tolist()]
        points += [end for segment in pairwise(places) for end in segment]
    return {
        "header": header_fields(stamp_s),
        "ns": name,
        "id": index,
        "type": 5,  # LINE_LIST
        "pose": {"orientation": {"w": 1.0}},
        "scale": {"x": 1.0},
        "color": {"r": red, "g": green, "b": blue, "a": 1.0},
        "points": points,
    }


# Plans -------------------------------------------------------------------------------------------------------------


def encode_plan(report: PlanReport, vehicle: int) -> Fields:
    """Plan."""
    plan = report.plan
    segment_legs, bearings = plan.tour_fields
    return {
        "header": header_fields(report.stamp_s),
        "vehicle": report.vehicle,
        "step": plan.step,
        "heading_rad": plan.heading_rad,
        "north_m": plan.north_m,
        "east_m": plan.east_m,
        "actions": list(plan.actions),
        "segment_legs": segment_legs,
        "bearings": list(bearings),
        "naive_path": plan.naive_path,
    }


def decode_plan(message: Any) -> PlanReport:
    """A plan; older recordings call its naive path "heuristic" and hold no tour."""
    bearings = tuple(map(int, getattr(message, "bearings", ())))
    plan = Plan(
        step=int(message.step),
        heading_rad=float(message.heading_rad),
        north_m=float(message.north_m),
        east_m=float(message.east_m),
        actions=tuple(map(int, message.actions)),
        tour=Tour.from_fields(int(getattr(message, "segment_legs", 0)), bearings),
        naive_path=int(message.naive_path if hasattr(message, "naive_path") else message.heuristic),
    )
    return PlanReport(stamp_s=seconds(message.header.stamp), vehicle=int(message.vehicle), plan=plan)


def encode_path(value: tuple[float, NDArray[np.float64], float], vehicle: int) -> Fields:
    """Path through states (heading, north, east), shape (n, 3), at a depth (m): (stamp s, states, depth)."""
    stamp_s, states, depth_m = value
    header, poses = header_fields(stamp_s), []
    for heading, north, east in states:
        x, y, z, w = quaternion_from_heading(float(heading))
        position = {"x": float(east), "y": float(north), "z": -depth_m}
        pose = {"position": position, "orientation": {"x": x, "y": y, "z": z, "w": w}}
        poses.append({"header": header, "pose": pose})
    return {"header": header, "poses": poses}


def stop_of(action: int, north_m: float, east_m: float) -> Stop | None:
    """The stop of a message's action (one of MissionState's) and place; None: the vehicle travels.

    Raises:
        ValueError: if there is no such action, or no place to go to.
    """
    known = Action(action)
    return None if known is Action.TRAVEL else Stop(action=known, place_m=(north_m, east_m))


def stop_fields(stop: Stop | None) -> tuple[int, float, float]:
    """Action, north and east (m) of a stop in a message; None: the vehicle travels."""
    return (int(Action.TRAVEL), math.nan, math.nan) if stop is None else (int(stop.action), *stop.place_m)


def encode_waypoint(waypoint: Waypoint, vehicle: int) -> Fields:
    """Waypoint."""
    leg, then = waypoint.leg, waypoint.then
    action, then_north_m, then_east_m = stop_fields(then)
    end_heading_rad, end_north_m, end_east_m = map(float, waypoint.end)
    return {
        "header": header_fields(waypoint.stamp_s),
        "step": leg.step,
        "start_heading_rad": leg.heading_rad,
        "start_north_m": leg.north_m,
        "start_east_m": leg.east_m,
        "turn_rad": leg.action_rad,
        "turn_radius_m": leg.radius_m,
        "straight_m": leg.straight_m,
        "end_heading_rad": end_heading_rad,
        "end_north_m": end_north_m,
        "end_east_m": end_east_m,
        "speed_mps": waypoint.speed_mps,
        "depth_m": waypoint.depth_m,
        "last": then is not None,
        "then": action,
        "then_north_m": then_north_m,
        "then_east_m": then_east_m,
        "surface": leg.surface,
    }


def decode_waypoint(message: Any) -> Waypoint:
    """The next leg; older recordings know no `surface`.

    Raises:
        ValueError: if what is to follow it is none of MissionState's actions.
    """
    leg = Leg(
        step=int(message.step),
        heading_rad=float(message.start_heading_rad),
        north_m=float(message.start_north_m),
        east_m=float(message.start_east_m),
        action_rad=float(message.turn_rad),
        radius_m=float(message.turn_radius_m),
        straight_m=float(message.straight_m),
        surface=bool(getattr(message, "surface", False)),
    )
    then = stop_of(message.then, message.then_north_m, message.then_east_m) if hasattr(message, "then") else None
    return Waypoint(
        stamp_s=seconds(message.header.stamp),
        leg=leg,
        speed_mps=message.speed_mps,
        depth_m=message.depth_m,
        end=(message.end_heading_rad, message.end_north_m, message.end_east_m),
        then=then,
    )


# The mission, packets and health -----------------------------------------------------------------------------------


def encode_run(report: RunReport, vehicle: int) -> Fields:
    """MissionState."""
    status = report.status
    action, north_m, east_m = stop_fields(status.stop)
    return {
        "header": header_fields(report.stamp_s),
        "revision": report.revision,
        "state": int(status.state),
        "action": action,
        "go_to_north_m": north_m,
        "go_to_east_m": east_m,
        "team_abort": status.team_abort,
        "reason": status.reason,
        "limits": list(status.limits),
        "warnings": list(report.warnings),
    }


def decode_run(message: Any) -> RunReport:
    """The state of a vehicle's mission.

    Raises:
        ValueError: if a number in it has no meaning.
    """
    status = RunStatus(
        state=RunState(int(message.state)),
        stop=stop_of(int(message.action), message.go_to_north_m, message.go_to_east_m),
        team_abort=bool(message.team_abort),
        reason=str(message.reason),
        limits=tuple(map(str, message.limits)),
    )
    return RunReport(
        stamp_s=seconds(message.header.stamp),
        revision=int(message.revision),
        status=status,
        warnings=tuple(map(str, message.warnings)),
    )


#: A command to a mission, of a topic or a service.
decode_order = record_decoder(MissionOrder)


def packet_decoder(kind: type[Transmission] | type[Reception]) -> Decode:
    """What decodes ModemTx or ModemRx; in older recordings an empty payload marks a ping."""
    decode = record_decoder(kind)

    def decode_packet(message: Any) -> Any:
        packet = decode(message)
        return packet if hasattr(message, "ping") else replace(packet, ping=not packet.payload)

    return decode_packet


def encode_health(report: HealthReport, vehicle: int) -> Fields:
    """DiagnosticArray with one status."""
    status = {
        "level": report.level,
        "name": report.name,
        "message": report.text,
        "hardware_id": "auv_lse",
        "values": [{"key": key, "value": str(value)} for key, value in report.values.items()],
    }
    return {"header": header_fields(report.stamp_s), "status": [status]}


def decode_health(message: Any) -> list[HealthReport]:
    """Every status of a DiagnosticArray."""
    return [
        HealthReport(
            stamp_s=seconds(message.header.stamp),
            name=str(status.name),
            level=status.level[0] if isinstance(status.level, bytes) else int(status.level),
            text=str(status.message),
            values={str(pair.key): str(pair.value) for pair in status.values},
        )
        for status in message.status
    ]
