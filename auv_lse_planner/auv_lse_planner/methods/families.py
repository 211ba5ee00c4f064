"""The class of each family of methods; `auv_lse_common.mission_file.methods` has their names and properties."""

from __future__ import annotations

from collections.abc import Callable

from auv_lse_planner.methods.baselines import NaivePath, OneLeg
from auv_lse_planner.methods.line import Line
from auv_lse_planner.methods.method import Method, PlanningContext
from auv_lse_planner.methods.tour import Tour
from auv_lse_planner.methods.tree_search import TreeSearch

CLASSES: dict[str, Callable[[PlanningContext], Method]] = {
    "tour": Tour,
    "line": Line,
    "path": TreeSearch,
    "naive": NaivePath,
    "random": OneLeg,
    "benefit": OneLeg,
    "variance": OneLeg,
    "straddle": OneLeg,
}
