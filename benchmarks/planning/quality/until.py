"""Distance to a true quality: `tour` with `mission.until`, mowing, a public planner, and one that knows the isobath.

    python -m benchmarks.planning.quality.until --environment FOLDER --lakes 5
    python -m benchmarks.planning.quality.until --environment FOLDER --lakes 5 --vehicles 3

Vehicles with perfect navigation map an area of `benchmarks.planning.undiscovered_flights`. They fly each method and end
when their maps have the share found that `mission.until.found` asks for (`ASKED`), at the latest after `STEPS` legs,
teams after `TEAM_STEPS`. Then the same lake is measured along other lines until as large a share of the true isobath is
found:

- *mown*: finer and finer lanes over the whole area;
- *`GCBCover`* (sgptools 2.0.7, installed as `benchmarks.planning.peer` does): smaller and smaller posterior variances.
  Without `--environment` it is left out;
- *known*: the shortest path found along a larger and larger share of the true isobath, from the vehicles' start. No
  planner can know it: this shows how far a goal is within reach.

Distances are those of all vehicles together. A line is cut into as many pieces of equal length as there are vehicles.
It is measured exactly, corners included, and the ways to the beginnings of its pieces are not counted: this favors it.
The known isobath counts the way from the start. `scripts/bench until` prints the means.
"""

from __future__ import annotations

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
from auv_lse_planner.search.routing import ruin_and_recreate
from auv_lse_shore.judge.isobath import trace
from benchmarks.command import end_with, parser_of
from benchmarks.planning import peer
from benchmarks.planning.peer import environment
from benchmarks.planning.peer import request as peer_request
from benchmarks.planning.planner_loop import light_mission, settings_for
from benchmarks.planning.planner_methods import AREAS, area
from benchmarks.planning.undiscovered_flights import LOSS, ground_of, where_of
from benchmarks.results_file import FOLDER, fly, read
from benchmarks.rows import Row, row

Array = NDArray[np.float64]

#: Share found at which missions end, and their largest number of legs, of one vehicle and of each of a team.
ASKED, STEPS, TEAM_STEPS = 0.8, 160, 100
METHODS = ("tour",)
OTHERS = {"mown": "mowing", "peer": "GCBCover", "known": "a path along the known isobath"}
GOALS = {"mown": 0.5, "peer": 1.0}
KINDS = ("valley", "rough", "gaussian")
FIRST = 9800
#: Lane spacings (m), and largest posterior variances (m2) in each area, coarse to fine. In the larger area the peer
#: needs more than an hour for 10 m2.
SPACINGS = (115.0, 97.0, 80.0, 65.0, 55.0, 45.0, 38.0, 32.0, 27.0, 22.0, 18.0)
VARIANCES = {"default": (40.0, 35.0, 30.0, 25.0, 20.0, 16.0, 13.0)}
VARIANCES["small"] = (*VARIANCES["default"], 10.0)
#: Shares of the known isobath that are traveled, and the spacing (m) of the nodes of that path.
KNOWN_SHARES, NODE_M = (0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 1.0), 20.0
#: Iterations of the search for the shortest path through them, and for the least length.
ITERATIONS, BISECTIONS = 10_000, 8
SOUNDING_STD_M, SOUNDING_EVERY_S = 0.2, 2.0


def steps_of(vehicles: int) -> int:
    """Largest number of legs of each vehicle."""
    return STEPS if vehicles == 1 else TEAM_STEPS


def settings(method: str, vehicles: int, steps: int) -> PlannerSettings:
    """Settings of a mission that ends with the quality."""
    until = {"steps": steps, "until": {"found": ASKED}}
    return settings_for(method, vehicles, area(where_of(vehicles))[1], mission=until)


def lanes(spacing_m: float, where: str) -> Array:
    """Corners (n, 2) of one line of lanes over the whole area."""
    height, width, margin = AREAS[where]
    edge = 10.0 - margin
    south, north, west, east = edge, height - margin - 10.0, edge, width - margin - 10.0
    corners: list[tuple[float, float]] = []
    for i, at in enumerate(np.linspace(west, east, max(2, round((east - west) / spacing_m) + 1)).tolist()):
        corners += [(south, at), (north, at)][:: 1 if i % 2 == 0 else -1]
    return np.array(corners)


def covering(python: Path, folder: Path, where: str) -> list[Array]:
    """The peer's paths, one for each of the area's `VARIANCES`; planned once, then read from the folder."""
    wanted = {**peer_request(0, where), "variances_m2": VARIANCES[where]}
    file = folder / f"peer_cover_{where}.json"
    stored = json.loads(file.read_text()) if file.exists() else {}
    if stored.get("request") != json.loads(json.dumps(wanted)):
        script = Path(peer.__file__).with_name("peer_path.py")
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
    locations = np.column_stack([np.interp(at_m, along, line_m[:, i]) for i in (0, 1)])
    depth = np.asarray(ground.depth_m(locations[:, 0], locations[:, 1]), float)
    depth = np.maximum(depth + SOUNDING_STD_M * stream(seed, "mowing").normal(size=len(depth)), 0.1)
    rows = np.column_stack([at_m / speed_mps, locations, depth])
    return rows[np.isfinite(depth)]


