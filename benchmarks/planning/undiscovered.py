"""Calibration of a mission report's estimates: found line, missing line, expected loss (docs/evidence/gp.md).

    python -m benchmarks.planning.undiscovered --lakes 20 --real LAKE_FILE --out undiscovered.jsonl

Flies missions over fresh lakes (`undiscovered_flights.py`) with one to three vehicles, and appends each mission's
soundings to the file as one JSON line. Judges each mission's map and appends its figures to a second file beside it
(`undiscovered.figures.jsonl`). Prints the table of all figures. Ctrl-C stops it; the same command continues. Without
the second file all missions are judged again, from the soundings flown before: a few seconds each.
"""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.spatial import cKDTree

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.support.arrays import Array, Mask
from auv_lse_gp.level_set.lines import near, resample
from auv_lse_gp.map import certainty
from auv_lse_gp.map.certainty import Piece
from auv_lse_gp.map.depth_map import BAND_SIGMAS, DepthMap
from auv_lse_gp.map.undiscovered import coarse_grid, undiscovered
from auv_lse_shore.campaign.statistics import proportion
from auv_lse_shore.judge import isobath
from benchmarks.command import end_with, existing_file, parser_of
from benchmarks.planning.areas import spread_windows
from benchmarks.planning.undiscovered_flights import ground_of, mission, settings, where_of
from benchmarks.results_file import FOLDER, fly, read

#: A missing line longer than this (m) counts as missed.
MISSED_M = 40.0
#: Kinds of made-up ground.
KINDS = ("valley", "rough", "gaussian")
#: Number of windows of a real lake for each number of vehicles.
WINDOWS = 10

Row = dict[str, Any]


def figures(line: Row) -> Row:
    """Estimates of a mission's map and their true values; ground of unknown depth is left out of both."""
    chosen = settings(line["vehicles"])
    area, level = OperatingArea(chosen.area), chosen.level_set.level_m
    depth_map = DepthMap(chosen.gp, chosen.level_set, area)
    rows = np.array(line["soundings"])
    depth_map.add_soundings(rows)
    field, grid = depth_map.field(), depth_map.grid
    locations = np.column_stack([rows[:, 1:3], np.zeros(len(rows))])
    pieces = certainty.classify(depth_map.isobath().lines, field, chosen.gp.signal_std_m, locations)
    sure = [p for p in pieces if p.kind == certainty.FOUND]
    ground = ground_of(line["kind"], line["lake"], where_of(line["vehicles"]), line["real"])
    depth = np.where(grid.inside, ground.depth_m(*np.meshgrid(grid.north_m, grid.east_m, indexing="ij")), np.nan)
    truth = isobath.trace(grid.north_m, grid.east_m, depth, level)
    is_found = near(certainty.lines_of(pieces, certainty.FOUND))

    def left_out(locations_m: Array) -> Mask:
        unknown = ~np.isfinite(ground.depth_m(locations_m[:, 0], locations_m[:, 1]))
        return np.asarray(is_found(locations_m) | unknown)

    located = left_out if np.isnan(depth[grid.inside]).any() else is_found
    missing = undiscovered(chosen.gp, depth_map.centers, level, coarse_grid(area, chosen.gp.map_resolution_m), located)
    known = np.isfinite(depth)
    called, deep = depth_map.level_set.safe(field.mean_m[known], field.std_m[known]), depth[known] >= level
    cost = np.where(called, chosen.level_set.cost_false_safe, chosen.level_set.cost_false_unsafe)
    true_m = isobath.length_m(truth)
    return {
        **{key: line[key] for key in ("kind", "vehicles", "lake")},
        "missing": true_m * (1.0 - float(np.mean(is_found(resample(truth))))) if true_m else 0.0,
        "expected": missing.expected_m,
        "limit": missing.limit_m,
        "loss": float(np.mean(cost * (called != deep))),
        "loss_expected": float(field.risk[known].mean()),
        "band": _covered(sure, truth),
    }


def _covered(sure: Sequence[Piece], truth: Sequence[Array]) -> float | None:
    """Share of the line found that is within `BAND_SIGMAS` standard deviations of the true isobath."""
    if not sure or not truth:
        return None
    tree = cKDTree(resample(truth, 0.5))
    off = np.concatenate([tree.query(p.line)[0] / np.maximum(p.std_m, 1e-6) for p in sure])
    return float(np.mean(off <= BAND_SIGMAS))


