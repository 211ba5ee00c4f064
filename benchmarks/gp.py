"""The objective and the Gaussian process: speed against scikit-learn and GPyTorch, and the accuracy of the choices.

All on one core, in processor time, so that it can be measured on a machine that has other things to do. The accuracy
of the choices is measured on a made-up lake, or with `--lake FILE` on the soundings of a real one. The other libraries
live in an optional environment of their own:

    python3 -m venv .venv-bench
    .venv-bench/bin/pip install torch==2.13.0 gpytorch==1.15.2 scikit-learn==1.9.1
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_gp import (
    AreaConfig,
    Centers,
    GpConfig,
    Kernel,
    LevelSet,
    OnlineGp,
    OperatingArea,
    Posterior,
    bayes_risk,
    expected_bayes_risk,
    read_soundings,
)
from auv_lse_gp.inference.work import Job
from auv_lse_gp.map.quality import QualityJudge
from auv_lse_gp.map.quality_watch import SLICE
from benchmarks.rows import Row, row

ROOT = Path(__file__).resolve().parents[1]
RIVALS = ROOT / ".venv-bench" / "bin" / "python"
ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}

#: The map of the comparison: 500 m x 400 m, as in the paper's trials.
SIZE_M = (500.0, 400.0)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Sizes:
    """Sizes of the measurements.

    Attributes:
        evaluations: Locations at which the ways to the expected risk are compared.
        cells: Cells of the map in north and east.
        data: Numbers of centers of the maps.
        judged: Centers of the map whose quality is judged.
        queries: Locations at which the local subset is compared with all centers.
        every: Every how many soundings of the survey are used.
        repeats: Most repeats of a timed call.
    """

    evaluations: int = 100_000
    cells: tuple[int, int] = (400, 250)
    data: tuple[int, ...] = (500, 1000, 2000)
    judged: int = 12000
    queries: int = 3000
    every: int = 1
    repeats: int = 5


FULL = Sizes()
SMOKE = Sizes(
    evaluations=200,
    cells=(16, 10),
    data=(30,),
    judged=60,
    queries=20,
    every=4,
    repeats=1,
)


def run(*, smoke: bool = False, lake: Path | None = None) -> list[Row]:
    """Measures everything in a separate process on one core. Takes about three minutes.

    Args:
        smoke: Measures at the smallest sizes, in seconds, and without the other libraries.
        lake: Soundings of a real lake; None: a made-up lake.

    Raises:
        RuntimeError: if that process failed, with its output.
    """
    sizes = SMOKE if smoke else FULL
    if all(os.environ.get(name) == value for name, value in ONE_CORE.items()):
        return measure(sizes, lake)
    code = (
        "import json; from pathlib import Path; from benchmarks import gp;"
        f"print(json.dumps(gp.measure(gp.{'SMOKE' if smoke else 'FULL'}, {f'Path({str(lake)!r})' if lake else None})))"
    )
    environment = {**os.environ, **ONE_CORE, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        cwd=Path.cwd(),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"benchmarks.gp failed: {done.stderr[-2000:]}")
    rows: list[Row] = json.loads(done.stdout.splitlines()[-1])
    return rows


def measure(sizes: Sizes = FULL, lake: Path | None = None) -> list[Row]:
    """All rows, in this process."""
    survey = Survey.of(lake)
    return [
        *accuracy(sizes),
        *maps(sizes),
        judgement(sizes),
        *local_subset(survey, sizes),
    ]


def clock() -> float:
    """Processor time (s); on an idle core it equals wall-clock time."""
    return time.process_time()


def best_of(repeats: int, function: Callable[[], Any]) -> float:
    """Shortest processor time of `repeats` calls (s)."""
    times = []
    for _ in range(repeats):
        begin = clock()
        function()
        times.append(clock() - begin)
    return min(times)


# ---------------------------------------------------------------- objective


def field_like(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means and standard deviations as they occur in a mission: uncertain positions near the level among certain
    ones."""
    rng = np.random.default_rng(seed)
    total = np.exp(rng.uniform(np.log(0.1), np.log(8.0), n))
    share = rng.beta(0.5, 0.5, n)
    return 15.0 + 5.0 * rng.normal(size=n), np.sqrt(share) * total, np.sqrt(1.0 - share) * total


