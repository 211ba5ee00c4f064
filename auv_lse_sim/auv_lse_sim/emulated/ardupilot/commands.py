"""Commands (COMMAND_LONG) that a simulated ArduPilot carries out, and the messages that can be requested."""

from collections.abc import Callable
from typing import Protocol

from auv_lse_mavlink.messages.wire import Message, mavlink
from auv_lse_sim.emulated import mavlink_telemetry as telemetry
from auv_lse_sim.emulated.ardupilot.parameters import Parameters
from auv_lse_sim.emulated.ardupilot.streams import Streams


class Commanded(Protocol):
    """The parts of an autopilot that commands act on."""

    parameters: Parameters
    streams: Streams
    armed: bool

    @property
    def now_s(self) -> float:
        """Time (s)."""
        ...

    def arm(self, on: bool) -> bool:
        """Arms or disarms; returns whether it could."""
        ...

    def set_mode(self, number: int) -> bool:
        """Changes the mode; returns whether it could."""
        ...

    def change_speed(self, speed_mps: float) -> bool:
        """Changes the speed; returns whether it could."""
        ...

    def restart_mission(self, number: int) -> bool:
        """Restarts the mission from an item; returns whether it could."""
        ...

    def select(self, number: int) -> bool:
        """Selects an item of the mission; returns whether it could."""
        ...

    def reboot(self, now_s: float) -> None:
        """Boots."""
        ...

    def send(self, message: Message) -> None:
        """Sends a message."""
        ...

    def send_origin(self, home: bool = False) -> None:
        """Sends the origin, if there is one."""
        ...


def _reboot(autopilot: Commanded, command: Message) -> bool:
    if command.param1 == 1.0 and not autopilot.armed:
        autopilot.reboot(autopilot.now_s)
        return True
    return False


#: Handler of each command; returns whether it succeeded. MISSION_START is acknowledged without effect.
COMMANDS: dict[int, Callable[[Commanded, Message], bool]] = {
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


#: Handlers of REQUEST_MESSAGE by message id. The origin's request is accepted even if there is none to send.
MESSAGES: dict[int, Callable[[Commanded], None]] = {
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: lambda pilot: pilot.send(
        telemetry.version(round(pilot.parameters["SYSID_THISMAV"]))
    ),
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: lambda pilot: pilot.send_origin(),
}
