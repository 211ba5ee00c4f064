"""Chooses the reader of a log by its content, and reads tables of soundings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_gp.soundings import read_table
from auv_lse_shore.export.uncertainty import SIGMAS_95
from auv_lse_shore.survey_import import nmea
from auv_lse_shore.survey_import.survey_log import LogError, Progress, SurveyLog

#: Bytes of a file by which its format is recognized.
_HEAD = 4096


def read_logs(path: Path, density_kgpm3: float, progress: Progress) -> list[SurveyLog]:
    """Reads a file of any known format: one log, or one of each vehicle of a table.

    Args:
        path: The file.
        density_kgpm3: Density of the water (kg/m3), for the depth of a vehicle under water.
        progress: Takes the share that has been read.

    Raises:
        LogError, FlightLogError, SoundingsError: if it cannot be used; names the file and what was expected.
        MissingPackageError: if pymavlink is needed, and missing.
        OSError: if it cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(_HEAD)
    if not head.strip():
        raise LogError(f"{path}: got an empty file; expected a log. Copy it from the vehicle again")
    if b"\0" in head:
        return [_read_binary(path, head, density_kgpm3, progress)]
    if nmea.is_nmea(head):
        return [nmea.read(path, density_kgpm3, progress)]
    return _read_table(path)


def _read_binary(path: Path, head: bytes, density_kgpm3: float, progress: Progress) -> SurveyLog:
    from auv_lse_shore.survey_import import ardupilot  # needs pymavlink

    if head.startswith(ardupilot.DATAFLASH):
        return ardupilot.read_dataflash(path, density_kgpm3, progress)
    if ardupilot.is_telemetry(head):
        return ardupilot.read_telemetry(path, density_kgpm3, progress)
    raise LogError(
        f"{path}: got bytes of an unknown format; expected an ArduPilot dataflash log (.bin), a telemetry log (.tlog), "
        "NMEA 0183 or a table (CSV)"
    )


def _read_table(path: Path) -> list[SurveyLog]:
    """A table with times, or with soundings in the order of its lines; a log for each vehicle."""
    table = read_table(path)
    is_geodetic = table.lat_deg is not None and table.lon_deg is not None
    columns: Any = (table.lat_deg, table.lon_deg) if is_geodetic else (table.north_m, table.east_m)
    stamps = np.arange(len(table.values), dtype=float) if table.time_s is None else table.time_s
    depths = -table.values if table.upward else table.values
    positions, pings = np.column_stack([stamps, *columns]), np.column_stack([stamps, depths])
    order = np.argsort(stamps, kind="stable")
    vehicles = np.zeros(len(order)) if table.vehicles is None else table.vehicles
    names = np.unique(vehicles)
    depth_std_m = 0.0 if table.tvu_m is None else float(np.nan_to_num(table.tvu_m).max()) / SIGMAS_95
    notes = [f"columns {'lat, lon' if is_geodetic else 'north, east'}, {table.depth_name}"]
    if table.position_std_m is not None:
        notes.append("positions as estimated before, with their standard deviations (north_std_m, east_std_m)")
    if depth_std_m:
        notes.append(f"depths with a standard deviation of at most {depth_std_m:.2f} m (tvu_m)")
    logs = []
    for name in names:
        own = order[vehicles[order] == name]
        logs.append(
            SurveyLog(
                name=path.name if len(names) == 1 else f"{path.name}, vehicle {name}",
                positions=positions[own],
                depths=pings[own],
                is_geodetic=is_geodetic,
                has_time=table.time_s is not None,
                position_std_m=None if table.position_std_m is None else table.position_std_m[own],
                depth_std_m=depth_std_m,
                notes=list(notes),
            )
        )
    return logs
