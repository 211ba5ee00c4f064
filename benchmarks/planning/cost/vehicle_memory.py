"""Memory and time of one vehicle's map and planner late in a long mission of three vehicles.

    python -m benchmarks.planning.cost.vehicle_memory

Map and planner are in one process, as in a vehicle. The map has all soundings of a third of the area, from lanes 68 m
apart, and every second one of the rest, as a mate's samples. Each round moves all positions, as a position correction
does, publishes the map, decides four legs and takes three packets.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from auv_lse_common.mission_file.operating_area import OperatingArea
from auv_lse_common.mission_file.settings import Settings
from auv_lse_common.support.free_memory import return_free_memory
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_gp.map.depth_map import DepthMap
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from benchmarks.command import end_with, parser_of
from benchmarks.planning.day import square
from benchmarks.planning.planner_memory import private_mb

_LANES_M, _SOUNDINGS_M, _LEG_S = 68.0, 5.5, 16.0
_MODES, _PACKET = 10, 14


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table. Returns 0."""
    p = parser_of("benchmarks.planning.cost.vehicle_memory", __doc__)
    p.add_argument("--legs", type=int, default=1200, help="legs of each vehicle (default: %(default)s)")
    p.add_argument("--vehicles", type=int, default=3, help="vehicles (default: %(default)s)")
    p.add_argument("--rounds", type=int, default=5, help="rounds (default: %(default)s)")
    options = p.parse_args(arguments)
    settings = Settings.load(None, square(options.legs, options.vehicles))
    own = settings.planner_settings(1)
    before_mb = private_mb()
    depth_map = DepthMap(own.gp, settings.level_set, OperatingArea(settings.area))
    planner = VehiclePlanner(1, own, stream(7, "planner", 1))
    grid, rng = depth_map.grid, np.random.default_rng(0)
    north = np.arange(grid.north_m[0], grid.north_m[-1], _SOUNDINGS_M)
    lanes = [
        np.column_stack([north, np.full_like(north, e)]) for e in np.arange(grid.east_m[0], grid.east_m[-1], _LANES_M)
    ]
    locations = np.concatenate(lanes)
    depths = (
        15.0
        + 8.0 * np.sin(locations[:, 0] / 90.0) * np.cos(locations[:, 1] / 110.0)
        + 0.3 * rng.normal(size=len(locations))
    )
    third = locations[:, 1] < grid.east_m[0] + (grid.east_m[-1] - grid.east_m[0]) / options.vehicles
    mine, theirs = np.flatnonzero(third), np.flatnonzero(~third)[::2]
    start = own.vehicle
    state = (start.start_heading_rad, start.start_north_m, start.start_east_m)
    print(f"{len(depth_map.grid.locations_m)} cells; private memory before: {before_mb:.0f} MB")
    print(
        "| round | centers | rebuild | published map | longest decision | memory | after it is returned |\n"
        + "|---" * 7
        + "|"
    )
    for number in range(options.rounds):
        moved, began_s = locations + 0.2 * number, time.process_time()
        depth_map.clear()
        depth_map.add_soundings(np.column_stack([1.0 * np.arange(len(mine)), moved[mine], depths[mine]]))
        samples = np.column_stack([moved[theirs], depths[theirs]])
        depth_map.add_samples(samples, 2, np.arange(len(theirs)) // _PACKET)
        waves = depth_map.centers.locations_m[:, :1] / 200.0 + np.arange(_MODES)
        depth_map.gp.set_position_effect(0.3 * np.sin(waves))
        built_s = time.process_time()
        depth_map.isobath(depth_map.recent_field())
        published_s = time.process_time()
        longest_s = 0.0
        for leg in range(4):
            now_s = _LEG_S * (4 * number + leg)
            planner.set_centers(depth_map.centers, now_s)
            planner.odometry(now_s, *state)
            planner.set_blocked(now_s)
            decided_s = time.process_time()
            heading_rad, north_m, east_m = planner.decide(now_s).leg.end_state
            state = (float(heading_rad), float(north_m), float(east_m))
            longest_s = max(longest_s, time.process_time() - decided_s)
        for packet in range(3):
            taken = theirs[(60 * number + 900 * packet) % (len(theirs) - 900) :][: 60 * _PACKET : 60]
            depth_map.add_samples(np.column_stack([moved[taken] + 15.0, depths[taken]]), 2)
        held_mb = private_mb()
        return_free_memory()
        print(
            f"| {number} | {len(depth_map.gp)} | {built_s - began_s:.2f} s | {published_s - built_s:.2f} s | "
            f"{longest_s:.2f} s | {held_mb:.0f} MB | {private_mb():.0f} MB |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    end_with(main)
