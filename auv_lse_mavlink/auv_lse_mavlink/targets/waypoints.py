"""The targets that lead an autopilot along the planner's waypoints and to its stops."""

import dataclasses
import math
from collections.abc import Callable

from auv_lse_common.topics.records import Waypoint
from auv_lse_common.vocabulary.mission_run import Action, Stop
from auv_lse_mavlink.messages.conversion import Target


def target_of(waypoint: Waypoint) -> Target:
    """The end of a waypoint's leg."""
    heading_rad, north_m, east_m = waypoint.end
    return Target(
        north_m=north_m,
        east_m=east_m,
        depth_m=waypoint.depth_m,
        heading_rad=heading_rad,
        step=waypoint.leg.step,
        speed_mps=waypoint.speed_mps if waypoint.speed_mps > 0.0 else math.nan,
        then=waypoint.then,
        surface=waypoint.leg.surface,
        begins_m=(waypoint.leg.north_m, waypoint.leg.east_m),
    )


def ends_to_reach(waypoint: Waypoint, north_m: float, east_m: float) -> list[Target]:
    """The targets of a restarted link: the end of a waypoint's leg, preceded by its start if that is still ahead.

    Where the leg leads back, the short cut to its end would never pass the end of the previous leg. On the leg itself
    its start lies behind: the vehicle must not turn back to it.

    Args:
        waypoint: The last waypoint before the restart.
        north_m: Where the vehicle is, north (m).
        east_m: And east (m).
    """
    leg, end = waypoint.leg, target_of(waypoint)
    if leg.progress_m(north_m, east_m) > 0.0:
        return [end]
    start = Target(
        north_m=leg.north_m, east_m=leg.east_m, depth_m=waypoint.depth_m, heading_rad=leg.heading_rad, step=leg.step - 1
    )
    return [start, end]


def shifted(target: Target, own_depth: Callable[[float], float]) -> Target:
    """A target in the autopilot's own depth."""
    return dataclasses.replace(target, depth_m=own_depth(target.depth_m))


def following(target: Target, stop: Stop) -> Target:
    """The target of a stop that follows `target`."""
    if stop.action is Action.GO_TO:
        north_m, east_m = stop.position_m
        heading_rad = math.atan2(east_m - target.east_m, north_m - target.north_m)
        return dataclasses.replace(
            target,
            north_m=north_m,
            east_m=east_m,
            heading_rad=heading_rad,
            step=target.step + 1,
            then=Stop(action=Action.HOLD),
        )
    up = stop.action is Action.SURFACE
    depth_m = 0.0 if up else target.depth_m
    return dataclasses.replace(target, depth_m=depth_m, step=target.step + 1, then=None, at_surface=up)
