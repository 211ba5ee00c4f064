"""Ground from files: soundings (CSV, XYZ), npz and ESRI ASCII grids, and rasters that GDAL reads."""

from __future__ import annotations

from pathlib import Path

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_gp.soundings import SoundingsError
from auv_lse_sim.ground.ascii_ground import read_ascii_ground
from auv_lse_sim.ground.gdal_ground import is_raster_file, read_gdal_ground
from auv_lse_sim.ground.grid_ground import GridGround, checked_origin
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.npz_ground import read_npz_ground
from auv_lse_sim.ground.soundings_ground import read_soundings_ground
from auv_lse_sim.ground.xyz_ground import is_xyz, read_xyz_ground


def load_ground(
    path: str | Path, config: BathymetryConfig | None = None, origin: tuple[float, float] | None = None
) -> GridGround:
    """Reads a bathymetry file; by content, else by suffix.

    Args:
        path: The file.
        config: How to read it.
        origin: WGS84 latitude and longitude (deg) of the local origin if the file has none; by default the middle of
            the data.

    Raises:
        GroundError: naming the file, the line where there is one, what was found and what was expected.
    """
    path = Path(path)
    config = config or BathymetryConfig()
    if not path.is_file():
        what = "is not a file" if path.exists() else "does not exist"
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
    if begin[:4] in (b"DSAA", b"DSBB", b"DSRB"):
        raise GroundError(f"{path} is a Surfer grid. Convert it: gdal_translate {path.name} {path.stem}.tif")
    if is_raster_file(begin):
        reader = read_gdal_ground
    elif reader is read_soundings_ground and is_xyz(path):
        reader = read_xyz_ground
    if reader is None:
        raise GroundError(f"{path}: files ending in {path.suffix!r} cannot be read; use one of {', '.join(kinds)}")
    if origin is not None:
        origin = checked_origin(*origin, where=f"{path}: area.origin_lat_deg, origin_lon_deg")
    try:
        return reader(path, config, origin)
    except SoundingsError as error:
        raise GroundError(str(error)) from error
    except OSError as error:
        raise GroundError(f"{path}: cannot be read: {error.strerror or error}") from error


def _begin(path: Path) -> bytes:
    """The first bytes of a file.

    Raises:
        GroundError: if it cannot be read.
    """
    try:
        with path.open("rb") as file:
            return file.read(8)
    except OSError as error:
        raise GroundError(f"{path}: cannot be read: {error.strerror or error}") from error
