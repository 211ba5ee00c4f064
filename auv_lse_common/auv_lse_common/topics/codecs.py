"""Encodes values as the fields of messages, and decodes messages.

Encoders return a message's fields as nested dicts, from which `ros_conversions.to_message` makes a ROS message and
`auv_lse_record.message_types.make_message` a recorded one. Decoders accept both. Only this package converts between
north, east, heading and x, y, yaw (ENU, docs/reference/frames.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import MISSING, asdict, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.safety.watch import AutopilotReport
from auv_lse_common.topics.records import (
    Altitude,
    GeodeticPosition,
    HealthReport,
    MissionOrder,
    Odometry,
    Pressure,
    Reception,
    Transmission,
)
from auv_lse_common.vocabulary.dead_reckoning import CorrectedPosition, DeadReckoning, MateNavigation, raw_position
from auv_lse_common.vocabulary.frames import heading_from_quaternion, quaternion_from_heading
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

#: By the text of a field's type: modules of records therefore need `from __future__ import annotations`.
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
    """Fields of a message with those of a dataclass; `stamp_s` becomes the header's stamp."""
    values = {f.name: _TO_MESSAGE[str(f.type)](getattr(record, f.name)) for f in fields(record) if f.name != "stamp_s"}
    return {"header": header_fields(record.stamp_s), **values}


def record_decoder(kind: type) -> Decode:
    """A decoder of messages with the fields of the dataclass `kind`."""
    columns = [(f.name, _FROM_MESSAGE[str(f.type)], f.default) for f in fields(kind) if f.name != "stamp_s"]
    stamped = any(f.name == "stamp_s" for f in fields(kind))

    def decode(message: Any) -> Any:
        values: Fields = {"stamp_s": seconds(message.header.stamp)} if stamped else {}
        for name, convert, default in columns:
            if default is MISSING or hasattr(message, name):
                values[name] = convert(getattr(message, name))
        return kind(**values)

    return decode


# Positions of vehicles ------------------------------------------------------------------------------------------------


#: Variance (m2) of the height of the water's surface above the ellipsoid.
_UNKNOWN_HEIGHT_M2 = 1e8
#: From (heading, north, east) to (x east, y north, yaw = pi/2 - heading), and their rows in a pose's covariance.
_TO_ENU = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
_ENU_ROWS = np.ix_([0, 1, 5], [0, 1, 5])


def odom_frame(vehicle: int) -> str:
    """The frame of a vehicle's dead reckoning (REP 105)."""
    return f"auv{vehicle}/odom"


def base_frame(vehicle: int) -> str:
    """The frame of a vehicle's body (REP 105): x forward, y to port, z up."""
    return f"auv{vehicle}/base_link"


def sonar_frame(vehicle: int) -> str:
    """The frame of a vehicle's altitude: x points down."""
    return f"auv{vehicle}/dvl"


def encode_dead_reckoning(value: DeadReckoning, vehicle: int) -> Fields:
    """Odometry in the vehicle's odom frame."""
    return encode_odometry(value, vehicle, odom_frame(vehicle))


def encode_odometry(value: Any, vehicle: int, frame: str = "map") -> Fields:
    """Odometry of a `DeadReckoning` or `Odometry`, or of an object with the same attributes."""
    x, y, z, w = quaternion_from_heading(float(value.heading_rad))
    pose = {
        "position": {"x": float(value.east_m), "y": float(value.north_m), "z": -float(value.depth_m)},
        "orientation": {"x": x, "y": y, "z": z, "w": w},
    }
    placed: Fields = {"pose": pose}
    if (covariance := getattr(value, "covariance", None)) is not None:
        matrix = np.zeros((6, 6))
        matrix[_ENU_ROWS] = _TO_ENU @ np.asarray(covariance) @ _TO_ENU.T
        placed["covariance"] = matrix.ravel()
    speed, yaw_rate = getattr(value, "speed_mps", 0.0), getattr(value, "yaw_rate_radps", 0.0)
    twist = {"linear": {"x": float(speed)}, "angular": {"z": 0.0 - float(yaw_rate)}}
    return {
        "header": header_fields(value.stamp_s, frame),
        "child_frame_id": base_frame(vehicle),
        "pose": placed,
        "twist": {"twist": twist},
    }


