"""Expected risk of tours and of mowing at a third of the mission and at its end, before any measurement.

    python -m benchmarks.planning.tour_frontier [--weights 0 1 2 4]

One vehicle in the small area, which it can just cover, with the default prior. Tours are optimized from several
starts with each anytime weight, steered along, and bent as long as that brings more. Risk is the mean over the map,
using 1, 2 and 4 locations per leg. Fewer locations underestimate the value of turning paths.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.methods import MAP_LOCATIONS_PER_LEG
from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.vocabulary.naive_ids import FITTED, STRIPS
from auv_lse_common.vocabulary.plan import NONE, Plan, length_m
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_planner.methods.tour_candidates import LINE_LOCATIONS
from auv_lse_planner.paths.steering import Steering
from auv_lse_planner.reward.anytime import AnytimeReward, Weighting
from auv_lse_planner.search.tour import TourSearch
from auv_lse_planner.vehicle.vehicle_planner import COARSE_M, VehiclePlanner
from benchmarks.command import end_with, parser_of
from benchmarks.planning.planner_loop import settings_for
from benchmarks.planning.planner_methods import area

Array = NDArray[np.float64]

#: Locations of each leg at which risk is computed.
LOCATIONS = (1, 2, 4)
#: Tours that are optimized for each weight, and iterations: of each, then whenever the best is bent.
STARTS, ITERATIONS, MORE = 3, 100, 40
#: How often a tour is bent at most.
MOST_BENDS = 3


class Frontier:
    """Optimizes tours of one vehicle without data; reports the risk expected after its plans."""

    def __init__(self, legs: int) -> None:
        """Takes a mission of so many legs."""
        settings = settings_for("tour", 1, area("small")[1], mission={"steps": legs})
        planner = VehiclePlanner(1, settings, np.random.default_rng(1))
        grounds = OperatingArea(settings.area)
        spacing = settings.planner.map_spacing_m
        self._legs, self._level_set, self._rollout = legs, settings.level_set, planner.rollout
        self._kept, self._coarse = (
            CachedPoints(planner.posterior, grounds.grid(m).locations_m) for m in (spacing, max(COARSE_M, spacing))
        )
        self._search, self._steering = TourSearch(planner.space, MAP_LOCATIONS_PER_LEG), Steering(planner.space)
        self._start = np.zeros(3)

    def _reward(self, weight: float) -> AnytimeReward:
        legs = self._legs
        return AnytimeReward(self._kept, self._level_set, [], Weighting(legs, 0, legs, weight), self._coarse)

    def naive(self, naive_path: int) -> Plan:
        """A naive path from the start."""
        return Plan.at(0, self._start, (), naive_path)

    def tour(self, weight: float) -> Plan:
        """The tour of one anytime weight, bent as long as that brings more, `MOST_BENDS` times at most."""
        reward, search, legs = self._reward(weight), self._search, self._legs
        lanes = self._rollout.follow(self.naive(FITTED[0])).states[:, 1:]
        starts = [search.resampled(lanes, legs), *search.starts(self._start[1:], legs, 1, 1)]
        starts.sort(key=lambda w: -reward.coarse_value(search.locations(w, legs)))
        found = max((search.improve(w, legs, reward, ITERATIONS) for w in starts[:STARTS]), key=lambda f: f.value)
        best = Plan.at(0, self._start, (), NONE, search.tour(found.waypoints_m, legs))
        for _ in range(MOST_BENDS):
            line = np.concatenate([self._start[None, 1:], self._locations(best, LINE_LOCATIONS).reshape(-1, 2)])
            bent = search.bend(line, legs, reward, MORE)
            actions = self._steering.along(self._start, bent.waypoints_m, length_m(line) / legs, legs)
            plan = Plan.at(0, self._start, tuple(int(a) for a in actions), NONE)
            worth, before = (reward.value(self._locations(p, MAP_LOCATIONS_PER_LEG)).weighted for p in (plan, best))
            if worth <= before:
                break
            best = plan
        return best

    def _locations(self, plan: Plan, count: int) -> Array:
        """So many locations of each leg of a plan, (L, count, 2)."""
        path = self._rollout.follow(plan)
        return self._rollout.leg_locations(path.states[:-1], path.actions, count)[: self._legs]

    def left(self, plan: Plan) -> list[tuple[float, float]]:
        """Mean risk expected at a third and at the end, for each number of `LOCATIONS`."""
        reward = self._reward(0.0)
        rows = []
        for count in LOCATIONS:
            locations = self._locations(plan, count)
            drops = [reward.value(locations[:legs]).expected_end for legs in (self._legs // 3, self._legs)]
            third, end = ((reward.risk_before - drop) / len(self._kept.locations_m) for drop in drops)
            rows.append((third, end))
        return rows


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = parser_of("benchmarks.planning.tour_frontier", __doc__)
    parser.add_argument("--weights", type=float, nargs="+", default=[0.0, 1.0, 2.0, 4.0], help="anytime weights")
    parser.add_argument("--steps", type=int, default=100, help="legs of the mission (default: %(default)s)")
    options = parser.parse_args(arguments)
    frontier = Frontier(options.steps)
    print("| path | " + " | ".join(f"1/3, {n} a leg | end, {n} a leg" for n in LOCATIONS) + " |")
    print("|---" * (1 + 2 * len(LOCATIONS)) + "|")
    plans = [("fitted lanes", frontier.naive(FITTED[0])), ("covering strip", frontier.naive(STRIPS[0]))]
    for name, plan in plans:
        print(_row(name, frontier.left(plan)), flush=True)
    for weight in options.weights:
        row = _row(f"tour, anytime weight {weight:g}", frontier.left(frontier.tour(weight)))
        print(row, flush=True)


def _row(name: str, left: list[tuple[float, float]]) -> str:
    return "| " + " | ".join([name, *(f"{third:.2f} | {end:.3f}" for third, end in left)]) + " |"


if __name__ == "__main__":
    end_with(main)
