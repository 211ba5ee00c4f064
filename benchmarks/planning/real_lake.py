"""Real and concave lakes in the whole simulator: navigation, packets, corrected positions (docs/evidence/planner.md).

    python -m benchmarks.planning.real_lake FILE
    python -m benchmarks.planning.real_lake [FILE] --whole

FILE is a lake's grid or soundings, as `auv_lse mission --bathymetry` takes it. Each of its windows is mown and flown by
`tour`, with dead-reckoned and corrected positions. With --whole, the file's whole lake, if one is named, and two
made-up concave lakes are flown by several methods, and by `tour` without the shore that the ground shows
(`area.shore`). The recipes of the made-up lakes were fixed before any was flown: drowned valleys whose banks rise to
land, with side valleys and islands. `FRESH` is flown with --fresh.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.campaign.mission_row import simulate_and_evaluate
from auv_lse_shore.judge.evaluation import evaluate
from auv_lse_sim.engine.fleet import Fleet
from auv_lse_sim.ground.ground_source import ground_of
from auv_lse_sim.ground.navigable import fit_to_ground
from benchmarks.command import end_with, existing_file, parser_of
from benchmarks.planning.areas import area, spread_windows
from benchmarks.planning.headline_table import Row, means, pairs

#: Settings by name; the first is compared with the others.
SETTINGS: dict[str, dict[str, Any]] = {
    "tour": {},
    "tour, dead-reckoned": {"positions.correct": False, "packet.navigation": False, "vehicle.surfacings": 0},
    "lawnmower": {"planner.method": "lawnmower"},
}
#: Methods flown on whole lakes; `OPEN` ignores the shore.
OPEN = "tour, all ground open"
METHODS: dict[str, dict[str, Any]] = {
    "tour": {},
    OPEN: {},
    "lawnmower": {"planner.method": "lawnmower"},
    "plain": {"planner.method": "plain"},
}
#: The recipe of the made-up lakes.
MADE_UP: dict[str, Any] = {
    "sim.lake.terrace_m": 0.0,
    "sim.lake.steepness": 3.0,
    "sim.lake.inlets": 6,
    "sim.lake.islands": 3,
    "sim.lake.north_m": 400.0,
    "sim.lake.east_m": 450.0,
    "sim.lake.height_m": 900.0,
    "sim.lake.width_m": 1000.0,
    "area.polygon_m": [-50.0, -50.0, 850.0, -50.0, 850.0, 950.0, -50.0, 950.0],
}
#: A recipe that nothing was chosen on: shallower, wider, with less steep banks.
FRESH: dict[str, Any] = {
    **MADE_UP,
    "sim.lake.steepness": 2.0,
    "sim.lake.inlets": 4,
    "sim.lake.islands": 2,
    "sim.lake.deepest_m": 28.0,
    "sim.lake.north_m": 350.0,
    "sim.lake.east_m": 500.0,
    "sim.lake.height_m": 800.0,
    "sim.lake.width_m": 1100.0,
    "area.polygon_m": [-50.0, -50.0, 750.0, -50.0, 750.0, 1050.0, -50.0, 1050.0],
}


def flown(settings: Settings, *, open_ground: bool) -> Row:
    """Figures of a mission over its ground, whose shore is known or ignored."""
    ground = ground_of(settings)
    fitted, _ = fit_to_ground(settings, ground)
    if open_ground:
        patterns = fitted.to_patterns()
        patterns["/**"]["area"]["shore"] = {}
        fitted = Settings.from_patterns(patterns, fitted.where)
    return dataclasses.asdict(evaluate(Fleet(fitted, ground).run(), 2).summary)


def grounds_of(file: Path | None, made_up: dict[int, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Settings of the file's whole lake and of made-up lakes (recipes by the seed of the lake), by name."""
    real = [] if file is None else [file]
    grounds = {f.stem: {"sim.bathymetry.file": str(f.resolve()), "gp.map_resolution_m": 10.0} for f in real}
    return grounds | {f"made up {k}": {**recipe, "sim.lake.seed": k} for k, recipe in made_up.items()}


