"""Texts for operators about a planner's problems.

Each function returns the texts by problem key. A key names the kind of problem, and the team mate if one is concerned.
It stays the same while the problem lasts; the text may change from call to call.
"""

from collections.abc import Mapping

from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_common.support.arrays import Array
from auv_lse_planner.methods.team import Team
from auv_lse_planner.paths.free_space import HOLD_BEYOND_M, FreeSpace
from auv_lse_planner.vehicle.travel import Travel

#: Report a team mate that has been silent for this share of `planner.plan_expiry_s`.
SILENT_SHARE = 0.25
#: Warn after this time (s) without mission/state; it leaves safety_node enough time to restart.
STATE_SILENT_S = 15.0


def of_odometry(now_s: float, travel: Travel, planner: PlannerConfig, started: bool) -> dict[str, str]:
    """Odometry is missing after the start, or too old."""
    if travel.estimate is None:
        return {"odometry missing": "odometry: none received; no planning without it"} if started else {}
    age_s = now_s - travel.estimate.now_s
    if age_s <= planner.odometry_timeout_s:
        return {}
    return {
        "odometry old": f"odometry: last {age_s:.1f} s ago, more than planner.odometry_timeout_s = "
        f"{planner.odometry_timeout_s:g} s; planning has stopped"
    }


def of_state(silent_s: float) -> dict[str, str]:
    """No mission/state has arrived for `silent_s` (s); safety_node publishes it every second."""
    if silent_s <= STATE_SILENT_S:
        return {}
    return {
        "state old": f"mission/state: last one {silent_s:.0f} s ago, but one is due every second. Safety limits may be "
        "unmonitored; check that safety_node is running"
    }


def of_counts(totals: Mapping[str, int], recent: Mapping[str, int]) -> dict[str, str]:
    """Recently ignored odometry, team plans that cannot be followed, and legs not finished in time.

    Args:
        totals: Total counts of "odometry impossible", "odometry jumps", "plans refused" and "leg timeouts".
        recent: Recent counts of the same (`Recent`).
    """
    texts = {
        "odometry impossible": "odometry: {} messages ignored: not finite, or more than 1000 km from the origin",
        "odometry jumps": "odometry: {} positions rejected because the vehicle cannot have reached them",
        "plans refused": "team: {} received plans could not be rebuilt and were ignored",
        "leg timeouts": "travel: {} legs timed out before the vehicle passed their end; continued with the next leg",
    }
    return {key: text.format(f"{recent[key]} (of {totals[key]})") for key, text in texts.items() if recent.get(key)}


def of_position(travel: Travel, space: FreeSpace, map_offset_m: Array) -> dict[str, str]:
    """The problem of a vehicle outside the area; empty inside, margin included, or without an estimate.

    Args:
        map_offset_m: Offset from odometry to map coordinates: heading (rad), north, east (m), shape (3,).
    """
    found: dict[str, str] = {}
    if travel.estimate is None:
        return found
    clearance_m = space.clearance_m(
        travel.estimate.north_m + float(map_offset_m[1]), travel.estimate.east_m + float(map_offset_m[2])
    )
    outside_m = -clearance_m - space.margin_m
    if clearance_m < -HOLD_BEYOND_M:
        found["outside"] = f"position: {outside_m:.0f} m outside the area, more than {HOLD_BEYOND_M:.0f} m: holding"
    elif outside_m > 0.0:
        found["outside"] = f"position: {outside_m:.1f} m outside the area: returning"
    return found


def of_map(now_s: float, map_s: float | None, refused: str, planner: PlannerConfig) -> dict[str, str]:
    """The map is unusable (`refused`: the reason, else "") or too old (`map_s`: time of reception, s)."""
    found = {"map refused": refused} if refused else {}
    if map_s is not None and now_s - map_s > planner.map_timeout_s:
        found["map old"] = f"map: last {now_s - map_s:.0f} s ago; planning continues with it"
    return found


def of_team(now_s: float, team: Team, planner: PlannerConfig, travelled_s: float) -> dict[str, str]:
    """Relevant plans of team mates that are missing, getting old or expired.

    Args:
        travelled_s: How long this vehicle's mission has run; a first plan is expected as soon as any later one.
    """
    found, ages, limit_s = {}, team.age_s(now_s), SILENT_SHARE * planner.plan_expiry_s
    for mate in team.others if planner.family.all_mates else team.before:
        if mate not in ages and travelled_s < limit_s:
            continue
        if mate not in ages:
            found[f"plan of {mate} missing"] = f"team: no plan received from vehicle {mate} yet; planning without it"
        elif ages[mate] >= planner.plan_expiry_s:
            found[f"plan of {mate} expired"] = f"team: plan of vehicle {mate} expired, received {ages[mate]:.0f} s ago"
        elif ages[mate] >= limit_s:
            found[f"{mate} silent"] = (
                f"team: no plan from vehicle {mate} for {ages[mate]:.0f} s; its last plan expires after "
                f"{planner.plan_expiry_s:g} s (planner.plan_expiry_s)"
            )
    return found


def of_leg(now_s: float, travel: Travel) -> dict[str, str]:
    """The current leg takes far too long."""
    if travel.leg is None or travel.finished or not travel.overdue(now_s):
        return {}
    return {"leg overdue": f"leg {travel.leg.step}: not finished {now_s - travel.leg_started_s:.0f} s after its start"}
