"""Compares a vehicle's battery with its mission: refuses GO, and sends the vehicle home in time. No ROS, no clock."""

from __future__ import annotations

import math
from dataclasses import dataclass

from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.mission import MissionConfig, MotionConfig
from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.safety.battery_use import BatteryUse
from auv_lse_common.vocabulary.health import BATTERY_LASTS, LEGS_LEFT
from auv_lse_common.vocabulary.mission_run import Action
from auv_lse_planner.paths.motion import MotionTable

#: The range of a full battery counts as learned below this relative standard deviation; the filter begins with 0.3.
LEARNED_SHARE = 0.2
#: GO is refused if the battery is expected to last for less than this share of the legs.
LEAST_SHARE = 0.5


@dataclass(slots=True)
class BatteryWatch:
    """The battery of one vehicle, its mission, and the way to its recovery position.

    Attributes:
        use: The estimated use of charge, updated under way.
        legs: Legs of the mission.
        leg_m: Length of a leg.
        stated_m: Range (m) of a full battery by `vehicle.battery_km`; None: not stated.
        home_m: The recovery position (north, east); None: the mission ends elsewhere.
        farthest_m: Greatest distance from it in the area.
        warning: Warning of the last GO; "" if none.
        went: Whether a GO was accepted.
    """

    use: BatteryUse
    legs: int
    leg_m: float
    stated_m: float | None
    home_m: tuple[float, float] | None
    farthest_m: float
    warning: str = ""
    went: bool = False

    @classmethod
    def of(
        cls,
        vehicle: VehicleConfig,
        safety: SafetyConfig,
        area: AreaConfig,
        mission: MissionConfig,
        motion: MotionConfig,
    ) -> BatteryWatch:
        """The watch of a mission's vehicle; with `safety.min_battery` 0 it does nothing."""
        stated_m = None if vehicle.battery_km is None else 1000.0 * vehicle.battery_km
        end = vehicle.stop_at_end
        home_m = end.position_m if end.action is Action.GO_TO else None
        corners = zip(area.polygon_m[::2], area.polygon_m[1::2], strict=True)
        return cls(
            use=BatteryUse(safety.min_battery, stated_m),
            legs=mission.steps,
            leg_m=MotionTable(motion).leg_length_m,
            stated_m=stated_m,
            home_m=home_m,
            farthest_m=0.0 if home_m is None else max(math.dist(home_m, corner) for corner in corners),
        )

    @property
    def is_watched(self) -> bool:
        """Whether a reserve must remain in the battery."""
        return self.use.reserve > 0.0

    def answer_go(self, charge: float) -> tuple[str, str]:
        """Compares the whole mission with a charge (0 to 1; NaN: unknown).

        Returns:
            Reason to refuse GO, and a warning; "" if there is none. Without a stated range or a charge, only a warning.
        """
        if not self.is_watched or self.stated_m is None:
            return "", ""
        if math.isnan(charge):
            return "", "the autopilot reports no charge, so the mission is not compared with vehicle.battery_km"
        lasts_m = (charge - self.use.reserve) * self.stated_m - self.farthest_m
        legs = max(int(lasts_m / self.leg_m), 0)
        if legs >= self.legs:
            return "", ""
        home = f" and up to {self.farthest_m:.0f} m to the recovery position" if self.home_m else ""
        cure = "Charge it, or lower mission.steps" if charge < 1.0 else "Lower mission.steps"
        text = (
            f"the battery ({charge:.0%}) lasts for about {legs} of {self.legs} legs{home} above the reserve of "
            f"{self.use.reserve:.0%} (vehicle.battery_km = {self.stated_m / 1000.0:g}). {cure}"
        )
        return (text, "") if legs < LEAST_SHARE * self.legs else ("", text)

    def take(self, now_s: float, way: tuple[float, float, float, float]) -> str:
        """Adds distance (m), charge, north, east (m); returns why the mission must end now, "" if it need not."""
        way_m, charge, north_m, east_m = way
        self.use.take(now_s, charge, way_m, north_m, east_m)
        if self.home_m is None or not self.use.must_turn(self._to_home(north_m, east_m)):
            return ""
        home_m = math.dist((north_m, east_m), self.home_m)
        left = self.use.charge  # one reading may jump, or be missing
        return f"the battery ({left:.0%}) just suffices for the {home_m:.0f} m to the recovery position"

    def values(self, north_m: float, east_m: float) -> dict[str, str]:
        """Diagnostics: the legs that the battery has left, and the range of a full battery once it is learned."""
        if not self.use.is_known:
            return {}
        lasts_m, std_m = self.use.lasts_m
        found = {LEGS_LEFT: f"{int(self.use.left_m(self._to_home(north_m, east_m)) / self.leg_m)}"}
        if std_m < LEARNED_SHARE * lasts_m:  # else the charge has hardly fallen yet
            found[BATTERY_LASTS] = f"{lasts_m / 1000.0:.2f} km (standard deviation {std_m / 1000.0:.2f} km)"
        return found

    def _to_home(self, north_m: float, east_m: float) -> tuple[float, float]:
        return (0.0, 0.0) if self.home_m is None else (self.home_m[0] - north_m, self.home_m[1] - east_m)