def groups_of(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Groups of missions: by ground and team, by third of expected loss within each team, and with a missing line."""
    groups: dict[str, list[Row]] = {}
    for r in rows:
        for name in (f"{r['kind']}, {r['vehicles']}", f"{r['kind']}, all", f"all, {r['vehicles']}", "all"):
            groups.setdefault(name, []).append(r)
    for vehicles in (1, 2, 3):
        team = sorted((r for r in rows if r["vehicles"] == vehicles), key=lambda r: r["loss_expected"])
        for third, name in enumerate(("least", "middle", "most")):
            part = team[third * len(team) // 3 : (third + 1) * len(team) // 3]
            groups[f"third of {name} expected loss, {vehicles}"] = part
    groups[f"with a missing line over {MISSED_M:.0f} m"] = [r for r in rows if r["missing"] > MISSED_M]
    return {name: group for name, group in sorted(groups.items()) if group}


def table(rows: Sequence[Row]) -> list[str]:
    """The groups in Markdown: means, the median of limit / missing, and the share of missions whose limit holds."""
    lines = [
        "| ground, vehicles | missions | missing (m) | expected (m) | expected / true | limit (m) | limit / missing, "
        "median | limit holds (95 % interval) | expected / true loss | within the band |",
        "|---" * 10 + "|",
    ]
    for name, group in groups_of(rows).items():
        mean = {
            key: float(np.mean([r[key] for r in group if r[key] is not None] or [math.nan]))
            for key in ("missing", "expected", "limit", "loss", "loss_expected", "band")
        }
        ratios = [r["limit"] / r["missing"] for r in group if r["missing"] > MISSED_M]
        sharpness = f"{np.median(ratios):.2f}" if ratios else "–"
        holds = proportion([r["missing"] <= r["limit"] for r in group])
        lines.append(
            f"| {name} | {len(group)} | {mean['missing']:.0f} | {mean['expected']:.0f} | "
            f"{mean['expected'] / max(mean['missing'], 1e-9):.2f} | {mean['limit']:.0f} | "
            f"{sharpness} | {holds} | "
            f"{mean['loss_expected'] / max(mean['loss'], 1e-9):.2f} | {mean['band']:.3f} |"
        )
    return lines


def spread(rows: Sequence[Row]) -> str:
    """A line about the band's and the loss's scatter over missions."""
    band = np.array([r["band"] for r in rows if r["band"] is not None])
    ratio = np.array([r["loss_expected"] / r["loss"] for r in rows if r["loss"] > 0.0])
    error = 1.96 * band.std() / math.sqrt(max(len(band), 1))
    return (
        f"within the band: {band.mean():.3f} +- {error:.3f} of the line found (mean of missions, 95 % interval); "
        f"mean |log(expected / true loss)|: {np.abs(np.log(ratio)).mean():.2f}"
    )


def jobs(seeds: Sequence[int], teams: Sequence[int], real: Path | None) -> list[tuple[str, int, str, str]]:
    """Arguments of `mission`, lake by lake, so that a part of them is a sample of all."""
    path = str(real.resolve()) if real else ""
    windows = {k: spread_windows(real, where_of(k), WINDOWS)[:WINDOWS] if real else [] for k in teams}
    found = []
    for number in range(max(len(seeds), *(len(names) for names in windows.values()))):
        for k in teams:
            made_up = [(kind, k, str(seed), "") for seed in seeds[number : number + 1] for kind in KINDS]
            found += made_up + [("real", k, name, path) for name in windows[k][number : number + 1]]
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies what is missing in the file, and prints the table."""
    parser = parser_of("benchmarks.planning.undiscovered", __doc__)
    parser.add_argument("--first", type=int, nargs="+", default=[5000], help="seeds of first lakes")
    parser.add_argument("--lakes", type=int, default=20, help="lakes of each made-up kind from each of them on")
    parser.add_argument("--vehicles", type=int, nargs="+", default=[1, 2, 3], help="teams")
    parser.add_argument("--real", type=existing_file, metavar="FILE", help="a real lake: also fly windows of it")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, default=FOLDER / "undiscovered.jsonl", help="file of soundings")
    options = parser.parse_args(arguments)
    judged_file = options.out.with_suffix(".figures.jsonl")
    flown = {_key(line) for line in read(options.out)}
    seeds = [seed for first in options.first for seed in range(first, first + options.lakes)]
    todo = [job for job in jobs(seeds, options.vehicles, options.real) if job[:3] not in flown]
    for line in fly(mission, todo, options.out, options.processes):
        print(f"{line['kind']} {line['lake']}: {line['vehicles']} vehicles", flush=True)
    judged = {_key(line) for line in read(judged_file)}
    unjudged = [(line,) for line in read(options.out) if _key(line) not in judged]
    for number, _ in enumerate(fly(figures, unjudged, judged_file, options.processes), 1):
        print(f"judged {number} of {len(unjudged)}", flush=True)
    rows = read(judged_file)
    print("\n".join([*table(rows), "", spread(rows)]))


def _key(line: Row) -> tuple[Any, ...]:
    return line["kind"], line["vehicles"], line["lake"]


if __name__ == "__main__":
    end_with(main)
