"""Calibration of what a mission's report promises: found line, missing line, expected loss (docs/evidence/gp.md).

    python -m benchmarks.planning.undiscovered --lakes 20 --real LAKE_FILE --out undiscovered.jsonl

Flies missions over fresh lakes (`undiscovered_flights.py`) with one to three vehicles, appends each mission's soundings
to the file as one JSON line, and continues a file that is there already. Then it prints a table.
Seeds 100 to 107 were used while choosing the parameters of `auv_lse_gp/map/undiscovered.py`, and 6000 to 6003 those of
`auv_lse_gp/inference/roughness.py`.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.spatial import cKDTree

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_gp.level_set.lines import near, resample
from auv_lse_gp.map import certainty
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_gp.map.undiscovered import coarse_grid, undiscovered
from auv_lse_shore.judge import isobath
from benchmarks.command import end_with, existing_file
from benchmarks.planning.planner_methods import spread_windows
from benchmarks.planning.undiscovered_flights import ground_of, mission, settings, where_of
from benchmarks.results_file import FOLDER, fly, read

#: Half width of the 95 % band in standard deviations.
BAND = 1.96
#: Number of windows of a real lake for each number of vehicles.
WINDOWS = 10

Row = dict[str, Any]


def figures(line: Row) -> Row:
    """What a mission's map promises and what is true."""
    chosen = settings(line["vehicles"])
    area, level = OperatingArea(chosen.area), chosen.level_set.level_m
    depth_map = DepthMap(chosen.gp, chosen.level_set, area)
    prior, rows = depth_map.field(), np.array(line["soundings"])
    depth_map.add_soundings(rows)
    field, grid = depth_map.field(), depth_map.grid
    places = np.column_stack([rows[:, 1:3], np.zeros(len(rows))])
    pieces = certainty.classify(depth_map.isobath().lines, field, prior, places)
    found = certainty.lines_of(pieces, certainty.FOUND)
    ground = ground_of(line["kind"], line["lake"], where_of(line["vehicles"]), line["real"])
    depth = np.where(grid.inside, ground.depth_m(*np.meshgrid(grid.north_m, grid.east_m, indexing="ij")), np.nan)
    truth = isobath.trace(grid.north_m, grid.east_m, depth, level)
    located = near(found)
    missing = undiscovered(chosen.gp, depth_map.centers, level, coarse_grid(area, chosen.gp.map_resolution_m), located)
    known = np.isfinite(depth)
    called, deep = depth_map.level_set.safe(field.mean_m[known], field.std_m[known]), depth[known] >= level
    cost = np.where(called, chosen.level_set.cost_false_safe, chosen.level_set.cost_false_unsafe)
    sure = [p for p in pieces if p.kind == certainty.FOUND]
    tree = cKDTree(resample(truth, 0.5))
    off = [tree.query(p.line)[0] / np.maximum(p.std_m, 1e-6) for p in sure] or [np.empty(0)]
    return {
        **{key: line[key] for key in ("kind", "vehicles", "lake")},
        "missing": isobath.length_m(truth) * (1.0 - float(np.mean(located(resample(truth))))),
        "expected": missing.expected_m,
        "limit": missing.limit_m,
        "loss": float(np.mean(cost * (called != deep))),
        "loss_expected": float(field.risk[known].mean()),
        "band": float(np.mean(np.concatenate(off) <= BAND)) if sure else None,
        "wide": float(np.mean(np.concatenate(off) <= certainty.WIDENED * BAND)) if sure else None,
    }


def table(rows: Sequence[Row]) -> list[str]:
    """Groups of missions: by ground and team, then by third of expected loss within each team, in Markdown."""
    lines = [
        "| ground, vehicles | missions | missing (m) | expected (m) | expected / true | limit (m) | limit holds | "
        "expected / true loss | within the band | within 1.2 bands |",
        "|---" * 10 + "|",
    ]
    groups: dict[str, list[Row]] = {}
    for r in rows:
        for name in (f"{r['kind']}, {r['vehicles']}", f"{r['kind']}, all", f"all, {r['vehicles']}", "all"):
            groups.setdefault(name, []).append(r)
    for vehicles in (1, 2, 3):
        team = sorted((r for r in rows if r["vehicles"] == vehicles), key=lambda r: r["loss_expected"])
        for third, name in enumerate(("least", "middle", "most")):
            part = team[third * len(team) // 3 : (third + 1) * len(team) // 3]
            groups[f"third of {name} expected loss, {vehicles}"] = part
    groups["with a missing line over 40 m"] = [r for r in rows if r["missing"] > 40.0]
    for name, group in sorted(groups.items()):
        if not group:
            continue
        mean = {
            key: float(np.mean([r[key] for r in group if r[key] is not None]))
            for key in ("missing", "expected", "limit", "loss", "loss_expected", "band", "wide")
        }
        held = 100.0 * np.mean([r["missing"] <= r["limit"] for r in group])
        lines.append(
            f"| {name} | {len(group)} | {mean['missing']:.0f} | {mean['expected']:.0f} | "
            f"{mean['expected'] / max(mean['missing'], 1e-9):.2f} | {mean['limit']:.0f} | {held:.0f} % | "
            f"{mean['loss_expected'] / max(mean['loss'], 1e-9):.2f} | {100.0 * mean['band']:.0f} % | "
            f"{100.0 * mean['wide']:.0f} % |"
        )
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies what is missing in the file, and prints the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.planning.undiscovered",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--first", type=int, default=5000, help="seed of the first lake")
    parser.add_argument("--lakes", type=int, default=20, help="lakes of each made-up kind")
    parser.add_argument("--vehicles", type=int, nargs="+", default=[1, 2, 3], help="teams")
    parser.add_argument("--real", type=existing_file, metavar="FILE", help="a real lake: also fly windows of it")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, default=FOLDER / "undiscovered.jsonl", help="file of soundings")
    options = parser.parse_args(arguments)
    jobs = [
        (kind, vehicles, str(seed), "")
        for vehicles in options.vehicles
        for seed in range(options.first, options.first + options.lakes)
        for kind in ("valley", "rough", "gaussian")
    ]
    if options.real:
        jobs += [
            ("real", vehicles, window, str(options.real.resolve()))
            for vehicles in options.vehicles
            for window in spread_windows(options.real, where_of(vehicles), WINDOWS)[:WINDOWS]
        ]
    flown = {(line["kind"], line["vehicles"], line["lake"]) for line in read(options.out)}
    for line in fly(mission, [job for job in jobs if job[:3] not in flown], options.out, options.processes):
        print(f"{line['kind']} {line['lake']}: {line['vehicles']} vehicles", flush=True)
    print("\n".join(table([figures(line) for line in read(options.out)])))


if __name__ == "__main__":
    end_with(main)
