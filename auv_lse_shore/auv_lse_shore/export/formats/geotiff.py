"""risk.tif, depth.tif, std.tif: map risk, depth and its standard deviation as GeoTIFF."""

from pathlib import Path
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


def copy_whole(dataset: Any, path: Path, driver: str, **options: str) -> None:
    """Writes a dataset to a file in GDAL's format `driver`.

    GDAL writes into memory: on a full disk its drivers raise errors of their own, or none.

    Raises:
        OSError: if the file cannot be written.
    """
    from rasterio.io import MemoryFile
    from rasterio.shutil import copy

    with MemoryFile(ext=path.suffix) as memory:
        copy(dataset, memory.name, driver=driver, **options)
        path.write_bytes(memory.read())


def check() -> None:
    """Raises ExportError if rasterio is not installed."""
    rasterio()


def write(export: Export) -> str:
    """Writes the maps as float32, north up; no data outside of the operating area."""
    grid, reference = export.team.field.grid, export.reference
    from rasterio.io import MemoryFile
    from rasterio.transform import from_origin

    (west, _), size = export.corner(), grid.resolution_m
    for raster in export.rasters():
        with MemoryFile() as memory:
            with memory.open(
                driver="GTiff",
                height=len(grid.north_m),
                width=len(grid.east_m),
                count=1,
                dtype="float32",
                crs=reference.wkt() or None,
                transform=from_origin(west, float(grid.north_m[-1]) + 0.5 * size, size, size),
                nodata=NODATA,
            ) as file:
                file.write(raster.northern_row_first.astype(np.float32), 1)
                file.set_band_description(1, raster.meaning)
                file.set_band_unit(1, raster.unit)
                file.update_tags(**export.metadata())
            with memory.open() as file:
                copy_whole(file, export.folder / f"{raster.name}.tif", "GTiff", compress="deflate")
    return ", ".join(f"{raster.name}.tif" for raster in export.rasters())
