"""Inflates the map's standard deviations for the comparison of paths.

A stationary prior does not fit a lake both along densely sounded tracks and far from them. On steep ground between
distant tracks, errors have heavier tails than the map's standard deviation suggests, and a planner that relies on it
leaves pieces of the isobath unvisited. The inflation is proportional to the soundings' squared residuals relative to
the prior's expectation (`Posterior.residual_ratio`). The ratio is 0.4 to 1 for one vehicle in a small, steep lake, and
about 0.2 (no inflation) for three vehicles in a larger lake.
"""

from auv_lse_gp.inference.posterior import Posterior

#: Inflation per unit of the residual ratio, and the largest inflation.
MAX_INFLATION = 5.0


def std_inflation(posterior: Posterior) -> float:
    """Factor on the posterior's standard deviations: `MAX_INFLATION` times the ratio, in [1, MAX_INFLATION].

    It is 1 without data.
    """
    if not posterior.data_rows:
        return 1.0
    return min(max(1.0, MAX_INFLATION * posterior.residual_ratio), MAX_INFLATION)
