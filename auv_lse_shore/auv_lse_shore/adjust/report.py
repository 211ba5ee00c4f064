"""The report of an adjustment, and the table of soundings before and after it."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from auv_lse_common.vocabulary.frames import geodetic_from_local
from auv_lse_gp.positions.correction import Correction
from auv_lse_gp.positions.error_model import STATIC
from auv_lse_record.run_data import RunData, VehicleRun
from auv_lse_shore.judge.tracks import true_positions
from auv_lse_shore.positions.adjustment import Adjustment
from auv_lse_shore.report.page import render

#: Columns of the table of soundings before and after.
COLUMNS = ("run", "vehicle", "time_s", "north_m", "east_m", "adjusted_north_m", "adjusted_east_m", "depth_m")
#: Further columns where the origin is known: the adjusted position.
GEODETIC = ("adjusted_latitude_deg", "adjusted_longitude_deg")


def report(adjustment: Adjustment, before: Sequence[RunData], names: Sequence[str]) -> str:
    """The report as Markdown."""
    vehicles = []
    for v in adjustment.vehicles:
        old, new = (_vehicle(runs[v.run], v.vehicle) for runs in (before, adjustment.runs))
        errors = f"{_rms_error(old, old):.2f}, {_rms_error(new, old):.2f}" if len(old.truth) else ""
        vehicles.append((v, names[v.run], errors))
    return render(
        "moved.md",
        "auv_lse_shore.adjust",
        adjustment=adjustment,
        vehicles=vehicles,
        unknowns=lambda v: _unknowns(adjustment.correction, v.key),
    )


def _vehicle(run: RunData, number: int) -> VehicleRun:
    return next(v for v in run.vehicles if v.vehicle == number)


def _rms_error(vehicle: VehicleRun, recorded: VehicleRun) -> float:
    """Root mean square error (m) of a vehicle's sounding positions."""
    apart = vehicle.soundings.locations_m - true_positions(recorded).locations_m
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def _unknowns(correction: Correction, key: int) -> list[str]:
    block = correction.model.vehicles[key].block
    values = correction.theta[block][:STATIC]
    stds = np.sqrt(np.diag(correction.covariance)[block][:STATIC])
    deg = math.degrees(1.0)
    units = (1.0, 1.0, deg, deg, deg, 100.0)
    return [f"{u * v:+z.2f} ± {u * s:.2f}" for u, v, s in zip(units, values, stds, strict=True)]


def write_before_and_after(path: Path, adjustment: Adjustment, before: Sequence[RunData], names: Sequence[str]) -> int:
    """Writes each sounding's position before and after the adjustment as CSV; returns the number of soundings."""
    count, origin = 0, adjustment.runs[0].origin
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*COLUMNS, *(GEODETIC if origin is not None else ())])
        for name, old_run, new_run in zip(names, before, adjustment.runs, strict=True):
            for old, new in zip(old_run.vehicles, new_run.vehicles, strict=True):
                positions = new.soundings.locations_m
                geodetic = np.empty((len(positions), 0))
                if origin is not None:
                    geodetic = np.column_stack(geodetic_from_local(positions[:, 0], positions[:, 1], *origin))
                for was, position, degrees in zip(old.soundings, positions, geodetic, strict=True):
                    numbers = (was.north_m, was.east_m, *position, was.depth_m)
                    metres = (f"{value:.3f}" for value in numbers)
                    angles = (f"{value:.8f}" for value in degrees)
                    writer.writerow([name, old.vehicle, f"{was.stamp_s:.3f}", *metres, *angles])
                    count += 1
    return count
