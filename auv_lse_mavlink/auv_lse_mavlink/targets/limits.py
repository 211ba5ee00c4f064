"""Limits of the targets that an autopilot may be sent: the fence and the greatest depth."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from auv_lse_common.mission_file.parameters import is_given, section
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.mission_file.sections.safety import SafetyConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.safety.fence import Fence
from auv_lse_mavlink.messages.conversion import Target
from auv_lse_mavlink.messages.events import AutopilotEstimate

#: Default depth (m) of a vehicle without `vehicle.depth_m`.
DEFAULT_DEPTH_M = 5.0


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class TargetLimits:
    """Limits of targets.

    Attributes:
        fence: Where they must lie; None: anywhere.
        deepest_m: Greatest depth (m).
        turn_radius_m: Turn radius (m).
        least_altitude_m: Altitude (m) that the vehicle keeps above the ground; 0: none.
        is_afloat: Whether the vehicle travels at the surface only (`vehicle.depth_m: 0`).
    """

    fence: Fence | None = None
    deepest_m: float = math.inf
    turn_radius_m: float = MotionConfig().turn_radius_m
    least_altitude_m: float = 0.0
    is_afloat: bool = False

    def check(self, target: Target, position: AutopilotEstimate | None) -> None:
        """Checks a target; one that leads a vehicle outside the fence back towards it passes.

        Raises:
            ValueError: naming the limit and the value.
        """
        if target.depth_m > self.deepest_m:
            raise ValueError(
                f"target of step {target.step}: depth {target.depth_m:.1f} m is deeper than {self.deepest_m:.1f} "
                "m (safety.max_depth_m)"
            )
        if self.fence is None:
            return
        outside_m = self.fence.outside_m(target.north_m, target.east_m)
        allowed_m = self.fence.margin_m
        if position is not None:
            allowed_m = max(allowed_m, self.fence.outside_m(position.north_m, position.east_m))
        if outside_m > allowed_m:
            raise ValueError(
                f"target of step {target.step}: {outside_m:.0f} m outside the area (north {target.north_m:.0f}, "
                f"east {target.east_m:.0f} m), more than {allowed_m:.0f} m (safety.fence_margin_m)"
            )


def target_limits(parameters: Mapping[str, Any], where: str) -> TargetLimits:
    """The limits of a vehicle's targets, from the sections `area`, `safety` and `vehicle`; `where` is for messages.

    Raises:
        ParameterError: if one of these sections cannot be used.
    """
    safety = section(SafetyConfig, parameters, "safety", where)
    area = section(AreaConfig, parameters, "area", where)
    vehicle = section(VehicleConfig, parameters, "vehicle", where)
    depth_m = vehicle.depth_m if is_given(parameters, "vehicle.depth_m") else DEFAULT_DEPTH_M
    has_fence = is_given(parameters, "area.polygon_m")
    fence = Fence(area.polygon_m, safety.fence_margin_m) if has_fence else None
    radius_m = section(MotionConfig, parameters, "motion", where).turn_radius_m
    is_afloat = depth_m == 0.0
    return TargetLimits(
        fence=fence,
        deepest_m=safety.deepest_m(depth_m),
        turn_radius_m=radius_m,
        least_altitude_m=0.0 if is_afloat else safety.kept_altitude_m(vehicle.min_altitude_m),
        is_afloat=is_afloat,
    )
