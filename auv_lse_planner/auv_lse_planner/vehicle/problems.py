"""Problems of a planner, as texts for people.

Each function gives a text for each problem, by the problem's key. A key names the kind of problem (and the team mate,
where it is about one) and stays the same while the problem lasts; its text may change from call to call.
"""

from __future__ import annotations

from collections.abc import Mapping

from auv_lse_common.mission_file.sections.planner import PlannerConfig
from auv_lse_planner.methods.team import Team
from auv_lse_planner.paths.free_space import HOLD_BEYOND_M, FreeSpace
from auv_lse_planner.vehicle.travel import Travel

#: A mate that has been silent for this share of the time for which its plan counts is named.
SILENT_SHARE = 0.25
#: After this time (s) without mission/state from safety_node, warn: it has had time to restart.
STATE_SILENT_S = 15.0


def of_odometry(now_s: float, travel: Travel, planner: PlannerConfig, started: bool) -> dict[str, str]:
    """No odometry after the start, or none for too long."""
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
    """No mission/state for this time (s); safety_node sends one every second."""
    if silent_s <= STATE_SILENT_S:
        return {}
    return {
        "state old": f"mission/state: last {silent_s:.0f} s ago; expected one a second: limits may be unwatched, is "
        "safety_node running?"
    }


def of_counts(totals: Mapping[str, int], recent: Mapping[str, int]) -> dict[str, str]:
    """What was ignored or given up lately: odometry, plans that cannot be followed, legs not finished in time.

    Args:
        totals: How many in all: "odometry absurd", "odometry jumps", "plans refused", "legs given up".
        recent: How many of them lately (`Recent`).
    """
    texts = {
        "odometry absurd": "odometry: {} messages ignored: not finite, or more than 1000 km from the origin",
        "odometry jumps": "odometry: {} places refused that the vehicle cannot have reached",
        "plans refused": "team: {} received plans could not be rebuilt and were ignored",
        "legs given up": "travel: the end of {} legs was not passed in time; the mission went on without",
    }
    return {key: text.format(f"{recent[key]} (of {totals[key]})") for key, text in texts.items() if recent.get(key)}


def of_place(travel: Travel, space: FreeSpace) -> dict[str, str]:
    """A place outside of the area."""
    found: dict[str, str] = {}
    if travel.estimate is None:
        return found
    outside_m = -space.clearance_m(travel.estimate.north_m, travel.estimate.east_m)
    if outside_m > HOLD_BEYOND_M:
        found["outside"] = f"place: {outside_m:.0f} m outside of the area, more than {HOLD_BEYOND_M:.0f} m: holding"
    elif outside_m > 0.0:
        found["outside"] = f"place: {outside_m:.0f} m outside of the area: coming back"
    return found


def of_map(now_s: float, map_s: float | None, refused: str, planner: PlannerConfig) -> dict[str, str]:
    """A map that cannot be used (`refused` says why, "" if it can), or is too old (`map_s`: when it was received)."""
    found = {"map refused": refused} if refused else {}
    if map_s is not None and now_s - map_s > planner.map_timeout_s:
        found["map old"] = f"map: last {now_s - map_s:.0f} s ago; planning goes on with it"
    return found


def of_team(now_s: float, team: Team, planner: PlannerConfig) -> dict[str, str]:
    """Team mates whose plans count, and are missing, getting old, or have expired."""
    found, ages = {}, team.age_s(now_s)
    for mate in team.others if planner.family.all_mates else team.before:
        if mate not in ages:
            found[f"plan of {mate} missing"] = f"team: no plan of vehicle {mate} heard yet; planning goes on without"
        elif ages[mate] >= planner.plan_expiry_s:
            found[f"plan of {mate} expired"] = f"team: plan of vehicle {mate} expired, heard {ages[mate]:.0f} s ago"
        elif ages[mate] >= SILENT_SHARE * planner.plan_expiry_s:
            found[f"{mate} silent"] = (
                f"team: nothing heard of vehicle {mate} for {ages[mate]:.0f} s; its plan counts until "
                f"{planner.plan_expiry_s:g} s (planner.plan_expiry_s)"
            )
    return found


def of_leg(now_s: float, travel: Travel) -> dict[str, str]:
    """A leg that takes far too long."""
    if travel.leg is None or travel.finished or not travel.overdue(now_s):
        return {}
    return {"leg overdue": f"leg {travel.leg.step}: not finished {now_s - travel.leg_started_s:.0f} s after its start"}