def found_share(chosen: PlannerSettings, rows: Array, ground: Any) -> float:
    """Share of the true isobath within 10 m of what the map of soundings calls found."""
    operating = OperatingArea(chosen.area)
    depth_map = DepthMap(chosen.gp, chosen.level_set, operating)
    grid = depth_map.grid
    depth_map.add_soundings(rows)
    locations = np.column_stack([rows[:, 1:3], np.zeros(len(rows))])
    pieces = classify(depth_map.isobath().lines, depth_map.field(), chosen.gp.signal_std_m, locations)
    depth = np.where(grid.inside, ground.depth_m(*np.meshgrid(grid.north_m, grid.east_m, indexing="ij")), np.nan)
    truth = resample(trace(grid.north_m, grid.east_m, depth, chosen.level_set.level_m))
    return float(np.mean(near(lines_of(pieces, FOUND))(truth))) if len(truth) else math.nan


def along_isobath(lines: Sequence[Array], start_m: Array, share: float) -> Array:
    """The shortest path found (n, 2) from a start (2,) along a share of the length of lines."""
    nodes, lengths = [], []
    for line in lines:
        at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        count = max(1, round(at[-1] / NODE_M))
        middles = (np.arange(count) + 0.5) * at[-1] / count
        nodes.append(np.column_stack([np.interp(middles, at, line[:, i]) for i in (0, 1)]))
        lengths.append(np.full(count, at[-1] / count))
    locations, length = np.concatenate([*nodes, start_m[None]]), np.concatenate(lengths)
    cm = np.rint(100.0 * locations)
    distance = np.rint(np.hypot(*(cm[:, None] - cm).transpose(2, 0, 1))).astype(np.int64)
    near = np.argsort(distance[:-1, :-1], axis=1, kind="stable")
    prizes, hot = np.rint(1e4 * length).astype(np.int64), round(100.0 * NODE_M)
    low, high, best = 0, round(100.0 * (4.0 * length.sum() + float(np.hypot(*np.ptp(locations, axis=0))))), np.arange(0)
    for _ in range(BISECTIONS):
        budget = high if not len(best) else (low + high) // 2
        route = ruin_and_recreate(distance, near, prizes, budget, ITERATIONS, hot)
        if float(length[route[1:]].sum()) >= share * float(length.sum()) - 1e-6:
            best, high = route, budget
        else:
            low = budget
    return np.asarray(locations[best])


def compared(
    method: str, vehicles: int, kind: str, lake: str, steps: int, covers: Sequence[Sequence[Sequence[float]]]
) -> dict[str, Any]:
    """One lake: the mission that ended, and the shortest line of each other kind that finds as much."""
    where = where_of(vehicles)
    chosen, ground = settings(method, vehicles, steps), ground_of(kind, lake, where, "")
    outcome = light_mission(chosen, ground, int(lake), LOSS)
    boats = outcome.boats
    rows = np.array(sorted(row for boat in boats for row in boat.soundings))
    share, untils = found_share(chosen, rows, ground), [boat.planner.until for boat in boats]
    line: dict[str, Any] = {"method": method, "vehicles": vehicles, "kind": kind, "lake": lake, "steps": steps}
    line |= {"share": share, "legs": max(len(boat.planner.records) for boat in boats)}
    line |= {"reached": all(until.reached for until in untils), "flown_m": outcome.travelled_m}
    line["promised"] = min(until.quality.found_share for until in untils)
    grid = OperatingArea(chosen.area).grid(chosen.gp.map_resolution_m)
    depth = np.where(grid.inside, ground.depth_m(*np.meshgrid(grid.north_m, grid.east_m, indexing="ij")), np.nan)
    truth = trace(grid.north_m, grid.east_m, depth, chosen.level_set.level_m)
    start = np.array([chosen.vehicle.start_north_m, chosen.vehicle.start_east_m])
    paths = {
        "mown": (lanes(spacing, where) for spacing in SPACINGS),
        "peer": (np.array(cover) for cover in covers),
        "known": (along_isobath(truth, start, part) for part in KNOWN_SHARES) if truth else (),
    }
    for name, tried in paths.items():
        line[f"{name}_m"] = None
        for path in tried:
            if found_share(chosen, measured(path, chosen.vehicle.speed_mps, ground, int(lake)), ground) >= share:
                line[f"{name}_m"] = length_m(path)
                break
    return line


def ratios(lines: Sequence[dict[str, Any]], name: str, own: str = "flown_m") -> list[float]:
    """A distance relative to that of other lines, for each lake where both are known."""
    return [line[own] / line[f"{name}_m"] for line in lines if line[own] and line[f"{name}_m"]]


