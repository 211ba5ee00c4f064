"""Distance to a true quality: `tour` with `mission.until`, mowing, and a public planner's covering path.

    python -m benchmarks.planning.until --environment FOLDER --lakes 5

One vehicle maps the small area with perfect navigation. It flies each method and ends when its map has the share found
that `mission.until.found` asks for (`ASKED`), at the latest after `STEPS` legs. Then the same lake is mown with finer
and finer lanes, and measured along the paths of `GCBCover` (sgptools 2.0.7, installed as `benchmarks.planning.peer`
does) for smaller and smaller posterior variances, until as large a share of the true isobath is found. Lines of both
are measured exactly, corners included, and the way to the mown line's start is not counted: this favors them. Without
`--environment` the peer is left out. `scripts/bench until` prints the means.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.plan import length_m
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_gp.level_set.lines import near, resample
from auv_lse_gp.map.certainty import FOUND, classify, lines_of
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_shore.judge.isobath import trace
from benchmarks.command import end_with
from benchmarks.planning.peer import environment
from benchmarks.planning.peer import request as peer_request
from benchmarks.planning.planner_loop import light_mission, settings_for
from benchmarks.planning.planner_methods import AREAS, area
from benchmarks.planning.undiscovered_flights import ground_of
from benchmarks.results_file import FOLDER, fly, read
from benchmarks.rows import Row, row

Array = NDArray[np.float64]

#: Share found at which missions end, and their largest number of legs.
ASKED, STEPS = 0.8, 160
METHODS = ("tour",)
KINDS = ("valley", "rough", "gaussian")
FIRST = 9800
#: Lane spacings (m) and largest posterior variances (m2), coarse to fine.
SPACINGS = (115.0, 97.0, 80.0, 65.0, 55.0, 45.0, 38.0, 32.0, 27.0, 22.0, 18.0)
VARIANCES = (40.0, 35.0, 30.0, 25.0, 20.0, 16.0, 13.0, 10.0)
SOUNDING_STD_M, SOUNDING_EVERY_S = 0.2, 2.0


def settings(method: str, steps: int) -> PlannerSettings:
    """Settings of a mission that ends with the quality."""
    return settings_for(method, 1, area("small")[1], mission={"steps": steps, "until": {"found": ASKED}})


def lanes(spacing_m: float) -> Array:
    """Corners (n, 2) of one line of lanes over the whole area."""
    height, width, margin = AREAS["small"]
    edge = 10.0 - margin
    south, north, west, east = edge, height - margin - 10.0, edge, width - margin - 10.0
    corners: list[tuple[float, float]] = []
    for i, at in enumerate(np.linspace(west, east, max(2, round((east - west) / spacing_m) + 1)).tolist()):
        corners += [(south, at), (north, at)][:: 1 if i % 2 == 0 else -1]
    return np.array(corners)


def covering(python: Path, folder: Path) -> list[Array]:
    """The peer's paths, one for each of `VARIANCES`; planned once, then read from the folder."""
    wanted = {**peer_request(0), "variances_m2": VARIANCES}
    file = folder / "peer_cover.json"
    stored = json.loads(file.read_text()) if file.exists() else {}
    if stored.get("request") != json.loads(json.dumps(wanted)):
        script = Path(__file__).with_name("peer_path.py")
        done = subprocess.run([python, script], input=json.dumps(wanted), check=False, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"{script.name} failed in {python}:\n{done.stderr.strip()[-2000:]}")
        stored = {"request": wanted, "paths": json.loads(done.stdout)}
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(stored))
    return [np.array(path) for path in stored["paths"]]