def by_quadrature(mean: float, of_mean: float, after: float, c1: float, c2: float) -> float:
    """Expected risk by Gauss-Legendre on both sides of the depth at which the decision changes; error about 1e-14."""
    from scipy.special import ndtri

    nodes, weights = np.polynomial.legendre.leggauss(64)
    star = 15.0 - after * float(ndtri(c2 / (c1 + c2)))
    total = 0.0
    low, high = mean - 9.0 * of_mean, mean + 9.0 * of_mean
    breaks = np.unique(np.clip(star + after * np.arange(-9, 10) * 1.0, low, high))
    edges = np.unique(np.concatenate([breaks, np.linspace(low, high, 19), np.clip([star], low, high)]))
    for a, b in itertools.pairwise(edges):
        x = 0.5 * (a + b) + 0.5 * (b - a) * nodes
        density = np.exp(-0.5 * ((x - mean) / of_mean) ** 2) / (of_mean * np.sqrt(2.0 * np.pi))
        total += 0.5 * (b - a) * float(weights @ (density * bayes_risk(x, after, 15.0, c1, c2)))
    return total


def accuracy(sizes: Sizes = FULL) -> list[Row]:
    """Error and speed of five ways to the expected risk, at equal costs."""
    args = field_like(sizes.evaluations, seed=1)
    mean, of_mean, after = args
    exact = expected_bayes_risk(*args, 15.0, 10.0, 10.0)
    in_hand = bayes_risk(mean, np.hypot(of_mean, after), 15.0, 10.0, 10.0)
    rng = np.random.default_rng(2)

    def hermite(count: int) -> np.ndarray:
        nodes, weights = np.polynomial.hermite_e.hermegauss(count)
        total = np.zeros_like(mean)
        for node, weight in zip(nodes, weights / np.sqrt(2.0 * np.pi), strict=True):
            total += weight * bayes_risk(mean + of_mean * node, after, 15.0, 10.0, 10.0)
        return total

    def monte_carlo(count: int) -> np.ndarray:
        total = np.zeros_like(mean)
        for _ in range(count):
            total += bayes_risk(mean + of_mean * rng.normal(size=len(mean)), after, 15.0, 10.0, 10.0)
        return total / count

    ways: list[tuple[str, Callable[[], np.ndarray]]] = [
        ("exact (Owen's T)", lambda: expected_bayes_risk(*args, 15.0, 10.0, 10.0)),
        ("exponential-quadratic", lambda: expected_bayes_risk(*args, 15.0, 10.0, 10.0, "exponential_quadratic")),
        ("Gauss-Hermite, 8 nodes", lambda: hermite(8)),
        ("Gauss-Hermite, 32 nodes", lambda: hermite(32)),
        ("Monte Carlo, 100 draws", lambda: monte_carlo(100)),
    ]
    pick = np.linspace(0, len(mean) - 1, min(400, len(mean))).astype(int)
    truth = np.array([by_quadrature(mean[i], of_mean[i], after[i], 10.0, 10.0) for i in pick])
    rows = []
    speed = None
    for name, way in ways:
        seconds = best_of(min(3, sizes.repeats) if "Monte" not in name else 1, way)
        speed = speed or seconds
        value = way()
        negative = float(np.mean(in_hand - value < -1e-9))
        is_exact = "exact" in name
        error = float(np.max(np.abs(value[pick] - truth) if is_exact else np.abs(value - exact))) / 20.0
        goals = (("<= 1e-13", error <= 1e-13), ("0", negative == 0.0)) if is_exact else (("", None), ("", None))
        name = f"expected risk, {name}"
        rows += [
            row(f"{name}: largest error / (c1 + c2)", error, "", "", None, *goals[0]),
            row(f"{name}: speed", len(mean) / seconds, "/s", "exact", speed / seconds),
            row(f"{name}: negative benefits", 100.0 * negative, "%", "", None, *goals[1]),
        ]
    return rows


