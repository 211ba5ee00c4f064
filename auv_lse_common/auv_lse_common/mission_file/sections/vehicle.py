"""Section `vehicle`: start, depth, speed, surfacings, and the end of the mission."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from auv_lse_common.mission_file.parameters import ParameterError, configuration, merge, parameter
from auv_lse_common.mission_file.sections.area import metres_only
from auv_lse_common.vocabulary.mission_run import STOPS, Stop
from auv_lse_common.vocabulary.sounding import DEEPEST_M

#: Default of `vehicle.surfacings` if a fix can improve the map.
MAX_SURFACINGS = 2
#: A vehicle that climbs over rising ground climbs to this depth (m) at most.
SHALLOWEST_M = 1.0
#: Vehicles need at least this depth difference (m), for the errors of depth sensors and control.
LEAST_SEPARATION_M = 0.5
#: Default depths (m), assigned to the vehicles cyclically (the paper's).
DEPTHS_M = (3.0, 4.0, 5.0)


def with_depth(parameters: Mapping[str, Any], vehicle: int) -> Mapping[str, Any]:
    """The parameters of vehicle number `vehicle`, with its default depth unless they contain one."""
    own = parameters.get("vehicle", {})
    if not isinstance(own, Mapping) or "depth_m" in own:  # rejected where it is read
        return parameters
    return merge(parameters, {"vehicle": {"depth_m": DEPTHS_M[(vehicle - 1) % len(DEPTHS_M)]}})


@configuration
class VehicleConfig:
    """One vehicle: start, depth, speed, surfacings, and the end of its mission."""

    depth_m: float = parameter(
        3.0,
        unit="m",
        low=0.0,
        high=DEEPEST_M,
        help="travel depth below the surface; by default 3, 4 and 5 m, cyclically by vehicle number",
    )
    speed_mps: float = parameter(1.5, unit="m/s", low=0.05, high=30.0, help="speed through the water")
    start_north_m: float = parameter(0.0, low=-1e7, high=1e7, unit="m", help="north of the start")
    start_east_m: float = parameter(0.0, low=-1e7, high=1e7, unit="m", help="east of the start")
    start_deg: tuple[float, ...] = parameter(
        (), unit="deg", help="instead of start_north_m, start_east_m: latitude, longitude of the start"
    )
    start_heading_rad: float = parameter(
        0.0, low=-7.0, high=7.0, unit="rad", help="heading at the start, clockwise from north"
    )
    start_delay_s: float = parameter(
        0.0,
        unit="s",
        low=0.0,
        high=86400.0,
        help="time of departure on the simulator's clock; no effect on a real vehicle, whose clock is UTC",
    )
    start: str = parameter(
        "at_once",
        choices=("at_once", "on_call"),
        help="at_once: the mission starts with the first odometry and, with a simulated autopilot, when it is armed "
        "and follows targets; on_call: it waits for the command GO. A vehicle with an autopilot (link.kind: mavlink) "
        "and no simulator always waits for GO",
    )
    at_end: str = parameter(
        "hold", choices=tuple(STOPS), help="action after the last leg; go_to leads to recovery_north_m, recovery_east_m"
    )
    recovery_north_m: float | None = parameter(
        None, low=-1e7, high=1e7, unit="m", help="north of the recovery position"
    )
    recovery_east_m: float | None = parameter(None, low=-1e7, high=1e7, unit="m", help="east of the recovery position")
    recovery_deg: tuple[float, ...] = parameter(
        (),
        unit="deg",
        help="instead of recovery_north_m, recovery_east_m: latitude, longitude of the recovery position",
    )
    battery_km: float | None = parameter(
        None,
        unit="km",
        above=0.0,
        high=1e5,
        help="range of a full battery, as in the reports of dives; left out: learned under way, unknown to "
        "check and GO",
    )
    surfacings: int | None = parameter(
        None,
        low=0,
        high=10,
        help="largest number of surfacings for a GPS fix, each where it gains more than the time it costs. Default: 2, "
        "but 0 with the paper's methods, ideal simulated navigation, or an autopilot (set it to allow surfacing). "
        "Needs positions.correct",
    )
    surfacing_s: float = parameter(
        60.0,
        unit="s",
        above=0.0,
        high=86400.0,
        help="duration of a surfacing: stop, climb, fix, dive; the mission loses the legs that fit into this time",
    )
    min_altitude_m: float = parameter(
        0.0,
        unit="m",
        low=0.0,
        high=100.0,
        help="altitude to keep: where the ground rises, the vehicle climbs in time, and returns to depth_m behind; a "
        "boat avoids and holds over shallower ground. 0: only safety.min_altitude_m",
    )
    min_water_m: float = parameter(
        3.0,
        unit="m",
        low=0.0,
        high=1e3,
        help="smallest water depth below the vehicle: it avoids ground that the map shows as shallower than depth_m "
        "plus this value; with min_altitude_m, ground over which it cannot climb enough",
    )

    def __post_init__(self) -> None:
        """Checks that a position to go to is given.

        Raises:
            ParameterError: if it is not, or a position is in degrees.
        """
        for key in ("start_deg", "recovery_deg"):
            if value := getattr(self, key):
                raise ParameterError(metres_only(f"vehicle.{key}", value))
        self.stop("vehicle.at_end", self.at_end)

    @property
    def shallowest_ground_m(self) -> float:
        """Depth (m) of the shallowest ground over which the vehicle travels."""
        if self.min_altitude_m > 0.0 and self.depth_m > SHALLOWEST_M:
            return SHALLOWEST_M + self.min_altitude_m
        return self.depth_m + max(self.min_water_m, self.min_altitude_m)

    def without_surfacing(self) -> VehicleConfig:
        """This configuration without surfacings, unless the mission file asks for them."""
        return self if self.surfacings is not None else replace(self, surfacings=0)

    @property
    def stop_at_end(self) -> Stop:
        """The stop after the last leg."""
        return self.stop("vehicle.at_end", self.at_end)

    def stop(self, key: str, name: str) -> Stop:
        """The stop for the value `name` of parameter `key`; GO_TO leads to the recovery position.

        Raises:
            ParameterError: if the recovery position is not given.
        """
        north_m, east_m = self.recovery_north_m, self.recovery_east_m
        if name != "go_to":
            return Stop(action=STOPS[name])
        if north_m is None or east_m is None:
            raise ParameterError(
                f"{key}: 'go_to' needs a recovery position, but vehicle.recovery_north_m, recovery_east_m are "
                f"{north_m}, {east_m}"
            )
        return Stop(action=STOPS[name], position_m=(north_m, east_m))
