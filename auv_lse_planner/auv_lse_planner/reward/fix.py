"""Gain of a fix: the reduction of the loss that uncertain positions of soundings cause.

The planners' risk undervalues a fix: the prior's variance is several times the map's squared errors
(docs/design/positions.md), so the variance due to uncertain positions hardly counts. The gain is therefore computed
with the variance estimated from the soundings. Let v be the map's variance without position errors, D the position
effects (`Posterior`), D_1 those that a fix removes, and c^2 = `Posterior.variance_scale`:

    gain = sum over the map of r(mean, sqrt(c^2 v + D^2)) - r(mean, sqrt(c^2 v + D^2 - D_1^2)).

The gain has the unit of the map's risk and is summed over the same locations as a path's reward. For c = 0 it is the
area by which the isobath may be displaced, times the cost of an error. It ignores the benefit for future soundings,
which start from a better known position.
"""

import numpy as np

from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.level_set.bayes_risk import LevelSet


def gain_of_fix(points: CachedPoints, level_set: LevelSetConfig) -> float:
    """Gain of an immediate fix of this vehicle; 0 if positions are assumed exact.

    Args:
        points: The map's locations, of a posterior without planned locations.
    """
    posterior = points.posterior
    if not posterior.positions_uncertain:
        return 0.0
    now = points.current()
    parts = (now.white[:, : posterior.data_rows] @ posterior.white_position_effect) ** 2
    by_positions, by_fix = parts.sum(axis=1), parts[:, :2].sum(axis=1)
    others = posterior.variance_scale * np.maximum(now.data_var_m2 - by_positions, 0.0)
    levels = LevelSet.of(level_set)
    before = levels.risk(now.mean_m, np.sqrt(others + by_positions))
    after = levels.risk(now.mean_m, np.sqrt(others + by_positions - by_fix))
    return float(np.sum(before - after))
