"""The messages that ArduPilot streams, in groups whose rates are parameters (SR0_...)."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from auv_lse_mavlink.messages.conversion import DOWN
from auv_lse_mavlink.messages.wire import Message, mavlink
from auv_lse_sim.emulated import mavlink_telemetry as telemetry
from auv_lse_sim.emulated.ardupilot.auto_mission import AutoMission
from auv_lse_sim.emulated.ardupilot.estimator import Estimator
from auv_lse_sim.emulated.ardupilot.parameters import Parameters
from auv_lse_sim.emulated.ardupilot.personality import Personality
from auv_lse_sim.emulated.autopilot_report import Report

#: Energy of a full battery (Wh), and hJ in one.
BATTERY_WH, HJ_PER_WH = 266.0, 36.0
#: RNGFND1_TYPE of a range finder that sends DISTANCE_SENSOR.
MAVLINK_RANGE_FINDER = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """State that an autopilot reports besides the vehicle's and its estimator's.

    Attributes:
        target_m: North, east of the present target (m); None: there is none.
        is_guided: Whether it is in GUIDED.
        battery: Charge, 0 to 1.
        has_echo: Whether the range finder's source sends.
    """

    target_m: tuple[float, float] | None
    is_guided: bool
    mission: AutoMission
    battery: float
    has_echo: bool


class Streams:
    """Sends each group at its rate."""

    def __init__(self, personality: Personality, parameters: Parameters, estimator: Estimator) -> None:
        """Reads rates and the range finder's settings from `parameters`."""
        self._own, self._parameters, self._estimator = personality, parameters, estimator
        self._sent_s: dict[str, float] = {}
        self._intervals_s: dict[int, float] = {}  # by message id, of SET_MESSAGE_INTERVAL

    def boot(self) -> None:
        """Forgets what was set since the last boot."""
        self._sent_s, self._intervals_s = {}, {}

    def forget_times(self) -> None:
        """Makes everything due now."""
        self._sent_s = {}

    def set_interval(self, message_id: int, interval_us: float) -> bool:
        """Streams a message at an interval (us), as SET_MESSAGE_INTERVAL sets it; -1: not at all, 0: by its group."""
        if interval_us == 0.0:
            self._intervals_s.pop(message_id, None)
        else:
            self._intervals_s[message_id] = math.inf if interval_us < 0.0 else interval_us * 1e-6
        return True

    def due(self, now_s: float, report: Report, status: Status) -> list[Message]:
        """The messages that are due at `now_s`."""
        messages: list[Message] = []
        for group, makers in GROUPS.items():
            rate_hz = self._parameters[f"SR0_{group}"]
            in_group = self._is_due(group, now_s, 1.0 / rate_hz if rate_hz > 0.0 else math.inf)
            for maker, message_id in makers:
                interval_s = self._intervals_s.get(message_id)
                sends = in_group if interval_s is None else self._is_due(f"{group} {message_id}", now_s, interval_s)
                message = maker(self, report, status) if sends else None
                if message is not None:
                    messages.append(message)
        return messages

    def _is_due(self, name: str, now_s: float, interval_s: float) -> bool:
        if math.isinf(interval_s) or now_s - self._sent_s.get(name, -math.inf) < interval_s - 1e-6:
            return False
        self._sent_s[name] = now_s
        return True

    # ------------------------------------------------------------------ messages

    def _pressure(self, report: Report, status: Status) -> Message:
        return mavlink.MAVLink_scaled_pressure_message(self._estimator.boot_ms, report.pressure_pa / 100.0, 0.0, 1428)

    def _pressure2(self, report: Report, status: Status) -> Message:
        return mavlink.MAVLink_scaled_pressure2_message(self._estimator.boot_ms, report.pressure_pa / 100.0, 0.0, 1428)

    def _pressure3(self, report: Report, status: Status) -> Message | None:
        """ArduSub's temperature sensor, which has no pressure."""
        if self._own.surface is None:
            return None
        return mavlink.MAVLink_scaled_pressure3_message(self._estimator.boot_ms, 0.0, 0.0, 4001)

    def _sys_status(self, report: Report, status: Status) -> Message:
        percent = round(100.0 * status.battery)
        return mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12600, 0, percent, 0, 0, 0, 0, 0, 0)

    def _battery(self, report: Report, status: Status) -> Message:
        used_hj = round((1.0 - status.battery) * BATTERY_WH * HJ_PER_WH)
        voltages = [12600] + [65535] * 9
        return mavlink.MAVLink_battery_status_message(0, 0, 0, 32767, voltages, 0, -1, used_hj, -1)

    def _mission_current(self, report: Report, status: Status) -> Message:
        return mission_current(status.mission)

    def _gps(self, report: Report, status: Status) -> Message:
        if self._estimator.uses_gps:
            return telemetry.gps(self._estimator.boot_ms, report, self._estimator.datum)
        unknown, none = 65535, mavlink.GPS_FIX_TYPE_NO_GPS
        return mavlink.MAVLink_gps_raw_int_message(0, none, 0, 0, 0, unknown, unknown, 0, 0, 0)

    def _navigation(self, report: Report, status: Status) -> Message:
        here, target_m = (report.north_m, report.east_m), status.target_m
        apart_m, bearing = 0.0, 0
        if target_m is not None:
            apart_m = math.dist(here, target_m)
            bearing = round(math.degrees(math.atan2(target_m[1] - here[1], target_m[0] - here[0])))
        heading = round(math.degrees(math.remainder(report.heading_rad, 2.0 * math.pi)))
        return mavlink.MAVLink_nav_controller_output_message(
            0.0, 0.0, heading, bearing % 360, min(int(apart_m), 65535), 0.0, 0.0, 0.0
        )

    def _target(self, report: Report, status: Status) -> Message | None:
        """ArduRover's echo of its target; ArduSub sends none."""
        target_m, datum = status.target_m, self._estimator.datum
        if self._own.surface is not None or target_m is None or not status.is_guided:
            return None
        if datum.mission is None or datum.autopilot is None:
            return None
        lat, lon = datum.to_geodetic(*target_m)
        position_only = 65016
        return mavlink.MAVLink_position_target_global_int_message(
            self._estimator.boot_ms, mavlink.MAV_FRAME_GLOBAL, position_only, lat, lon, *(0.0,) * 9
        )

    def _global_position(self, report: Report, status: Status) -> Message:
        return telemetry.global_position(
            self._estimator.boot_ms, report, self._estimator.datum, self._estimator.height_m
        )

    def _local_position(self, report: Report, status: Status) -> Message | None:
        if not self._estimator.has_position:
            return None
        return telemetry.local_position(
            self._estimator.boot_ms, report, self._estimator.datum, self._estimator.height_m
        )

    def _attitude(self, report: Report, status: Status) -> Message:
        return telemetry.attitude(self._estimator.boot_ms, report)

    def _system_time(self, report: Report, status: Status) -> Message:
        return mavlink.MAVLink_system_time_message(self._estimator.unix_us, self._estimator.boot_ms)

    def _distance(self, report: Report, status: Status) -> Message | None:
        looks_down = round(self._parameters["RNGFND1_ORIENT"]) == DOWN
        if round(self._parameters["RNGFND1_TYPE"]) != MAVLINK_RANGE_FINDER or not (status.has_echo and looks_down):
            return None
        reach_cm = (round(self._parameters[f"RNGFND1_{end}_CM"]) for end in ("MIN", "MAX"))
        return telemetry.distance(self._estimator.boot_ms, report, *reach_cm)


