"""What fewer routes cost a vehicle alone at its first decision, over areas of many shapes and sizes.

    python -m benchmarks.planning.first_decision --areas 40

A single vehicle tries routes over the whole ground (`methods/single_routes.py`): fewer where it cannot cover it. Each
row compares the first decision with that of all routes: processor time, and the drop of risk expected at the end.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import time
from typing import Any
from unittest import mock

import numpy as np

from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_planner.methods import single_routes
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from benchmarks.command import end_with, parser_of

#: Largest mean loss of the expected end by fewer routes, relative to that with all.
MOST_LOSS = 1e-3


def area(number: int) -> dict[str, Any]:
    """Parameters of the mission in area `number`: a rectangle or a polygon of six corners, and a number of legs."""
    rng = stream(number, "first_decision")
    north, east = rng.uniform(250.0, 1100.0, 2)
    corners = np.array([[0.0, 0.0], [0.0, east], [north, east], [north, 0.0]])
    if number % 2:
        angles = np.arange(6) * np.pi / 3.0 + rng.uniform(-0.3, 0.3, 6)
        around = rng.uniform(0.7, 1.0, (6, 1)) * np.column_stack([np.cos(angles), np.sin(angles)])
        corners = 0.5 * np.array([north, east]) * (1.0 + around)
    return {
        "area": {"polygon_m": [round(float(v), 1) for v in corners.ravel()]},
        "mission": {"vehicles": 1, "steps": int(rng.integers(40, 140)), "seed": number},
    }


def decided(parameters: dict[str, Any]) -> tuple[float, float]:
    """Processor time (s) of the first decision, and the drop of risk that it expects at the end."""
    settings = PlannerSettings.from_parameters(parameters, "benchmark")
    planner = VehiclePlanner(1, settings, stream(settings.mission.seed, "planner", 1))
    corners = np.reshape(settings.area.polygon_m, (-1, 2))
    start = corners.mean(axis=0) + 0.8 * (corners[0] - corners.mean(axis=0))
    planner.odometry(0.0, 0.0, *start.tolist())
    began = time.process_time()
    decision = planner.decide(0.0)
    return time.process_time() - began, decision.bound.expected_end


def main() -> int:
    """Command line. Returns 1 if fewer routes lose more than `MOST_LOSS` in the mean."""
    parser = parser_of("benchmarks.planning.first_decision", __doc__)
    parser.add_argument("--areas", type=int, default=40, metavar="N", help="number of areas (default: 40)")
    options = parser.parse_args()
    losses, times = [], []
    print("area  time (s)  with all routes (s)  drop of risk expected at the end / that with all routes")
    for number in range(options.areas):
        parameters = area(number)
        own_s, own = decided(parameters)
        with mock.patch.object(single_routes, "count_of_routes", return_value=single_routes.NODES[2]):
            all_s, best = decided(parameters)
        losses.append(1.0 - own / best)
        times.append((own_s, all_s))
        print(f"{number:4d}  {own_s:8.2f}  {all_s:19.2f}  {own / best:.5f}", flush=True)
    own_s, all_s = np.mean(times, axis=0)
    loss = float(np.mean(losses))
    print(f"mean: {own_s:.2f} s, {all_s:.2f} s with all routes; {100.0 * loss:.3f} % less expected at the end")
    return int(loss > MOST_LOSS)


if __name__ == "__main__":
    end_with(main)
