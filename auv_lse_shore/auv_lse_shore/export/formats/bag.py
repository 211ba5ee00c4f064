"""chart.bag: elevation and total vertical uncertainty as Bathymetry Attributed Grid (BAG) in UTM, or in --crs."""

import numpy as np

from auv_lse_shore.export.content import NO_ORIGIN, Export, ExportError
from auv_lse_shore.export.formats import geotiff
from auv_lse_shore.export.projected import project
from auv_lse_shore.export.uncertainty import EDITION

#: Value of cells without data in every BAG.
_NO_DATA = 1e6


def check() -> None:
    """Raises ExportError if rasterio is missing, or its GDAL cannot write BAG."""
    with geotiff.rasterio().Env() as environment:
        if "BAG" not in environment.drivers():
            raise ExportError("chart.bag needs a GDAL with driver BAG (HDF5); fix: pip install rasterio")


def write(export: Export) -> str:
    """Writes elevation (positive up) and the 95 % vertical uncertainty."""
    path = export.folder / "chart.bag"
    export.discard(path.name)
    if export.reference.origin is None:
        return f"chart.bag: {NO_ORIGIN}"
    chart = project(export)
    if not chart.crs.is_projected:
        return f"chart.bag: skipped, because {chart.crs.to_string()} is in degrees; BAG needs metres, as of a UTM zone"
    from rasterio.io import MemoryFile

    bands = np.stack([-chart.depth_m, chart.tvu_m])
    bands = np.where(np.isnan(bands), _NO_DATA, bands).astype(np.float32)
    _, height, width = bands.shape
    profile = {"driver": "GTiff", "count": 2, "dtype": "float32", "nodata": _NO_DATA}
    with MemoryFile() as memory:
        with memory.open(height=height, width=width, crs=chart.crs, transform=chart.transform, **profile) as file:
            file.write(bands)
        with memory.open() as file:
            geotiff.copy_whole(file, path, "BAG", **_metadata(export))
    return f"chart.bag ({chart.crs.to_string()}, {export.survey.vertical_datum})"


def _metadata(export: Export) -> dict[str, str]:
    """Variables of the XML metadata that GDAL writes; rasterio passes them in capitals."""
    datum = export.survey.vertical_datum.replace('"', "'")
    about = "; ".join(f"{key}: {text}" for key, text in export.metadata().items() if key != "coordinates")
    content = f"Gaussian process map of soundings by underwater vehicles. Uncertainty: 95 % ({EDITION})"
    provider = export.survey.provider
    return {
        "VAR_VERT_WKT": f'VERT_CS["{datum}",VERT_DATUM["{datum}",2005],UNIT["metre",1],AXIS["Height",UP]]',
        "VAR_ABSTRACT": f"{content}. {about}",
        "VAR_PROCESS_STEP_DESCRIPTION": "mapped by auv_lse, written by GDAL",
        **({"VAR_ORGANISATION_NAME": provider[0]} if provider else {}),
    }
