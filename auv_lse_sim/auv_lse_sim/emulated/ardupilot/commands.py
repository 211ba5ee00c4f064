"""Commands (COMMAND_LONG) that a simulated ArduPilot carries out, and the messages that can be requested."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from auv_lse_mavlink.messages.wire import Message, mavlink

if TYPE_CHECKING:
    from auv_lse_sim.emulated.ardupilot.autopilot import ArduPilot


def _arm(autopilot: ArduPilot, command: Message) -> bool:
    return autopilot.arm(command.param1 == 1.0)


def _set_mode(autopilot: ArduPilot, command: Message) -> bool:
    return autopilot.set_mode(int(command.param2))


def _change_speed(autopilot: ArduPilot, command: Message) -> bool:
    return autopilot.change_speed(float(command.param2))


def _start_mission(autopilot: ArduPilot, command: Message) -> bool:
    """Acknowledged without effect."""
    return True


def _set_current(autopilot: ArduPilot, command: Message) -> bool:
    number = int(command.param1)
    if command.param2 == 1.0:
        return autopilot.restart_mission(number)
    return autopilot.select(number)


def _set_interval(autopilot: ArduPilot, command: Message) -> bool:
    autopilot.streams.set_interval(int(command.param1), float(command.param2))
    return True


def _reboot(autopilot: ArduPilot, command: Message) -> bool:
    if command.param1 == 1.0 and not autopilot.armed:
        autopilot.reboot(autopilot.now_s)
        return True
    return False


#: What each command does; returns whether it could.
COMMANDS: dict[int, Callable[[ArduPilot, Message], bool]] = {
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM: _arm,
    mavlink.MAV_CMD_DO_SET_MODE: _set_mode,
    mavlink.MAV_CMD_DO_CHANGE_SPEED: _change_speed,
    mavlink.MAV_CMD_MISSION_START: _start_mission,
    mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: _set_current,
    mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: _set_interval,
    mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: _reboot,
}


def _send_version(autopilot: ArduPilot) -> None:
    able = (
        mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    )
    none = bytes(8)
    system = round(autopilot.parameters["SYSID_THISMAV"])
    autopilot.send(mavlink.MAVLink_autopilot_version_message(able, 1, 0, 0, 0, none, none, none, 0, 0, system))


#: What REQUEST_MESSAGE sends, by message id. The origin's request is accepted even if there is none to send.
MESSAGES: dict[int, Callable[[ArduPilot], None]] = {
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _send_version,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: lambda autopilot: autopilot.send_origin(),
}
