"""The chart of an export in a projected coordinate reference system: depth, uncertainty and order of each cell."""

from typing import Any, NamedTuple

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_shore.export.content import Export, ExportError
from auv_lse_shore.export.formats.geotiff import rasterio
from auv_lse_shore.export.uncertainty import cell_tvu_m, orders_met

#: Latitudes (deg) for which UTM is defined.
UTM_LATITUDES_DEG = (-80.0, 84.0)


class Chart(NamedTuple):
    """A map, northernmost row first; arrays (ny, nx), NaN outside of the area.

    Attributes:
        depth_m: Depth below the vertical datum.
        tvu_m: Total vertical uncertainty (95 %).
        order: Code of the order of S-44 that it meets.
        crs: The coordinate reference system (rasterio).
        transform: From column, row to coordinates (rasterio).
    """

    depth_m: Array
    tvu_m: Array
    order: Array
    crs: Any
    transform: Any


def target_crs(export: Export) -> Any:
    """The coordinate reference system that was asked for, or the UTM zone of the origin; beyond UTM the pole's UPS.

    Raises:
        ExportError: if there is no such system.
    """
    library = rasterio()
    assert export.reference.origin is not None
    latitude, longitude = export.reference.origin
    zone = int((longitude + 180.0) // 6.0) % 60 + 1
    code = (32600 if latitude >= 0.0 else 32700) + zone
    if not UTM_LATITUDES_DEG[0] <= latitude < UTM_LATITUDES_DEG[1]:
        code = 5041 if latitude > 0.0 else 5042
    name = export.survey.crs or f"EPSG:{code}"
    try:
        return library.crs.CRS.from_user_input(name)
    except library.errors.CRSError as error:
        raise ExportError(f"--crs: {name} is not a projection, such as EPSG:32632 ({error})") from error


def project(export: Export) -> Chart:
    """Resamples the map into `target_crs`, with cells of the same size.

    Raises:
        ExportError: if there is no such system.
    """
    library, crs, grid = rasterio(), target_crs(export), export.team.field.grid
    from rasterio.transform import from_origin
    from rasterio.warp import Resampling, calculate_default_transform, reproject

    local = library.crs.CRS.from_wkt(export.reference.wkt())
    (west, south), size = export.corner(), float(grid.resolution_m)
    ny, nx = len(grid.north_m), len(grid.east_m)
    north, east = south + ny * size, west + nx * size
    cell = size if crs.is_projected else None
    transform, width, height = calculate_default_transform(
        local, crs, nx, ny, left=west, bottom=south, right=east, top=north, resolution=cell
    )
    layers = []
    for values in (export.team.field.mean_m, cell_tvu_m(export.team, export.survey)):
        target = np.full((height, width), np.nan)
        reproject(
            np.ascontiguousarray(values[::-1]),
            target,
            src_transform=from_origin(west, north, size, size),
            src_crs=local,
            src_nodata=np.nan,
            dst_transform=transform,
            dst_crs=crs,
            dst_nodata=np.nan,
            resampling=Resampling.bilinear,
        )
        layers.append(target)
    depth, tvu = layers
    order = np.where(np.isnan(depth), np.nan, orders_met(np.zeros_like(tvu), tvu, depth))
    return Chart(depth, tvu, order, crs, transform)
