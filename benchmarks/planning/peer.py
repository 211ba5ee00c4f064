"""One vehicle: our methods against a public planner's path, sgptools 2.0.7, flown with our steering.

    python -m benchmarks.planning.peer --environment FOLDER --lakes 10

The peer plans one path for the whole mission, at the prior that the mission uses, from every seed of `SEEDS`. It needs
TensorFlow, so it is installed into an environment of its own (3 GB, once); FOLDER may be anywhere. All missions are
those of the light loop on the small area, and one judge evaluates them all. Kinds of ground are those of
`benchmarks.planning.undiscovered_flights`; with `--real FILE` windows of a real lake are flown, too. Missions that are
in the results file are not flown again.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.vocabulary.seeds import stream
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_shore.campaign.statistics import interval
from benchmarks.command import end_with, existing_file, parser_of
from benchmarks.planning.areas import AREAS, area, spread_windows
from benchmarks.planning.hindsight import Sea
from benchmarks.planning.peer_environment import answer, environment
from benchmarks.planning.planner_loop import judged_map, light_mission, settings_for
from benchmarks.planning.undiscovered_flights import ground_of
from benchmarks.results_file import FOLDER, fly, read

Array = NDArray[np.float64]

#: Seeds of the peer, each a path; the number of its waypoints; time of its travelling salesman (s).
SEEDS, WAYPOINTS, TSP_S = (1, 2), 45, 10
METHODS = ("lawnmower", "fixed_tour", "tour")
FIGURES = {
    "risk_third": "risk at 1/3",
    "risk_end": "at the end",
    "true_loss": "true loss",
    "f1": "F1",
    "isobath_m": "isobath error (m)",
}
WHERE, STEPS = "small", 100
KINDS = ("valley", "rough", "gaussian")


def request(seed: int, where: str = WHERE) -> dict[str, Any]:
    """What the peer has to plan: an area, the default prior, and the length of the mission."""
    settings = settings_for("fixed_tour", 1, area(where)[1])
    height, width, margin = AREAS[where]
    edge = settings.area.margin_m
    gp = settings.gp
    return {
        "seed": seed,
        "low_m": [edge - margin, edge - margin],
        "high_m": [height - margin - edge, width - margin - edge],
        "start_m": [settings.vehicle.start_north_m, settings.vehicle.start_east_m],
        "std_m": gp.signal_std_m,
        "length_scale_m": gp.length_scale_m,
        "noise_std_m": 0.2,
        "length_m": MotionTable(settings.motion).leg_length_m * STEPS,
        "waypoints": WAYPOINTS,
        "tsp_s": TSP_S,
    }


@cache
def path(python: Path, folder: Path, seed: int) -> Array:
    """Waypoints (n, 2) of the peer, north and east (m); planned once, then read from the folder."""
    wanted = request(seed)
    file = folder / f"peer_path_{seed}.json"
    if file.exists():
        stored = json.loads(file.read_text())
        if stored["request"] == wanted:
            return np.array(stored["path"])
    print(f"the peer plans its path, seed {seed} ...", file=sys.stderr, flush=True)
    found = answer(python, wanted)[0]
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps({"request": wanted, "path": found}))
    return np.array(found)


def mission(
    method: str, kind: str, name: str, real: str, waypoints: Sequence[Sequence[float]] | None
) -> dict[str, Any]:
    """One mission of a method, or of a vehicle that steers along the peer's waypoints; its line."""
    ground, seed = ground_of(kind, name, WHERE, real), int(name) if name.isdigit() else sum(name.encode())
    if waypoints is None:
        outcome = light_mission(settings_for(method, 1, area(WHERE)[1], mission={"steps": STEPS}), ground, seed)
        figures = {key: getattr(outcome, key) for key in FIGURES}
    else:
        figures = steered(np.array(waypoints), ground, seed)
    return {"method": method, "kind": kind, "lake": name, **figures}


