"""Ground from GeoTIFF, netCDF (GEBCO), BAG and S-102, read by GDAL if rasterio is installed."""

import math
import os
import re
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.support.arrays import Array
from auv_lse_common.support.input_bounds import MAX_GRID_NODES
from auv_lse_common.support.plurals import counted
from auv_lse_common.support.user_error import brief
from auv_lse_common.vocabulary.frames import unwrapped_deg
from auv_lse_sim.ground.band_meaning import Meaning, is_bare, is_elevation, is_other, is_other_file, length_m, meaning
from auv_lse_sim.ground.depth_sign import SIGN_FLAGS
from auv_lse_sim.ground.grid_ground import GridGround, check_nodes
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.raster_ground import raster_ground

#: Latitudes and longitudes (deg).
Corners = Sequence[tuple[float, float]]

_CLASSIC_NETCDF = (b"CDF\1", b"CDF\2")
#: Variables of a GMT 3 grid, which stores all nodes in one row.
_GMT_3 = {"x_range", "y_range", "z_range", "spacing", "dimension", "z"}
#: GDAL drivers that may open a file, by its first bytes; other formats, such as VRT, name further files.
_DRIVERS = {
    **dict.fromkeys((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), ("GTiff",)),
    **dict.fromkeys((*_CLASSIC_NETCDF, b"CDF\5"), ("netCDF",)),
    b"\x89HDF": ("BAG", "S102", "netCDF"),
}
#: Standard names and units of the coordinates of rows and of columns in a netCDF file.
_AXES = (
    ("latitude", "projection_y_coordinate", "degrees_north", "degree_north", "degrees_N", "degree_N"),
    ("longitude", "projection_x_coordinate", "degrees_east", "degree_east", "degrees_E", "degree_E"),
)
#: Their names in a file without these marks, as GMT writes it.
_AXIS_NAMES = (("y", "lat", "latitude", "northing", "north"), ("x", "lon", "longitude", "easting", "east"))
#: Steps of an axis differ by less than this share.
_UNEVEN = 0.1
#: Of a raster with more nodes, only those around the area are read.
LARGE_NODES = 4_000_000
#: Largest block of nodes that are averaged; larger rasters are refused: reading them takes minutes.
MAX_BLOCK = 6
_COLORS = ("red", "green", "blue", "alpha", "palette", "cyan", "magenta", "yellow", "black", "hue", "saturation")


