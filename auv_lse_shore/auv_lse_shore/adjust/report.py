"""The report of an adjustment, and a table of every sounding before and after it."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from auv_lse_gp.places.correction import Correction
from auv_lse_gp.places.error_model import STATIC
from auv_lse_record.run_data import RunData, VehicleRun
from auv_lse_shore.judge.tracks import true_positions
from auv_lse_shore.places.adjustment import Adjustment, VehicleAdjustment

#: Columns of the table of positions, and of the table of errors of dead reckoning.
POSITIONS = (
    "run", "vehicle", "soundings", "mean shift (m)", "largest shift (m)", "std now, per axis (m)", "fixes", "ranges",
    "RMS error before, now (m)",
)  # fmt: skip
DEAD_RECKONING = (
    "run", "vehicle", "start north (m)", "start east (m)", "heading (deg)", "heading × sine (deg)",
    "heading × cosine (deg)", "DVL scale (%)",
)  # fmt: skip

#: Columns of the table of soundings before and after.
COLUMNS = ("run", "vehicle", "time_s", "north_m", "east_m", "adjusted_north_m", "adjusted_east_m", "depth_m")


def lines(adjustment: Adjustment, before: Sequence[RunData], names: Sequence[str]) -> list[str]:
    """The report, as text with tables in Markdown.

    Args:
        adjustment: The adjustment.
        before: The runs as they were recorded.
        names: A name for each run.
    """
    text = [
        "# Adjusted positions",
        "",
        *_table_head(POSITIONS),
        *(_row(v, adjustment, before, names[v.run]) for v in adjustment.vehicles),
        "",
        f"{adjustment.ranges} ranges used; {adjustment.refused} ranges and fixes rejected as outliers.",
    ]
    if not any(v.fixes for v in adjustment.vehicles):
        text += [
            "",
            "No fix under way: a translation, rotation or scale error common to all tracks remains as uncertain as "
            "before the dive.",
        ]
    text += [
        "",
        "# Estimated errors of dead reckoning",
        "",
        *_table_head(DEAD_RECKONING),
    ]
    for v in adjustment.vehicles:
        if not v.missing:
            text.append(_markdown_row(names[v.run], f"auv{v.vehicle}", *_unknowns(adjustment.correction, v.key)))
    return [*text, "", "Values are mean ± standard deviation. Drift under way comes on top."]


def _markdown_row(*cells: object) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def _table_head(names: Sequence[str]) -> list[str]:
    return [_markdown_row(*names), "|---" * len(names) + "|"]


def _row(v: VehicleAdjustment, adjustment: Adjustment, before: Sequence[RunData], name: str) -> str:
    if v.missing:
        return _markdown_row(name, f"auv{v.vehicle}", v.soundings, f"not moved: {v.missing}", *[""] * 5)
    old, new = (_vehicle(runs[v.run], v.vehicle) for runs in (before, adjustment.runs))
    errors = f"{_rms_error(old, old):.2f}, {_rms_error(new, old):.2f}" if len(old.truth) else ""
    numbers = (f"{v.mean_m:.2f}", f"{v.largest_m:.2f}", f"{v.std_m:.2f}", v.fixes, v.ranges, errors)
    return _markdown_row(name, f"auv{v.vehicle}", v.soundings, *numbers)


def _vehicle(run: RunData, number: int) -> VehicleRun:
    return next(v for v in run.vehicles if v.vehicle == number)


def _rms_error(vehicle: VehicleRun, recorded: VehicleRun) -> float:
    """Root mean square error (m) of the places of a vehicle's soundings."""
    apart = vehicle.soundings.places_m - true_positions(recorded).places_m
    return float(np.sqrt((apart**2).sum(axis=1).mean()))


def _unknowns(correction: Correction, key: int) -> list[str]:
    block = correction.model.vehicles[key].block
    values = correction.theta[block][:STATIC]
    stds = np.sqrt(np.diag(correction.covariance)[block][:STATIC])
    deg = math.degrees(1.0)
    units = (1.0, 1.0, deg, deg, deg, 100.0)
    return [f"{u * v:+.2f} ± {u * s:.2f}" for u, v, s in zip(units, values, stds, strict=True)]


def write_before_and_after(path: Path, adjustment: Adjustment, before: Sequence[RunData], names: Sequence[str]) -> int:
    """Writes every sounding with its place before and after as CSV; returns how many."""
    count = 0
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for name, old_run, new_run in zip(names, before, adjustment.runs, strict=True):
            for old, new in zip(old_run.vehicles, new_run.vehicles, strict=True):
                for was, place in zip(old.soundings, new.soundings.places_m, strict=True):
                    numbers = (was.north_m, was.east_m, *place, was.depth_m)
                    writer.writerow([name, old.vehicle, f"{was.stamp_s:.3f}", *(f"{value:.3f}" for value in numbers)])
                    count += 1
    return count
