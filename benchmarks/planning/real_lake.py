"""Windows of a real lake in the whole simulator: navigation, packets, corrected positions (docs/evidence/planner.md).

    python -m benchmarks.planning.real_lake FILE

FILE is a lake's grid or soundings, as `auv_lse mission --bathymetry` takes it. Each of its windows is mown and flown by
`tour`, with dead-reckoned and corrected positions. `auv_lse bench planners` flies whole lakes.
"""

import dataclasses
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from auv_lse_common.mission_file.settings import Settings
from auv_lse_shore.campaign.mission_row import simulate_and_evaluate
from benchmarks.command import end_with, existing_file, parser_of
from benchmarks.planning.areas import area, spread_windows
from benchmarks.planning.headline_table import Row, means, pairs

#: Settings by name; the first is compared with the others.
SETTINGS: dict[str, dict[str, Any]] = {
    "tour": {},
    "tour, dead-reckoned": {"positions.correct": False, "packet.navigation": False, "vehicle.surfacings": 0},
    "lawnmower": {"planner.method": "lawnmower"},
}


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
    parser.add_argument("file", type=existing_file, help="the lake's grid or soundings")
    parser.add_argument("--vehicles", type=int, nargs="+", default=[1, 3], help="teams")
    parser.add_argument("--windows", type=int, default=6, help="largest number of windows of 400 m x 500 m")
    parser.add_argument("--steps", type=int, default=100, help="legs of a mission")
    options = parser.parse_args(arguments)
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
