"""Section `vehicle`: where a vehicle starts, how deep and fast it travels, and how its mission ends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from auv_lse_common.mission_file.parameter_file import merge
from auv_lse_common.mission_file.parameters import ParameterError, parameter
from auv_lse_common.vocabulary.mission_run import STOPS, Stop

#: Surfacings for a fix in a mission at most, where `vehicle.surfacings` is left out.
MOST_SURFACINGS = 2
#: Depths (m) that vehicles without one of their own take in turn (the paper's).
DEPTHS_M = (3.0, 4.0, 5.0)


def with_depth(parameters: Mapping[str, Any], vehicle: int) -> Mapping[str, Any]:
    """The parameters of vehicle number `vehicle` with its turn of `DEPTHS_M`, unless they name a depth."""
    own = parameters.get("vehicle", {})
    if not isinstance(own, Mapping) or "depth_m" in own:  # what is no section is refused where it is read
        return parameters
    return merge(parameters, {"vehicle": {"depth_m": DEPTHS_M[(vehicle - 1) % len(DEPTHS_M)]}})


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleConfig:
    """One vehicle: where it starts, how deep and how fast it travels."""

    depth_m: float = parameter(
        3.0, unit="m", low=0.0, help="depth it keeps below the surface; left out of a file: 3, 4, 5 m in turn"
    )
    speed_mps: float = parameter(1.5, unit="m/s", above=0.0, help="speed through the water")
    start_north_m: float = parameter(0.0, unit="m", help="north of the start")
    start_east_m: float = parameter(0.0, unit="m", help="east of the start")
    start_heading_rad: float = parameter(0.0, unit="rad", help="heading at the start, clockwise from north")
    start_delay_s: float = parameter(
        0.0,
        unit="s",
        low=0.0,
        help="time at which it sets out, on the simulator's clock (on a real vehicle's UTC clock: long past)",
    )
    start: str = parameter(
        "at_once",
        choices=("at_once", "on_call"),
        help="at_once: the mission starts with the first odometry and, with an autopilot, when that is armed and "
        "follows targets; on_call: when somebody says GO",
    )
    at_end: str = parameter(
        "hold", choices=tuple(STOPS), help="after the last leg; go_to: to recovery_north_m, _east_m"
    )
    recovery_north_m: float | None = parameter(None, unit="m", help="north of the place where it is picked up")
    recovery_east_m: float | None = parameter(None, unit="m", help="east of the place where it is picked up")
    surfacings: int | None = parameter(
        None,
        low=0,
        high=10,
        help="fixes for which it surfaces in a mission at most, where they bring more than the legs that they cost; 0 "
        "for a vehicle that must not; left out: 2, but 0 with the paper's methods (planner.method augmented, "
        "exponential_quadratic, plain), with an autopilot (link.kind mavlink), of which its owner must say that it has "
        "GPS and may come up, and with ideal simulated navigation; none without places.correct, which tells what they "
        "bring",
    )
    surfacing_s: float = parameter(
        60.0,
        unit="s",
        above=0.0,
        help="time that such a surfacing takes: stop, climb, fix, dive; the mission is so many legs shorter",
    )
    min_water_m: float = parameter(
        3.0,
        unit="m",
        low=0.0,
        help="least water under it: it keeps clear of ground that the map shows shallower than depth_m + this",
    )

    def __post_init__(self) -> None:
        """Checks what holds between the fields.

        Raises:
            ParameterError: if it is to go to a place that is not given.
        """
        self.stop("vehicle.at_end", self.at_end)

    def without_surfacing(self) -> VehicleConfig:
        """These parameters for a vehicle to which a fix is worth nothing: no surfacing unless one is asked for."""
        return self if self.surfacings is not None else replace(self, surfacings=0)

    @property
    def stop_at_end(self) -> Stop:
        """What follows the last leg."""
        return self.stop("vehicle.at_end", self.at_end)

    def stop(self, key: str, name: str) -> Stop:
        """The stop that parameter `key` names; GO_TO leads to the place where the vehicle is picked up.

        Raises:
            ParameterError: if that place is not given.
        """
        north_m, east_m = self.recovery_north_m, self.recovery_east_m
        if name != "go_to":
            return Stop(action=STOPS[name])
        if north_m is None or east_m is None:
            raise ParameterError(
                f"{key}: is 'go_to' and vehicle.recovery_north_m, recovery_east_m are {north_m}, {east_m}; expected a "
                "place (m)"
            )
        return Stop(action=STOPS[name], place_m=(north_m, east_m))
