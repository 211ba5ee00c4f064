"""Commands (COMMAND_LONG) that a simulated ArduPilot carries out, and the messages that can be requested."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from auv_lse_mavlink.messages.wire import Message, mavlink
from auv_lse_sim.emulated import mavlink_telemetry as telemetry

if TYPE_CHECKING:
    from auv_lse_sim.emulated.ardupilot.autopilot import ArduPilot


def _reboot(autopilot: ArduPilot, command: Message) -> bool:
    if command.param1 == 1.0 and not autopilot.armed:
        autopilot.reboot(autopilot.now_s)
        return True
    return False


#: What each command does; returns whether it could. MISSION_START is acknowledged without effect.
COMMANDS: dict[int, Callable[[ArduPilot, Message], bool]] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: lambda pilot, command: pilot.arm(command.param1 == 1.0),
    mavlink.MAV_CMD_DO_SET_MODE: lambda pilot, command: pilot.set_mode(int(command.param2)),
    mavlink.MAV_CMD_DO_CHANGE_SPEED: lambda pilot, command: pilot.change_speed(float(command.param2)),
    mavlink.MAV_CMD_MISSION_START: lambda pilot, command: True,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: lambda pilot, command: (
        pilot.restart_mission if command.param2 == 1.0 else pilot.select
    )(int(command.param1)),
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: lambda pilot, command: pilot.streams.set_interval(
        int(command.param1), float(command.param2)
    ),
    mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
}


#: What REQUEST_MESSAGE sends, by message id. The origin's request is accepted even if there is none to send.
MESSAGES: dict[int, Callable[[ArduPilot], None]] = {
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: lambda pilot: pilot.send(
        telemetry.version(round(pilot.parameters["SYSID_THISMAV"]))
    ),
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: lambda pilot: pilot.send_origin(),
}