def measured(line_m: Array, speed_mps: float, ground: Any, seed: int) -> Array:
    """Soundings along a line (n, 2): rows of time (s), north, east, depth (m)."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line_m, axis=0).T))])
    at_m = np.arange(0.0, along[-1], SOUNDING_EVERY_S * speed_mps)
    places = np.column_stack([np.interp(at_m, along, line_m[:, i]) for i in (0, 1)])
    depth = np.asarray(ground.depth_m(places[:, 0], places[:, 1]), float)
    depth = np.maximum(depth + SOUNDING_STD_M * stream(seed, "mowing").normal(size=len(depth)), 0.1)
    rows = np.column_stack([at_m / speed_mps, places, depth])
    return rows[np.isfinite(depth)]


def found_share(chosen: PlannerSettings, rows: Array, ground: Any) -> float:
    """Share of the true isobath within 10 m of what the map of soundings calls found."""
    operating = OperatingArea(chosen.area)
    depth_map = DepthMap(chosen.gp, chosen.level_set, operating)
    prior, grid = depth_map.field(), depth_map.grid
    depth_map.add_soundings(rows)
    places = np.column_stack([rows[:, 1:3], np.zeros(len(rows))])
    pieces = classify(depth_map.isobath().lines, depth_map.field(), prior, places)
    depth = np.where(grid.inside, ground.depth_m(*np.meshgrid(grid.north_m, grid.east_m, indexing="ij")), np.nan)
    truth = resample(trace(grid.north_m, grid.east_m, depth, chosen.level_set.level_m))
    return float(np.mean(near(lines_of(pieces, FOUND))(truth))) if len(truth) else math.nan


def compared(
    method: str, kind: str, lake: str, steps: int, covers: Sequence[Sequence[Sequence[float]]]
) -> dict[str, Any]:
    """One lake: the mission that ended, and the shortest mown line and path of the peer that find as much."""
    chosen, ground = settings(method, steps), ground_of(kind, lake, "small", "")
    outcome = light_mission(chosen, ground, int(lake))
    (boat,) = outcome.boats
    share = found_share(chosen, np.array(boat.soundings), ground)
    line: dict[str, Any] = {"method": method, "kind": kind, "lake": lake, "steps": steps, "share": share}
    line |= {"legs": len(boat.planner.records), "reached": boat.planner.until.reached, "flown_m": outcome.travelled_m}
    line["promised"] = boat.planner.until.quality.found_share
    speed = chosen.vehicle.speed_mps
    for name, paths in (("mown", [lanes(spacing) for spacing in SPACINGS]), ("peer", [np.array(c) for c in covers])):
        line[f"{name}_m"] = None
        for path in paths:
            if found_share(chosen, measured(path, speed, ground, int(lake)), ground) >= share:
                line[f"{name}_m"] = length_m(path)
                break
    return line


def ratios(lines: Sequence[dict[str, Any]], method: str, name: str) -> list[float]:
    """A method's distance relative to another's, for each lake where both are known."""
    return [line["flown_m"] / line[f"{name}_m"] for line in lines if line["method"] == method and line[f"{name}_m"]]


def table(lines: Sequence[dict[str, Any]]) -> str:
    """A line for each lake, in Markdown."""
    text = [
        "| method, lake | legs | ended by the map | found, promised | found, true | flown (m) | mown (m) | "
        "`GCBCover` (m) |\n"
        f"|{'---|' * 8}"
    ]
    for line in sorted(lines, key=lambda line: (line["method"], line["kind"], line["lake"])):
        others = ["none" if line[f"{name}_m"] is None else f"{line[f'{name}_m']:,.0f}" for name in ("mown", "peer")]
        ended = "yes" if line["reached"] else "no"
        text.append(
            f"| {line['method']}, {line['kind']} {line['lake']} | {line['legs']} | {ended} | "
            f"{line['promised']:.2f} | {line['share']:.2f} | {line['flown_m']:,.0f} | {' | '.join(others)} |"
        )
    return "\n".join(text)


def run(smoke: bool = False) -> list[Row]:
    """Rows of `scripts/bench until`; `--smoke` leaves the peer out."""
    covers = [] if smoke else [c.tolist() for c in covering(environment(FOLDER / "peer"), FOLDER)]
    lakes, steps = (1, 10) if smoke else (3, STEPS)
    kinds = KINDS[:1] if smoke else KINDS
    jobs = [(method, kind, str(FIRST + i)) for method in METHODS for kind in kinds for i in range(lakes)]
    lines = [compared(*job, steps, covers) for job in jobs]
    return [
        found for method in METHODS for found in _rows(method, [line for line in lines if line["method"] == method])
    ]


def _rows(method: str, lines: Sequence[dict[str, Any]]) -> list[Row]:
    """Rows of one method's missions."""
    ended, share = (float(np.mean([line[key] for line in lines])) for key in ("reached", "share"))
    rows = [row(f"{method}: missions that ended with the quality", ended, "of all")]
    rows.append(row(f"{method}: true share found", share, "of the true isobath"))
    for name, against, goal in (("mown", "mowing", 0.5), ("peer", "GCBCover", 1.0)):
        if found := ratios(lines, method, name):
            mean = float(np.mean(found))
            title, unit = f"{method}: distance, {len(found)} lakes", f"of {against}'s"
            rows.append(row(title, mean, unit, against, goal=f"at most {goal:g}", holds=mean <= goal))
    return rows


def main(arguments: list[str] | None = None) -> None:
    """Flies what is missing in the file, and prints the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.planning.until", description=__doc__)
    parser.add_argument("--environment", type=Path, metavar="FOLDER", help="of the peer (default: without it)")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS, help="kinds of ground")
    parser.add_argument("--lakes", type=int, default=5, help="number of lakes of each kind (default: %(default)s)")
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first lake (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=FOLDER / "until.jsonl", help="results file (default: %(default)s)")
    parser.add_argument("--processes", type=int, default=2, help="missions flown at once (default: %(default)s)")
    options = parser.parse_args(arguments)
    covers: list[Any] = []
    if options.environment:
        covers = [c.tolist() for c in covering(environment(options.environment), options.out.parent)]
    done = {(line["method"], line["kind"], line["lake"]) for line in read(options.out)}
    lakes = [str(options.first + i) for i in range(options.lakes)]
    jobs = [(method, kind, lake, STEPS, covers) for lake in lakes for kind in options.kinds for method in METHODS]
    for line in fly(compared, [job for job in jobs if job[:3] not in done], options.out, options.processes):
        print(line["method"], line["kind"], line["lake"], f"{line['flown_m']:.0f} m", file=sys.stderr, flush=True)
    lines = read(options.out)
    print(table(lines))
    for method in METHODS:
        for name in ("mown", "peer"):
            if found := ratios(lines, method, name):
                spread = f"{min(found):.2f} to {max(found):.2f}; {len(found)} lakes"
                print(f"{method} / {name}: {np.mean(found):.2f} ({spread})")


if __name__ == "__main__":
    end_with(main)
