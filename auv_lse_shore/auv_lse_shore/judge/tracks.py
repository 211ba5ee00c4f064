"""Measures of vehicles' tracks: position error, length, distance to each other."""

from dataclasses import replace

import numpy as np

from auv_lse_common.mission_file.operating_area import UNREACHABLE, OperatingArea
from auv_lse_common.mission_file.sections.area import AreaConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.vocabulary.sounding import Soundings
from auv_lse_record.run_data import VehicleRun

#: Time (s) after the start from which separation counts: all vehicles start at one position, at their own depths.
SEPARATION_FROM_S = 60.0


def true_positions(vehicle: VehicleRun) -> Soundings:
    """A vehicle's soundings with their true positions."""
    own, truth = vehicle.soundings, vehicle.truth
    north_m, east_m = (np.interp(own.stamp_s, truth[:, 0], truth[:, column]) for column in (1, 2))
    return replace(own, north_m=north_m, east_m=east_m)


def navigation_error(vehicle: VehicleRun) -> Array:
    """Horizontal error (m) of each odometry message, (n,); empty without truth."""
    if len(vehicle.truth) == 0 or len(vehicle.odometry) == 0:
        return np.empty(0)
    north, east = (np.interp(vehicle.odometry[:, 0], vehicle.truth[:, 0], vehicle.truth[:, c]) for c in (1, 2))
    return np.asarray(np.hypot(vehicle.odometry[:, 1] - north, vehicle.odometry[:, 2] - east))


def track(vehicle: VehicleRun) -> Array:
    """The best known track (n, 4): the true one where there is one, else odometry."""
    return vehicle.truth if len(vehicle.truth) else vehicle.odometry


def path_length_m(vehicle: VehicleRun) -> float:
    """Distance (m) along the best known track."""
    return float(np.hypot(*np.diff(track(vehicle)[:, 1:3], axis=0).T).sum())


def time_outside(vehicle: VehicleRun, config: AreaConfig) -> tuple[float, float]:
    """Time (s) outside the area or in a no-go area, and the largest distance (m) from it, by the best known track.

    Ground that is left out because it cannot be reached is not outside.
    """
    rows = track(vehicle)
    if len(rows) == 0:
        return 0.0, 0.0
    no_go = {name: flat for name, flat in config.no_go.items() if not name.startswith(UNREACHABLE)}
    area = OperatingArea(replace(config, no_go=no_go))
    outside = ~area.contains(rows[:, 1:3])
    farthest = -area.clearance_m(rows[outside, 1:3])
    return float(np.diff(rows[:, 0], append=rows[-1, 0])[outside].sum()), float(max(farthest.max(initial=0.0), 0.0))


def least_separation(vehicles: list[VehicleRun]) -> float | None:
    """Least horizontal distance (m) between two vehicles after `SEPARATION_FROM_S`; None for a lone one."""
    tracks = [track(v) for v in vehicles if len(track(v))]
    if len(tracks) < 2:
        return None
    begin, end = max(t[0, 0] for t in tracks), min(t[-1, 0] for t in tracks)
    times = np.arange(begin + SEPARATION_FROM_S, end, 1.0)
    if len(times) == 0:
        return None
    at = [np.column_stack([np.interp(times, t[:, 0], t[:, c]) for c in (1, 2)]) for t in tracks]
    pairs = [(i, j) for i in range(len(at)) for j in range(i)]
    return min(float(np.hypot(*(at[i] - at[j]).T).min()) for i, j in pairs)