def whole(
    grounds: dict[str, dict[str, Any]],
    teams: Sequence[int],
    methods: Sequence[str],
    seeds: int,
    steps: int,
    out: Path | None,
) -> None:
    """Flies whole lakes by some of `METHODS` and prints a table for each team and lake, and for all lakes together.

    Args:
        out: File of the missions' summaries; missions that it has are not flown again.
    """
    known = [json.loads(line) for line in out.read_text().splitlines()] if out and out.exists() else []
    groups: dict[str, dict[int, Row]] = {}
    for seed, vehicles, (number, ground), name in itertools.product(
        range(1, seeds + 1), teams, enumerate(grounds), methods
    ):
        key = {"ground": ground, "vehicles": vehicles, "name": name, "seed": seed}
        found = next((row for row in known if key.items() <= row.items()), None)
        if found is None:
            mission = {"mission.seed": seed, "mission.vehicles": vehicles, "mission.steps": steps}
            settings = Settings.load(None, {**mission, **grounds[ground], **METHODS[name]})
            found = flown(settings, open_ground=name == OPEN)
            print(f"{key}: {found['risk_after']:.3f}", file=sys.stderr, flush=True)
            if out:
                with out.open("a") as lines:
                    lines.write(json.dumps({**key, **found}) + "\n")
        where = f"{vehicles} vehicle{'s' * (vehicles > 1)}"
        groups.setdefault(f"{where}: {name}", {})[100 * number + seed] = found
        groups.setdefault(f"{where}, {ground}: {name}", {})[seed] = found
    print("\n".join([*means(groups), "", *pairs(groups)]))


def row(file: Path, window: str, vehicles: int, overrides: dict[str, Any], steps: int) -> Row:
    """Figures of one flight over a window `NAME@NORTH,EAST` (m, its southwestern corner) of a lake."""
    (height, width, _), _ = area("small")
    south, west = (float(x) for x in window.split("@")[1].split(","))
    north, east = south + height, west + width
    settings = Settings.load(
        None,
        {
            "mission.seed": sum(window.encode()),
            "mission.vehicles": vehicles,
            "mission.steps": steps,
            "sim.bathymetry.file": str(file.resolve()),
            "area.polygon_m": [south, west, north, west, north, east, south, east],
            **overrides,
        },
    )
    return dataclasses.asdict(simulate_and_evaluate(settings.to_patterns(), window, 2).summary)


def main(arguments: Sequence[str] | None = None) -> int:
    """Flies and prints the tables. Returns 0, 1 without any window."""
    parser = parser_of("benchmarks.planning.real_lake", __doc__)
    parser.add_argument("file", type=existing_file, nargs="?", help="the lake's grid or soundings; needed for windows")
    parser.add_argument("--vehicles", type=int, nargs="+", default=[1, 3], help="teams")
    parser.add_argument("--windows", type=int, default=6, help="at most so many windows of 400 m x 500 m")
    parser.add_argument("--steps", type=int, default=100, help="legs of a mission")
    parser.add_argument("--whole", action="store_true", help="whole lakes: this one and two made-up ones")
    parser.add_argument("--fresh", action="store_true", help="with --whole: made-up lakes of the other recipe")
    parser.add_argument("--lakes", type=int, nargs="+", help="with --whole: seeds of the made-up lakes")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS), help="with --whole: methods")
    parser.add_argument("--seeds", type=int, default=2, help="with --whole: missions on each lake (default: 2)")
    parser.add_argument("--out", type=Path, help="with --whole: file of summaries, continued")
    options = parser.parse_args(arguments)
    if options.whole:
        lakes, recipe = (range(41, 46), FRESH) if options.fresh else ((1, 2), MADE_UP)
        grounds = grounds_of(options.file, dict.fromkeys(options.lakes or lakes, recipe))
        whole(grounds, options.vehicles, options.methods, options.seeds, options.steps, options.out)
        return 0
    if options.file is None:
        parser.error("windows need a FILE to be in; without one, --whole flies made-up lakes")
    found = spread_windows(options.file, "small", options.windows)
    if not found:
        print(f"{options.file}: no window of 400 m x 500 m is known well enough and 20 to 80 % deep", file=sys.stderr)
        return 1
    groups: dict[str, dict[int, Row]] = {}
    for vehicles, (name, overrides) in itertools.product(options.vehicles, SETTINGS.items()):
        label = f"{vehicles} vehicle{'s' * (vehicles > 1)}: {name}"
        for number, window in enumerate(found):
            print(f"{label}: {window}", file=sys.stderr, flush=True)
            groups.setdefault(label, {})[number] = row(options.file, window, vehicles, overrides, options.steps)
    print("\n".join([*means(groups), "", *pairs(groups)]))
    return 0


if __name__ == "__main__":
    end_with(main)
