"""The table of methods: the same lakes, the same distance travelled, differences paired lake by lake.

    python -m benchmarks.planning.planner_methods --vehicles 1 3 --lakes 20 --out methods.jsonl
    python -m benchmarks.planning.planner_methods --vehicles 3 --area default --out methods.jsonl
    python -m benchmarks.planning.planner_methods --table methods.jsonl

Every mission's figures are appended to the file as one JSON line as soon as it is over, and missions that are in the
file already are not flown again, so a run can be stopped and continued. Lakes are `SyntheticLake`s with seeds from
`--first` on (seeds 1000 to 1015 were used while developing) and, with `--real FILE`, windows of a real lake's grid.
The small area (500 m x 400 m) is what one vehicle can just cover in 100 steps, the default mission's (600 m x 700 m)
what three can.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from auv_lse_common.mission_file.sections.world import LakeConfig
from auv_lse_common.vocabulary.naive_ids import STRIPS
from auv_lse_sim.ground.lake import SyntheticLake
from benchmarks.command import end_with, existing_file, parser_of
from benchmarks.planning.planner_loop import light_mission, settings_for
from benchmarks.results_file import FOLDER, fly, read

METHODS = (
    "lawnmower",
    "covering",
    "random",
    "myopic",
    "max_variance",
    "straddle",
    "plain",
    "plain_beyond",
    "augmented",
    "exponential_quadratic",
    "fixed_tour",
    "tour",
)
#: Parameters of names that are no methods: the lawnmower whose lanes are not fitted but just cover its strip; plain
#: search credited beyond the team mates' plans.
VARIANTS: dict[str, dict[str, Any]] = {
    "covering": {"method": "lawnmower", "naive_paths": STRIPS},
    "plain_beyond": {"method": "plain", "credit": "beyond"},
}
#: North and east span (m) of the areas, and their margin around the start (0, 0).
AREAS = {"small": (400.0, 500.0, 20.0), "default": (600.0, 700.0, 50.0)}
#: Share of a real lake's window that must be known; over the rest a vehicle measures nothing, and nothing is judged.
KNOWN = 0.9
FIGURES = {
    "team_reward": "team reward",
    "risk_third": "map risk at 1/3",
    "risk_end": "map risk at end",
    "true_loss": "true loss",
    "f1": "F1",
    "isobath_m": "isobath error m",
    "wall_ms": "ms / decision",
}


class Shifted:
    """A gridded real lake, moved so that the window's corner is the local origin's surroundings."""

    def __init__(self, ground: Any, north_m: float, east_m: float) -> None:
        """Adds (north_m, east_m) to every requested location."""
        self._ground, self._north, self._east = ground, north_m, east_m

    def depth_m(self, north_m: Any, east_m: Any) -> Any:
        """Depth at locations relative to the window."""
        return self._ground.depth_m(np.asarray(north_m) + self._north, np.asarray(east_m) + self._east)


def area(name: str) -> tuple[tuple[float, float, float], dict[str, Any]]:
    """Span and the `area` section of the area called `name`."""
    north, east, margin = span = AREAS[name]
    polygon = [-margin, -margin, north - margin, -margin, north - margin, east - margin, -margin, east - margin]
    return span, {"polygon_m": polygon}


def windows(path: Path, where: str) -> Iterator[tuple[str, float, float]]:
    """Windows of a real lake whose ground is mostly known, and 20 to 80 % of that at least 15 m deep."""
    from auv_lse_sim.ground.ground_files import load_ground

    ground = load_ground(path)
    (height, width, margin), _ = area(where)
    e = ground.extent
    for north in np.arange(e.north_min_m, e.north_max_m - height, 50.0):
        for east in np.arange(e.east_min_m, e.east_max_m - width, 50.0):
            grid = np.meshgrid(
                np.arange(north, north + height, 20.0), np.arange(east, east + width, 20.0), indexing="ij"
            )
            depth = ground.depth_m(*grid)
            known = np.isfinite(depth)
            if known.mean() >= KNOWN and 0.2 <= np.mean(depth[known] >= 15.0) <= 0.8:
                yield f"{path.stem}@{north:.0f},{east:.0f}", float(north + margin), float(east + margin)


def spread_windows(path: Path, where: str, most: int) -> list[str]:
    """Names of at most so many windows, spread over all that there are."""
    found = [name for name, _, _ in windows(path, where)]
    return found[:: max(1, len(found) // most)][:most]


def lake(name: str, where: str, real: Path | None) -> Any:
    """The ground called `name`: a seed, or a window of the real lake."""
    (height, width, margin), _ = area(where)
    if name.isdigit():
        middle = {"north_m": height / 2.0 - margin, "east_m": width / 2.0 - margin}
        return SyntheticLake(LakeConfig(seed=int(name), height_m=height, width_m=width, **middle))
    from auv_lse_sim.ground.ground_files import load_ground

    assert real is not None
    north, east = (float(x) for x in name.split("@")[1].split(","))
    return Shifted(load_ground(real), north + margin, east + margin)


def mission(method: str, vehicles: int, where: str, name: str, loss: float, real: str, steps: int) -> dict[str, Any]:
    """Simulates one mission; returns its line."""
    _, section = area(where)
    ground = lake(name, where, Path(real) if real else None)
    seed = int(name) if name.isdigit() else sum(name.encode())
    settings = settings_for(method, vehicles, section, VARIANTS.get(method), mission={"steps": steps})
    outcome = light_mission(settings, ground, seed, loss)
    figures = {key: getattr(outcome, key) for key in (*FIGURES, "wall_max_ms", "travelled_m", "kept_share")}
    return {
        "method": method,
        "vehicles": vehicles,
        "area": where,
        "lake": name,
        "loss": loss,
        "steps": steps,
        **figures,
    }


def interval(differences: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """95 % bootstrap interval of the mean."""
    draws = rng.choice(differences, (4000, len(differences))).mean(axis=1)
    return float(np.percentile(draws, 2.5)), float(np.percentile(draws, 97.5))


def figure(lines: list[dict[str, Any]], key: str) -> str:
    """Mean of a figure over the missions that have it; "-" if none has it (no isobath found)."""
    known = [line[key] for line in lines if np.isfinite(line[key])]
    return f"{np.mean(known):.3g}" if known else "-"


def table(lines: list[dict[str, Any]]) -> str:
    """Markdown tables, one for each team, area and packet loss: means, and map risk against the lawnmower."""
    text = []
    for kind in sorted({(r["vehicles"], r["area"], r["loss"]) for r in lines}):
        vehicles, where, loss = kind
        rows = [r for r in lines if (r["vehicles"], r["area"], r["loss"]) == kind]
        base = {r["lake"]: r for r in rows if r["method"] == "lawnmower"}
        title = (
            f"{vehicles} vehicle{'s' if vehicles > 1 else ''}, {where} area, packet loss {loss:.0%}, {len(base)} lakes"
        )
        head = ["method", "lakes", *FIGURES.values(), "risk at 1/3 vs lawnmower", "at end vs lawnmower", "worst lake"]
        text += [f"### {title}", "", "| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
        for method in METHODS:
            mine = [r for r in rows if r["method"] == method and r["lake"] in base]
            if not mine:
                continue
            cells = [method, str(len(mine))]
            cells += [figure(mine, key) for key in FIGURES]
            for key in ("risk_third", "risk_end"):
                ratio = np.array([r[key] / base[r["lake"]][key] - 1.0 for r in mine])
                low, high = interval(ratio, np.random.default_rng(0))
                cells.append(f"{ratio.mean():+.0%} ({low:+.0%} .. {high:+.0%})")
            cells.append(f"{ratio.max():+.0%}")
            text.append("| " + " | ".join(cells) + " |")
        text.append("")
    return "\n".join(text)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = parser_of("benchmarks.planning.planner_methods", __doc__)
    parser.add_argument("--table", type=existing_file, help="only print the tables of this results file")
    parser.add_argument(
        "--out",
        type=Path,
        default=FOLDER / "planner_methods.jsonl",
        help="results file, appended to (default: %(default)s)",
    )
    parser.add_argument(
        "--methods",
        nargs="+",
        default=list(METHODS),
        choices=METHODS,
        metavar="METHOD",
        help=f"any of {', '.join(METHODS)} (default: all of these)",
    )
    parser.add_argument(
        "--vehicles", type=int, nargs="+", default=[1, 3], metavar="K", help="sizes of team (default: 1 3)"
    )
    parser.add_argument("--area", default="small", choices=AREAS, help="see above (default: %(default)s)")
    parser.add_argument("--lakes", type=int, default=20, help="number of synthetic lakes")
    parser.add_argument("--first", type=int, default=5000, help="seed of the first lake")
    parser.add_argument("--real", type=Path, help="grid or soundings of a real lake: its windows are flown too")
    parser.add_argument("--windows", type=int, default=6, help="most windows of the real lake")
    parser.add_argument("--loss", type=float, default=0.0, help="share of packets lost")
    parser.add_argument("--steps", type=int, default=100, help="legs of each vehicle (default: %(default)s)")
    parser.add_argument("--processes", type=int, default=2, help="missions flown at once (default: %(default)s)")
    options = parser.parse_args(arguments)
    if options.table:
        print(table(read(options.table)))
        return
    done = {(r["method"], r["vehicles"], r["area"], r["lake"], r["loss"], r["steps"]) for r in read(options.out)}
    jobs = []
    for vehicles in options.vehicles:
        names = [str(options.first + i) for i in range(options.lakes)]
        if options.real:
            names += spread_windows(options.real, options.area, options.windows)
        jobs += [(m, vehicles, options.area, name, options.loss) for name in names for m in options.methods]
    jobs = [j for j in jobs if (*j, options.steps) not in done]
    print(f"{len(jobs)} missions to fly, {len(done)} in {options.out}", flush=True)
    real = str(options.real) if options.real else ""
    for line in fly(mission, [(*job, real, options.steps) for job in jobs], options.out, options.processes):
        print(line["vehicles"], line["lake"], line["method"], f"risk {line['risk_end']:.3f}", flush=True)
    print(table(read(options.out)))


if __name__ == "__main__":
    end_with(main)