# ---------------------------------------------------------------- maps


def made_up(n: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Locations and depths of n soundings in a made-up lake."""
    rng = np.random.default_rng(seed)
    locations = rng.uniform(0.0, SIZE_M, (n, 2))
    return locations, 15.0 + 5.0 * np.sin(locations[:, 0] / 80.0) * np.cos(locations[:, 1] / 60.0) + 0.3 * rng.normal(
        size=n
    )


def add_all(gp: OnlineGp, locations: np.ndarray, depths: np.ndarray) -> None:
    """Adds soundings one by one."""
    for (north, east), depth in zip(locations, depths, strict=True):
        gp.add(north, east, depth)


def rivals(arrays: dict[str, Any], sizes: Sizes) -> dict[str, dict[str, Any]]:
    """Results of the other libraries by name; {"missing": reason} for one that is not measured."""
    if sizes == SMOKE or not RIVALS.exists():
        missing = {"missing": "not in a smoke run" if sizes == SMOKE else "no .venv-bench: see benchmarks/gp.py"}
        return {"scikit-learn": missing, "GPyTorch": missing}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "data.npz"
        np.savez(file, **arrays)
        done = subprocess.run(
            [str(RIVALS), str(Path(__file__).parent / "navigation" / "gp_rivals.py"), str(file)],
            env={**os.environ, **ONE_CORE},
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode:
        why = {"missing": (done.stderr.strip().splitlines() or ["failed"])[-1][:100]}
        return {"scikit-learn": why, "GPyTorch": why}
    result: dict[str, dict[str, Any]] = json.loads(done.stdout.splitlines()[-1])
    return result


def maps(sizes: Sizes = FULL) -> list[Row]:
    """Whole map of mean and std, and appending a datum, for several numbers of centers."""
    config = GpConfig(min_spacing_m=0.0, merge=False)
    axes = [(np.arange(c) + 0.5) * s / c for s, c in zip(SIZE_M, sizes.cells, strict=True)]
    queries = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    rows: list[Row] = []
    for n in sizes.data:
        locations, depths = made_up(n + 40, seed=n)
        gp = OnlineGp(config)
        add_all(gp, locations[:n], depths[:n])
        field = gp.predict(queries)
        part = queries if n < 2000 else queries[::5]
        call: Callable[[], Any] = partial(gp.predict, part)
        ours = len(queries) / len(part) * best_of(min(3, sizes.repeats) if n == 500 else 1, call)
        asked = queries if n == 500 else queries[:: max(1, len(queries) // 5_000)]
        scale = len(queries) / len(asked)
        data = {
            "locations": locations[:n],
            "depths": depths[:n],
            "queries": asked,
            "new": locations[n : n + 20],
            "new_depths": depths[n : n + 20],
            "signal_std": config.signal_std_m,
            "length": config.length_scale_m,
            "noise_std": config.noise_std_m,
            "mean": config.mean_depth_m,
        }
        theirs = rivals(data, sizes)
        rows += against_rivals(n, ours, (field[0][:: round(scale)], field[1][:: round(scale)]), theirs, scale)
        rows.append(appending(gp, locations, depths, n, theirs["GPyTorch"]))
    return rows


def against_rivals(
    n: int, ours: float, field: tuple[np.ndarray, np.ndarray], theirs: dict[str, dict[str, Any]], scale: float
) -> list[Row]:
    """Rows of the whole map: each library as one would call it, and in the chunks that suit it best.

    Args:
        n: Number of centers.
        ours: Our time for the whole map (s).
        field: Our mean and standard deviation at the locations computed by the libraries, (P,) each.
        theirs: What `rivals` gave.
        scale: How many times as many locations the whole map has.
    """
    locations = round(scale * len(field[0]))
    name = f"map of {locations:,} locations, n = {n}"
    rows = [row(name, ours, "s")]
    for library, goal in (("scikit-learn", 9.0), ("GPyTorch", 30.0)):
        result = theirs[library]
        if "missing" in result:
            rows.append(row(name, ours, "s", f"{library}: {result['missing']}"))
            continue
        times = {int(chunk): scale * seconds for chunk, seconds in result["by_chunk"].items()}
        # scikit-learn takes the map in one call; GPyTorch would ask for P x P, so that chunks must be chosen.
        plain, how = (max(times), "one call") if library == "scikit-learn" else (2048, "chunks of 2048")
        best = min(times, key=lambda chunk: times[chunk])
        label = f"{library} {result['version']}"
        note = "" if scale == 1.0 else ", from 5,000 locations"
        for chunk, text in ((plain, how), (best, f"its best chunks ({best})")):
            has_goal, ratio = n == 500 and chunk == plain, times[chunk] / ours
            against = f"{label}, {text}{note}: {times[chunk]:.3g} s"
            goals = (f">= {goal:g} times", ratio >= goal) if has_goal else ("", None)
            rows.append(row(name, ours, "s", against, ratio, *goals))
        off = max(abs(values.sum() / result[k] - 1) for values, k in zip(field, ("mean_sum", "std_sum"), strict=True))
        rows.append(row(f"{name}: sums differ by", off, "", label, goal="<= 1e-6", holds=off <= 1e-6))
    return rows


def appending(gp: OnlineGp, locations: np.ndarray, depths: np.ndarray, n: int, gpytorch: dict[str, Any]) -> Row:
    """Appending a datum to a process of n centers, and predicting one location with it."""
    gp.add(locations[n, 0], locations[n, 1], depths[n])  # makes room
    times = []
    for (north, east), depth in zip(locations[n + 1 : n + 20], depths[n + 1 : n + 20], strict=True):
        begin = clock()
        gp.add(north, east, depth)
        gp.predict(locations[:1])  # `add` alone leaves the work to the next answer
        times.append(clock() - begin)
    append = 1e3 * float(np.median(times))
    rival, ratio = "GPyTorch: missing", None
    if "append_s" in gpytorch:
        rival = f"GPyTorch {gpytorch['version']}: {1e3 * gpytorch['append_s']:.3g} ms"
        ratio = 1e3 * gpytorch["append_s"] / append
    goals = ("<= 0.5 ms", append <= 0.5) if n == 500 else ("", None)
    return row(f"append a datum and predict one location, n = {n}", append, "ms", rival, ratio, *goals)


def judgement(sizes: Sizes = FULL) -> Row:
    """The longest slice of a judgement of the map's quality, of corrected positions."""
    side_m = 22.0 * math.sqrt(sizes.judged)
    area = OperatingArea(AreaConfig(polygon_m=(0.0, 0.0, side_m, 0.0, side_m, side_m, 0.0, side_m)))
    rng = np.random.default_rng(6)
    locations = rng.uniform(0.0, side_m, (sizes.judged, 2))
    depths = 15.0 + 6.0 * np.sin(locations[:, 0] / 170.0) * np.cos(locations[:, 1] / 230.0)
    effect = 0.05 * rng.standard_normal((sizes.judged, 40))
    judge = QualityJudge(GpConfig(), LevelSet(), area)
    judge.judge(Centers(locations[:20], depths[:20], np.full(20, 0.3)))  # loads compiled code
    job = Job(judge.judge_in_parts(Centers(locations, depths, np.full(sizes.judged, 0.3), effect)))
    times, done = [], False
    while not done:
        begin = clock()
        done = job.advance(SLICE)
        times.append(clock() - begin)
    name = f"longest of {len(times)} slices of a judgement, n = {sizes.judged}"
    return row(name, 1e3 * max(times), "ms", goal="<= 100 ms", holds=max(times) <= 0.1)


# ---------------------------------------------------------------- choices


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """Soundings of a lake along lines.

    Attributes:
        locations_m: North and east of the soundings, (n, 2).
        depths_m: Their depths, (n,); at least `LEAST_DEPTH_M`, so that noise added to them leaves a depth.
        name: Of the lake, for the rows.
    """

    locations_m: np.ndarray
    depths_m: np.ndarray
    name: str

    @classmethod
    def of(cls, lake: Path | None, seed: int = 3) -> Survey:
        """The soundings in the file `lake`, or those of a made-up lake."""
        if lake is not None:
            rows = read_soundings(lake)
            locations, depths, name = rows[:, :2], rows[:, 2], f"real lake, {lake.stem}"
        else:
            (locations, depths), name = made_up_lines(seed), "made-up lake"
        wet = depths >= LEAST_DEPTH_M
        return cls(locations_m=locations[wet], depths_m=depths[wet], name=name)

    def middle(self, sizes: Sizes) -> Survey:
        """Every `sizes.every`-th sounding in the middle 800 m x 800 m."""
        near = np.all(np.abs(self.locations_m - np.median(self.locations_m, axis=0)) < 400.0, axis=1)
        kept = np.flatnonzero(near)[:: sizes.every]
        return Survey(locations_m=self.locations_m[kept], depths_m=self.depths_m[kept], name=self.name)


#: Five standard deviations of the noise that `merging` adds.
LEAST_DEPTH_M = 2.5


def made_up_lines(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Locations (n, 2) and depths (n,) along parallel lines over a draw from a Gaussian process."""
    rng = np.random.default_rng(seed)
    north = np.arange(0.0, 800.0, 4.0)
    locations = np.concatenate(
        [np.column_stack([north, np.full(len(north), east)]) for east in np.arange(0, 800, 60.0)]
    )
    truth = GpConfig(length_scale_m=90.0, signal_std_m=8.0)
    centers = rng.uniform(-100, 900, (600, 2))
    depths = 15.0 + np.linalg.cholesky(Kernel(truth)(centers, centers) + np.eye(600) * 0.01) @ rng.normal(size=600)
    posterior = Posterior(truth)
    posterior.extend(Centers(centers, depths, np.full(600, 0.1)))
    return locations, posterior.mean_m(locations) + 0.3 * rng.normal(size=len(locations))


#: Radius of the local subset (the paper's d_eps) in length scales.
LOCAL_RATIO = 4.0


def predict_locally(config: GpConfig, centers: Centers, locations: np.ndarray, reach_m: float) -> np.ndarray:
    """Mean (P,) at locations (P, 2), each from the centers within `reach_m` of it alone."""
    means = []
    for location in locations:
        near = np.hypot(*(centers.locations_m - location).T) < reach_m
        posterior = Posterior(config)
        posterior.extend(Centers(centers.locations_m[near], centers.depths_m[near], centers.noise_std_m[near]))
        means.append(float(posterior.mean_m(location[None])[0]))
    return np.array(means)


def local_subset(survey: Survey, sizes: Sizes = FULL) -> list[Row]:
    """Error of predicting from the centers within d_eps, against the full posterior.

    With a compact kernel these are the centers within its support: k(S, p) is local, but K^-1 is not.
    """
    part = survey.middle(sizes)
    against = f"full posterior, {part.name}"
    rng = np.random.default_rng(0)
    queries = rng.uniform(part.locations_m.min(axis=0), part.locations_m.max(axis=0), (sizes.queries, 2))
    rows = []
    for kernel in ("matern52", "squared_exponential", "wendland_c2"):
        config = GpConfig(kernel=kernel, length_scale_m=70.0, min_spacing_m=20.0, merge=False)
        full = OnlineGp(config)
        add_all(full, part.locations_m, part.depths_m)
        mean, std = full.predict(queries)
        reach_m = full.kernel.support_m if kernel == "wendland_c2" else LOCAL_RATIO * config.length_scale_m
        off = np.abs(predict_locally(config, full.centers, queries, reach_m) - mean)
        name = f"local subset, {kernel}, centers within {reach_m:g} m"
        rows.append(row(f"{name}: largest error of the mean", off.max(), "m", f"{against}, n = {len(full)}"))
        rows.append(row(f"{name}: / std", float(np.max(off / std)), "", against))
    return rows
