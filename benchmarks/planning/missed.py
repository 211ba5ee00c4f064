"""Pieces of the isobath that missions miss, in the whole simulator (docs/evidence/planner.md).

    scripts/bench missed --lake FILE
    python -m benchmarks.planning.missed --vehicles 3 --first 9600 --lakes 40 --real FILE

Flies `tour` over fresh lakes, appends each mission's figures to the file as one JSON line, and continues a file that is
there already. Then it prints a table, and pairs each variant with the first one lake by lake. FILE is a lake's grid or
soundings; without it no real lake is flown. One vehicle maps 400 m x 500 m, a team 600 m x 700 m.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from auv_lse_common.mission_file.settings import Settings
from auv_lse_gp.level_set.lines import FOUND_WITHIN_M, resample
from auv_lse_shore.campaign.mission_row import simulate_and_evaluate
from auv_lse_shore.campaign.statistics import interval
from auv_lse_shore.judge import isobath
from benchmarks.command import end_with, existing_file
from benchmarks.planning.planner_methods import area, spread_windows
from benchmarks.results_file import FOLDER, fly, read
from benchmarks.rows import Row, row

Array = NDArray[np.float64]
Line = dict[str, Any]

#: Settings by name; the first is the one that the others are compared with.
VARIANTS: dict[str, dict[str, Any]] = {
    "tour": {},
    "joint routes": {"planner.team_routes": True},
}
#: Seed of the first lake; seeds 8200 to 8211 and 8300 to 8311 were used to choose among trials.
FIRST = 9600
#: A stretch of the true isobath is missed if it is longer than this (m) and nowhere within `FOUND_WITHIN_M`
#: of the estimate.
LEAST_M = 40.0
#: Figures of a mission's summary that are kept.
KEPT = ("isobath_error_m", "isobath_found", "risk_third", "risk_after", "loss_expected", "loss_after",
        "isobath_undiscovered_m", "isobath_undiscovered_limit_m", "isobath_found_within_m",
        "isobath_found_error_p95_m")  # fmt: skip
#: Figures that `scripts/bench missed` prints, and their units.
UNITS = {"isobath_error_m": "m", "isobath_found": "of all", "risk_after": "", "loss_expected": "", "loss_after": ""}
#: Columns that are compared in pairs: key, heading, whether as a ratio.
PAIRED = (("isobath_error_m", "isobath error (m)", False), ("isobath_found", "found", False),
          ("risk_after", "final risk", True), ("loss_after", "true loss", True))  # fmt: skip


def missed_m(truth: Sequence[Array], estimate: Sequence[Array], within_m: float = FOUND_WITHIN_M) -> list[float]:
    """Lengths (m) of the stretches of true isobath longer than `LEAST_M` that the estimate does not come near."""
    points = resample(estimate)
    tree = cKDTree(points) if len(points) else None
    lengths = []
    for line in truth:
        places = resample([line])
        away = np.ones(len(places), dtype=bool) if tree is None else tree.query(places)[0] > within_m
        if np.array_equal(line[0], line[-1]) and not away.all():  # a closed line begins where nothing is missed
            away = np.roll(away, -int(np.argmin(away)))
        edges = np.flatnonzero(np.diff(np.concatenate([[False], away, [False]]).astype(int)))
        step = isobath.length_m([line]) / len(places)
        lengths += [step * int(end - start) for start, end in edges.reshape(-1, 2)]
    return [round(length, 1) for length in lengths if length > LEAST_M]


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
    line["missed_m"] = missed_m(found.truth, found.team_map.isobath.lines)
    return {**line, **{key: getattr(found.summary, key) for key in KEPT}}


def _number(line: Line, key: str) -> float:
    return math.nan if line[key] is None else float(line[key])


def _mean(lines: Sequence[Line], key: str) -> float:
    return interval([_number(line, key) for line in lines]).mean


def table(lines: Sequence[Line]) -> list[str]:
    """Means of each team and variant, then the missions that missed a piece, in Markdown."""
    text = [
        "| ground, vehicles: variant | missions | with a missed piece | pieces | longest (m) | isobath error (m) "
        "| worst (m) | found | least | final risk | expected loss | true loss | expected / true "
        "| 95 % of the line found expected within (m) | actually | worst |",
        "|---" * 16 + "|",
    ]
    groups: dict[str, list[Line]] = {}
    for line in lines:
        ground = "made up" if line["lake"].isdigit() else "real"
        groups.setdefault(f"{ground}, {line['vehicles']}: {line['variant']}", []).append(line)
    for name, group in groups.items():
        pieces = [piece for line in group for piece in line["missed_m"]]
        mean = {key: _mean(group, key) for key in KEPT}
        text.append(
            f"| {name} | {len(group)} | {sum(bool(line['missed_m']) for line in group)} | {len(pieces)} | "
            f"{max(pieces, default=0.0):.0f} | {mean['isobath_error_m']:.1f} | "
            f"{max(_number(line, 'isobath_error_m') for line in group):.1f} | {mean['isobath_found']:.3f} | "
            f"{min(_number(line, 'isobath_found') for line in group):.2f} | {mean['risk_after']:.3f} | "
            f"{mean['loss_expected']:.3f} | {mean['loss_after']:.3f} | "
            f"{mean['loss_expected'] / max(mean['loss_after'], 1e-9):.2f} | {mean['isobath_found_within_m']:.1f} | "
            f"{mean['isobath_found_error_p95_m']:.1f} | "
            f"{max(_number(line, 'isobath_found_error_p95_m') for line in group):.1f} |"
        )
    text += [
        "",
        "| with a missed piece | lengths (m) | isobath error (m) | expected loss | true loss |",
        "|---" * 5 + "|",
    ]
    for line in lines:
        if line["missed_m"]:
            text.append(
                f"| {line['vehicles']}, {line['lake']}: {line['variant']} | "
                f"{', '.join(f'{m:.0f}' for m in line['missed_m'])} | {_number(line, 'isobath_error_m'):.1f} | "
                f"{line['loss_expected']:.3f} | {line['loss_after']:.3f} |"
            )
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


def run(smoke: bool = False, lake: Path | None = None) -> list[Row]:
    """Rows of `scripts/bench missed`: a few fresh lakes and, with a file, one window of the real lake."""
    lakes, steps = (1, 6) if smoke else (4, 100)
    rows = []
    for vehicles in (3, 1):
        names = [str(FIRST + i) for i in range(lakes)]
        if lake is not None:
            names += spread_windows(lake, where_of(vehicles), 1)
        lines = [mission(next(iter(VARIANTS)), vehicles, name, str(lake or ""), steps) for name in names]
        team = f"{vehicles} vehicle{'s' * (vehicles > 1)}, {len(lines)} lakes"
        share = sum(bool(line["missed_m"]) for line in lines) / len(lines)
        rows.append(row(f"{team}: missions with a missed piece over {LEAST_M:.0f} m", share, "of all"))
        for key, unit in UNITS.items():
            mean = _mean(lines, key)
            rows.append(row(f"{team}: {key}", mean if math.isfinite(mean) else None, unit))
    if lake is None:
        rows.append(row("real lake: skipped, no --lake FILE", None, ""))
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Flies what is missing in the file, and prints the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.planning.missed",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--first", type=int, default=FIRST, help="seed of the first lake (default: %(default)s)")
    parser.add_argument("--lakes", type=int, default=12, help="made-up lakes (default: %(default)s)")
    parser.add_argument("--vehicles", type=int, nargs="+", default=[1, 3], metavar="K", help="teams")
    parser.add_argument("--variants", nargs="+", default=list(VARIANTS), choices=VARIANTS, help="what is compared")
    parser.add_argument("--real", type=existing_file, metavar="FILE", help="a real lake: also fly windows of it")
    parser.add_argument("--windows", type=int, default=1, help="windows of the real lake (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=100, help="legs of each vehicle (default: %(default)s)")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--out", type=Path, default=FOLDER / "missed.jsonl", help="results file")
    options = parser.parse_args(arguments)
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
        print(f"{line['vehicles']}, {line['lake']}: {line['variant']}: missed {line['missed_m']}", flush=True)
    lines = sorted(read(options.out), key=lambda r: (r["vehicles"], r["lake"], r["variant"]))
    print("\n".join([*table(lines), "", *pairs(lines)]))


if __name__ == "__main__":
    end_with(main)
