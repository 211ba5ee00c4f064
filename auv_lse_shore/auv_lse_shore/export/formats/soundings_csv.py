"""soundings.csv: every sounding with time, vehicle, position, total uncertainties and the order of S-44 it meets."""

from __future__ import annotations

import csv

import numpy as np

from auv_lse_common.support.plurals import counted
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_shore.export.content import Export
from auv_lse_shore.export.uncertainty import ORDERS, sounding_uncertainty

#: Columns of the table; those of latitude and longitude only where the origin is known.
COLUMNS = (
    "time_s", "vehicle", "east_m", "north_m", "depth_m", "east_std_m", "north_std_m", "thu_m", "tvu_m", "s44_order",
)  # fmt: skip
GEODETIC = ("latitude_deg", "longitude_deg")


def write(export: Export) -> str:
    """Writes all soundings in order of time.

    Standard deviations are those of navigation, empty if unknown. THU and TVU are at 95 % confidence.
    """
    rows = []
    for vehicle in export.team.run.vehicles:
        stds = vehicle.position_std_at(vehicle.soundings.stamp_s)
        noise = export.team.settings.gp.noise_std_m
        total = zip(*sounding_uncertainty(export.team.run, vehicle, export.survey, noise), strict=True)
        for s, (north_std, east_std), (thu, tvu, order) in zip(vehicle.soundings, stds, total, strict=True):
            row = (s.stamp_s, vehicle.vehicle, s.east_m, s.north_m, s.depth_m, east_std, north_std, thu, tvu, order)
            rows.append(row)
    rows.sort()
    origin = export.team.run.origin
    geodetic = np.empty((len(rows), 0))
    if origin is not None and rows:
        east, north = np.array(rows)[:, 2:4].T
        geodetic = np.column_stack(geodetic_from_local(north, east, *origin))
    with (export.folder / "soundings.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*COLUMNS, *(GEODETIC if origin is not None else ())])
        for (stamp, number, *values, order), location in zip(rows, geodetic, strict=True):
            cells = ["" if np.isnan(value) else f"{value:.3f}" for value in values]
            degrees = (f"{value:.8f}" for value in location)
            writer.writerow([f"{stamp:.3f}", number, *cells, ORDERS[order].name, *degrees])
    counts = np.bincount([row[-1] for row in rows], minlength=len(ORDERS))
    shares = ", ".join(f"{order.name} {count:,}" for order, count in zip(ORDERS, counts, strict=True) if count)
    return f"soundings.csv ({counted(len(rows), 'sounding')}; by S-44 order: {shares or 'none'})"
