"""Compares methods with hindsight: their share of the gain from the lawnmower to the best paths in hindsight.

    python -m benchmarks.planning.hindsight --lakes 2 [--methods tour fixed_tour] [--vehicles 1] [--mutations 400]

On each lake the light loop flies the methods and the lawnmower. A random search that knows the lake then improves the
flown paths: it shifts waypoints, the vehicles steer along them, and it keeps what does not harm an objective. The
objective of "hindsight" is final risk plus true loss, that of "hindsight on the isobath" the isobath's error. All
paths, flown or improved, are evaluated again with new soundings on a 5 m grid: mean Bayes risk, mean cost of wrong
calls, error of the isobath. Hindsight scores 100 %, the lawnmower 0 %. Hindsight is no bound, only the best result of
`--mutations` mutations.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.methods import METHODS
from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_gp.map.gate import SoundingError
from auv_lse_gp.map.online import OnlineGp
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.paths.rollout import Rollout
from auv_lse_planner.paths.steering import Steering
from auv_lse_shore.judge.isobath import compare, trace
from benchmarks.command import end_with, parser_of
from benchmarks.planning.areas import AREAS, area, lake
from benchmarks.planning.planner_loop import light_mission, settings_for

Array = NDArray[np.float64]

#: The reference of the comparison.
MOWING = "lawnmower"
#: Grid (m) on which paths are judged, and on which mutations are.
JUDGED_M, MUTATED_M = 5.0, 15.0
#: Soundings on a leg, where paths are judged, and where mutations are: these stand for merged soundings.
JUDGED_SOUNDINGS, MUTATED_SOUNDINGS = 8, 2
#: Legs between waypoints, and how far (m) waypoints are shifted: standard deviations.
WAYPOINT_LEGS = 2
SHIFTS_M = (10.0, 25.0, 60.0)


@dataclass(frozen=True, slots=True)
class Judged:
    """Results of paths.

    Attributes:
        risk: Mean Bayes risk at the end.
        loss: Mean cost of the calls that were wrong.
        isobath_m: Mean distance between the estimated and the true isobath; infinite if there is none.
    """

    risk: float
    loss: float
    isobath_m: float

    @property
    def sum(self) -> float:
        """Risk and loss."""
        return self.risk + self.loss


#: What somebody who knows the lake may be after, and how the paths are called that are improved for it.
AIMS: dict[str, Callable[[Judged], float]] = {
    "hindsight": lambda judged: judged.sum,
    "hindsight on the isobath": lambda judged: judged.isobath_m,
}


class Sea:
    """One lake with the vehicles' settings: evaluates paths within the area."""

    def __init__(self, settings: PlannerSettings, ground: Any, seed: int) -> None:
        """Prepares the grids; soundings draw their noise from `seed`."""
        self.settings, self._ground, self._seed = settings, ground, seed
        operating, self.motion = OperatingArea(settings.area), MotionTable(settings.motion)
        space = FreeSpace(operating, self.motion, settings.area.raster_m)
        self._steering = Steering(space)
        naive = NaivePaths(space, settings.planner, operating.polygon)
        steps = settings.mission.steps
        self._fine, self._coarse = (
            Rollout(self.motion, naive, steps, n) for n in (JUDGED_SOUNDINGS, MUTATED_SOUNDINGS)
        )
        margin = operating.margin_m
        self.low_m, self.high_m = operating.polygon.min(axis=0) + margin, operating.polygon.max(axis=0) - margin
        self._grids = {m: operating.grid(m) for m in (JUDGED_M, MUTATED_M)}
        self._truth = {
            m: np.asarray(ground.depth_m(grid.locations_m[:, 0], grid.locations_m[:, 1]))
            for m, grid in self._grids.items()
        }
        self._isobath = {m: self._traced(m, truth) for m, truth in self._truth.items()}
        v = settings.vehicle
        self.start = np.array([v.start_heading_rad, v.start_north_m, v.start_east_m])

    def steered(self, waypoints_m: Array) -> tuple[Array, Array]:
        """States before each leg (L, 3), and actions (L,), of a vehicle that follows waypoints (n, 2)."""
        legs, leg_m = self.settings.mission.steps, self.motion.leg_length_m
        corners = np.concatenate([self.start[None, 1:], waypoints_m])
        at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
        wanted = np.arange(legs + 1) * leg_m
        points = np.column_stack([np.interp(wanted, at, corners[:, k]) for k in (0, 1)])
        actions = self._steering.actions(self.start, points, 1, legs)
        return self.motion.roll(self.start, actions)[:-1], actions

    def roughly(self, waypoints_m: Sequence[Array]) -> Judged:
        """Fast evaluation of all vehicles' waypoints: few soundings without noise on a coarse grid."""
        locations = np.concatenate([self._coarse.leg_locations(*self.steered(w)).reshape(-1, 2) for w in waypoints_m])
        depths = np.asarray(self._ground.depth_m(locations[:, 0], locations[:, 1]))
        known = np.isfinite(depths)
        posterior = Posterior(self.settings.gp)
        noise = np.full(int(known.sum()), self.settings.gp.noise_std_m)
        posterior.follow(Centers(locations[known], depths[known], noise))
        mean, variance = posterior.moments(self._grids[MUTATED_M].locations_m)
        return self._judged(MUTATED_M, mean, np.sqrt(variance))

    def judge(self, waypoints_m: Sequence[Array]) -> Judged:
        """Full evaluation of all vehicles' waypoints: soundings as a vehicle takes and keeps them, on the fine grid."""
        rng = stream(self._seed, "soundings")
        # leg after leg, the vehicles in turn
        locations = np.stack([self._fine.leg_locations(*self.steered(w)) for w in waypoints_m], axis=1).reshape(-1, 2)
        depths = np.asarray(self._ground.depth_m(locations[:, 0], locations[:, 1])) + 0.2 * rng.normal(
            size=len(locations)
        )
        gp = OnlineGp(self.settings.gp)
        for (north, east), depth in zip(locations, depths, strict=True):
            try:
                gp.add(float(north), float(east), max(float(depth), 0.1))
            except SoundingError:
                continue  # no ground is known there
        return self._judged(JUDGED_M, *gp.predict(self._grids[JUDGED_M].locations_m))

    def _judged(self, grid_m: float, mean: Array, std: Array) -> Judged:
        level, truth = LevelSet.of(self.settings.level_set), self._truth[grid_m]
        known = np.isfinite(truth)
        safe, called = (truth >= level.level_m)[known], level.safe(mean, std)[known]
        loss = level.cost_false_safe * np.mean(called & ~safe) + level.cost_false_unsafe * np.mean(~called & safe)
        error = compare(self._traced(grid_m, np.where(known, mean, np.nan)), self._isobath[grid_m]).mean_m
        return Judged(
            float(level.risk(mean, std)[known].mean()), float(loss), float(error) if np.isfinite(error) else np.inf
        )

    def _traced(self, grid_m: float, depth_m: Array) -> list[Array]:
        """The isobath of depths (P,) of a grid's locations."""
        grid = self._grids[grid_m]
        return trace(grid.north_m, grid.east_m, grid.fill(depth_m), self.settings.level_set.level_m)


