"""chart.tif: depth, its total vertical uncertainty and S-44 order as cloud-optimized GeoTIFF in UTM, or in --crs."""

import numpy as np

from auv_lse_shore.export.content import NO_ORIGIN, NODATA, Export
from auv_lse_shore.export.formats import geotiff
from auv_lse_shore.export.projected import project
from auv_lse_shore.export.uncertainty import EDITION, ORDERS

check = geotiff.check

#: Description and unit of each band.
BANDS = (
    ("depth below the vertical datum, positive down", "m"),
    ("total vertical uncertainty, 95 %", "m"),
    (f"order by {EDITION}: " + ", ".join(f"{code} {order.name}" for code, order in enumerate(ORDERS)), ""),
)


def write(export: Export) -> str:
    """Writes one file of three bands."""
    path = export.folder / "chart.tif"
    if export.reference.origin is None:
        export.discard(path.name)
        return f"chart.tif: {NO_ORIGIN}"
    chart = project(export)
    from rasterio.io import MemoryFile

    bands = np.stack([chart.depth_m, chart.tvu_m, chart.order])
    height, width = chart.depth_m.shape
    profile = {"driver": "GTiff", "count": len(BANDS), "dtype": "float32", "nodata": NODATA}
    with MemoryFile() as memory:
        with memory.open(height=height, width=width, crs=chart.crs, transform=chart.transform, **profile) as file:
            file.write(np.where(np.isnan(bands), NODATA, bands).astype(np.float32))
            file.update_tags(**{**export.metadata(), "coordinates": chart.crs.to_string(), "s44": EDITION})
            for number, (meaning, unit) in enumerate(BANDS, 1):
                file.set_band_description(number, meaning)
                file.set_band_unit(number, unit)
        with memory.open() as file:
            geotiff.copy_whole(file, path, "COG", compress="deflate", overview_resampling="nearest")
    codes = np.bincount(chart.order[np.isfinite(chart.order)].astype(int), minlength=len(ORDERS))
    shares = (f"{o.name} {100.0 * n / max(codes.sum(), 1):.0f} %" for n, o in zip(codes, ORDERS, strict=True) if n)
    return f"chart.tif ({chart.crs.to_string()}; cells by S-44 order: {', '.join(shares)})"
