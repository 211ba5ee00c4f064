"""Joint routes of a team, which every vehicle computes alike before it has heard of the others (`search/routing.py`).

The routes start at this vehicle's configured start and rest on the prior alone: neither soundings nor received plans
change them. Of several node spacings, those routes are taken that lower the map's expected risk most by the mission's
end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.operating_area import Grid
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.support.compiled import USE_NUMBA
from auv_lse_common.vocabulary.naive_ids import FITTED
from auv_lse_common.vocabulary.plan import NONE, Plan
from auv_lse_gp.inference.banks import Banks
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.rollout import PlannedPath, Rollout
from auv_lse_planner.paths.steering import Steering
from auv_lse_planner.reward.anytime import AnytimeReward, Weighting
from auv_lse_planner.search.routing import Ground, free_area_m2, routes_m

Array = NDArray[np.float64]

#: Numbers of nodes that are tried, relative to the one whose spacing is that of lanes over the whole area.
NODES = (0.7, 0.85, 1.0, 1.15, 1.3)
#: Of a single vehicle: smallest and largest number, and how many are tried.
ALONE_NODES = (0.7, 1.35, 14)
#: Most nodes; with more, the routes would take too long to compute.
MAX_NODES = 400


class TeamRoutes:
    """The routes of all vehicles, and what they and a team of lawnmowers are expected to achieve."""

    def __init__(self, settings: PlannerSettings, space: FreeSpace, rollout: Rollout, grid: Grid) -> None:
        """Prepares; the routes are computed when they are first used.

        Args:
            grid: Places over which the map's risk is summed.
        """
        self._settings, self._space, self._rollout = settings, space, rollout
        banks = Banks.of(settings.area, settings.level_set.level_m)
        self._points = CachedPoints(Posterior(settings.gp, banks=banks), grid.places_m)
        v = settings.vehicle
        self._start = Plan.at(0, np.array([v.start_heading_rad, v.start_north_m, v.start_east_m]), (), NONE).state

    @cached_property
    def lines_m(self) -> list[Array]:
        """A polyline (n + 1, 2) for each vehicle, from its start.

        Empty without `planner.team_routes`, for a single vehicle, which gains nothing by routes, with nodes closer than
        a turn or too many of them, and where lanes are expected to achieve more.
        """
        steps, vehicles = self._settings.mission.steps, self._settings.mission.vehicles
        legs_m, turn_m = steps * self._space.motion.leg_length_m, 2.0 * self._space.motion.radius_m
        area_m2 = free_area_m2(self._space)
        if (
            not self._settings.planner.team_routes
            or vehicles == 1
            or not area_m2
            or area_m2 < turn_m * vehicles * legs_m
        ):
            return []
        usual = (vehicles * legs_m) ** 2 / area_m2
        if usual > MAX_NODES:
            return []
        ground = Ground(self._space)
        weights = self._weights(ground)
        counts = sorted({max(vehicles, round(share * usual)) for share in NODES})
        found = [routes_m(ground, self._start[1:], weights, vehicles, legs_m, count) for count in counts]
        ends = [self.expected_end([self._path(line).leg_places_m for line in lines]) for lines in found]
        best = int(np.argmax(np.round(ends, 6)))  # rounded: alike on all machines
        return found[best] if ends[best] > self.lanes_end else []

    def alone_m(self, start_m: Array, legs: int, deadline: Callable[[], bool] | None = None) -> list[Array]:
        """Routes of a single vehicle over different numbers of nodes, each a polyline (n + 1, 2) of `legs` legs.

        Empty for a team, with too many nodes, and without compiled code, which would take minutes.

        Args:
            deadline: Returns whether to stop, with the routes so far; None: no deadline.
        """
        length_m, area_m2 = legs * self._space.motion.leg_length_m, free_area_m2(self._space)
        if self._settings.mission.vehicles > 1 or not USE_NUMBA or not area_m2 or length_m**2 > MAX_NODES * area_m2:
            return []
        ground = Ground(self._space)
        weights, usual = self._weights(ground), length_m**2 / area_m2
        counts = sorted({max(2, round(share * usual)) for share in np.linspace(*ALONE_NODES)})
        routes = []
        for count in counts:
            if deadline is not None and deadline():
                break
            routes.append(routes_m(ground, start_m, weights, 1, length_m, count)[0])
        return routes

    def _weights(self, ground: Ground) -> Array:
        """Prior risk at the ground's places."""
        posterior = self._points.posterior
        places_m = np.asarray(0.01 * ground.places_cm, dtype=np.float64)
        std_m = np.sqrt(posterior.kernel.variance(posterior.kernel.scale(places_m)))
        return np.asarray(LevelSet.of(self._settings.level_set).risk(posterior.prior_mean(places_m), std_m))

    def plan(self, vehicle: int) -> Plan:
        """The route of a vehicle (from 1), as explicit actions from the start."""
        return Plan.at(0, self._start, tuple(int(a) for a in self._actions(self.lines_m[vehicle - 1])), NONE)

    @cached_property
    def lanes_end(self) -> float:
        """Drop of the map's risk expected of a team that mows fitted lanes."""
        ids = [FITTED[k % len(FITTED)] for k in range(self._settings.mission.vehicles)]
        return self.expected_end([self._rollout.path(0, self._start, (), i).leg_places_m for i in ids])

    def expected_end(self, places_m: Sequence[Array]) -> float:
        """Drop of the map's risk expected at the mission's end, with the places (L, n, 2) of each vehicle."""
        own, *others = places_m
        mates = [(np.repeat(np.arange(1.0, len(m) + 1.0), m.shape[1]), m.reshape(-1, 2)) for m in others]
        steps = self._settings.mission.steps
        reward = AnytimeReward(self._points, self._settings.level_set, mates, Weighting(steps, 0, steps))
        return reward.value(own).expected_end

    def _actions(self, line_m: Array) -> NDArray[np.int64]:
        leg_m = self._space.motion.leg_length_m
        return Steering(self._space).along(self._start, line_m, leg_m, self._settings.mission.steps)

    def _path(self, line_m: Array) -> PlannedPath:
        return self._rollout.path(0, self._start, tuple(int(a) for a in self._actions(line_m)), NONE)
