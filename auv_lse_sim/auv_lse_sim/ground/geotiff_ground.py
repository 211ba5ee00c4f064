"""Ground from a GeoTIFF, if rasterio is installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_sim.ground.grid_ground import GridGround, check_nodes
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.raster_ground import raster_ground


def read_geotiff_ground(path: Path, config: BathymetryConfig, origin: tuple[float, float] | None) -> GridGround:
    """Reads ground from the first band of a GeoTIFF.

    Raises:
        GroundError: if rasterio is not installed, the file cannot be read, or is not north-up.
    """
    try:
        import rasterio
        from rasterio.errors import RasterioError, RasterioIOError
    except ImportError:
        raise GroundError(
            f"{path}: reading a GeoTIFF needs rasterio, which is not installed; pip install rasterio, or convert it: "
            "gdal_translate -of AAIGrid in.tif out.asc"
        ) from None
    try:
        with rasterio.open(path, driver="GTiff") as data:  # others, as VRT, name further files
            check_nodes(str(path), data.height, data.width)
            grid = data.read(1).astype(float)
            nodata, transform, crs = data.nodata, data.transform, data.crs
    except (RasterioIOError, RasterioError) as error:
        raise GroundError(f"{path}: not a readable GeoTIFF: {error}") from error
    if transform.b or transform.d or transform.e >= 0 or transform.a <= 0:
        raise GroundError(f"{path}: transform {tuple(transform)[:6]}; expected a north-up raster (gdalwarp makes one)")
    if nodata is not None:
        grid = np.where(grid == nodata, np.nan, grid)
    rows, columns = grid.shape
    x = transform.c + transform.a * (np.arange(columns) + 0.5)
    y = (transform.f + transform.e * (np.arange(rows) + 0.5))[::-1]
    return raster_ground(path, x, y, grid[::-1], crs.to_wkt() if crs else None, config, origin)
