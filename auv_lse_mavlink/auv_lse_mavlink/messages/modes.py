"""Flight modes in which autopilots follow targets (HEARTBEAT.custom_mode)."""

from auv_lse_mavlink.messages.wire import mavlink

_PX4_MAIN, _PX4_SUB = 16, 24  # bits of custom_mode where PX4 has its main mode and its sub mode
_ROVERS = (mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_TYPE_SURFACE_BOAT)


def obeying_modes(autopilot: int, vehicle_type: int, mission: bool) -> tuple[int, ...]:
    """The modes in which an autopilot follows the link's targets; empty if unknown: any may be right.

    `autopilot` (MAV_AUTOPILOT) and `vehicle_type` (MAV_TYPE) are its heartbeat's; `mission`: missions are uploaded.
    """
    if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA and vehicle_type == mavlink.MAV_TYPE_SUBMARINE:
        return (3,) if mission else (4,)  # AUTO, GUIDED
    if autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA and vehicle_type in _ROVERS:
        return (10,) if mission else (15,)  # AUTO, GUIDED
    if autopilot == mavlink.MAV_AUTOPILOT_PX4:
        return (4 << _PX4_MAIN | 4 << _PX4_SUB,) if mission else (6 << _PX4_MAIN,)  # Mission, Offboard
    return ()
