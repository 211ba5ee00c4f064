"""What a simulated autopilot sends about its vehicle."""

import math
from collections.abc import Iterator

from auv_lse_mavlink.messages.conversion import DOWN
from auv_lse_mavlink.messages.datum import Datum
from auv_lse_mavlink.messages.wire import Message, mavlink
from auv_lse_sim.emulated.autopilot_report import Report

#: Messages with a pressure.
PRESSURES = {
    "SCALED_PRESSURE": mavlink.MAVLink_scaled_pressure_message,
    "SCALED_PRESSURE2": mavlink.MAVLink_scaled_pressure2_message,
    "SCALED_PRESSURE3": mavlink.MAVLink_scaled_pressure3_message,
}
#: Range of the altimeter (cm).
ALTIMETER_CM = (50, 10000)


def heartbeat(armed: bool = True) -> Message:
    """HEARTBEAT of a submarine in guided flight."""
    flags = (
        mavlink.MAV_MODE_FLAG_SAFETY_ARMED * armed
        | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        | mavlink.MAV_MODE_FLAG_AUTO_ENABLED
        | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    )
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_SUBMARINE, mavlink.MAV_AUTOPILOT_GENERIC, flags, 4, mavlink.MAV_STATE_ACTIVE, 3
    )


def version(system: int) -> Message:
    """AUTOPILOT_VERSION of a system."""
    able = (
        mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    )
    none = bytes(8)
    return mavlink.MAVLink_autopilot_version_message(able, 1, 0, 0, 0, none, none, none, 0, 0, system)


def telemetry(boot_ms: int, report: Report, datum: Datum, height_m: float, pressure: str) -> Iterator[Message]:
    """The messages of one tick.

    Args:
        boot_ms: The autopilot's time since boot.
        datum: The mission's origin and the autopilot's.
        height_m: Height of the autopilot's origin, and of home, above the surface (m).
        pressure: Message with the water's pressure; "none": there is none.
    """
    yield attitude(boot_ms, report)
    yield from depth_telemetry(boot_ms, report, datum, height_m, pressure)
    yield gps(boot_ms, report, datum)
    yield distance(boot_ms, report, *ALTIMETER_CM)


def depth_telemetry(boot_ms: int, report: Report, datum: Datum, height_m: float, pressure: str) -> Iterator[Message]:
    """Pressure, LOCAL_POSITION_NED and, with an origin, GLOBAL_POSITION_INT; arguments as for `telemetry`."""
    if pressure in PRESSURES:
        yield PRESSURES[pressure](boot_ms, report.pressure_pa / 100.0, 0.0, 1000)
    yield local_position(boot_ms, report, datum, height_m)
    if datum.mission is not None:
        yield global_position(boot_ms, report, datum, height_m)


def attitude(boot_ms: int, report: Report) -> Message:
    """ATTITUDE."""
    yaw = math.remainder(report.heading_rad, 2.0 * math.pi)
    return mavlink.MAVLink_attitude_message(boot_ms, 0.0, 0.0, yaw, 0.0, 0.0, report.yaw_rate_radps)


def local_position(boot_ms: int, report: Report, datum: Datum, height_m: float) -> Message:
    """LOCAL_POSITION_NED; arguments as for `telemetry`."""
    x, y = datum.to_local_ned(report.north_m, report.east_m)
    return mavlink.MAVLink_local_position_ned_message(boot_ms, x, y, report.depth_m + height_m, *_velocity_mps(report))


def global_position(boot_ms: int, report: Report, datum: Datum, height_m: float) -> Message:
    """GLOBAL_POSITION_INT; arguments as for `telemetry`. Without an origin latitude and longitude are 0."""
    known = datum.mission is not None and datum.autopilot is not None
    lat, lon = datum.to_geodetic(report.north_m, report.east_m) if known else (0, 0)
    height_mm = round(-1000.0 * (report.depth_m + height_m))
    heading_cdeg = round(math.degrees(report.heading_rad) * 100.0) % 36000
    velocity_cmps = [round(100.0 * v) for v in _velocity_mps(report)]
    return mavlink.MAVLink_global_position_int_message(
        boot_ms, lat, lon, height_mm, height_mm, *velocity_cmps, heading_cdeg
    )


def distance(boot_ms: int, report: Report, min_cm: int, max_cm: int, sensor: int = 0) -> Message:
    """DISTANCE_SENSOR; no ground in reach (`ALTIMETER_CM`) is sent as one more than the reach."""
    out_cm = ALTIMETER_CM[1] + 1
    range_cm = out_cm if math.isnan(report.altitude_m) else min(out_cm, round(100.0 * report.altitude_m))
    return mavlink.MAVLink_distance_sensor_message(
        boot_ms, min_cm, max_cm, max(0, range_cm), mavlink.MAV_DISTANCE_SENSOR_ULTRASOUND, sensor, DOWN, 255
    )


def gps(boot_ms: int, report: Report, datum: Datum) -> Message:
    """GPS_RAW_INT; under water without a fix, and without a mission origin with a fix at 0, 0."""
    kind, lat, lon, accuracy_mm = mavlink.GPS_FIX_TYPE_NO_FIX, 0, 0, 0
    if report.gps_m is not None:
        kind, accuracy_mm = mavlink.GPS_FIX_TYPE_3D_FIX, round(1000.0 * report.gps_std_m)
        lat, lon = (0, 0) if datum.mission is None else datum.to_geodetic(*report.gps_m)
    unknown, satellites = 65535, 0 if report.gps_m is None else 9
    return mavlink.MAVLink_gps_raw_int_message(
        boot_ms * 1000, kind, lat, lon, 0, unknown, unknown, unknown, unknown, satellites, h_acc=accuracy_mm
    )


def _velocity_mps(report: Report) -> tuple[float, float, float]:
    course = report.heading_rad + report.drift_rad
    return report.speed_mps * math.cos(course), report.speed_mps * math.sin(course), -report.climb_mps
