"""The tree search against exhaustive search at m = 3, over random situations: the share within 99 % of the optimum.

Run: python -m benchmarks.planning.planner_yardstick --situations 200
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.paths.free_space import FreeSpace
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.paths.rollout import Rollout
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.path_search import SearchProblem, search_path
from auv_lse_planner.search.sequences import PathSequences
from auv_lse_planner.search.tree import every_sequence
from benchmarks.command import end_with, parser_of

#: Sequences of the exhaustive search that are valued together.
BATCH = 64


def shares(situations: int, augmented: bool, iterations: int | None = None, first: int = 0) -> np.ndarray:
    """Value found / optimum in each situation: random data (0 to 150 centers), state and steps left (3 to 100)."""
    settings = PlannerSettings.from_parameters({"area": {}}, "benchmark")
    area, motion = OperatingArea(settings.area), MotionTable(settings.motion)
    space = FreeSpace(area, motion)
    naive = NaivePaths(space, PlannerConfig(), area.polygon)
    grid = area.grid(PlannerConfig().map_spacing_m)
    planner = PlannerConfig(method="augmented", iterations=iterations).complete()
    result = []
    for number in range(first, first + situations):
        rng = np.random.default_rng([number, 11])
        count = int(rng.integers(0, 150))
        locations = rng.uniform([-40.0, -40.0], [540.0, 640.0], (count, 2))
        phase = rng.uniform(0.0, 6.0, 2)
        depths = 15.0 + 8.0 * np.sin(locations[:, 0] / 60.0 + phase[0]) * np.cos(locations[:, 1] / 75.0 + phase[1])
        posterior = Posterior(GpConfig())
        posterior.follow(Centers(locations, depths, np.full(count, 0.3)))
        state = np.array([rng.uniform(-np.pi, np.pi), *rng.uniform(0.0, 480.0, 2)])
        left = int(rng.integers(3, 101))
        naive_paths = planner.naive_paths if augmented and left > planner.horizon else ()
        rollout = Rollout(motion, naive, left, planner.samples_per_leg)
        reward = PathReward(posterior, LevelSet())
        problem = SearchProblem(
            planner=planner,
            step=0,
            state=state,
            horizon=planner.horizon,
            naive_paths=naive_paths,
            rng=rng,
            grid=grid,
        )
        found = search_path(problem, space, rollout, reward).found.value
        sequences = PathSequences(reward, rollout, 0, state, naive_paths)
        every = [tuple(s) for s in every_sequence(space.arguments(), state, planner.horizon).tolist()]
        best = max(sequences(every[i : i + BATCH]).max() for i in range(0, len(every), BATCH))
        result.append(found / best)
    return np.array(result)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = parser_of("benchmarks.planning.planner_yardstick", __doc__)
    parser.add_argument("--situations", type=int, default=200, help="number of situations (default: %(default)s)")
    parser.add_argument("--iterations", type=int, help="search budget; default: that of the method 'augmented'")
    options = parser.parse_args(arguments)
    for augmented in (True, False):
        found = shares(options.situations, augmented, options.iterations)
        print(
            f"m = 3 {'with' if augmented else 'without'} naive path: {np.mean(found >= 0.99):.1%} of {len(found)} "
            f"situations within 99 % of the optimum (least {found.min():.4f}, mean {found.mean():.4f})",
            flush=True,
        )


if __name__ == "__main__":
    end_with(main)
