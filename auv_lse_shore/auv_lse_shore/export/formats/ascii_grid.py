"""risk.asc, depth.asc, std.asc: the same maps as ESRI ASCII grid, with their coordinates in .prj files."""

from auv_lse_shore.export.content import NODATA, Export


def write(export: Export) -> str:
    """Writes the maps, north up."""
    grid, (west, south) = export.team.field.grid, export.corner()
    header = {
        "ncols": str(len(grid.east_m)),
        "nrows": str(len(grid.north_m)),
        "xllcorner": repr(west),
        "yllcorner": repr(south),
        "cellsize": repr(float(grid.resolution_m)),
        "NODATA_value": f"{NODATA:g}",
    }
    for raster in export.rasters():
        path = export.folder / f"{raster.name}.asc"
        lines = [f"{name} {value}" for name, value in header.items()]
        lines += [" ".join(f"{value:.7g}" for value in row) for row in raster.northern_row_first]
        path.write_text("\n".join(lines) + "\n")
        projection = path.with_suffix(".prj")
        if export.reference.origin is not None:
            projection.write_text(export.reference.wkt("WKT1_ESRI") + "\n")
        else:
            export.discard(projection.name)
    return ", ".join(f"{raster.name}.asc" for raster in export.rasters())
