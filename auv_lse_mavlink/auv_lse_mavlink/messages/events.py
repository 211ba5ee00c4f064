"""Events that the link to the autopilot reports to its owner."""

import math
from dataclasses import dataclass

from auv_lse_common.safety.watch import AutopilotReport
from auv_lse_common.topics.records import Altitude, Odometry, Pressure
from auv_lse_common.vocabulary.dead_reckoning import Fix
from auv_lse_mavlink.messages.conversion import Target


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotEstimate(Odometry):
    """The autopilot's estimate of its vehicle's state, in the mission's frame.

    Attributes:
        stamp_s: Time of the estimate, s since 1970 (UTC, or simulated).
        raw_north_m: North of the dead-reckoned position, without corrections by fixes; NaN: not reported.
        raw_east_m: East of it.
    """

    raw_north_m: float = math.nan
    raw_east_m: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkUp:
    """The autopilot is heard: its kind (MAV_AUTOPILOT) and vehicle type (MAV_TYPE)."""

    autopilot: int
    vehicle_type: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkLost:
    """The autopilot has not been heard for `silent_s`."""

    silent_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Zeroed:
    """The pressure at the surface is known, or has changed (Pa); the sensor was `sensor_depth_m` (m) below it."""

    pressure_pa: float
    sensor_depth_m: float = 0.0

    @property
    def text(self) -> str:
        """The event in words for an operator."""
        at = f"depth is zeroed at {self.pressure_pa / 100.0:.1f} hPa"
        if self.sensor_depth_m > 0.0:
            return f"{at}, with the sensor {self.sensor_depth_m:g} m below the surface (link.sensor_depth_m)"
        return (
            f"{at}, where the sensor is now. If the vehicle floats, all depths are too small by the sensor's depth: "
            "zero it on deck, or set link.zero_afloat and link.sensor_depth_m"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Surfaced:
    """After a dive the vehicle is at the surface, where its depth gauge shows `drift_m` (m)."""

    drift_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class AutopilotState:
    """The autopilot's state, reported with each heartbeat and when they stop.

    Attributes:
        stamp_s: When it was last heard (s, the host's clock).
        battery_v: Voltage of its battery (V); NaN unknown.
    """

    stamp_s: float
    report: AutopilotReport
    battery_v: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetSent:
    """A new target was sent (position_target), or the autopilot has accepted a mission that ends there."""

    target: Target


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """Something an operator should read."""

    text: str


Event = (
    AutopilotEstimate
    | Fix
    | Altitude
    | Pressure
    | Zeroed
    | Surfaced
    | AutopilotState
    | LinkUp
    | LinkLost
    | TargetSent
    | Problem
)
