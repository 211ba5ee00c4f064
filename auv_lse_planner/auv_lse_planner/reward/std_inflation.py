"""Inflation of the map's standard deviations where paths are compared.

A stationary prior does not fit a lake both along densely sounded tracks and far from any. Where tracks are wide apart
on steep ground, errors between them have heavier tails than the map's standard deviation, and a planner that trusts it
leaves pieces of the isobath unvisited. The soundings show how far that goes: by the ratio of their squared residuals to
what the prior expects (`Posterior.residual_ratio`). The ratio is 0.4 to 1 for one vehicle in a small and steep lake,
and about 0.2 for three in a larger one, which hardly inflates at all.
"""

from __future__ import annotations

from auv_lse_gp.inference.posterior import Posterior

#: Inflation for each unit of the residuals' ratio, and the largest inflation.
MAX_INFLATION = 5.0


def std_inflation(posterior: Posterior) -> float:
    """Factor on the posterior's standard deviations: `MAX_INFLATION` times the ratio, in [1, MAX_INFLATION].

    It is 1 without data.
    """
    if not posterior.data_rows:
        return 1.0
    return min(max(1.0, MAX_INFLATION * posterior.residual_ratio), MAX_INFLATION)