def mission_current(mission: AutoMission) -> Message:
    """MISSION_CURRENT."""
    return mavlink.MAVLink_mission_current_message(mission.current, mission.total, mission.state, 0)


_Maker = Callable[[Streams, Report, Status], Message | None]

#: Messages of each group, with their ids.
GROUPS: dict[str, tuple[tuple[_Maker, int], ...]] = {
    "EXTRA3": (
        (Streams._system_time, mavlink.MAVLINK_MSG_ID_SYSTEM_TIME),
        (Streams._distance, mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR),
        (Streams._battery, mavlink.MAVLINK_MSG_ID_BATTERY_STATUS),
    ),
    "EXTRA1": ((Streams._attitude, mavlink.MAVLINK_MSG_ID_ATTITUDE),),
    "RAW_SENS": (
        (Streams._pressure, mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE),
        (Streams._pressure2, mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE2),
        (Streams._pressure3, mavlink.MAVLINK_MSG_ID_SCALED_PRESSURE3),
    ),
    "POSITION": (
        (Streams._local_position, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED),
        (Streams._global_position, mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT),
    ),
    "EXT_STAT": (
        (Streams._sys_status, mavlink.MAVLINK_MSG_ID_SYS_STATUS),
        (Streams._mission_current, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT),
        (Streams._gps, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT),
        (Streams._navigation, mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT),
        (Streams._target, mavlink.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT),
    ),
}