def read_gdal_ground(
    path: Path, config: BathymetryConfig, origin: tuple[float, float] | None, around: Corners = ()
) -> GridGround:
    """Reads ground from a raster, using its scale, offset, unit, no-data values, masks, names and vertical axis.

    Of a large raster only the part around an area is read.

    Args:
        origin: WGS84 latitude and longitude (deg) of the local origin; None: the middle of the raster.
        around: Latitudes and longitudes (deg) of corners around the area; (): all is read.

    Raises:
        GroundError: if rasterio is not installed, or the file cannot be read, is a picture, or is not north-up.
    """
    try:
        import rasterio
        from rasterio.errors import NotGeoreferencedWarning, RasterioError
    except ImportError:
        raise GroundError(
            f"{path}: reading it needs rasterio, which is not installed; pip install rasterio, or convert it: "
            "gdal_translate -of AAIGrid in.tif out.asc"
        ) from None
    try:
        with warnings.catch_warnings(), _quiet():
            warnings.simplefilter("ignore", NotGeoreferencedWarning)
            with _opened(path) as data:
                if data.count or not data.subdatasets:
                    return _ground(data, path, config, origin, around)
                (variable, notes), driver = _variable(data.subdatasets, path), data.driver
            with rasterio.open(variable, driver=driver, **_options(driver)) as data:
                return _ground(data, path, config, origin, around, notes)
    except GroundError:
        raise
    except (RasterioError, RuntimeError, MemoryError, ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise GroundError(f"{path} is not a readable raster: {type(error).__name__}: {brief(error)}") from error


@contextmanager
def _quiet() -> Iterator[None]:
    """Discards what the C libraries print on stderr about a damaged file; errors are raised all the same."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        sys.stderr.flush()
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


def _opened(path: Path) -> Any:
    """The dataset of a file, opened with the first driver that can.

    Raises:
        GroundError: if none is known for the file's first bytes.
        RasterioIOError: if none can.
    """
    import rasterio
    from rasterio.errors import RasterioIOError

    with path.open("rb") as file:
        signature = file.read(4)
    *others, last = _DRIVERS.get(signature, ("",))
    if signature in _CLASSIC_NETCDF:
        _check_header(path)
    if not last:
        raise GroundError(f"{path} is not a readable raster: it is neither TIFF, netCDF nor HDF5 (BAG, S-102)")
    for driver in others:
        try:
            return rasterio.open(path, driver=driver, **_options(driver))
        except RasterioIOError:
            continue
    try:
        return rasterio.open(path, driver=last, **_options(last))
    except RasterioIOError as error:
        if last != "netCDF":
            raise
        raise GroundError(
            f"{path} is not a readable raster: {brief(error)}. If it holds points instead of a grid, write them as "
            ".csv with lat, lon, depth_m"
        ) from error


def _options(driver: str) -> dict[str, str]:
    """Options for opening a file: GDAL's own use of a netCDF variable's valid range makes the others 0."""
    return {"HONOUR_VALID_RANGE": "NO"} if driver == "netCDF" else {}


def _check_header(path: Path) -> None:
    """Checks the header of a classic netCDF file: for a damaged one, GDAL asks for memory without limit and crashes."""
    from scipy.io import netcdf_file

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with netcdf_file(path, mmap=True) as file:
                variables = {*file.variables}
    except (ValueError, LookupError, TypeError, OverflowError, MemoryError, ArithmeticError) as error:
        raise GroundError(f"{path} is a damaged netCDF file ({brief(error)}). Copy it again") from error
    if variables >= _GMT_3:
        raise GroundError(
            f"{path} is a netCDF grid of GMT 3, which is not read. Convert it: gmt grdconvert {path.name} "
            f"{path.stem}-new.nc"
        )


def _variable(names: list[str], path: Path) -> tuple[str, list[str]]:
    """The subdataset that holds depths or elevations, by its name, and a note if it is one of several."""
    shown = {name: name.rpartition(":")[2].strip("/") for name in names}
    fit = [name for name, last in shown.items() if not is_other(last)]
    named = [name for name in fit if is_elevation(shown[name]) is not None] or fit
    plain = [name for name in named if is_bare(shown[name].rpartition("/")[2])]
    if len(named) == 1 or len(plain) == 1:
        chosen = named[0] if len(named) == 1 else plain[0]
        others = ", ".join(shown[name] for name in named if name != chosen)
        return chosen, [f"variable {shown[chosen]}, not {others}"] if others else []
    raise GroundError(
        f"{path} has the variables {', '.join(shown.values())}; which are the depths? Write that one to a "
        f"GeoTIFF: gdal_translate '{(named or names)[0]}' depth.tif"
    )


def _ground(
    data: Any,
    path: Path,
    config: BathymetryConfig,
    origin: tuple[float, float] | None,
    around: Corners,
    about: Sequence[str] = (),
) -> GridGround:
    """Ground from an opened raster, with notes about its choice."""
    band, notes = _band(data, path)
    notes = [*about, *notes]
    said, crs = _meaning(data, band, path)
    _check_are_depths(data, band, said, path, config)
    transform = data.transform
    if transform.b or transform.d or not transform.a or not transform.e:
        raise GroundError(f"{path}: it is rotated (transform {tuple(transform)[:6]}). Make it north-up with gdalwarp")
    if transform.is_identity and data.driver != "netCDF":
        raise GroundError(f"{path}: it has no position on Earth. Use gdal_translate -a_ullr -a_srs")
    x, y = _axes(data, path)
    part = _part_around(around, x, y, crs)
    block = _nodes_per_block(data, band, part)
    check_nodes(str(path), part.height, part.width, block)
    grid = _averaged(data, band, block, part)
    if np.iscomplexobj(grid):
        raise GroundError(f"{path}: its values are complex numbers, which are not depths")
    scale, offset = data.scales[band - 1], data.offsets[band - 1]
    values: Array = np.ma.filled(grid.astype(float), np.nan)
    if data.driver == "netCDF":
        values, note = _valid(values, data.tags(band), scale, offset)
        notes += note
    values = values * scale + offset
    if part.height * part.width < data.height * data.width:
        notes.append(f"only the {part.height:,} x {part.width:,} nodes around the area are read")
    if block > 1:
        notes.append(f"means of {block} x {block} nodes, from {part.height:,} x {part.width:,}")
    if (scale, offset) != (1.0, 0.0):
        notes.append(f"scale {scale:g} and offset {offset:g} of the file applied")
    x = x[part.col_off : part.col_off + part.width]
    y = y[part.row_off : part.row_off + part.height]
    x, y = (axis[: len(axis) // block * block].reshape(-1, block).mean(axis=1) for axis in (x, y))
    if y[0] > y[-1]:
        y, values = y[::-1], values[::-1]
    if x[0] > x[-1]:
        x, values = x[::-1], values[:, ::-1]
    if not said.has_unit and data.crs and data.crs.is_projected and "foot" in data.crs.linear_units.lower():
        notes.append(f"values without a unit taken as metres, though coordinates are in {data.crs.linear_units}")
    return raster_ground(path, x, y, values, crs, config, origin, replace(said, notes=tuple(notes)))


def _axes(data: Any, path: Path) -> tuple[Array, Array]:
    """Coordinates of the columns and rows, in the unit of the CRS."""
    transform = data.transform
    x = transform.c + transform.a * (np.arange(data.width) + 0.5)
    y = transform.f + transform.e * (np.arange(data.height) + 0.5)
    return _netcdf_axes(data, path, x, y) if data.driver == "netCDF" else (x, y)


def _part_around(around: Corners, x: Array, y: Array, crs: str | None) -> Any:
    """The window of a large raster with axes `x` and `y` that holds the corners; all of it if it holds none."""
    from rasterio.windows import Window

    whole = Window(0, 0, len(x), len(y))
    if not around or crs is None or len(x) * len(y) <= LARGE_NODES:
        return whole
    from pyproj import Transformer

    lat, lon = np.array(around).T
    to_raster = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    at_x, at_y = (np.asarray(values) for values in to_raster.transform(unwrapped_deg(lon), lat))
    if to_raster.target_crs is not None and to_raster.target_crs.is_geographic:  # longitudes may be from 0 to 360
        at_x = at_x + 360.0 * np.round(((x[0] + x[-1]) / 2.0 - at_x.mean()) / 360.0)
    ends = []
    for axis, at in ((x, at_x), (y, at_y)):
        inside = np.flatnonzero((axis >= at.min()) & (axis <= at.max()))
        if len(inside) < 2:
            return whole
        ends.append((int(inside[0]), len(inside)))
    (column, width), (row, height) = ends
    return Window(column, row, width, height)


def _nodes_per_block(data: Any, band: int, part: Any) -> int:
    """Number of nodes along the side of a block of which the mean is read, so that a large raster fits into memory.

    GDAL's means include values outside of a valid range, so a netCDF band with one is read unreduced.
    """
    if any(key.startswith("valid_") for key in data.tags(band)):
        return 1
    return min(math.ceil(math.sqrt(part.height * part.width / MAX_GRID_NODES)), MAX_BLOCK) or 1


def _averaged(data: Any, band: int, block: int, part: Any) -> Any:
    """A part of the band as a masked array (ny, nx): means over the known values of blocks of nodes.

    Up to `block` - 1 rows and columns at the last edges are left out.
    """
    if block == 1:
        return data.read(band, masked=True, window=part)
    from rasterio.enums import Resampling
    from rasterio.windows import Window

    shape = part.height // block, part.width // block
    window = Window(part.col_off, part.row_off, block * shape[1], block * shape[0])
    return data.read(band, masked=True, window=window, out_shape=shape, resampling=Resampling.average)


def _valid(values: Array, tags: Mapping[str, str], scale: float, offset: float) -> tuple[Array, list[str]]:
    """Values (ny, nx) as stored with those outside of `valid_range`, `valid_min`, `valid_max` unknown, and a note.

    The range applies to stored values. If they are packed and it excludes most, the writer meant unpacked ones. A range
    that excludes all is a mistake.
    """
    texts = [*tags.get("valid_range", "").strip("{} ").split(","), "", ""][:2]
    low, high = (_number(tags.get(key, text)) for key, text in zip(("valid_min", "valid_max"), texts, strict=True))
    with np.errstate(invalid="ignore"):
        stored, unpacked = ((v < low) | (v > high) for v in (values, values * scale + offset))
    known = int(np.isfinite(values).sum())
    outside = unpacked if known < 2 * stored.sum() and unpacked.sum() < stored.sum() else stored
    if not outside.any():
        return values, []
    pairs = (("below", low), ("above", high))
    limits = " or ".join(f"{word} {limit:g}" for word, limit in pairs if np.isfinite(limit))
    if outside.sum() == known:
        return values, [f"the file's valid range is ignored: all its values are {limits}"]
    note = f"{counted(int(outside.sum()), 'node')} {limits} (the file's valid range) taken as unknown"
    return np.where(outside, np.nan, values), [note]


def _number(text: str) -> float:
    """A limit from an attribute; NaN, which excludes no value, if it is not a number."""
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _netcdf_axes(data: Any, path: Path, x: Array, y: Array) -> tuple[Array, Array]:
    """The axes of the columns and rows of a netCDF grid, in the unit of its CRS; GDAL found `x` and `y`.

    GDAL takes the last dimension for x and assumes even steps. It finds only axes that the file marks.
    """
    tags = data.tags()
    names = [next((key.partition("#")[0] for key, text in tags.items() if text in marks), "") for marks in _AXES]
    if data.transform.is_identity:
        names, x, y = _named_axes(data, path)
    for name, what, found in zip(names, ("rows", "columns"), (y, x), strict=True):
        axis, precision = _values(path, name) if name else (np.empty(0), 0.0)
        if not axis.size or len(found) < 2:
            continue
        axis = np.sort(unwrapped_deg(axis) if tags.get(f"{name}#units") in _AXES[1] else axis)
        steps, step = np.diff(axis), abs(found[1] - found[0])
        if np.ptp(steps) > _UNEVEN * step + 4.0 * precision:
            raise GroundError(
                f"{path}: its {name} has uneven steps, from {steps.min():.4g} to {steps.max():.4g}. Grid it evenly, or "
                "write its points as .xyz"
            )
        apart = abs(axis[0] - found.min())
        apart = min(apart, abs(apart - 360.0)) if what == "columns" else apart  # longitudes from 0 to 360
        if len(axis) != len(found) or apart > step:
            raise GroundError(
                f"{path}: its {what} are not those of {name}: its dimensions have another order. Turn it: "
                f"ncpdq -a {','.join(names)} {path.name} out.nc"
            )
    unit_m = length_m(tags.get(f"{names[1]}#units", ""))
    factor = 1.0 if unit_m is None else unit_m / (data.crs.linear_units_factor[1] if data.crs else 1.0)
    return factor * x, factor * y


def _named_axes(data: Any, path: Path) -> tuple[list[str], Array, Array]:
    """The axes of a netCDF grid that marks none, found by name: names for rows and columns, then columns, then rows."""
    if coordinates := data.tags(1).get("coordinates"):
        raise GroundError(
            f"{path}: its rows and columns have no axes; each node has a position ({coordinates}). Grid it evenly: "
            f"gdalwarp -geoloc {path.name} out.tif"
        )
    found = [
        next(((name, axis) for name in names if (axis := _values(path, name)[0]).size == count), None)
        for names, count in zip(_AXIS_NAMES, data.shape, strict=True)
    ]
    rows, columns = found
    if rows is None or columns is None:
        raise GroundError(f"{path}: it has no position on Earth. Use gdal_translate -a_ullr -a_srs")
    return [rows[0], columns[0]], columns[1], rows[1][::-1]  # GDAL reads it from the last row


def _values(path: Path, name: str) -> tuple[Array, float]:
    """The values of a netCDF variable with one dimension, and their precision; empty for any other variable."""
    import rasterio
    from rasterio.errors import RasterioIOError

    try:
        with rasterio.open(f'netcdf:"{path}":{name}', driver="netCDF") as file:
            if 1 not in file.shape:
                return np.empty(0), 0.0
            axis = file.read(1).ravel()
    except RasterioIOError:
        return np.empty(0), 0.0
    return axis.astype(float), float(np.spacing(np.abs(axis).max())) if axis.dtype.kind == "f" else 0.0


def _band(data: Any, path: Path) -> tuple[int, list[str]]:
    """The number of the band with depths or elevations, and a note if there are others."""
    said = [(text, data.tags(k).get("NETCDF_VARNAME")) for k, text in enumerate(data.descriptions, 1)]
    names = [" ".join(filter(None, texts)) for texts in said]
    fit = [k for k, name in enumerate(names, 1) if not is_other(name)]
    named = [k for k in fit if is_elevation(names[k - 1]) is not None] or fit
    if not named:
        shown = ", ".join(name[:40] for name in names[:30])
        raise GroundError(f"{path}: its bands are {shown}; none holds depths or elevations. If one does, name it depth")
    if data.count == 1:
        return named[0], []
    return named[0], [f"band {named[0]} of {data.count}{f' ({names[named[0] - 1]})' if names[named[0] - 1] else ''}"]


def _meaning(data: Any, band: int, path: Path) -> tuple[Meaning, str | None]:
    """The meaning of a band's values, and the horizontal CRS as WKT."""
    tags = {key.lower(): value for key, value in data.tags(band).items()}
    texts = {key: tags.get(key, "") for key in ("positive", "standard_name", "long_name")}
    name = tags.get("netcdf_varname", "").removeprefix("__xarray_dataarray_variable__")  # of a variable without one
    texts |= {"name": name, "description": data.descriptions[band - 1] or ""}
    unit = data.units[band - 1] or tags.get("units", "") or tags.get("unittype", "")
    crs = data.crs.to_wkt() if data.crs else None
    horizontal, vertical = _split(crs)
    return meaning(texts, unit, vertical, path.stem, str(path)), horizontal


def _split(crs: str | None) -> tuple[str | None, tuple[bool, float] | None]:
    """The horizontal part of a CRS (WKT), and whether its vertical axis points up, with metres per unit; None: none."""
    if crs is None or not re.search(r"COMPD_CS|COMPOUNDCRS|VERT_CS|\bup\b", crs, re.IGNORECASE):
        return crs, None
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    try:
        whole = CRS.from_wkt(crs)
    except CRSError:
        return crs, None  # `raster_ground` reports it
    parts = whole.sub_crs_list or [whole]
    axis = next((a for part in parts for a in part.axis_info if a.direction in ("up", "down")), None)
    if axis is None:
        return crs, None
    horizontal = parts[0].to_2d() if len(parts) == 1 else parts[0]
    return horizontal.to_wkt(), (axis.direction == "up", float(axis.unit_conversion_factor or 1.0))


def _check_are_depths(data: Any, band: int, said: Meaning, path: Path, config: BathymetryConfig) -> None:
    """Refuses pictures (colors, and 8-bit values that nothing describes) and, by the file's name, other quantities."""
    colors = sorted({color.name for color in data.colorinterp} & set(_COLORS))
    if data.colorinterp[band - 1].name in _COLORS or {"red", "green", "blue"} <= set(colors):
        raise GroundError(f"{path} is a picture (bands {', '.join(colors)}), not depths. Export the depths themselves")
    plain = (data.scales[band - 1], data.offsets[band - 1]) == (1.0, 0.0) and said.is_undescribed
    is_given = config.depth_sign != "auto" or config.water_level_m is not None
    if data.dtypes[band - 1] == "uint8" and plain and not is_given:
        raise GroundError(
            f"{path}: its values are whole numbers from 0 to 255, as in a picture. If these are depths in metres, "
            f"add {SIGN_FLAGS}"
        )
    if said.is_undescribed and is_other_file(path.stem) and not is_given:
        raise GroundError(
            f"{path} is named after another quantity, and nothing in it describes the values. If these are depths in "
            f"metres, add {SIGN_FLAGS}"
        )


def is_raster_file(begin: bytes) -> bool:
    """Whether a file's first bytes are those of a TIFF, netCDF or HDF5 file."""
    return begin[:4] in _DRIVERS
