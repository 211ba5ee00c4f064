"""All soundings of a mission as a table."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_record.run_data import RunData
from auv_lse_shore.export.reference import Reference

#: Columns of the table; those of latitude and longitude only where the origin is known.
COLUMNS = ("time_s", "vehicle", "east_m", "north_m", "depth_m", "east_std_m", "north_std_m")
GEODETIC = ("latitude_deg", "longitude_deg")


def write_soundings(path: Path, run: RunData, reference: Reference) -> int:
    """Writes every sounding of every vehicle as CSV, in order of time; returns their number.

    Each has its time (s, of the mission's clock), vehicle, place, depth (m, positive down), and the standard deviation
    of that place by the vehicle's own navigation, empty where it says nothing about it.
    """
    rows = []
    for vehicle in run.vehicles:
        stds = vehicle.place_std_at(vehicle.soundings.stamp_s)
        for s, (north_std, east_std) in zip(vehicle.soundings, stds, strict=True):
            rows.append((s.stamp_s, vehicle.vehicle, s.east_m, s.north_m, s.depth_m, east_std, north_std))
    rows.sort()
    geodetic = np.empty((len(rows), 2))
    if reference.origin is not None and rows:
        east, north = np.array(rows)[:, 2:4].T
        geodetic = np.column_stack(geodetic_from_local(north, east, *reference.origin))
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*COLUMNS, *(GEODETIC if reference.origin is not None else ())])
        for (stamp, number, *values, east_std, north_std), place in zip(rows, geodetic, strict=True):
            cells = [f"{stamp:.3f}", number, *(f"{v:.3f}" for v in values), _known(east_std), _known(north_std)]
            writer.writerow([*cells, *(f"{v:.8f}" for v in place if reference.origin is not None)])
    return len(rows)


def _known(std_m: float) -> str:
    return "" if np.isnan(std_m) else f"{std_m:.3f}"