def improved(
    sea: Sea,
    waypoints_m: Sequence[Array],
    aim: Callable[[Judged], float],
    mutations: int,
    rng: np.random.Generator,
) -> list[Array]:
    """Waypoints of all vehicles after random mutations; those that do not increase `aim` are kept."""
    best = [np.array(w) for w in waypoints_m]
    value = aim(sea.roughly(best))
    for _ in range(mutations):
        vehicle = int(rng.integers(len(best)))
        moved = best[vehicle].copy()
        middle, width = int(rng.integers(len(moved))), int(rng.integers(1, 5))
        share = np.maximum(1.0 - np.abs(np.arange(len(moved)) - middle) / width, 0.0)  # the neighbours come along
        moved += share[:, None] * rng.normal(0.0, SHIFTS_M[int(rng.integers(len(SHIFTS_M)))], 2)
        moved = np.clip(moved, sea.low_m, sea.high_m)
        every = [*best[:vehicle], moved, *best[vehicle + 1 :]]
        found = aim(sea.roughly(every))
        if found <= value:
            best, value = every, found
    return best


def on_lake(options: argparse.Namespace, number: int) -> dict[str, Judged]:
    """Results of each method and of hindsight on one lake."""
    _, section = area(options.area)
    ground = lake(str(number), options.area, None)
    mission = {"steps": options.steps}
    sea = Sea(settings_for(MOWING, options.vehicles, section, mission=mission), ground, number)
    flown: dict[str, list[Array]] = {}
    for method in dict.fromkeys((MOWING, *options.methods)):
        settings = settings_for(method, options.vehicles, section, mission=mission)
        outcome = light_mission(settings, ground, number)
        # the end of the last leg is not among the locations visited
        flown[method] = [
            np.array([*boat.visited, (boat.north, boat.east)])[WAYPOINT_LEGS - 1 :: WAYPOINT_LEGS]
            for boat in outcome.boats
        ]
        print(f"  lake {number}: {method} flown", file=sys.stderr, flush=True)
    result = {method: sea.judge(waypoints) for method, waypoints in flown.items()}
    for name, aim in AIMS.items():
        rng = stream(number, "hindsight")
        tries = [improved(sea, waypoints, aim, options.mutations, rng) for waypoints in flown.values()]
        result[name] = min((sea.judge(waypoints) for waypoints in tries), key=aim)
        print(f"  lake {number}: {name} found", file=sys.stderr, flush=True)
    return result


