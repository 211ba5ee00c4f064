"""Converts MAVLink's frames, datums and units to the stack's and back (docs/reference/frames.md).

| quantity | MAVLink | here |
|---|---|---|
| heading | ATTITUDE.yaw: rad, clockwise from north, -pi to pi | the same |
| position | LOCAL_POSITION_NED.x, y: m north and east of the autopilot's own origin | of the mission's origin |
| depth | pressure minus the pressure at the surface (`depth_gauge.py`), in m | depth_m, positive down |
| own depth | LOCAL_POSITION_NED.z: m down from the autopilot's origin, wherever that is | compared with depth_m |
| geodetic | lat, lon: 1e-7 degrees, WGS84; altitude mm, up | degrees; depth_m |
| altitude over ground | DISTANCE_SENSOR, orientation 25 (down): cm | m |
| pressure | SCALED_PRESSURE2.press_abs (or another, `link.pressure`): hPa | Pa |

The autopilot's origin is that of its estimator (GPS_GLOBAL_ORIGIN). If it differs from the mission's, positions are
shifted by the offset. Both planes are assumed parallel: within 1 km the error is below 0.1 m.
"""

import math
from dataclasses import dataclass

from auv_lse_common.vocabulary.frames import wrap_pi
from auv_lse_common.vocabulary.mission_run import Stop
from auv_lse_mavlink.messages.datum import Datum
from auv_lse_mavlink.messages.wire import Message, mavlink

#: SET_POSITION_TARGET_LOCAL_NED.type_mask: take position and yaw; ignore velocity, acceleration, yaw rate.
POSITION_AND_YAW = (
    mavlink.POSITION_TARGET_TYPEMASK_VX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_VZ_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AZ_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
)
DOWN = mavlink.MAV_SENSOR_ROTATION_PITCH_270
#: Echoes of less quality (DISTANCE_SENSOR.signal_quality, %) are left out.
LEAST_QUALITY = 25


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """The vehicle's next destination: the end of a leg.

    Attributes:
        north_m: North of the mission's origin.
        east_m: East of it.
        depth_m: Below the surface, positive down.
        heading_rad: Heading there, clockwise from north.
        step: Mission step of the leg's start, for messages.
        speed_mps: Speed on the leg; NaN: the autopilot's setting.
        then: What follows the mission's last target; None: it is not the last.
        surface: Whether the vehicle surfaces there for a fix before it continues.
        begins_m: North, east of the leg's start; None: at the previous target.
        at_surface: Whether it is reached at the surface, wherever that is.
    """

    north_m: float
    east_m: float
    depth_m: float
    heading_rad: float
    step: int = 0
    speed_mps: float = math.nan
    then: Stop | None = None
    surface: bool = False
    begins_m: tuple[float, float] | None = None
    at_surface: bool = False


def position_target(target: Target, datum: Datum, boot_ms: int, system: int, component: int) -> Message:
    """SET_POSITION_TARGET_LOCAL_NED for a target, to the autopilot `system`, `component`."""
    x, y = datum.to_local_ned(target.north_m, target.east_m)
    frame, velocity_and_acceleration, yaw_rate = mavlink.MAV_FRAME_LOCAL_NED, (0.0,) * 6, 0.0
    return mavlink.MAVLink_set_position_target_local_ned_message(
        boot_ms % 2**32, system, component, frame, POSITION_AND_YAW, x, y, target.depth_m,
        *velocity_and_acceleration, float(wrap_pi(target.heading_rad)), yaw_rate,
    )  # fmt: skip


def speed_command(speed_mps: float, system: int, component: int) -> Message:
    """DO_CHANGE_SPEED to a speed over ground (m/s), without a change of throttle, to the autopilot."""
    ground, throttle = 1.0, -1.0
    return mavlink.MAVLink_command_long_message(
        system, component, mavlink.MAV_CMD_DO_CHANGE_SPEED, 0, ground, speed_mps, throttle, *(0.0,) * 4
    )


def mission_item(
    target: Target, datum: Datum, number: int, acceptance_m: float, system: int, component: int
) -> Message:
    """MISSION_ITEM_INT number `number` for a target: a waypoint at its latitude and longitude, depth as altitude."""
    lat_e7, lon_e7 = datum.to_geodetic(target.north_m, target.east_m)
    frame, command = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_CMD_NAV_WAYPOINT
    current, autocontinue, hold_s, pass_radius_m = int(number == 0), 1, 0.0, 0.0
    return mavlink.MAVLink_mission_item_int_message(
        system, component, number, frame, command, current, autocontinue, hold_s, acceptance_m, pass_radius_m,
        math.degrees(float(wrap_pi(target.heading_rad))), lat_e7, lon_e7, -target.depth_m,
    )  # fmt: skip


def target_of_position(message: Message, datum: Datum) -> Target:
    """The target of a SET_POSITION_TARGET_LOCAL_NED.

    Raises:
        ValueError: if it is in another frame, or has no position.
    """
    if message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
        raise ValueError(f"frame is {message.coordinate_frame}, not MAV_FRAME_LOCAL_NED (1)")
    if message.type_mask & 0b111:
        raise ValueError(f"type_mask {message.type_mask:#x} leaves out the position, which a target needs")
    if not all(map(math.isfinite, (message.x, message.y, message.z))):
        raise ValueError(f"position ({message.x}, {message.y}, {message.z}) must be finite")
    north, east = datum.from_local_ned(message.x, message.y)
    ignored = message.type_mask & mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
    heading = math.nan if ignored else float(message.yaw)
    return Target(north_m=north, east_m=east, depth_m=float(message.z), heading_rad=heading)


def target_of_item(message: Message, datum: Datum) -> Target:
    """The target of a MISSION_ITEM_INT.

    Raises:
        ValueError: if it is not a waypoint, or its frame is not global with relative altitude.
    """
    if message.command != mavlink.MAV_CMD_NAV_WAYPOINT:
        raise ValueError(f"command is {message.command}, not MAV_CMD_NAV_WAYPOINT (16)")
    if message.frame not in (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT):
        raise ValueError(f"frame is {message.frame}, not MAV_FRAME_GLOBAL_RELATIVE_ALT_INT (6)")
    north, east = datum.from_geodetic(message.x, message.y)
    heading = math.radians(message.param4) if math.isfinite(message.param4) else math.nan
    return Target(north_m=north, east_m=east, depth_m=-float(message.z), heading_rad=heading)


def altitude_m(message: Message) -> float | None:
    """Altitude over ground (m) of a DISTANCE_SENSOR, NaN without a usable echo; None if it does not look down."""
    if message.orientation != DOWN:
        return None
    if 0 < getattr(message, "signal_quality", 0) < LEAST_QUALITY:  # 0: unknown
        return math.nan
    if not message.min_distance <= message.current_distance <= message.max_distance:
        return math.nan
    return float(message.current_distance) / 100.0


def pressure_pa(message: Message) -> float:
    """Absolute pressure (Pa) of a SCALED_PRESSURE, 2 or 3."""
    return float(message.press_abs) * 100.0
