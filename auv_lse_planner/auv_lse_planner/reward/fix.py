"""What a fix brings: how much less is lost because soundings are not where they are booked.

The map's own risk undervalues it. Its prior is wider than lakes are, so that its variance is several times the square
of its errors (docs/places.md), and beside that variance those of places hardly count. What is lost to places is
therefore priced beside an honest variance of the depth: with v the map's variance without places, D the place effects
(`Posterior`), D_1 those that a fix takes away, and h = `HONEST`,

    worth = sum over the map of r(mean, sqrt(h v + D^2)) - r(mean, sqrt(h v + D^2 - D_1^2)),

in the unit of the map's risk, summed over the same places as a path's reward. Where h = 0, it is the area between the
isobath and where it may be displaced to, times the cost of an error. What is not sounded yet does not count, though it
gains, too: later soundings begin at a known place.
"""

from __future__ import annotations

import numpy as np

from auv_lse_gp.kept import KeptColumns
from auv_lse_gp.risk import LevelSet

#: The square of the map's errors over its variance, where places are known.
HONEST = 0.2


def worth_of_fix(kept: KeptColumns, level_set: LevelSet) -> float:
    """What a fix of the vehicle would bring, now; 0 where places count as known.

    Args:
        kept: The map's places, of a posterior without planned places.
        level_set: Level and costs.
    """
    posterior = kept.posterior
    if not posterior.places_uncertain:
        return 0.0
    columns = kept.columns()
    parts = (columns.white[:, : posterior.data_rows] @ posterior.place_white) ** 2
    by_places, by_fix = parts.sum(axis=1), parts[:, :2].sum(axis=1)
    others = HONEST * np.maximum(columns.data_var_m2 - by_places, 0.0)
    before = level_set.risk(columns.mean_m, np.sqrt(others + by_places))
    after = level_set.risk(columns.mean_m, np.sqrt(others + by_places - by_fix))
    return float(np.sum(before - after))
