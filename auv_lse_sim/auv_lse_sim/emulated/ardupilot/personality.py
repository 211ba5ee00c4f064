"""What differs between ArduSub and ArduRover on the wire: type, flight modes, base modes, texts, time limits."""

from dataclasses import dataclass

from auv_lse_mavlink.messages.wire import Message, mavlink

_CUSTOM, _STABILIZE = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
_MANUAL, _GUIDED = mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED, mavlink.MAV_MODE_FLAG_GUIDED_ENABLED


@dataclass(frozen=True, slots=True, kw_only=True)
class Personality:
    """One firmware.

    Attributes:
        vehicle_type: MAV_TYPE of its heartbeat.
        manual: Number of the mode in which it boots.
        guided: Number of the mode that follows position targets.
        auto: Number of the mode that flies missions.
        hold: Number of the mode after a failsafe: ALT_HOLD of ArduSub, HOLD of ArduRover.
        surface: Number of SURFACE; None: there is none.
        base_modes: HEARTBEAT.base_mode by mode number, disarmed.
        gcs_timeout_s: Time without a ground station's heartbeat after which its failsafe acts.
        armed_text, disarmed_text, lost_text: Texts at arming, disarming, and at a lost ground station.
        reached_text: Text at a reached mission item, with {} for its number.
    """

    name: str
    vehicle_type: int
    manual: int
    guided: int
    auto: int
    hold: int
    surface: int | None
    base_modes: dict[int, int]
    gcs_timeout_s: float
    armed_text: str
    disarmed_text: str
    lost_text: str
    reached_text: str

    def heartbeat(self, mode: int, armed: bool, is_critical: bool) -> Message:
        """HEARTBEAT in a mode; `is_critical`: a failsafe acts, or it is booting."""
        flags = self.base_modes[mode] | mavlink.MAV_MODE_FLAG_SAFETY_ARMED * armed
        if is_critical:
            state = mavlink.MAV_STATE_CRITICAL
        elif self.surface is not None:
            state = mavlink.MAV_STATE_ACTIVE if armed else mavlink.MAV_STATE_STANDBY
        else:
            state = mavlink.MAV_STATE_STANDBY if mode == self.hold else mavlink.MAV_STATE_ACTIVE
        kind = self.vehicle_type, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        return mavlink.MAVLink_heartbeat_message(*kind, flags, mode, state, 3)


SUB = Personality(
    name="ArduSub",
    vehicle_type=mavlink.MAV_TYPE_SUBMARINE,
    manual=19,
    guided=4,
    auto=3,
    hold=2,
    surface=9,
    base_modes={
        **dict.fromkeys((0, 2, 9, 19), _CUSTOM | _STABILIZE | _MANUAL),
        **dict.fromkeys((3, 4), _CUSTOM | _STABILIZE | _MANUAL | _GUIDED),
    },
    gcs_timeout_s=2.5,
    armed_text="Arming motors",
    disarmed_text="Disarming motors",
    lost_text="MYGCS: {}, heartbeat lost",
    reached_text="Reached command #{}",
)

ROVER = Personality(
    name="ArduRover",
    vehicle_type=mavlink.MAV_TYPE_SURFACE_BOAT,
    manual=0,
    guided=15,
    auto=10,
    hold=4,
    surface=None,
    base_modes={0: _CUSTOM | _MANUAL, 4: _CUSTOM, 10: _CUSTOM | _GUIDED, 15: _CUSTOM | _GUIDED},
    gcs_timeout_s=6.5,
    armed_text="Throttle armed",
    disarmed_text="Throttle disarmed",
    lost_text="GCS Failsafe",
    reached_text="Reached waypoint #{}",
)