def table(lines: Sequence[dict[str, Any]]) -> str:
    """A line for each lake, in Markdown."""
    text = [
        "| method, lake, vehicles | legs | ended by the maps | found, promised | found, true | flown (m) | mown (m) | "
        "`GCBCover` (m) | known (m) |\n"
        f"|{'---|' * 9}"
    ]
    for line in sorted(lines, key=lambda line: (line["method"], line["vehicles"], line["kind"], line["lake"])):
        others = ["none" if line[f"{name}_m"] is None else f"{line[f'{name}_m']:,.0f}" for name in OTHERS]
        ended = "yes" if line["reached"] else "no"
        text.append(
            f"| {line['method']}, {line['kind']} {line['lake']}, {line['vehicles']} | {line['legs']} | {ended} | "
            f"{line['promised']:.2f} | {line['share']:.2f} | {line['flown_m']:,.0f} | {' | '.join(others)} |"
        )
    return "\n".join(text)


def run(smoke: bool = False) -> list[Row]:
    """Rows of `scripts/bench until`; `--smoke` leaves the peer and teams out."""
    rows = []
    for vehicles, lakes in ((1, 1),) if smoke else ((1, 3), (3, 1)):
        where, kinds, steps = where_of(vehicles), KINDS[:1] if smoke else KINDS, 10 if smoke else steps_of(vehicles)
        covers = [] if smoke else [c.tolist() for c in covering(environment(FOLDER / "peer"), FOLDER, where)]
        for method in METHODS:
            jobs = [(method, vehicles, kind, str(FIRST + i)) for kind in kinds for i in range(lakes)]
            rows += _rows(
                f"{method}, {vehicles} vehicle{'s' if vehicles > 1 else ''}",
                [compared(*job, steps, covers) for job in jobs],
            )
    return rows


def _rows(name: str, lines: Sequence[dict[str, Any]]) -> list[Row]:
    """Rows of one method's missions."""
    ended, share = (float(np.mean([line[key] for line in lines])) for key in ("reached", "share"))
    rows = [row(f"{name}: missions that ended with the quality", ended, "of all")]
    rows.append(row(f"{name}: true share found", share, "of the true isobath"))
    for other, words in OTHERS.items():
        if found := ratios(lines, other):
            mean, goal = float(np.mean(found)), GOALS.get(other)
            title, unit = f"{name}: distance, {len(found)} lakes", f"of that of {words}"
            if goal is None:
                rows.append(row(title, mean, unit, words))
            else:
                rows.append(row(title, mean, unit, words, goal=f"at most {goal:g}", holds=mean <= goal))
    if found := ratios(lines, "mown", "known_m"):
        title = f"lower bound: a path along the known isobath, {len(found)} lakes"
        rows.append(row(title, float(np.mean(found)), "of mowing's distance", "mowing"))
    return rows


def main(arguments: list[str] | None = None) -> None:
    """Flies what is missing in the file, and prints the table."""
    parser = parser_of("benchmarks.planning.quality.until", __doc__)
    parser.add_argument("--environment", type=Path, metavar="FOLDER", help="of the peer (default: without it)")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS, help="kinds of ground")
    parser.add_argument("--vehicles", type=int, default=1, help="number of vehicles (default: %(default)s)")
    parser.add_argument("--lakes", type=int, default=5, help="number of lakes of each kind (default: %(default)s)")
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first lake (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=FOLDER / "until.jsonl", help="results file (default: %(default)s)")
    parser.add_argument("--processes", type=int, default=2, help="missions flown at once (default: %(default)s)")
    options = parser.parse_args(arguments)
    covers: list[Any] = []
    if options.environment:
        where = where_of(options.vehicles)
        covers = [c.tolist() for c in covering(environment(options.environment), options.out.parent, where)]
    done = {(line["method"], line["vehicles"], line["kind"], line["lake"]) for line in read(options.out)}
    lakes = [str(options.first + i) for i in range(options.lakes)]
    jobs = [
        (method, options.vehicles, kind, lake, steps_of(options.vehicles), covers)
        for lake in lakes
        for kind in options.kinds
        for method in METHODS
    ]
    for line in fly(compared, [job for job in jobs if job[:4] not in done], options.out, options.processes):
        print(line["method"], line["kind"], line["lake"], f"{line['flown_m']:.0f} m", file=sys.stderr, flush=True)
    lines = read(options.out)
    print(table(lines))
    for vehicles in sorted({line["vehicles"] for line in lines}):
        team = [line for line in lines if line["vehicles"] == vehicles]
        for own, other in (("flown", "mown"), ("flown", "peer"), ("flown", "known"), ("known", "mown")):
            if found := ratios(team, other, f"{own}_m"):
                spread = f"{min(found):.2f} to {max(found):.2f}; {len(found)} lakes"
                print(f"{vehicles} vehicles, {own} / {other}: {np.mean(found):.2f} ({spread})")


if __name__ == "__main__":
    end_with(main)
