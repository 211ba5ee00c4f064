"""Memory of a planner by the number of kernel centers of a short mission, and whether it grows beyond.

    python -m benchmarks.planning.planner_memory

A planner of the default method decides on maps of random centers. At the cap the map is made again and again, as by a
correction of locations, which moves every center.
"""

from __future__ import annotations

import gc
import re
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_gp.inference.centers import Centers
from auv_lse_planner.vehicle.intake import PlannerIntake
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from benchmarks.command import end_with, parser_of

_SIZES = (300, 1000, 2000)
_AGAIN = 12


def private_mb() -> float:
    """Private memory (MB) of this process (Linux)."""
    text = Path("/proc/self/smaps_rollup").read_text()
    return sum(int(n) for n in re.findall(r"^Private_\w+:\s+(\d+) kB", text, re.MULTILINE)) / 1e3


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table. Returns 0, or 1 if a full map made again takes ever more memory."""
    p = parser_of("benchmarks.planning.planner_memory", __doc__)
    p.add_argument("--most", type=int, metavar="N", default=3000, help="centers at most (default: %(default)s)")
    options = p.parse_args(arguments)
    settings = Settings.load(None, {"mission.vehicles": 2})
    own = settings.planner_settings(1)
    most = options.most
    planner = VehiclePlanner(1, own, stream(7, "planner", 1))
    intake = PlannerIntake(planner)
    rng = np.random.default_rng(1)
    corners = np.reshape(settings.area.polygon_m, (-1, 2))
    locations = rng.uniform(corners.min(axis=0), corners.max(axis=0), (most, 2))
    depths, effects = 20.0 + 3.0 * rng.standard_normal(most), 0.1 * rng.standard_normal((most, 8))
    vehicle, now_s = own.vehicle, 0.0
    print("| centers | memory of its own | longest decision, processor time |\n|---|---|---|")

    def decided(n: int, times: int) -> float:
        nonlocal now_s
        longest_s = 0.0
        for _ in range(times):
            now_s += 16.0
            moved = locations[:n] + rng.normal(0.0, 0.5, (n, 2))
            planner.set_centers(Centers(moved, depths[:n], np.full(n, 0.3), effects[:n]), now_s)
            intake.set_odometry(now_s, 0.0, vehicle.start_north_m, vehicle.start_east_m)
            intake.take(now_s)
            began_s = time.process_time()
            planner.decide(now_s)
            longest_s = max(longest_s, time.process_time() - began_s)
        gc.collect()
        return longest_s

    def line(what: str, n: int, times: int) -> float:
        longest_s, size_mb = decided(n, times), private_mb()
        print(f"| {what} | {size_mb:.0f} MB | {longest_s:.1f} s |", flush=True)
        return size_mb

    for n in (*(size for size in _SIZES if size < most), most):
        first_mb = line(f"{n}", n, 2)
    last_mb = line(f"{most}, map made again {_AGAIN} times", most, _AGAIN)
    return 0 if last_mb < 1.4 * first_mb else 1  # what the allocator keeps goes up and down by a fifth


if __name__ == "__main__":
    end_with(main)
