"""How much a planner doubts its map where it has not measured.

A stationary prior does not fit a lake both along densely sounded tracks and far from any: where tracks are wide apart
on steep ground, errors between them have heavier tails than the map's standard deviation says, and a planner that
takes such ground for known leaves pieces of the isobath unvisited. So paths are weighed as if standard deviations
were larger, by what the soundings show of the ground: the ratio of their squared residuals to what the prior expects
(`Posterior.residual_ratio`). It is .4 to 1 where one vehicle is on a small and steep lake; three in a larger one have
about a fifth, and hardly any doubt.
"""

from __future__ import annotations

from auv_lse_gp.inference.posterior import Posterior

#: Doubt for each unit of the residuals' ratio, and the largest doubt.
DOUBT = 5.0


def doubt(posterior: Posterior) -> float:
    """Factor on the posterior's standard deviations by which paths are weighed.

    It is `DOUBT` times the ratio, but at least 1 and at most `DOUBT`; 1 without data, where nothing is known to doubt.
    """
    if not posterior.data_rows:
        return 1.0
    return min(max(1.0, DOUBT * posterior.residual_ratio), DOUBT)
