"""soundings.csv: every sounding with time, vehicle, position and its standard deviation."""

from __future__ import annotations

import csv

import numpy as np

from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_shore.export.content import Export

#: Columns of the table; those of latitude and longitude only where the origin is known.
COLUMNS = ("time_s", "vehicle", "east_m", "north_m", "depth_m", "east_std_m", "north_std_m")
GEODETIC = ("latitude_deg", "longitude_deg")


def write(export: Export) -> str:
    """Writes all soundings in order of time; the standard deviation is that of navigation, empty if unknown."""
    rows = []
    for vehicle in export.team.run.vehicles:
        stds = vehicle.place_std_at(vehicle.soundings.stamp_s)
        for s, (north_std, east_std) in zip(vehicle.soundings, stds, strict=True):
            rows.append((s.stamp_s, vehicle.vehicle, s.east_m, s.north_m, s.depth_m, east_std, north_std))
    rows.sort()
    origin = export.team.run.origin
    geodetic = np.empty((len(rows), 0))
    if origin is not None and rows:
        east, north = np.array(rows)[:, 2:4].T
        geodetic = np.column_stack(geodetic_from_local(north, east, *origin))
    with (export.folder / "soundings.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*COLUMNS, *(GEODETIC if origin is not None else ())])
        for (stamp, number, *values), place in zip(rows, geodetic, strict=True):
            cells = ["" if np.isnan(value) else f"{value:.3f}" for value in values]
            writer.writerow([f"{stamp:.3f}", number, *cells, *(f"{value:.8f}" for value in place)])
    return f"soundings.csv ({len(rows)} soundings)"
