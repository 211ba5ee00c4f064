"""risk.tif, depth.tif, std.tif: map risk, depth and its standard deviation as GeoTIFF."""

from __future__ import annotations

from typing import Any

import numpy as np

from auv_lse_shore.export.content import NODATA, Export, ExportError


def rasterio() -> Any:
    """The library, imported where it is used.

    Raises:
        ExportError: if it is not installed, with the command that installs it.
    """
    try:
        import rasterio
    except ImportError as error:
        raise ExportError(
            f"GeoTIFF needs rasterio, which cannot be imported ({error}); fix: pip install rasterio (on Ubuntu: sudo "
            "apt install python3-rasterio)"
        ) from None
    return rasterio


def check() -> None:
    """Raises ExportError if rasterio is not installed."""
    rasterio()


def write(export: Export) -> str:
    """Writes the maps as float32, north up; no data outside of the operating area."""
    library, grid, reference = rasterio(), export.team.field.grid, export.reference
    from rasterio.transform import from_origin

    (west, _), size = export.corner(), grid.resolution_m
    for raster in export.rasters():
        with library.open(
            export.folder / f"{raster.name}.tif",
            "w",
            driver="GTiff",
            height=len(grid.north_m),
            width=len(grid.east_m),
            count=1,
            dtype="float32",
            crs=reference.wkt() or None,
            transform=from_origin(west, float(grid.north_m[-1]) + 0.5 * size, size, size),
            nodata=NODATA,
            compress="deflate",
        ) as file:
            file.write(raster.northern_row_first.astype(np.float32), 1)
            file.set_band_description(1, raster.meaning)
            file.set_band_unit(1, raster.unit)
            file.update_tags(**export.metadata())
    return ", ".join(f"{raster.name}.tif" for raster in export.rasters())
