"""Gain of a fix: the drop of the loss from soundings at uncertain places.

The risk that plans minimize undervalues it. Its prior is wider than lakes are, so that its variance is several times
the square of the map's errors (docs/design/places.md), and beside that variance those of places hardly count. What is
lost to places is therefore priced beside the variance that the soundings show: with v the map's variance without
places, D the place effects (`Posterior`), D_1 those that a fix takes away, and c^2 = `Posterior.variance_scale`,

    worth = sum over the map of r(mean, sqrt(c^2 v + D^2)) - r(mean, sqrt(c^2 v + D^2 - D_1^2)),

in the unit of the map's risk, summed over the same places as a path's reward. Where c = 0, it is the area between the
isobath and where it may be displaced to, times the cost of an error. What is not sounded yet does not count, though it
gains, too: later soundings begin at a known place.
"""

from __future__ import annotations

import numpy as np

from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.level_set.bayes_risk import LevelSet


def gain_of_fix(points: CachedPoints, level_set: LevelSetConfig) -> float:
    """Gain of a fix of the vehicle, now; 0 where places count as known.

    Args:
        points: The map's places, of a posterior without planned places.
        level_set: Level and costs.
    """
    posterior = points.posterior
    if not posterior.places_uncertain:
        return 0.0
    now = points.current()
    parts = (now.white[:, : posterior.data_rows] @ posterior.white_place_effect) ** 2
    by_places, by_fix = parts.sum(axis=1), parts[:, :2].sum(axis=1)
    others = posterior.variance_scale * np.maximum(now.data_var_m2 - by_places, 0.0)
    levels = LevelSet.of(level_set)
    before = levels.risk(now.mean_m, np.sqrt(others + by_places))
    after = levels.risk(now.mean_m, np.sqrt(others + by_places - by_fix))
    return float(np.sum(before - after))
