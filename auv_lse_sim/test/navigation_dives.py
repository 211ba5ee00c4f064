"""Many dives of one vehicle over flat ground: how far its estimated positions are off, and what it reports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from auv_lse_common.mission_file.sections.mission import MotionConfig
from auv_lse_common.mission_file.sections.sim import SimConfig
from auv_lse_common.mission_file.sections.vehicle import VehicleConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.seeds import stream
from auv_lse_planner.paths.motion import MotionTable
from auv_lse_sim.vehicle.navigation import COMPASS_SIN
from auv_lse_sim.vehicle.vehicle import SimVehicle
from auv_lse_sim.water.current import Current


@dataclass(frozen=True, slots=True, kw_only=True)
class Consistency:
    """Errors of many dives, one row for each, one column per time.

    NEES is the squared error over the filter's own covariance. For a consistent filter its mean is the number of states
    (Bar-Shalom, Li & Kirubarajan 2001, section 5.4): 2 for the position, 3 with the heading.

    Attributes:
        nees: NEES of north, east, heading.
        nees_position: NEES of north, east.
        error_m: Distance between estimated and true position.
        travelled_m: Distance travelled.
    """

    nees: Array
    nees_position: Array
    error_m: Array
    travelled_m: Array

    @property
    def drift(self) -> float:
        """Root mean square error at the end over the mean distance travelled."""
        return float(np.sqrt((self.error_m[:, -1] ** 2).mean()) / self.travelled_m[:, -1].mean())

    def bounds(self, states: int, probability: float) -> tuple[float, float]:
        """Limits of the mean NEES over the dives, with this probability, for a consistent filter."""
        n = states * len(self.nees)
        tail = (1.0 - probability) / 2.0
        return float(chi2.ppf(tail, n) / len(self.nees)), float(chi2.ppf(1.0 - tail, n) / len(self.nees))


def measure(dives: int, duration_s: float, every_s: float, first_seed: int, *, harmonics: bool = True) -> Consistency:
    """Dives one vehicle along random paths, over flat ground 20 m deep.

    Without `harmonics` the filter does not estimate how the compass's error depends on the heading.
    """
    table, sim = MotionTable(MotionConfig()), SimConfig()
    times = np.arange(every_s, duration_s + 0.5, every_s)
    nees, position, error, gone = (np.zeros((dives, len(times))) for _ in range(4))
    for dive in range(dives):
        seed = first_seed + dive
        vehicle = SimVehicle(1, VehicleConfig(start_delay_s=30.0), sim, stream(seed, "sensors", 1))
        if not harmonics:
            vehicle._p[COMPASS_SIN:, :] = vehicle._p[:, COMPASS_SIN:] = 0.0
        current = Current(sim.current, stream(seed, "current"))
        rng = stream(seed, "path")
        state, step = np.zeros(3), 0
        for tick in range(1, int(duration_s) + 1):
            stamps = tick - 1.0 + np.arange(1, 11) / 10.0
            north, _ = vehicle.move(stamps, current.advance(tick - 1.0, stamps))
            vehicle.sense(np.full(len(north), 20.0))
            if vehicle.step == step - 1:
                action = int(rng.integers(0, table.actions))
                vehicle.command(table.leg(step, state, action))
                state, step = table.end_state(state, action), step + 1
            column = np.flatnonzero(times == tick)
            if len(column):
                e, p = vehicle.error[:3], vehicle.covariance[:3, :3]
                nees[dive, column] = e @ np.linalg.solve(p, e)
                position[dive, column] = e[:2] @ np.linalg.solve(p[:2, :2], e[:2])
                error[dive, column] = np.hypot(e[0], e[1])
                gone[dive, column] = vehicle.truth(float(tick)).travelled_m
    return Consistency(nees=nees, nees_position=position, error_m=error, travelled_m=gone)
