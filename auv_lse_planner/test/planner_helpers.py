"""What several planner tests need: an area, settings, data, and dense reference computations."""

from __future__ import annotations

import math

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.mission_file.sections.planner import PlannerConfig, PlannerSettings
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.paths.free_space import (
    FreeSpace,
    clearance_at,
    feasible_mask,
    leg_clearance,
    random_actions,
    room_to_loop,
)
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_planner.paths.naive import NaivePaths
from auv_lse_planner.paths.rollout import Rollout
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.search.path_search import SearchProblem

MAX_SMALL_PATH = (-20.0, -20.0, 380.0, -20.0, 380.0, 480.0, -20.0, 480.0)


def area(polygon=MAX_SMALL_PATH, **options) -> OperatingArea:
    return OperatingArea(AreaConfig(polygon_m=polygon, **options))


def world(polygon=MAX_SMALL_PATH, motion=None, planner=None, vehicles=1, **options):
    """Area, motion table, free space, naive paths."""
    a = area(polygon, **options)
    m = MotionTable(motion or MotionConfig())
    space = FreeSpace(a, m)
    return a, m, space, NaivePaths(space, planner or PlannerConfig(), a.polygon, vehicles)


def settings(planner=None, vehicles=1, steps=20, **sections) -> PlannerSettings:
    return PlannerSettings.from_parameters(
        {
            "area": {"polygon_m": list(MAX_SMALL_PATH)},
            "mission": {"vehicles": vehicles, "steps": steps},
            "planner": planner or {},
            **sections,
        },
        "test",
    )


def rollout(steps, samples_per_leg=1, vehicles=1, **options):
    """A `Rollout` over a mission of so many steps, and the free space."""
    _, motion, space, naive = world(vehicles=vehicles, **options)
    return Rollout(motion, naive, steps, samples_per_leg), space


def search_problem(state, rng, step=0, naive_paths=(), **planner) -> SearchProblem:
    """A search problem from parameters of the method "augmented" and others."""
    config = PlannerConfig(**{"method": "augmented", **planner}).complete()
    return SearchProblem(
        planner=config, step=step, state=state, horizon=config.horizon, naive_paths=tuple(naive_paths), rng=rng
    )


def centers(rng: np.random.Generator, count: int, noise: float = 0.3) -> Centers:
    """Data of a wavy ground at random locations."""
    locations = rng.uniform([0.0, 0.0], [360.0, 460.0], (count, 2))
    return Centers(locations, depth(locations), np.full(count, noise))


def depth(locations):
    return 15.0 + 8.0 * np.sin(locations[:, 0] / 60.0) * np.cos(locations[:, 1] / 75.0)


def path_reward(data: int, team: int, credit: str, seed: int = 3) -> tuple[np.random.Generator, PathReward]:
    """The reward of paths beside so many centers and planned locations of the team, and the random numbers' source."""
    rng = np.random.default_rng(seed)
    posterior = Posterior(GpConfig())
    posterior.follow(centers(rng, data))
    posterior = posterior.with_planned(rng.uniform(0, 400, (team, 2)))
    return rng, PathReward(posterior, LevelSet(), credit)


def dense_posterior(config: GpConfig, data: Centers, measured, at):
    """Mean and variance at `at` given the data; variance given also measurements at `measured`: plain dense algebra."""
    kernel = Kernel(config)

    def variance(known, noise):
        if not len(known):
            return np.full(len(at), config.signal_std_m**2)
        cov = kernel(known, known) + np.diag(noise)
        cross = kernel(at, known)
        return config.signal_std_m**2 - np.einsum("pi,ip->p", cross, np.linalg.solve(cov, cross.T))

    noise = np.asarray(data.noise_std_m) ** 2
    mean = np.full(len(at), config.mean_depth_m)
    if len(data):
        cov = kernel(data.locations_m, data.locations_m) + np.diag(noise)
        mean = mean + kernel(at, data.locations_m) @ np.linalg.solve(cov, data.depths_m - config.mean_depth_m)
    both = np.concatenate([data.locations_m, measured]) if len(measured) else data.locations_m
    all_noise = np.concatenate([noise, np.full(len(measured), config.noise_std_m**2)])
    return mean, variance(data.locations_m, noise), variance(both, all_noise)


def expected_risk(level: LevelSet, mean, before, after):
    after = np.clip(after, 0.0, before)
    return level.expected_risk(mean, np.sqrt(before - after), np.sqrt(after))


def track_of(motion, state, action, spacing_m):
    """Locations along the leg of an action from a state, both ends among them, at most so far apart."""
    leg = motion.leg(0, state, action)
    return np.array(
        [leg.state_at(s)[1:] for s in np.linspace(0.0, leg.length_m, math.ceil(leg.length_m / spacing_m) + 1)]
    )


def clearance_m(space, locations):
    """Clearance of locations as planning sees it."""
    return np.array([clearance_at(space.arguments(), *location) for location in locations])


def is_safe(space, state):
    """Whether a turning loop of a state is free."""
    a = space.arguments()
    return room_to_loop(a, *state) >= 0.5 * a.spacing


def is_free(space, state, action):
    """Whether the leg of an action from a state stays clear."""
    a = space.arguments()
    return leg_clearance(a, *state, action) >= 0.5 * a.spacing


def feasible_by_area(space, state):
    """Indices of the actions that the area alone allows in a state, whatever shallow ground is known."""
    return np.flatnonzero(feasible_mask(space.arguments(static=True), *state))


def actions_by_chance(space, state, randoms):
    """Feasible actions from a state, one after another, one for each of uniform numbers."""
    return random_actions(space.arguments(), *state, randoms)


def border_distance(operating_area: OperatingArea, locations):
    """Exact distance of locations to the nearest border line."""
    best = np.full(len(locations), np.inf)
    for polygon in (operating_area.polygon, *operating_area.no_go.values()):
        for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            along = np.clip((locations - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            best = np.minimum(best, np.hypot(*(locations - (a + along[:, None] * (b - a))).T))
    return best
