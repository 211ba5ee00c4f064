"""Planning for a team of AUVs: motion, naive paths, rewards, tree search, and the planner of one vehicle.

The names below are the library's public interface (docs/reference/python/plan.md). Three subpackages are for developers
of the planner: `paths` (free space, and the path of a plan), `reward` (the value of a path) and `search` (the search
for the best path).
"""

from typing import TYPE_CHECKING

from auv_lse_common.support.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from auv_lse_common.mission_file.methods import METHODS
    from auv_lse_common.mission_file.sections.mission import MissionConfig, MotionConfig
    from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings
    from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
    from auv_lse_planner.methods.decision import BoundRecord, Decision, Statistics
    from auv_lse_planner.paths.free_space import FreeSpace
    from auv_lse_planner.paths.motion import MotionTable
    from auv_lse_planner.paths.naive import NaivePaths
    from auv_lse_planner.paths.rollout import PlannedPath, Rollout
    from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner

__all__ = [
    "METHODS",
    "BoundRecord",
    "Decision",
    "FreeSpace",
    "MissionConfig",
    "MotionConfig",
    "MotionTable",
    "NaivePaths",
    "PlannedPath",
    "PlannerConfig",
    "PlannerSettings",
    "Rollout",
    "Statistics",
    "VehicleConfig",
    "VehiclePlanner",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "auv_lse_common.mission_file.sections.mission": ("MissionConfig", "MotionConfig"),
        "auv_lse_common.mission_file.sections.planner": ("PlannerConfig", "PlannerSettings"),
        "auv_lse_common.mission_file.sections.vehicle": ("VehicleConfig",),
        "methods.decision": ("BoundRecord", "Decision", "Statistics"),
        "auv_lse_common.mission_file.methods": ("METHODS",),
        "paths.free_space": ("FreeSpace",),
        "paths.motion": ("MotionTable",),
        "paths.naive": ("NaivePaths",),
        "paths.rollout": ("PlannedPath", "Rollout"),
        "vehicle.vehicle_planner": ("VehiclePlanner",),
    },
)
