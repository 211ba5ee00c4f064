"""Pieces of the isobath that missions miss, in the whole simulator (docs/evidence/planner.md).

    scripts/bench missed --lake FILE
    python -m benchmarks.planning.missed --vehicles 3 --first 9600 --lakes 40 --real FILE
    python -m benchmarks.planning.missed --limits --vehicles 3

Flies `tour` over fresh lakes, appends each mission's figures to the file as one JSON line, and continues a file that is
there already. Then it prints a table, a line for each missed piece, and each variant less the first one, lake by lake.
FILE is a lake's grid or soundings; without it no real lake is flown. One vehicle maps 400 m x 500 m, a team 600 m x
700 m.

`--limits` shows what paths of the same length could find. No vehicle flies: locations are exact, turns take no
distance, and every sounding is known to all at once. *Lanes* are straight and equally far apart, in both directions,
with 1, 1.5
and 2 times the team's distance. *Free* soundings, as many as the distance holds at `FREE_APART_M`, go one after the
other to the location where the map so far leaves the isobath least certain, however far away it is: no path reaches
that.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import binomtest

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.level_set.lines import FOUND_WITHIN_M, near, resample
from auv_lse_gp.map.depth_map import DepthMap, contours
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_shore.campaign.mission_row import simulate_and_evaluate
from auv_lse_shore.campaign.statistics import interval, proportion
from auv_lse_shore.judge import isobath
from auv_lse_shore.judge.evaluation import Evaluation
from benchmarks.command import end_with, existing_file, parser_of
from benchmarks.planning.planner_loop import settings_for
from benchmarks.planning.planner_methods import area, spread_windows
from benchmarks.planning.planner_methods import lake as ground_of
from benchmarks.results_file import FOLDER, fly, read
from benchmarks.rows import Row, row

Array = NDArray[np.float64]
Line = dict[str, Any]

#: Settings by name; the first is the one that the others are compared with.
VARIANTS: dict[str, dict[str, Any]] = {
    "tour": {},
    "fitted lanes": {"planner.method": "lawnmower"},
}
#: Seed of the first lake; seeds 8200 to 8211 and 8300 to 8311 were used to choose among trials.
FIRST = 9600
#: A stretch of the true isobath is missed if it is longer than this (m) and nowhere within `FOUND_WITHIN_M`
#: of the estimate.
LEAST_M = 40.0
#: Limits (m) of the distance from the nearest track, and the distance (m) from the area's border, by which the true
#: isobath is divided.
TRACK_M, BORDER_M = (20.0, 40.0), 15.0
#: Figures of a mission's summary that are kept.
KEPT = ("isobath_error_m", "isobath_found", "risk_third", "risk_after", "loss_expected", "loss_after",
        "isobath_undiscovered_m", "isobath_undiscovered_limit_m", "isobath_found_within_m",
        "isobath_found_error_p95_m")  # fmt: skip
#: Figures that `scripts/bench missed` prints, and their units.
UNITS = {"isobath_error_m": "m", "isobath_found": "of all", "risk_after": "", "loss_expected": "", "loss_after": ""}
#: Goals by team and figure: at most, or at least, how much.
GOALS = {(3, "share"): ("<=", 0.025), (3, "isobath_error_m"): ("<=", 2.2), (1, "isobath_found"): (">=", 0.82)}
#: Distance (m) between soundings along a lane, and the noise of each (m).
ALONG_M, NOISE_M = 3.0, 0.2
#: Distance (m) between free soundings: cells of a grid on which they are chosen.
FREE_APART_M = 14.0
#: Ideal plans: lanes to the north or east with so many times the team's distance, and free soundings.
IDEALS = (*((way, times) for times in (1.0, 1.5, 2.0) for way in ("north", "east")), ("free", 1.0))
#: Columns that are compared in pairs: key, heading, whether as a ratio.
PAIRED = (("isobath_error_m", "isobath error (m)", False), ("isobath_found", "found", False),
          ("risk_after", "final risk", True), ("loss_after", "true loss", True))  # fmt: skip


@dataclass(frozen=True, slots=True)
class Missed:
    """A stretch of the true isobath that is longer than `LEAST_M` and that the estimate does not come near.

    Attributes:
        locations_m: Locations along it, (n, 2).
        line_m: Length (m) of the whole line that it belongs to.
    """

    locations_m: Array
    length_m: float
    line_m: float


def missed_pieces(truth: Sequence[Array], estimate: Sequence[Array], within_m: float = FOUND_WITHIN_M) -> list[Missed]:
    """Stretches of true isobath that the estimate misses by more than `within_m` all along."""
    points = resample(estimate)
    tree = cKDTree(points) if len(points) else None
    pieces = []
    for line in truth:
        locations = resample([line])
        away = np.ones(len(locations), dtype=bool) if tree is None else tree.query(locations)[0] > within_m
        if np.array_equal(line[0], line[-1]) and not away.all():  # a closed line begins where nothing is missed
            first = int(np.argmin(away))
            away, locations = np.roll(away, -first), np.roll(locations, -first, axis=0)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], away, [False]]).astype(int)))
        whole = isobath.length_m([line])
        for start, end in edges.reshape(-1, 2):
            pieces.append(Missed(locations[start:end], whole * int(end - start) / len(locations), whole))
    return [piece for piece in pieces if piece.length_m > LEAST_M]


def described(e: Evaluation, piece: Missed) -> Line:
    """Where a missed piece lies: its distance from the nearest track, and the final map's depth along it.

    Returns:
        Lengths (m) of the piece and of its line; means along the piece: distance (m) from the nearest track, standard
        deviation (m) of the map, the map's error in standard deviations, and slope of the true ground (m per m).
    """
    field, ground = e.team, e.run.ground
    assert ground is not None
    north, east = field.grid.north_m, field.grid.east_m
    index = cKDTree(field.grid.locations_m).query(piece.locations_m)[1]
    mean, std = (values[field.grid.inside][index] for values in (field.mean_m, field.std_m))
    slope = np.hypot(*np.gradient(ground.depth_m, north, east))[field.grid.inside][index]
    tracks = np.concatenate([v.truth[:, 1:3] for v in e.run.vehicles])
    return {
        "length_m": round(piece.length_m, 1),
        "line_m": round(piece.line_m, 1),
        "track_m": float(cKDTree(tracks).query(piece.locations_m)[0].mean()),
        "std_m": float(std.mean()),
        "error_stds": float(np.mean(np.abs(mean - e.team_map.level_m) / std)),
        "slope": float(np.nanmean(slope)),
    }


def length_off(e: Evaluation) -> dict[str, list[float]]:
    """Length (m) of the true isobath, and of what the estimate does not come near, by where it lies."""
    locations = resample(e.truth)
    step = isobath.length_m(e.truth) / max(len(locations), 1)
    off = ~near(e.team_map.isobath.lines)(locations)
    track_m = cKDTree(np.concatenate([v.truth[:, 1:3] for v in e.run.vehicles])).query(locations)[0]
    near_m, far_m = TRACK_M
    parts = {
        f"less than {near_m:g} m from a track": track_m < near_m,
        f"{near_m:g} to {far_m:g} m from a track": (track_m >= near_m) & (track_m < far_m),
        f"more than {far_m:g} m from a track": track_m >= far_m,
    }
    parts[f"within {BORDER_M:g} m of the border"] = e.area.clearance_m(locations) < BORDER_M
    return {name: [step * int(np.sum(part)), step * int(np.sum(part & off))] for name, part in parts.items()}


def where_of(vehicles: int) -> str:
    """The area that a team of this size maps."""
    return "small" if vehicles == 1 else "default"


def settings_of(name: str, vehicles: int, lake: str, real: str, steps: int) -> Settings:
    """Settings of a mission: `lake` is a seed, or a window `NAME@NORTH,EAST` of the real lake."""
    (height, width, margin), section = area(where_of(vehicles))
    common = {"mission.vehicles": vehicles, "mission.steps": steps, **VARIANTS[name]}
    if lake.isdigit():
        middle = {"north_m": height / 2.0 - margin, "east_m": width / 2.0 - margin}
        ground = {"seed": int(lake), "height_m": height, "width_m": width, **middle}
        made = {f"sim.lake.{key}": value for key, value in ground.items()}
        polygon = {"area.polygon_m": section["polygon_m"]}
        return Settings.load(None, {"mission.seed": int(lake), **made, **polygon, **common})
    south, west = (float(x) for x in lake.split("@")[1].split(","))
    north, east = south + height, west + width
    corners = [south, west, north, west, north, east, south, east]
    file = {"sim.bathymetry.file": real, "area.polygon_m": corners}
    return Settings.load(None, {"mission.seed": sum(lake.encode()), **file, **common})


def mission(name: str, vehicles: int, lake: str, real: str, steps: int) -> Line:
    """Simulates and evaluates one mission; returns its line."""
    found = simulate_and_evaluate(settings_of(name, vehicles, lake, real, steps).to_patterns(), lake, 2)
    line: Line = {"variant": name, "vehicles": vehicles, "lake": lake, "steps": steps}
    line["pieces"] = [described(found, piece) for piece in missed_pieces(found.truth, found.team_map.isobath.lines)]
    line["lengths_m"] = length_off(found)
    return {**line, **{key: getattr(found.summary, key) for key in KEPT}}


def _number(line: Line, key: str) -> float:
    return math.nan if line[key] is None else float(line[key])


def _mean(lines: Sequence[Line], key: str) -> float:
    return interval([_number(line, key) for line in lines]).mean


def table(lines: Sequence[Line]) -> list[str]:
    """Means of each team and variant, then every missed piece, in Markdown."""
    text = [
        "| ground, vehicles: variant | missions | share with a missed piece | pieces | longest (m) | isobath error (m) "
        "| worst (m) | found | least | final risk | expected loss | true loss | expected / true "
        "| 95 % of the line found expected within (m) | actually | worst |",
        "|---" * 16 + "|",
    ]
    groups: dict[str, list[Line]] = {}
    for line in lines:
        ground = "made up" if line["lake"].isdigit() else "real"
        groups.setdefault(f"{ground}, {line['vehicles']}: {line['variant']}", []).append(line)
    for name, group in groups.items():
        pieces = [piece["length_m"] for line in group for piece in line["pieces"]]
        mean = {key: _mean(group, key) for key in KEPT}
        text.append(
            f"| {name} | {len(group)} | {proportion([bool(line['pieces']) for line in group])} | {len(pieces)} | "
            f"{max(pieces, default=0.0):.0f} | {mean['isobath_error_m']:.1f} | "
            f"{max(_number(line, 'isobath_error_m') for line in group):.1f} | {mean['isobath_found']:.3f} | "
            f"{min(_number(line, 'isobath_found') for line in group):.2f} | {mean['risk_after']:.3f} | "
            f"{mean['loss_expected']:.3f} | {mean['loss_after']:.3f} | "
            f"{mean['loss_expected'] / max(mean['loss_after'], 1e-9):.2f} | {mean['isobath_found_within_m']:.1f} | "
            f"{mean['isobath_found_error_p95_m']:.1f} | "
            f"{max(_number(line, 'isobath_found_error_p95_m') for line in group):.1f} |"
        )
    text += ["", *lengths(groups)]
    text += [
        "",
        "| mission with a missed piece | length (m) | of a line of (m) | from the nearest track (m) | std there (m) "
        "| error (std) | true slope | isobath error (m) | expected loss | true loss |",
        "|---" * 10 + "|",
    ]
    for line in lines:
        for piece in line["pieces"]:
            text.append(
                f"| {line['vehicles']}, {line['lake']}: {line['variant']} | {piece['length_m']:.0f} | "
                f"{piece['line_m']:.0f} | {piece['track_m']:.0f} | {piece['std_m']:.1f} | {piece['error_stds']:.1f} | "
                f"{piece['slope']:.2f} | {_number(line, 'isobath_error_m'):.1f} | {line['loss_expected']:.3f} | "
                f"{line['loss_after']:.3f} |"
            )
    return text


def lengths(groups: Mapping[str, Sequence[Line]]) -> list[str]:
    """Where the true isobath lies that the estimate does not come near, in Markdown."""
    text = [
        "| ground, vehicles: variant | where | share of the isobath | share not found there | share of all not found |",
        "|---" * 5 + "|",
    ]
    for name, group in groups.items():
        sums = {part: np.sum([line["lengths_m"][part] for line in group], axis=0) for part in group[0]["lengths_m"]}
        by_track = list(sums.values())[: len(TRACK_M) + 1]  # these parts add up to the whole isobath
        whole, off = np.sum(by_track, axis=0)
        for part, (length, missed) in sums.items():
            shares = length / whole, missed / max(length, 1e-9), missed / max(off, 1e-9)
            text.append(f"| {name} | {part} | " + " | ".join(f"{share:.3f}" for share in shares) + " |")
    return text


def pairs(lines: Sequence[Line]) -> list[str]:
    """Each variant minus the first one of `VARIANTS`, lake by lake, with 95 % intervals, in Markdown."""
    by = {(line["variant"], line["vehicles"], line["lake"]): line for line in lines}
    first = next(iter(VARIANTS))
    text = [f"| minus {first} | lakes | " + " | ".join(title for _, title, _ in PAIRED) + " |", "|---" * 6 + "|"]
    for name, vehicles in sorted({key[:2] for key in by if key[0] != first}, key=str):
        both = [
            (by[first, vehicles, lake], line)
            for (n, v, lake), line in by.items()
            if (n, v) == (name, vehicles) and (first, vehicles, lake) in by
        ]
        cells = []
        for key, _, relative in PAIRED:
            values = [(_number(a, key), _number(b, key)) for a, b in both]
            found = interval([100.0 * (b / a - 1.0) if relative else b - a for a, b in values])
            unit = " %" if relative else ""
            digits = 0 if relative else 2
            cells.append(f"{found.mean:+.{digits}f}{unit} ({found.low:+.{digits}f}..{found.high:+.{digits}f})")
        text.append(f"| {vehicles}: {name} | {len(both)} | " + " | ".join(cells) + " |")
    return text


def lanes(extent_m: Sequence[float], length_m: float, north: bool) -> Array:
    """Locations (P, 2) along parallel lanes that are `length_m` long together with the ways between them.

    Args:
        extent_m: South, north, west and east border (m) of the area.
        length_m: Distance that is travelled.
        north: Whether the lanes run north and south.
    """
    south, top, west, east = extent_m
    if not north:
        south, top, west, east = west, east, south, top
    apart = (east - west) * (top - south) / (length_m - (east - west))
    along, across = np.arange(south, top, ALONG_M), np.arange(west + 0.5 * apart, east, apart)
    locations = np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1).transpose(1, 0, 2).reshape(-1, 2)
    return locations if north else locations[:, ::-1]


def free_locations(
    settings: PlannerSettings, depth_m: Any, cells_m: Array, count: int, rng: np.random.Generator
) -> Array:
    """Locations (count, 2) of soundings among cells (M, 2), each chosen given the depths of all before it."""
    posterior = Posterior(settings.gp)
    scaled, noise = posterior.kernel.scale(cells_m), settings.gp.noise_std_m**2
    covariance = np.array(posterior.kernel.of_scaled(scaled, scaled), dtype=float)
    mean = np.array(posterior.prior_mean(cells_m), dtype=float)
    measured = np.asarray(depth_m(cells_m[:, 0], cells_m[:, 1])) + NOISE_M * rng.standard_normal(len(cells_m))
    left = np.isfinite(measured)
    chosen = []
    for _ in range(min(count, int(left.sum()))):
        variance = np.maximum(np.diag(covariance), 1e-9)
        off = mean - settings.level_set.level_m
        worth = np.where(left, np.sqrt(variance) * np.exp(-0.5 * off * off / variance), -1.0)
        best = int(np.argmax(worth))
        gain = covariance[best] / (variance[best] + noise)
        mean = mean + gain * (measured[best] - mean[best])
        covariance -= np.outer(gain, covariance[best])
        left[best] = False
        chosen.append(best)
    return cells_m[chosen]


def ideal(way: str, times: float, vehicles: int, name: str) -> Line:
    """The line of one ideal plan on one lake."""
    where = where_of(vehicles)
    settings, ground = settings_for("tour", vehicles, area(where)[1]), ground_of(name, where, None)
    operating, rng = OperatingArea(settings.area), stream(int(name), "missed limits")
    length_m = times * vehicles * settings.mission.steps * MotionTable(settings.motion).leg_length_m
    if way == "free":
        cells = operating.grid(FREE_APART_M).locations_m
        locations = free_locations(settings, ground.depth_m, cells, int(length_m / FREE_APART_M), rng)
    else:
        locations = lanes(operating.extent_m, length_m, way == "north")
    depth = np.asarray(ground.depth_m(locations[:, 0], locations[:, 1])) + NOISE_M * rng.standard_normal(len(locations))
    depth_map = DepthMap(settings.gp, settings.level_set, operating)
    depth_map.gp.add_all(np.column_stack([locations, depth])[np.isfinite(depth)])
    grid, level = depth_map.grid, settings.level_set.level_m
    truth = contours(grid, grid.fill(np.asarray(ground.depth_m(*grid.locations_m.T))), level)
    estimate = depth_map.isobath().lines
    found = isobath.compare(estimate, truth)
    lengths = [round(piece.length_m, 1) for piece in missed_pieces(truth, estimate)]
    key = {"way": way, "times": times, "vehicles": vehicles, "lake": name}
    return {**key, "missed_m": lengths, "error_m": found.mean_m, "found": found.found}


def limits_table(lines: Sequence[Line]) -> list[str]:
    """One row for each team and plan, in Markdown."""
    text = [
        "| vehicles, plan | lakes | share with a missed piece | pieces per lake | isobath error (m) | found |",
        "|---" * 6 + "|",
    ]
    groups: dict[tuple[int, str, float], list[Line]] = {}
    for line in lines:
        groups.setdefault((line["vehicles"], line["way"], line["times"]), []).append(line)
    for (vehicles, way, times), group in groups.items():
        name = "free soundings" if way == "free" else f"lanes to the {way}"
        text.append(
            f"| {vehicles}, {name}, {times:g} x the distance | {len(group)} | "
            f"{proportion([bool(line['missed_m']) for line in group])} | "
            f"{np.mean([len(line['missed_m']) for line in group]):.1f} | "
            f"{interval([line['error_m'] for line in group]).mean:.1f} | {np.mean([r['found'] for r in group]):.3f} |"
        )
    return text


def run(smoke: bool = False, lake: Path | None = None) -> list[Row]:
    """Rows of `scripts/bench missed`: a few fresh lakes and, with a file, one window of the real lake."""
    lakes, steps = (1, 6) if smoke else (4, 100)
    rows = []
    for vehicles in (3, 1):
        names = [str(FIRST + i) for i in range(lakes)]
        if lake is not None:
            names += spread_windows(lake, where_of(vehicles), 1)
        tours, lanes = (
            [mission(variant, vehicles, name, str(lake or ""), steps) for name in names]
            for variant in ("tour", "fitted lanes")
        )
        rows += _rows(vehicles, tours, lanes)
    if lake is None:
        rows.append(row("real lake: skipped, no --lake FILE", None, ""))
    return rows


def _rows(vehicles: int, lines: Sequence[Line], others: Sequence[Line]) -> list[Row]:
    """Rows of one team: figures of `tour`, beside those of fitted lanes on the same lakes."""
    team = f"{vehicles} vehicle{'s' * (vehicles > 1)}, {len(lines)} lakes"
    missed, theirs = (sum(bool(line["pieces"]) for line in found) for found in (lines, others))
    limits = binomtest(missed, len(lines)).proportion_ci(method="wilson")
    head = f"{team}: missions with a missed piece over {LEAST_M:.0f} m"
    share, lanes = missed / len(lines), f"fitted lanes: {theirs / len(others):.3g}"
    rows = [row(head, share, "of all", lanes, **_goal(vehicles, "share", share))]
    rows += [row(f"{head}, {name} 95 % limit", x, "of all") for name, x in zip(("lower", "upper"), limits, strict=True)]
    for key, unit in UNITS.items():
        mean = _mean(lines, key)
        if math.isfinite(mean):
            against = f"fitted lanes: {_mean(others, key):.3g}"
            rows.append(row(f"{team}: {key}", mean, unit, against, **_goal(vehicles, key, mean)))
    ratios = [_number(a, "risk_after") / _number(b, "risk_after") for a, b in zip(lines, others, strict=True)]
    rows.append(row(f"{team}: risk_after, mean ratio of the same lake", interval(ratios).mean, "", "fitted lanes"))
    return rows


def _goal(vehicles: int, key: str, value: float) -> dict[str, Any]:
    """A row's goal and whether it holds; empty without one."""
    if (vehicles, key) not in GOALS:
        return {}
    sign, limit = GOALS[vehicles, key]
    return {"goal": f"{sign} {limit:g}", "holds": value <= limit if sign == "<=" else value >= limit}


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies what is missing in the file, and prints the tables."""
    parser = parser_of("benchmarks.planning.missed", __doc__)
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first lake (default: %(default)s)")
    parser.add_argument("--lakes", type=int, default=12, help="made-up lakes (default: %(default)s)")
    parser.add_argument("--vehicles", type=int, nargs="+", default=[1, 3], metavar="K", help="teams")
    parser.add_argument("--variants", nargs="+", default=list(VARIANTS), choices=VARIANTS, help="what is compared")
    parser.add_argument("--real", type=existing_file, metavar="FILE", help="a real lake: also fly windows of it")
    parser.add_argument("--windows", type=int, default=1, help="windows of the real lake (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=100, help="legs of each vehicle (default: %(default)s)")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, default=FOLDER / "missed.jsonl", help="results file")
    parser.add_argument("--limits", action="store_true", help="judge ideal plans instead of flying missions")
    options = parser.parse_args(arguments)
    if options.limits:
        _judge_ideals(options)
        return
    real = str(options.real.resolve()) if options.real else ""
    jobs = []
    for vehicles in options.vehicles:
        lakes = [str(options.first + i) for i in range(options.lakes)]
        if options.real:
            lakes += spread_windows(options.real, where_of(vehicles), options.windows)
        jobs += [(name, vehicles, lake, real, options.steps) for lake in lakes for name in options.variants]
    if not options.real:
        print("real lake: skipped, no --real FILE")
    flown = {(line["variant"], line["vehicles"], line["lake"], line["steps"]) for line in read(options.out)}
    jobs = [job for job in jobs if (*job[:3], job[4]) not in flown]
    for line in fly(mission, jobs, options.out, options.processes):
        lengths = [piece["length_m"] for piece in line["pieces"]]
        print(f"{line['vehicles']}, {line['lake']}: {line['variant']}: missed {lengths}", flush=True)
    lines = sorted(read(options.out), key=lambda r: (r["vehicles"], r["lake"], r["variant"]))
    print("\n".join([*table(lines), "", *pairs(lines)]))


def _judge_ideals(options: argparse.Namespace) -> None:
    """Judges the ideal plans that are missing in the file, and prints their table."""
    out = options.out.with_name(f"{options.out.stem}_limits{options.out.suffix}")
    lakes = [str(options.first + i) for i in range(options.lakes)]
    jobs = [(*i, vehicles, name) for vehicles in options.vehicles for name in lakes for i in IDEALS]
    known = {(line["way"], line["times"], line["vehicles"], line["lake"]) for line in read(out)}
    for line in fly(ideal, [job for job in jobs if job not in known], out, options.processes):
        name = f"{line['vehicles']}, {line['lake']}: {line['way']} {line['times']:g}"
        print(f"{name}: missed {line['missed_m']}", flush=True)
    order = {key: number for number, key in enumerate(IDEALS)}
    lines = sorted(read(out), key=lambda r: (r["vehicles"], order[r["way"], r["times"]], r["lake"]))
    print("\n".join(limits_table(lines)))


if __name__ == "__main__":
    end_with(main)
