"""Distance to a true quality: `tour` ended when its map promises a quality, against mowing.

    python -m benchmarks.planning.undiscovered --lakes 5 --vehicles 3 --out flights.jsonl
    python -m benchmarks.planning.until --flights flights.jsonl --asked 200

The first command flies complete missions of `tour` with perfect navigation. Every `EVERY` legs, the map of all
soundings is judged; the mission ends at the first check whose 95 % limit of undiscovered isobath is at most `--asked`
metres. The path up to then does not depend on the check, so a complete mission is cut there. Mowing is one line of
lanes over the whole area, finer by steps until as little isobath is truly missing as at that end; ways to its start
are not counted.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.vocabulary.seeds import stream
from benchmarks.command import end_with, existing_file
from benchmarks.planning.planner_methods import AREAS
from benchmarks.planning.undiscovered import figures
from benchmarks.planning.undiscovered_flights import ground_of, settings, where_of
from benchmarks.results_file import read

Array = NDArray[np.float64]

EVERY, FIRST = 10, 50
#: Lane spacings (m), coarse to fine.
SPACINGS = (115.0, 97.0, 80.0, 65.0, 55.0, 45.0, 38.0, 32.0, 27.0, 22.0, 18.0)
SOUNDING_STD_M, SOUNDING_EVERY_S = 0.2, 2.0


def mown(vehicles: int, spacing_m: float, speed_mps: float, ground: Any, seed: int) -> tuple[float, Array]:
    """Length (m) of lanes over the whole area, and their soundings: rows of time (s), north, east, depth (m)."""
    height, width, margin = AREAS[where_of(vehicles)]
    south, north, west, east = (
        10.0 - margin,
        height - margin - 10.0,
        10.0 - margin,
        width - margin - 10.0,
    )
    lanes = max(2, round((east - west) / spacing_m) + 1)
    corners: list[tuple[float, float]] = []
    for i, at in enumerate(np.linspace(west, east, lanes).tolist()):
        corners += [(south, at), (north, at)][:: 1 if i % 2 == 0 else -1]
    line = np.array(corners)
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    at_m = np.arange(0.0, along[-1], SOUNDING_EVERY_S * speed_mps)
    places = np.column_stack([np.interp(at_m, along, line[:, i]) for i in (0, 1)])
    depth = np.asarray(ground.depth_m(places[:, 0], places[:, 1]), float)
    depth = np.maximum(depth + SOUNDING_STD_M * stream(seed, "mowing").normal(size=len(depth)), 0.1)
    rows = np.column_stack([at_m / speed_mps, places, depth])
    return float(along[-1]), rows[np.isfinite(depth)]


def compared(flown: dict[str, Any], asked_m: float) -> dict[str, Any]:
    """One lake: the promised end of `tour`, and the mowing that misses as little."""
    kind, vehicles, lake = flown["kind"], flown["vehicles"], flown["lake"]
    chosen = settings(vehicles)
    speed, steps = chosen.vehicle.speed_mps, chosen.mission.steps
    rows = np.array(flown["soundings"])
    leg_s = rows[-1, 0] / steps
    result: dict[str, Any] = {"kind": kind, "vehicles": vehicles, "lake": lake, "asked": asked_m, "end": None}
    result["checks"] = checks = []
    for step in range(FIRST, steps + 1, EVERY):
        began = time.perf_counter()
        found = figures({**flown, "soundings": rows[rows[:, 0] <= step * leg_s]})
        checks.append(
            {
                "step": step,
                "wall_s": round(time.perf_counter() - began, 1),
                **{key: round(found[key], 1) for key in ("missing", "expected", "limit")},
            }
        )
        if found["limit"] <= asked_m:
            result["end"], result["missing"] = step, found["missing"]
            break
    last = checks[-1]
    result["tour_m"] = round(vehicles * last["step"] * leg_s * speed)
    ground = ground_of(kind, lake, where_of(vehicles), "")
    for spacing in SPACINGS:
        length, soundings = mown(vehicles, spacing, speed, ground, int(lake))
        found = figures({**flown, "soundings": soundings})
        if found["missing"] <= last["missing"] + 1.0:
            return {**result, "mown_m": round(length), "spacing": spacing, "mown_missing": found["missing"]}
    return {**result, "mown_m": None}


def main(arguments: list[str] | None = None) -> None:
    """Prints a comparison for each mission of three vehicles."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.planning.until", description=__doc__)
    parser.add_argument(
        "--flights", type=existing_file, required=True, help="missions of benchmarks.planning.undiscovered"
    )
    parser.add_argument("--asked", type=float, default=200.0, help="95 %% limit of undiscovered isobath (m)")
    options = parser.parse_args(arguments)
    for flown in read(options.flights):
        if flown["vehicles"] == 3 and flown["kind"] != "real":
            print(json.dumps(compared(flown, options.asked)), flush=True)


if __name__ == "__main__":
    end_with(main)