def steered(waypoints_m: Array, ground: Any, seed: int) -> dict[str, float]:
    """Figures of the map of a vehicle that steers along waypoints, with soundings like those of the light loop."""
    settings = settings_for("fixed_tour", 1, area(WHERE)[1], mission={"steps": STEPS})
    sea = Sea(settings, ground, seed)
    motion, speed = sea.motion, settings.vehicle.speed_mps
    noise = stream(seed, "soundings")
    rows, now, along = [], 0, speed
    for step, (state, action) in enumerate(zip(*sea.steered(waypoints_m), strict=True)):
        leg = motion.leg(step, state, int(action))
        while along <= leg.length_m:
            now += 1
            _, north, east = (float(x) for x in leg.state_at(along))
            if now % 2 == 0:
                depth = float(ground.depth_m(north, east))
                if np.isfinite(depth):
                    rows.append((float(now), north, east, max(depth + 0.2 * float(noise.normal()), 0.1)))
            along += speed
        along -= leg.length_m
    return judged_map(settings, ground, rows, STEPS / 3.0 * motion.leg_length_m / speed)


def table(lines: Sequence[dict[str, Any]]) -> str:
    """Means of each kind of ground and path; the end against each path of the peer, paired, with 95 % intervals."""
    by = {(line["kind"], line["method"], line["lake"]): line for line in lines}
    groups = sorted({(kind, method) for kind, method, _ in by})
    peers = sorted({method for _, method in groups if method.startswith("peer")})
    head = ["ground: path", "lakes", *FIGURES.values(), *(f"end against {peer}" for peer in peers)]
    text = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for kind, method in groups:
        mine = {at: line for (k, m, at), line in by.items() if (k, m) == (kind, method)}
        cells = [f"{kind}: {method}", str(len(mine))]
        cells += [f"{interval([line[key] for line in mine.values()]).mean:.3g}" for key in FIGURES]
        for peer in peers:
            others = {at: by[kind, peer, at]["risk_end"] for at in mine if (kind, peer, at) in by}
            ratios = [100.0 * (mine[at]["risk_end"] / other - 1.0) for at, other in others.items()]
            if method == peer or len(ratios) < 2:
                cells.append("")
                continue
            found = interval(ratios)
            cells.append(f"{found.mean:+z.0f} % ({found.low:+z.0f} to {found.high:+z.0f}; worst {max(ratios):+z.0f})")
        text.append("| " + " | ".join(cells) + " |")
    return "\n".join(text)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = parser_of("benchmarks.planning.peer", __doc__)
    parser.add_argument(
        "--environment", type=Path, default=FOLDER / "peer", metavar="FOLDER", help="of the peer (default: %(default)s)"
    )
    parser.add_argument(
        "--kinds", nargs="+", default=["valley"], choices=KINDS, help="kinds of made-up ground (default: valley)"
    )
    parser.add_argument("--lakes", type=int, default=10, help="number of lakes of each kind (default: %(default)s)")
    parser.add_argument("--first", type=int, default=7000, help="seed of the first lake (default: %(default)s)")
    parser.add_argument("--real", type=existing_file, metavar="FILE", help="grid or soundings of a real lake")
    parser.add_argument("--windows", type=int, default=6, help="most windows of the real lake (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=FOLDER / "peer.jsonl", help="results file (default: %(default)s)")
    parser.add_argument("--processes", type=int, default=2, help="missions flown at once (default: %(default)s)")
    options = parser.parse_args(arguments)
    python = environment(options.environment)
    paths = {f"peer, seed {seed}": path(python, options.out.parent, seed).tolist() for seed in SEEDS}
    done = {(line["method"], line["kind"], line["lake"]) for line in read(options.out)}
    grounds = [(kind, str(options.first + i), "") for kind in options.kinds for i in range(options.lakes)]
    if options.real:
        names = spread_windows(options.real, WHERE, options.windows)
        grounds += [("real", name, str(options.real)) for name in names]
    jobs = [(name, *ground, paths.get(name)) for ground in grounds for name in (*METHODS, *paths)]
    jobs = [job for job in jobs if job[:3] not in done]
    print(f"{len(jobs)} missions to fly, {len(done)} in {options.out}", file=sys.stderr, flush=True)
    for line in fly(mission, jobs, options.out, options.processes):
        words = (line["kind"], line["lake"], line["method"], f"risk {line['risk_end']:.3f}")
        print(*words, file=sys.stderr, flush=True)
    print(table(read(options.out)))


if __name__ == "__main__":
    end_with(main)
