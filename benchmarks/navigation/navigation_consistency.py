"""Is the navigation filter consistent, and how far does it drift? Many dives of one vehicle over flat ground.

NEES is the squared error over the filter's own covariance. For a consistent filter its mean is the number of states
(Bar-Shalom, Li & Kirubarajan 2001, section 5.4): 2 for the position, 3 with the heading. The table and the test of
consistency use `measure()`.

    python -m benchmarks.navigation.navigation_consistency 160
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_sim.vehicle.vehicle import SimVehicle
from auv_lse_sim.water.current import Current
from benchmarks.command import end_with, parser_of

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Consistency:
    """Errors and covariances of many dives.

    Attributes:
        nees: Normalized squared error of north, east, heading: one row per dive, one column per time.
        nees_position: The same of north, east.
        error_m: Distance between estimated and true position.
        std_m: Standard deviation of the position by the filter (root of the summed variances).
        travelled_m: Distance travelled.
        times_s: The columns' times.
    """

    nees: Array
    nees_position: Array
    error_m: Array
    std_m: Array
    travelled_m: Array
    times_s: Array

    @property
    def drift(self) -> float:
        """Root mean square error at the end over the mean distance travelled."""
        return float(np.sqrt((self.error_m[:, -1] ** 2).mean()) / self.travelled_m[:, -1].mean())

    def bounds(self, states: int, probability: float = 0.95) -> tuple[float, float]:
        """Limits of the mean NEES over the dives, with this probability, for a consistent filter."""
        n = states * len(self.nees)
        tail = (1.0 - probability) / 2.0
        return float(chi2.ppf(tail, n) / len(self.nees)), float(chi2.ppf(1.0 - tail, n) / len(self.nees))


def measure(
    sim: SimConfig,
    dives: int,
    duration_s: float = 900.0,
    every_s: float = 150.0,
    first_seed: int = 0,
    side_m: float = 0.0,
    told: bool = True,
) -> Consistency:
    """Dives one vehicle along lanes (side_m > 0) or a random path (side_m = 0), over flat ground 20 m deep.

    With `told` false the filter does not know that the compass's error depends on the heading.
    """
    table = MotionTable(MotionConfig())
    times = np.arange(every_s, duration_s + 0.5, every_s)
    shape = (dives, len(times))
    nees, position, error, std, gone = (np.zeros(shape) for _ in range(5))
    for dive in range(dives):
        seed = first_seed + dive
        vehicle = SimVehicle(1, VehicleConfig(start_delay_s=30.0), sim, stream(seed, "sensors", 1))
        if not told:
            vehicle.ignore_harmonics()
        current = Current(sim.current, stream(seed, "current"))
        rng = stream(seed, "path")
        state, step = np.zeros(3), 0
        lane = 0
        for tick in range(1, int(duration_s) + 1):
            stamps = tick - 1.0 + np.arange(1, 11) / 10.0
            north, _ = vehicle.move(stamps, current.advance(tick - 1.0, stamps))
            vehicle.sense(np.full(len(north), 20.0))
            if vehicle.step == step - 1:
                if side_m > 0.0:
                    per_lane = max(round(side_m / table.leg_length_m), 1)
                    turning = step % (per_lane + 2) >= per_lane
                    lane = step // (per_lane + 2)
                    action = (10 if lane % 2 == 0 else 0) if turning else 5
                else:
                    action = int(rng.integers(0, table.actions))
                vehicle.command(table.leg(step, state, action))
                state, step = table.end_state(state, action), step + 1
            column = np.flatnonzero(times == tick)
            if len(column):
                e, p = vehicle.error[:3], vehicle.covariance[:3, :3]
                nees[dive, column] = e @ np.linalg.solve(p, e)
                position[dive, column] = e[:2] @ np.linalg.solve(p[:2, :2], e[:2])
                error[dive, column] = np.hypot(e[0], e[1])
                std[dive, column] = np.sqrt(p[0, 0] + p[1, 1])
                gone[dive, column] = vehicle.truth(float(tick)).travelled_m
    return Consistency(nees=nees, nees_position=position, error_m=error, std_m=std, travelled_m=gone, times_s=times)


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints NEES against its bounds, and the drift; the last filter is not told of the compass's harmonics."""
    parser = parser_of("benchmarks.navigation.navigation_consistency", __doc__)
    parser.add_argument("dives", type=int, nargs="?", default=100, metavar="DIVES", help="of each kind (default: 100)")
    parser.add_argument(
        "duration_s", type=float, nargs="?", default=1500.0, metavar="SECONDS", help="of a dive (default: 1500)"
    )
    options = parser.parse_args(arguments)
    dives, duration_s = options.dives, options.duration_s
    if dives < 2 or not 60.0 <= duration_s < float("inf"):
        parser.error(f"{dives} dives of {duration_s:g} s are too few or too short; give at least 2 of at least 60 s")
    cases = (("random path", 0.0, True), ("lanes of 400 m", 400.0, True), ("random path, not told", 0.0, False))
    for name, side_m, told in cases:
        result = measure(SimConfig(), dives, duration_s=duration_s, every_s=duration_s / 6.0, side_m=side_m, told=told)
        low, high = result.bounds(3)
        low2, high2 = result.bounds(2)
        print(f"{name}, {dives} dives: NEES {low:.2f} to {high:.2f} (3 states), position {low2:.2f} to {high2:.2f}")
        print("   time s  NEES  position  rms error m  filter's std m  travelled m")
        for i, time in enumerate(result.times_s):
            rms = np.sqrt((result.error_m[:, i] ** 2).mean())
            std = np.sqrt((result.std_m[:, i] ** 2).mean())
            print(
                f"  {time:7.0f} {result.nees[:, i].mean():5.2f} {result.nees_position[:, i].mean():6.2f} {rms:12.2f} "
                f"{std:15.2f} {result.travelled_m[:, i].mean():12.0f}"
            )
        print(f"  drift at the end: {100.0 * result.drift:.2f} % of the distance travelled")
    return 0


if __name__ == "__main__":
    end_with(main)
