"""What an adjustment did, in words and numbers, and every sounding before and after it."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from auv_lse_gp.places.correction import Correction
from auv_lse_gp.places.error_model import STATIC
from auv_lse_record.run_data import RunData, VehicleRun
from auv_lse_shore.judge.adjustment import Adjustment, Moved
from auv_lse_shore.judge.tracks import true_positions

#: Columns of the table of soundings before and after.
COLUMNS = ("run", "vehicle", "time_s", "north_m", "east_m", "adjusted_north_m", "adjusted_east_m", "depth_m")


def lines(adjustment: Adjustment, before: Sequence[RunData], names: Sequence[str]) -> list[str]:
    """The report, as text with tables in Markdown.

    Args:
        adjustment: What was found.
        before: The runs as they were recorded.
        names: A name for each run.
    """
    text = [
        "# What moved",
        "",
        "| run | vehicle | soundings | moved, mean (m) | largest (m) | place now, std of each axis (m) | surfacings "
        "| ranges | off the truth before, now (m) |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    text += [_moved_row(m, adjustment, before, names[m.run]) for m in adjustment.moved]
    text += ["", f"{adjustment.ranges} ranges; {adjustment.refused} ranges and fixes refused as wrong."]
    if not any(m.fixes for m in adjustment.moved):
        text += [
            "",
            "No fix under way: a translation, rotation or scale that all tracks have in common is only known as well "
            "as before the dive.",
        ]
    text += ["", "# What was wrong with each vehicle's dead reckoning", ""]
    text += [
        "| run | vehicle | start north (m) | start east (m) | heading (deg) | with its sine (deg) "
        "| with its cosine (deg) | DVL scale (%) |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for m in adjustment.moved:
        if not m.missing:
            cells = " | ".join(_unknowns(adjustment.correction, m.key))
            text.append(f"| {names[m.run]} | auv{m.vehicle} | {cells} |")
    text += ["", "Each with its standard deviation; what drifted under way comes on top."]
    return text


def _moved_row(m: Moved, adjustment: Adjustment, before: Sequence[RunData], name: str) -> str:
    if m.missing:
        return f"| {name} | auv{m.vehicle} | {m.soundings} | stays: {m.missing} | | | | | |"
    old, new = (_vehicle(runs[m.run], m.vehicle) for runs in (before, adjustment.runs))
    truth = ""
    if len(old.truth):
        truth = f"{_off(old, old):.2f}, {_off(new, old):.2f}"
    cells = f"{m.mean_m:.2f} | {m.largest_m:.2f} | {m.std_m:.2f} | {m.fixes} | {m.ranges} | {truth}"
    return f"| {name} | auv{m.vehicle} | {m.soundings} | {cells} |"


def _vehicle(run: RunData, number: int) -> VehicleRun:
    return next(v for v in run.vehicles if v.vehicle == number)


def _off(vehicle: VehicleRun, recorded: VehicleRun) -> float:
    """Root mean square distance (m) of a vehicle's soundings from where it truly was."""
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
