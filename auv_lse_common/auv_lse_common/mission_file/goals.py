"""The planning method that follows from a mission's goal."""

from collections.abc import Iterable, Mapping
from typing import Any

from auv_lse_common.mission_file.operating_area import free_m2
from auv_lse_common.mission_file.parameters import ParameterError, is_given, merge, section
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.mission import MissionConfig, MotionConfig

#: Most legs of a vehicle that the method `line` plans; it cannot plan in stages.
MAX_LINE_LEGS = 200
#: Least coverage at which a longer mission, or a large team, with the goal `line` flies `tour`, which then finds as
#: much by its end or more (docs/evidence/planner.md).
TOUR_COVERAGE = 0.8
#: A team is large for its mission with fewer legs than this for each vehicle. Every vehicle has received every plan
#: after one cycle of slots, about .6 legs for each vehicle.
FEW_LEGS = 7


def coverage(area_m2: float, mission: MissionConfig, motion: MotionConfig, gp: GpConfig) -> float:
    """Share of an area within half a length scale of a path, if paths lie farther apart; else more than 1.

    Within half a length scale, depths correlate with the soundings by 0.8 or more (Matern 5/2: 0.83).
    """
    return mission.vehicles * mission.steps * motion.leg_length_m * gp.length_scale_m / area_m2


def is_large_team(mission: MissionConfig) -> bool:
    """Whether a team has too few legs to correct first plans that overlap."""
    return mission.vehicles > 1 and mission.steps < FEW_LEGS * mission.vehicles


def with_method(parameters: Mapping[str, Any], team: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A node's nested parameters with the planning method that follows from `mission.goal`, unless they name one.

    Args:
        parameters: Those of one vehicle, or of all.
        team: Those of all vehicles, with their method, which a vehicle without one gets; None: it follows here.
    """
    if not isinstance(parameters.get("planner", {}), Mapping) or is_given(parameters, "planner.method"):
        return dict(parameters)
    method = _method(parameters) if team is None or not is_given(team, "planner.method") else team["planner"]["method"]
    return merge(parameters, {"planner": {"method": method}})


def finds_method(goal: str, given: Iterable[Mapping[str, Any]]) -> bool:
    """Whether the method follows from the goal `line`: no vehicle's nested parameters, as `given`, name one."""
    return goal == "line" and not any(is_given(own, "planner.method") for own in given)


def _method(parameters: Mapping[str, Any]) -> str:
    """The method that follows from nested parameters; any method for unusable ones, which are reported elsewhere."""
    try:
        mission = section(MissionConfig, parameters, "mission", "")
        if mission.goal == "chart":
            return "tour"
        area_m2 = free_m2(section(AreaConfig, parameters, "area", ""))
        motion, gp = section(MotionConfig, parameters, "motion", ""), section(GpConfig, parameters, "gp", "")
    except ParameterError:
        return "tour"
    return line_method(area_m2, mission, motion, gp)


def line_method(area_m2: float, mission: MissionConfig, motion: MotionConfig, gp: GpConfig) -> str:
    """The method that follows from the goal `line`."""
    covered = coverage(area_m2, mission, motion, gp) >= TOUR_COVERAGE
    return "tour" if covered and (mission.steps > MAX_LINE_LEGS or is_large_team(mission)) else "line"
