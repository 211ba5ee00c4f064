"""A map compared with the true ground."""

import math
from dataclasses import dataclass

import numpy as np

from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.depth_map import DepthField
from auv_lse_record.run_data import GroundGrid
from auv_lse_shore.judge import isobath


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """A map against the true ground (areas in m2, distances in m)."""

    f1: float
    loss: float
    false_safe_m2: float
    false_unsafe_m2: float
    depth_rmse_m: float
    error: isobath.IsobathError

    @property
    def misclassified_m2(self) -> float:
        """Area on the wrong side of the level."""
        return self.false_safe_m2 + self.false_unsafe_m2


def judge(
    field_: DepthField, settings: PlannerSettings, ground: GroundGrid, scored: Mask, truth: list[Array]
) -> Verdict:
    """Compares a map with the true ground on the cells `scored`; `truth` is the true isobath."""
    level = LevelSet.of(settings.level_set)
    mean, std, depth = field_.mean_m[scored], field_.std_m[scored], ground.depth_m[scored]
    called, deep = level.safe(mean, std), depth >= level.level_m
    cell = field_.grid.resolution_m**2
    false_safe, false_unsafe = np.count_nonzero(called & ~deep), np.count_nonzero(~called & deep)
    hits = np.count_nonzero(called & deep)
    both = 2 * hits + false_safe + false_unsafe
    estimate = isobath.trace(
        field_.grid.north_m, field_.grid.east_m, np.where(scored, field_.mean_m, np.nan), level.level_m
    )
    return Verdict(
        f1=2 * hits / both if both else math.nan,
        loss=(level.cost_false_safe * false_safe + level.cost_false_unsafe * false_unsafe) / max(len(mean), 1),
        false_safe_m2=false_safe * cell,
        false_unsafe_m2=false_unsafe * cell,
        depth_rmse_m=float(np.sqrt(np.mean((mean - depth) ** 2))) if len(mean) else math.nan,
        error=isobath.compare(estimate, truth),
    )
