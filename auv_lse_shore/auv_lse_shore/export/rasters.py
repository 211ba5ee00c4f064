"""Maps as GeoTIFF and as ESRI ASCII grid, north up."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.operating_area import Grid
from auv_lse_shore.export.errors import ExportError
from auv_lse_shore.export.reference import Reference

Array = NDArray[np.float64]

#: Value of cells outside of the operating area.
NODATA = -9999.0

INSTALL = "pip install rasterio (on Ubuntu: sudo apt install python3-rasterio)"


def rasterio() -> Any:
    """The library, imported where it is used.

    Raises:
        ExportError: if it is not installed, with the command that installs it.
    """
    try:
        import rasterio
    except ImportError as error:
        raise ExportError(f"GeoTIFF needs rasterio, which cannot be imported ({error}); fix: {INSTALL}") from None
    return rasterio


def write_geotiff(path: Path, grid: Grid, values: Array, reference: Reference, what: str, unit: str) -> None:
    """Writes a map as GeoTIFF, float32, no data outside of the area.

    Args:
        path: File to write.
        grid: The map's cells.
        values: Values (ny, nx), rows from south to north, NaN outside of the area.
        reference: Its coordinates.
        what: What the values are, kept in the file.
        unit: Their unit, kept in the file.

    Raises:
        ExportError: if rasterio is not installed.
    """
    library = rasterio()
    from rasterio.transform import from_origin

    half = 0.5 * grid.resolution_m
    with library.open(
        path,
        "w",
        driver="GTiff",
        height=len(grid.north_m),
        width=len(grid.east_m),
        count=1,
        dtype="float32",
        crs=reference.wkt() or None,
        transform=from_origin(
            float(grid.east_m[0]) - half, float(grid.north_m[-1]) + half, grid.resolution_m, grid.resolution_m
        ),
        nodata=NODATA,
        compress="deflate",
    ) as file:
        file.write(_northern_row_first(values).astype(np.float32), 1)
        file.set_band_description(1, what)
        file.set_band_unit(1, unit)
        file.update_tags(coordinates=reference.describe())


def write_ascii_grid(path: Path, grid: Grid, values: Array, reference: Reference) -> None:
    """Writes a map as ESRI ASCII grid, and its coordinates as `.prj` beside it; arguments as of `write_geotiff`."""
    half = 0.5 * grid.resolution_m
    header = {
        "ncols": str(len(grid.east_m)),
        "nrows": str(len(grid.north_m)),
        "xllcorner": repr(float(grid.east_m[0]) - half),
        "yllcorner": repr(float(grid.north_m[0]) - half),
        "cellsize": repr(float(grid.resolution_m)),
        "NODATA_value": f"{NODATA:g}",
    }
    lines = [f"{name} {value}" for name, value in header.items()]
    lines += [" ".join(f"{value:.7g}" for value in row) for row in _northern_row_first(values)]
    path.write_text("\n".join(lines) + "\n")
    projection = path.with_suffix(".prj")
    if reference.origin is not None:
        projection.write_text(reference.wkt("WKT1_ESRI") + "\n")
    else:
        projection.unlink(missing_ok=True)


def _northern_row_first(values: Array) -> Array:
    return np.where(np.isnan(values), NODATA, values)[::-1]
