"""soundings.csv: every sounding with time, vehicle, position, total uncertainties and the order of S-44 it meets."""

import csv

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_common.support.plurals import counted
from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_record.run_data import VehicleRun
from auv_lse_shore.export.content import Export
from auv_lse_shore.export.uncertainty import ORDERS, sounding_uncertainty

#: Columns of the table; latitude and longitude only where the origin is known, the vertical datum only if it is named.
COLUMNS = (
    "time_s", "vehicle", "east_m", "north_m", "depth_m", "east_std_m", "north_std_m", "thu_m", "tvu_m", "s44_order",
)  # fmt: skip
GEODETIC, DATUM = ("latitude_deg", "longitude_deg"), "vertical_datum"


#: Soundings that are formatted at a time, so that a survey of many needs little memory.
_AT_A_TIME = 10_000


def write(export: Export) -> str:
    """Writes all soundings in order of time.

    Standard deviations are those of navigation, empty if unknown. THU and TVU are at 95 % confidence.
    """
    table = np.concatenate([_table(export, vehicle) for vehicle in export.team.run.vehicles])
    table = table[np.lexsort(table.T[::-1])]
    origin = export.team.run.origin
    with (export.folder / "soundings.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        datum = [export.survey.datum] * bool(export.survey.datum)
        writer.writerow([*COLUMNS, *(GEODETIC if origin is not None else ()), *[DATUM] * len(datum)])
        for first in range(0, len(table), _AT_A_TIME):
            rows = table[first : first + _AT_A_TIME]
            geodetic = np.empty((len(rows), 0))
            if origin is not None:
                geodetic = np.column_stack(geodetic_from_local(rows[:, 3], rows[:, 2], *origin))
            for (stamp, number, *values, order), location in zip(rows.tolist(), geodetic.tolist(), strict=True):
                cells = ["" if np.isnan(value) else f"{value:.3f}" for value in values]
                degrees = (f"{value:.8f}" for value in location)
                writer.writerow([f"{stamp:.3f}", int(number), *cells, ORDERS[int(order)].name, *degrees, *datum])
    counts = np.bincount(table[:, -1].astype(int), minlength=len(ORDERS))
    shares = ", ".join(f"{order.name} {count:,}" for order, count in zip(ORDERS, counts, strict=True) if count)
    return f"soundings.csv ({counted(len(table), 'sounding')}; by S-44 order: {shares or 'none'})"


def _table(export: Export, vehicle: VehicleRun) -> Array:
    """A vehicle's soundings (n, 10) with the columns of `COLUMNS`; the order of S-44 as its code."""
    s, noise = vehicle.soundings, export.team.settings.gp.noise_std_m
    north_std, east_std = vehicle.position_std_at(s.stamp_s).T
    total = sounding_uncertainty(export.team.run, vehicle, export.survey, noise)
    number = np.full(len(s), float(vehicle.vehicle))
    columns = (s.stamp_s, number, s.east_m, s.north_m, s.depth_m, east_std, north_std, *total)
    return np.column_stack(columns)
