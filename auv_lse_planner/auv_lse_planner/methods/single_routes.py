"""Routes of a single vehicle over the whole ground, from which the search for its first path starts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support.compiled import USE_NUMBA
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.methods.method import PlanningContext
from auv_lse_planner.search.routing import Ground, free_area_m2, route_m

Array = NDArray[np.float64]

#: Numbers of nodes, relative to the one whose spacing is that of lanes over the whole area: smallest, largest, and how
#: many are tried.
NODES = (0.7, 1.35, 10)
#: Most nodes; with more, the routes would take too long to compute.
MAX_NODES = 400


def single_routes_m(
    context: PlanningContext, start_m: Array, legs: int, deadline: Callable[[], bool] | None = None
) -> list[Array]:
    """Routes over different numbers of nodes, each a polyline (n + 1, 2) of `legs` legs.

    Empty for a team, with too many nodes, and without compiled code, which would take minutes.

    Args:
        start_m: North and east, shape (2,).
        deadline: Returns whether to stop, with the routes so far; None: no deadline.
    """
    length_m, area_m2 = legs * context.space.motion.leg_length_m, free_area_m2(context.space)
    is_team = context.settings.mission.vehicles > 1
    if is_team or not USE_NUMBA or not area_m2 or length_m**2 > MAX_NODES * area_m2:
        return []
    ground = Ground(context.space)
    weights, usual = _prior_risk(context, ground), length_m**2 / area_m2
    routes: list[Array] = []
    for count in sorted({max(2, round(share * usual)) for share in np.linspace(*NODES)}):
        if deadline is not None and deadline():
            break
        routes.append(route_m(ground, start_m, weights, length_m, count))
    return routes


def _prior_risk(context: PlanningContext, ground: Ground) -> Array:
    """Prior risk at the ground's locations."""
    posterior = context.posterior
    locations_m = np.asarray(0.01 * ground.locations_cm, dtype=np.float64)
    std_m = np.sqrt(posterior.kernel.variance(posterior.kernel.scale(locations_m)))
    return np.asarray(LevelSet.of(context.settings.level_set).risk(posterior.prior_mean(locations_m), std_m))