def table(lakes: Sequence[dict[str, Judged]]) -> str:
    """A Markdown table: means over the lakes; the way gone is that of the means."""
    means = {
        name: np.array([[lake[name].risk, lake[name].loss, lake[name].isobath_m] for lake in lakes]).mean(axis=0)
        for name in lakes[0]
    }
    mowing, best = (means[name][:2].sum() for name in (MOWING, "hindsight"))
    mown_m, best_m = (means[name][2] for name in (MOWING, "hindsight on the isobath"))
    text = [
        "| paths | risk at the end | true loss | sum | way from lawnmower to hindsight | isobath error (m) | way |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, (risk, loss, isobath_m) in sorted(means.items(), key=lambda item: -item[1][:2].sum()):
        text.append(
            f"| {name} | {risk:.3f} | {loss:.3f} | {risk + loss:.3f} | {_way(mowing, risk + loss, best)} "
            f"| {isobath_m:.1f} | {_way(mown_m, isobath_m, best_m)} |"
        )
    return "\n".join(text)


def _way(mowing: float, gone: float, best: float) -> str:
    """How much of the way from mowing's figure to the best one `gone` is."""
    return f"{(mowing - gone) / (mowing - best):.0%}" if mowing > best and np.isfinite(gone) else "-"


def main(arguments: list[str] | None = None) -> int:
    """Command line."""
    parser = parser_of("benchmarks.planning.hindsight", __doc__)
    parser.add_argument("--methods", nargs="+", default=["tour"], choices=METHODS, metavar="METHOD", help="any method")
    parser.add_argument("--vehicles", type=int, default=1, metavar="K", help="size of the team (default: %(default)s)")
    parser.add_argument("--area", default="small", choices=AREAS, help="where (default: %(default)s)")
    parser.add_argument("--lakes", type=int, default=2, help="number of synthetic lakes (default: %(default)s)")
    parser.add_argument("--first", type=int, default=6000, help="seed of the first lake (default: %(default)s)")
    parser.add_argument("--mutations", type=int, default=400, help="mutations of each path (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=100, help="legs of each vehicle (default: %(default)s)")
    options = parser.parse_args(arguments)
    lakes: list[dict[str, Judged]] = []
    try:
        for number in range(options.first, options.first + options.lakes):
            lakes.append(on_lake(options, number))
            line = ", ".join(f"{n} {judged.sum:.3f} {judged.isobath_m:.1f} m" for n, judged in lakes[-1].items())
            print(f"lake {number}: {line}", flush=True)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        if lakes:
            print(table(lakes))
        return 130
    print(table(lakes))
    return 0


if __name__ == "__main__":
    end_with(main)
