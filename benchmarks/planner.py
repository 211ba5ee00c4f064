"""Speed and quality of the planner: one core. `run()` gives the rows of `auv_lse bench planner`.

All in processor time, so that it can be measured on a machine that has other things to do.

Ratios to scikit-learn are of the same work: the values of the same paths by conditioning the library's own posterior on
the path's locations. Where it is not installed, they are left out.
"""

import copy
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.naive_ids import LAWNMOWERS
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.inference.centers import Centers
from auv_lse_gp.inference.point_posteriors import join_by_path
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.bayes_risk import LevelSet
from auv_lse_planner.reward.anytime import AnytimeReward, Weighting
from auv_lse_planner.reward.path import PathReward
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from benchmarks.rows import Row, row

#: Locations of a naive path, after three legs of a plan.
NAIVE = 97
#: Methods whose decision of step 0 is timed, with its goal (ms), if any. That of `tour` is its longest.
DECIDED = {"augmented": 100.0, "plain": None, "tour": 3000.0}
#: Paths valued together.
BATCH = 32


@dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """Sizes of the measurements.

    Attributes:
        centers: Kernel centers of the map.
        many_centers: The same for the memory.
        least_s: Time for which exact values are counted.
        repeats: Decisions of which the median is taken.
        options: Parameters of the section `planner` for every decision, and `steps` of the mission.
        memory_methods: Methods whose memory is measured, each in a process of its own.
    """

    centers: int = 500
    many_centers: int = 2000
    least_s: float = 1.0
    repeats: int = 5
    options: Mapping[str, Any] = field(default_factory=dict)
    memory_methods: tuple[str, ...] = ("augmented", "tour")


FULL = Sizes()
SMOKE = Sizes(
    centers=20,
    many_centers=30,
    least_s=0.01,
    repeats=1,
    options={"iterations": 8, "steps": 16},
    memory_methods=("tour",),
)


def centers(count: int, seed: int = 0) -> Centers:
    """Centers of a wavy ground over the default area, at least 8 m apart."""
    rng = np.random.default_rng(seed)
    kept = np.empty((0, 2))
    while len(kept) < count:
        location = rng.uniform([-40.0, -40.0], [540.0, 640.0])
        if not len(kept) or np.min((kept[:, 0] - location[0]) ** 2 + (kept[:, 1] - location[1]) ** 2) > 8.0**2:
            kept = np.vstack([kept, location])
    depths = 15.0 + 8.0 * np.sin(kept[:, 0] / 60.0) * np.cos(kept[:, 1] / 75.0)
    return Centers(kept, depths, np.full(count, 0.3))


def per_second(work: Callable[[], Any], count: int, least_s: float) -> float:
    """How many of `count` per call are done in a second of processor time: the best of three rounds."""
    work()
    best = 0.0
    for _ in range(3):
        calls, begin = 0, time.process_time()
        while time.process_time() - begin < least_s / 3.0:
            work()
            calls += 1
        best = max(best, calls * count / (time.process_time() - begin))
    return best


def planner(method: str, count: int, *, steps: int = 100, **options: Any) -> VehiclePlanner:
    """A planner of the default mission that has a map of `count` centers and is about to decide step 0."""
    settings = PlannerSettings.from_parameters(
        {"area": {}, "mission": {"vehicles": 1, "steps": steps}, "planner": {"method": method, **options}}, "benchmark"
    )
    made = VehiclePlanner(1, settings, np.random.default_rng(1))
    made.set_centers(centers(count))
    made.odometry(0.0, 0.0, 0.0, 0.0)
    return made


