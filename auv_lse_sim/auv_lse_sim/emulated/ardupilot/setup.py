"""How a simulated ArduPilot is installed."""

import math
from dataclasses import dataclass

from auv_lse_mavlink.messages.datum import Origin
from auv_lse_sim.emulated.ardupilot.personality import SUB, Personality

#: Rate (Hz) of every group of messages in a vehicle that is set up.
RATE_HZ = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """How an ArduPilot is installed.

    Attributes:
        personality: ArduSub or ArduRover.
        parameters: Changes to the firmware's parameters, by the names of 4.5.
        renamed: Whether the firmware has the parameter names of 4.8.
        aiding: "gps", "dvl" (no GPS, but velocities) or "none".
        has_origin: Whether its estimator has an origin when the simulation begins.
        origin: That origin; None: the mission's.
        origin_height_m: Height of that origin, and of home, above the surface.
        operator_mode: The mode that an operator chooses after arming on deck, and after a failsafe has ended; None:
            the vehicle stays disarmed in MANUAL.
        patience: Factor on the ground station's time limit, for simulations that run faster than real time.
        feeds: Whether another system on the same network feeds the range finder, so that its messages arrive too.
        lasts_m: Distance that it covers on a full battery.
        component_id: MAVLink component id.
    """

    personality: Personality
    parameters: dict[str, float]
    renamed: bool = False
    aiding: str = "gps"
    has_origin: bool = True
    origin: Origin | None = None
    origin_height_m: float = 0.0
    operator_mode: int | None = None
    patience: float = 1.0
    feeds: bool = True
    lasts_m: float = math.inf
    component_id: int = 1


def recommended_parameters(personality: Personality, station: int, speed_mps: float = 1.0) -> dict[str, float]:
    """Parameters of a vehicle that was set up for the link (docs/guide): rates, failsafes, range finder.

    Args:
        personality: ArduSub or ArduRover.
        station: System id of the link, whose heartbeats count.
        speed_mps: Speed where none is commanded.
    """
    rates = {f"SR0_{group}": RATE_HZ for group in ("RAW_SENS", "EXT_STAT", "POSITION", "EXTRA1", "EXTRA3")}
    common = {"SYSID_MYGCS": float(station), "RNGFND1_TYPE": 10.0, "RNGFND1_MAX_CM": 10000.0, **rates}
    if personality is SUB:
        return common | {
            "FS_GCS_ENABLE": 4.0,
            "FS_PILOT_INPUT": 0.0,
            "FS_LEAK_ENABLE": 2.0,
            "WPNAV_SPEED": 100.0 * speed_mps,
        }
    return common | {"FS_GCS_ENABLE": 1.0, "FS_THR_ENABLE": 0.0, "WP_SPEED": speed_mps}
