"""What the first decision of a team's vehicle takes, and what it loses by leaving out hopeless optimizations.

    python -m benchmarks.planning.first_decision --areas 40

A tour that is behind the best naive path is not optimized further (`tour_candidates.FAR_BEHIND`). Each row compares the
decision with one that optimizes every tour: processor time, and the drop of risk expected at the mission's end.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import math
import time
from collections.abc import Sequence
from typing import Any
from unittest import mock

import numpy as np

from auv_lse_common.mission_file.sections.planner import PlannerSettings
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_planner.methods import tour_candidates
from auv_lse_planner.vehicle.vehicle_planner import VehiclePlanner
from benchmarks.command import end_with, parser_of

#: Largest mean loss of the drop of risk expected at the end, as a share of it.
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
        "mission": {"vehicles": 2 + number % 3, "steps": int(rng.integers(40, 140)), "seed": number},
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line. Returns 1 if the mean loss is more than `MOST_LOSS`."""
    parser = parser_of("benchmarks.planning.first_decision", __doc__)
    parser.add_argument("--areas", type=int, default=40, metavar="N", help="number of areas (default: 40)")
    options = parser.parse_args(arguments)
    losses, times = [], []
    print("area  time (s)  optimizing every tour (s)  drop of risk expected at the end / that of every tour")
    for number in range(options.areas):
        parameters = area(number)
        own_s, own = decided(parameters)
        with mock.patch.object(tour_candidates, "FAR_BEHIND", math.inf):
            all_s, best = decided(parameters)
        losses.append(1.0 - own / best)
        times.append((own_s, all_s))
        print(f"{number:4d}  {own_s:8.2f}  {all_s:25.2f}  {own / best:.5f}", flush=True)
    own_s, all_s = np.mean(times, axis=0)
    loss = float(np.mean(losses))
    print(f"mean: {own_s:.2f} s, {all_s:.2f} s optimizing every tour; {100.0 * loss:.3f} % less expected at the end")
    return int(loss > MOST_LOSS)


if __name__ == "__main__":
    end_with(main)
