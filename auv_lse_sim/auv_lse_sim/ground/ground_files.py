"""Ground from files: soundings (CSV, XYZ), npz and ESRI ASCII grids, and rasters that GDAL reads."""

from pathlib import Path

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_gp.tables.table_error import TableError
from auv_lse_sim.ground.ascii_ground import read_ascii_ground
from auv_lse_sim.ground.gdal_ground import Corners, is_raster_file, read_gdal_ground
from auv_lse_sim.ground.grid_ground import GridGround, checked_origin
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.npz_ground import read_npz_ground
from auv_lse_sim.ground.soundings_ground import read_soundings_ground

_VECTORS = (".shp", ".gpkg", ".geojson", ".geojsonl", ".json", ".kml", ".kmz", ".gml", ".gpx", ".dxf", ".fgb")
_SPREADSHEETS = (".xls", ".xlsx", ".xlsm", ".ods", ".numbers")


def load_ground(
    path: str | Path,
    config: BathymetryConfig | None = None,
    origin: tuple[float, float] | None = None,
    around: Corners = (),
) -> GridGround:
    """Reads a bathymetry file; by content, else by suffix.

    Args:
        origin: WGS84 latitude and longitude (deg) of the local origin if the file has none; by default the middle of
            the data.
        around: Latitudes and longitudes (deg) of corners around the area, outside of which a large raster is not read.

    Raises:
        GroundError: naming the file, the line where there is one, what was found and what was expected.
    """
    path = Path(path)
    config = config or BathymetryConfig()
    try:
        what = "" if path.is_file() else "is not a file" if path.exists() else "does not exist"
    except OSError as error:  # such as a folder that must not be searched
        raise GroundError(f"{path}: cannot be read: {error.strerror}") from error
    if what:
        raise GroundError(f"{path} {what}; give bathymetry as .csv, .npz, .asc, .tif, .nc or .bag")
    kinds = {
        ".csv": read_soundings_ground,
        ".txt": read_soundings_ground,
        ".xyz": read_soundings_ground,
        ".npz": read_npz_ground,
        ".asc": read_ascii_ground,
        ".grd": read_ascii_ground,
        ".tif": read_gdal_ground,
        ".tiff": read_gdal_ground,
        ".nc": read_gdal_ground,
        ".bag": read_gdal_ground,
        ".h5": read_gdal_ground,
    }
    reader, begin = kinds.get(path.suffix.lower()), _begin(path)
    if is_raster_file(begin):
        reader = read_gdal_ground
    else:
        _refuse_other(path, begin)
    if reader is None:
        raise GroundError(f"{path}: files ending in {path.suffix!r} cannot be read; use one of {', '.join(kinds)}")
    if origin is not None:
        origin = checked_origin(*origin, where=f"{path}: area.origin_lat_deg, origin_lon_deg")
    try:
        return reader(path, config, origin) if reader is not read_gdal_ground else reader(path, config, origin, around)
    except TableError as error:
        raise GroundError(str(error)) from error
    except OSError as error:
        raise GroundError(f"{path}: cannot be read: {error.strerror or error}") from error


def _refuse_other(path: Path, begin: bytes) -> None:
    """Refuses files that another program converts, by their first bytes or their suffix."""
    if begin[:4] in (b"DSAA", b"DSBB", b"DSRB"):
        raise GroundError(f"{path} is a Surfer grid. Convert it: gdal_translate {path.name} {path.stem}.tif")
    if begin[:4] == b"LASF":
        raise GroundError(
            f"{path} is a point cloud (LAS). Write the points of the bottom as .xyz: pdal translate {path.name} "
            f"{path.stem}.xyz --writers.text.order=X,Y,Z --writers.text.keep_unspecified=false "
            "--writers.text.write_header=false"
        )
    if path.suffix.lower() in _VECTORS:
        raise GroundError(
            f"{path} holds points or lines, not a grid. Write its soundings as a table: ogr2ogr -t_srs EPSG:4326 -lco "
            f"GEOMETRY=AS_XY {path.stem}.csv {path.name}; then rename the columns to lon, lat, depth_m"
        )
    if path.suffix.lower() in _SPREADSHEETS:
        raise GroundError(f"{path} is a spreadsheet. Save it as .csv with lat, lon, depth_m")
    if begin[:2] == b"\x1f\x8b" or (begin[:4] == b"PK\3\4" and path.suffix.lower() != ".npz"):
        raise GroundError(f"{path} is packed. Unpack it, and give the file inside")


def _begin(path: Path) -> bytes:
    """The first bytes of a file."""
    try:
        with path.open("rb") as file:
            return file.read(8)
    except OSError as error:
        raise GroundError(f"{path}: cannot be read: {error.strerror or error}") from error