def encode_geodetic(position: GeodeticPosition, vehicle: int) -> Fields:
    """NavSatFix; its altitude is above the water's surface, whose height above the ellipsoid is unknown."""
    (east, north_east), (_, north) = position.covariance
    return {
        "header": header_fields(position.stamp_s, base_frame(vehicle)),
        "status": {"status": 0, "service": 0},  # a position, of no particular satellite system
        "latitude": position.lat_deg,
        "longitude": position.lon_deg,
        "altitude": -position.depth_m,  # robot_localization drops a fix whose altitude is NaN
        "position_covariance": np.array([east, north_east, 0.0, north_east, north, 0.0, 0.0, 0.0, _UNKNOWN_HEIGHT_M2]),
        "position_covariance_type": 1 if east > 0.0 and north > 0.0 else 0,  # approximated, or unknown
    }


def decode_dead_reckoning(message: Any) -> DeadReckoning:
    """The position in an Odometry."""
    position, q = message.pose.pose.position, message.pose.pose.orientation
    return DeadReckoning(
        stamp_s=seconds(message.header.stamp),
        heading_rad=heading_from_quaternion(q.x, q.y, q.z, q.w),
        north_m=position.y,
        east_m=position.x,
        depth_m=-position.z,
    )


def decode_corrected(message: Any) -> CorrectedPosition:
    """The position and its covariance in an Odometry."""
    position = asdict(decode_dead_reckoning(message))
    return CorrectedPosition(**position, covariance=decode_odometry(message).covariance)


def decode_odometry(message: Any) -> Odometry:
    """Position, motion and covariance in an Odometry."""
    position, q, c = message.pose.pose.position, message.pose.pose.orientation, message.pose.covariance
    east, north, heading = float(c[0]), float(c[7]), float(c[35])
    north_east, heading_north, heading_east = float(c[1]), 0.0 - float(c[11]), 0.0 - float(c[5])
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
    """Navigation data of a packet; without `has_fix` the fix is NaN, whatever the fields contain."""
    mate: MateNavigation = _decode_mate(message)
    if message.has_fix or not mate.has_fix:
        return mate
    nan = math.nan
    return replace(mate, fix_raw_north_m=nan, fix_raw_east_m=nan, fix_north_m=nan, fix_east_m=nan)


# Measurements -------------------------------------------------------------------------------------------------


def encode_sounding(sounding: Sounding, vehicle: int) -> Fields:
    """Sounding."""
    names = ("north_m", "east_m", "depth_m", "raw_north_m", "raw_east_m")
    values = {name: float(getattr(sounding, name)) for name in names}
    return {"header": header_fields(sounding.stamp_s), **values}


def decode_sounding(message: Any) -> Sounding:
    """The sounding of a message; older recordings have no dead-reckoned position."""
    raw = raw_position(getattr(message, "raw_north_m", math.nan), getattr(message, "raw_east_m", math.nan))
    return Sounding(seconds(message.header.stamp), message.north_m, message.east_m, message.depth_m, *raw)


def encode_altitude(altitude: Any, vehicle: int) -> Fields:
    """Range; without an echo (NaN) it is +inf (REP 117)."""
    return {
        "header": header_fields(altitude.stamp_s, sonar_frame(vehicle)),
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
    header = header_fields(pressure.stamp_s, base_frame(vehicle))
    return {"header": header, "fluid_pressure": float(pressure.pressure_pa)}


def decode_pressure(message: Any) -> Pressure:
    """Absolute pressure."""
    return Pressure(stamp_s=seconds(message.header.stamp), pressure_pa=float(message.fluid_pressure))


def encode_autopilot(state: Any, vehicle: int) -> Fields:
    """AutopilotStatus of an object with `stamp_s`, `report` (an AutopilotReport) and `battery_v`."""
    report: AutopilotReport = state.report
    values = {f.name: getattr(report, f.name) for f in fields(report) if f.name != "stamp_s"}
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
    columns = columns_of(message, "SampleArray", ("north_m", "east_m", "depth_m"))
    points_m = np.column_stack([column.astype(float) for column in columns])
    return Soundings.of_packet(seconds(message.header.stamp), int(message.source), points_m)


def columns_of(message: Any, kind: str, names: tuple[str, ...]) -> list[NDArray[Any]]:
    """Array fields of a message.

    Raises:
        ValueError: if they differ in length.
    """
    columns = [np.asarray(getattr(message, name)) for name in names]
    if len({len(column) for column in columns}) != 1:
        raise ValueError(f"{kind}: {', '.join(names)} differ in length: {[len(column) for column in columns]}")
    return columns


# Orders, packets and health ----------------------------------------------------------------------------------------


#: A command to a mission, of a topic or a service.
decode_order = record_decoder(MissionOrder)


def packet_decoder(kind: type[Transmission] | type[Reception]) -> Decode:
    """A decoder of ModemTx or ModemRx; in older recordings an empty payload marks a ping."""
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