def evaluations(sizes: Sizes = FULL) -> list[Row]:
    """Exact path values a second."""
    posterior = Posterior(GpConfig())
    posterior.follow(centers(sizes.centers))
    reward = PathReward(posterior, LevelSet())
    made = planner("augmented", sizes.centers)
    naive_locations = made.rollout.path(made.settings.mission.steps - NAIVE, np.zeros(3), (), LAWNMOWERS[0]).locations_m
    rng = np.random.default_rng(2)
    new = rng.uniform([0.0, 0.0], [500.0, 600.0], (3 * BATCH, 2))
    whole = np.concatenate([new[:3], naive_locations])

    def together() -> Any:
        """As the search asks: the locations of all paths at once, then their values."""
        columns = posterior.at(np.concatenate([new, np.tile(naive_locations, (BATCH, 1))]))
        paths = join_by_path(columns.slice(0, len(new)), columns.slice(len(new), len(columns)), BATCH)
        return reward.values_of_equal(paths, len(whole))

    batched = per_second(together, BATCH, sizes.least_s)
    alone = per_second(lambda: reward.value(posterior.at(whole)), 1, sizes.least_s)
    rows = [
        row(f"exact values of 100-location paths, {count} at once", each, "1/s", goal=">= 1000", holds=each >= 1000)
        for count, each in ((BATCH, batched), (1, alone))
    ]
    exact = reward.value(posterior.at(whole))
    try:
        value = _sklearn(whole, centers(sizes.centers))
    except ImportError:
        return rows
    assert abs(value() - exact) < 1e-3 * exact, f"scikit-learn gives {value()}, not {exact}"
    theirs = per_second(value, 1, sizes.least_s)
    for found, each in zip(rows, (batched, alone), strict=True):
        found.update(against="scikit-learn", ratio=each / theirs)
    return rows


#: Anytime reward: kernel centers of the map, legs left, team mates with as many legs.
TOUR_CENTERS, TOUR_LEGS, TOUR_MATES = 170, 100, 2


def anytime(sizes: Sizes = FULL) -> list[Row]:
    """Time of the anytime reward of a whole mission's path among two team mates."""
    count, legs = min(TOUR_CENTERS, sizes.centers), TOUR_LEGS if sizes is FULL else 8
    posterior = Posterior(GpConfig())
    posterior.follow(centers(count))
    area = OperatingArea(AreaConfig())
    fine, coarse = (CachedPoints(posterior, area.grid(spacing).locations_m) for spacing in (20.0, 24.0))
    rng = np.random.default_rng(3)
    paths = [_walk(rng, legs) for _ in range(1 + TOUR_MATES)]
    mates: list[Any] = [(np.arange(legs) + 0.4 * number, path) for number, path in enumerate(paths[1:], 1)]
    reward = AnytimeReward(fine, LevelSet(), mates, Weighting(legs, 0, legs, 1.5), coarse)
    value_ms = 1e3 / per_second(lambda: reward.value(paths[0][:, None]), 1, sizes.least_s)
    what = f"{legs} legs, {count} centers, {TOUR_MATES} mates"
    return [row(f"anytime value, {what}", value_ms, "ms", goal="<= 5", holds=value_ms <= 5.0)]


