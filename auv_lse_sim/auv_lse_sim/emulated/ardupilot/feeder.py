"""A companion that feeds the autopilot's range finder; the autopilot routes its messages onto the link too."""

from auv_lse_mavlink.messages.wire import MavlinkCodec, mavlink
from auv_lse_sim.emulated import mavlink_telemetry as telemetry
from auv_lse_sim.emulated.autopilot_report import Report

#: Its system and component.
SYSTEM, COMPONENT = 250, 190
#: Its clock (ms) minus the autopilot's.
CLOCK_MS = 400_000_000
#: Reach of the range finder (cm), as it reports it.
REACH_CM = (30, 10000)


class Feeder:
    """The companion's messages."""

    def __init__(self) -> None:
        self._codec = MavlinkCodec(SYSTEM, COMPONENT)

    def messages(self, now_s: float, report: Report, has_echo: bool) -> list[bytes]:
        """HEARTBEAT, and DISTANCE_SENSOR while the range finder sends."""
        kind = mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID
        messages = [mavlink.MAVLink_heartbeat_message(*kind, 0, 0, mavlink.MAV_STATE_ACTIVE, 3)]
        if has_echo:
            boot_ms = (round(now_s * 1000.0) + CLOCK_MS) % 2**32
            messages.append(telemetry.distance(boot_ms, report, *REACH_CM, sensor=1))
        return [self._codec.encode(message) for message in messages]
