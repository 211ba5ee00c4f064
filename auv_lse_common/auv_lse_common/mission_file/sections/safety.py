"""Section `safety` of the parameter file: limits that are watched, and what is done when one is exceeded."""

from __future__ import annotations

from dataclasses import dataclass

from auv_lse_common.mission_file.parameters import parameter
from auv_lse_common.vocabulary.mission_run import STOPS

#: What can be done when a limit is exceeded.
RESPONSES = ("warn", "hold", "surface", "abort")


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyConfig:
    """The limits of one vehicle. What each does: docs/design/safety.md."""

    max_depth_m: float | None = parameter(
        None, unit="m", above=0.0, help="greatest depth of the vehicle; left out: vehicle.depth_m + 5 m"
    )
    depth_response: str = parameter("surface", choices=RESPONSES, help="what is done below max_depth_m")
    min_altitude_m: float = parameter(1.0, unit="m", low=0.0, help="least height over the ground; 0: not watched")
    altitude_response: str = parameter("warn", choices=RESPONSES, help="what is done below min_altitude_m")
    fence_margin_m: float = parameter(
        150.0,
        unit="m",
        low=0.0,
        help="how far outside of area.polygon_m a vehicle may be once it has been in it, and a waypoint ever",
    )
    fence_response: str = parameter("surface", choices=RESPONSES, help="what is done outside of the fence")
    odometry_age_s: float = parameter(30.0, unit="s", above=0.0, help="longest time without usable odometry")
    odometry_response: str = parameter("surface", choices=RESPONSES, help="what is done without odometry")
    link_age_s: float = parameter(
        30.0, unit="s", above=0.0, help="longest time without a heartbeat of the autopilot, once it has been heard"
    )
    link_response: str = parameter("hold", choices=RESPONSES, help="what is done when the autopilot is back")
    min_battery: float = parameter(
        0.2, low=0.0, high=1.0, help="least charge that the autopilot may report, of 1; 0: not watched"
    )
    battery_response: str = parameter("surface", choices=RESPONSES, help="what is done below min_battery")
    leak_response: str = parameter("abort", choices=RESPONSES, help="what is done when the autopilot reports a leak")
    mission_time_s: float = parameter(
        0.0, unit="s", low=0.0, help="longest time that the mission may run, holds left out; 0: not watched"
    )
    mission_time_response: str = parameter("abort", choices=RESPONSES, help="what is done after mission_time_s")
    patience_s: float = parameter(
        3.0, unit="s", low=0.0, help="how long a limit is exceeded, and warned of, before something is done"
    )
    abort: str = parameter(
        "surface", choices=tuple(STOPS), help="what the vehicle does after an abort; go_to: vehicle.recovery_north_m"
    )

    def deepest_m(self, depth_m: float) -> float:
        """Greatest depth (m) of a vehicle that travels at `depth_m`."""
        return depth_m + 5.0 if self.max_depth_m is None else self.max_depth_m