def _walk(rng: np.random.Generator, legs: int) -> Any:
    """Ends (L, 2) of the legs of a wandering path that the area's borders reflect."""
    heading = np.cumsum(rng.normal(0.0, 0.4, legs))
    ends = np.cumsum(23.5 * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    low, width = np.array([-30.0, -30.0]), np.array([560.0, 660.0])
    return low + width - np.abs((ends - low) % (2.0 * width) - width)


def _risk_of(mean: Any, before: Any, after: Any) -> float:
    level = LevelSet()
    after = np.clip(after, 0.0, before)
    return float(
        np.sum(level.risk(mean, np.sqrt(before)) - level.expected_risk(mean, np.sqrt(before - after), np.sqrt(after)))
    )


def _sklearn(whole: Any, data: Centers) -> Callable[[], float]:
    """Path value with scikit-learn's regressor: its posterior covariance, then conditioning on the path."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern

    config = GpConfig()
    kernel = ConstantKernel(config.signal_std_m**2) * Matern(config.length_scale_m, nu=2.5)
    model = GaussianProcessRegressor(kernel, alpha=config.noise_std_m**2, optimizer=None)
    model.fit(data.locations_m, data.depths_m - config.mean_depth_m)

    def value() -> float:
        mean, covariance = model.predict(whole, return_cov=True)
        with_noise = covariance + config.noise_std_m**2 * np.eye(len(whole))
        after = np.diag(covariance - covariance @ np.linalg.solve(with_noise, covariance))
        return _risk_of(mean + config.mean_depth_m, np.diag(covariance), after)

    return value


def decisions(sizes: Sizes = FULL) -> list[Row]:
    """Time of a first decision at the default budget, and the share of its value that remains with a 20 ms deadline.

    Missions begin without a map; a planner that restarts on known ground finds one.
    """
    return [told for method in DECIDED for count in (0, sizes.centers) for told in _decision(method, count, sizes)]


def _after_20_ms() -> Callable[[], bool]:
    """A deadline in 20 ms of processor time."""
    end = time.process_time() + 0.020
    return lambda: time.process_time() > end


def _decision(method: str, count: int, sizes: Sizes) -> list[Row]:
    planner(method, count, **sizes.options).decide(0.0)  # compiled functions are loaded
    times, values = [], []
    for _ in range(sizes.repeats):
        made = planner(method, count, **sizes.options)
        made._take_centers(np.zeros(3), evaluates=True)  # the node takes the map as it arrives
        begin = time.process_time()
        values.append(made.decide(0.0).bound.expected_end)
        times.append(1e3 * (time.process_time() - begin))
    made = planner(method, count, **sizes.options)
    made._take_centers(np.zeros(3), evaluates=True)
    limited = made.decide(0.0, deadline=_after_20_ms())
    share = limited.bound.expected_end / float(np.median(values))
    took, what = float(np.median(times)), f"{method}, {count} centers, step 0"
    goal, holds = (f"<= {limit:g}", took <= limit) if (limit := DECIDED[method]) else ("", None)
    return [
        row(f"one decision, {what}", took, "ms", goal=goal, holds=holds),
        row(f"value with a 20 ms deadline, {what}", share, "of full", goal=">= 0.9", holds=share >= 0.9),
    ]


def _flown(made: VehiclePlanner, legs: int, now_s: float) -> float:
    """Travels this many legs as decided; returns the time (s) afterwards."""
    for _ in range(legs):
        leg = made.decide(now_s).leg
        now_s += leg.length_m / made.settings.vehicle.speed_mps
        made.odometry(now_s, *leg.end_state.tolist())
    return now_s


def under_way(sizes: Sizes = FULL) -> list[Row]:
    """Value that a 20 ms deadline leaves of a `tour` decision that looks for another plan, with one in hand."""
    made = planner("tour", sizes.centers, **sizes.options)
    made._take_centers(np.zeros(3), evaluates=True)
    every, now_s = made.planner.tour_interval, 0.0
    assert every is not None
    shares = []
    for _ in range(sizes.repeats):
        now_s = _flown(made, every, now_s)
        whole, hurried = copy.deepcopy(made), copy.deepcopy(made)
        value = whole.decide(now_s).bound.expected_end
        limited = hurried.decide(now_s, deadline=_after_20_ms())
        shares.append(limited.bound.expected_end / value)
    least, what = float(min(shares)), f"tour, {sizes.centers} centers, with a plan in hand"
    return [row(f"least value with a 20 ms deadline, {what}", least, "of full", goal=">= 0.9", holds=least >= 0.9)]


_MEMORY = """
import resource, sys
import numpy as np
sys.path[:0] = {path!r}
import benchmarks.planner as b
before = int(open("/proc/self/statm").read().split()[1]) * resource.getpagesize() / 1024.0  # now, not at most
made = b.planner({method!r}, {count})
made.decide(0.0)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) / 1024.0, before / 1024.0)
"""


def memory(sizes: Sizes = FULL) -> list[Row]:
    """Peak memory that a planner adds to a process: many centers taken in at once, one decision."""
    root = str(Path(__file__).resolve().parent.parent)
    rows = []
    for method in sizes.memory_methods:
        code = _MEMORY.format(path=[root, *sys.path], method=method, count=sizes.many_centers)
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        peak, before = (float(x) for x in done.stdout.split())
        own = peak - before
        name = f"peak memory of a planner, {method}, {sizes.many_centers} centers"
        rows.append(row(name, own, "MB", goal="< 300", holds=own < 300.0))
        rows.append(row(f"the same with interpreter and libraries, {method}", peak, "MB"))
    return rows


def run(*, smoke: bool = False) -> list[Row]:
    """All rows; `smoke`: at the smallest sizes, in seconds."""
    sizes = SMOKE if smoke else FULL
    return [
        *evaluations(sizes),
        *anytime(sizes),
        *decisions(sizes),
        *under_way(sizes),
        *memory(sizes),
    ]
