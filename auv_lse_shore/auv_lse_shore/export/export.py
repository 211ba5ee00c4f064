"""Writes what a mission found, for other programs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from auv_lse_record.bag import read_run
from auv_lse_record.run_data import RunData
from auv_lse_shore.export.qgis import write_qgis
from auv_lse_shore.export.rasters import rasterio, write_ascii_grid, write_geotiff
from auv_lse_shore.export.reference import Reference
from auv_lse_shore.export.soundings import write_soundings
from auv_lse_shore.judge.certainty import CLASSES, length_of
from auv_lse_shore.judge.team_map import TeamMap, team_map, write_isobath

#: The maps: file name without its ending, the attribute of the map's field, what it is, and its unit.
MAPS = (
    ("risk", "risk", "Bayes risk of the better call", "cost per place"),
    ("depth", "mean_m", "depth of water, positive down", "m"),
    ("std", "std_m", "standard deviation of the depth", "m"),
)


def export(run_folder: Path, folder: Path, picture: bool = False) -> Iterator[str]:
    """Exports a run folder into `folder`, which is made if needed; says what it does, line by line.

    Raises:
        ExportError: if rasterio is not installed.
        RecordingError, ParameterError: if the run folder cannot be read.
    """
    rasterio()  # before the work, not after it
    yield f"reading {run_folder}"
    run = read_run(run_folder)
    yield f"mapping {sum(len(v.soundings) for v in run.vehicles)} soundings"
    team = team_map(run)
    yield from write_export(team.run, team, folder)
    if picture:
        from auv_lse_shore.export.picture import draw_export

        draw_export(folder, folder / "export.png")
        yield f"written: {folder / 'export.png'}"


def write_export(run: RunData, team: TeamMap, folder: Path) -> Iterator[str]:
    """Writes the files of an export but the picture; says what it has written, line by line."""
    reference = Reference(origin=run.origin)
    folder.mkdir(parents=True, exist_ok=True)
    write_isobath(team, folder / "isobath.geojson", run.origin, [])
    lengths = ", ".join(f"{length_of(team.pieces, kind):.0f} m {kind}" for kind in CLASSES)
    yield f"written: {folder / 'isobath.geojson'} ({lengths})"
    for name, attribute, what, unit in MAPS:
        values = getattr(team.field, attribute)
        write_geotiff(folder / f"{name}.tif", team.field.grid, values, reference, what, unit)
        write_ascii_grid(folder / f"{name}.asc", team.field.grid, values, reference)
        yield f"written: {folder / name}.tif, .asc ({what}, {unit})"
    count = write_soundings(folder / "soundings.csv", run, reference)
    yield f"written: {folder / 'soundings.csv'} ({count} soundings)"
    write_qgis(folder, team, reference)
    yield f"written: {folder / 'isobath.qgs'} (QGIS), and a style (.qml) for each file"
    yield f"coordinates: {reference.describe()}"
