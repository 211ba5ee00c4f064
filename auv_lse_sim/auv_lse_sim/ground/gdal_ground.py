"""Ground from GeoTIFF, netCDF (GEBCO), BAG and S-102, read by GDAL if rasterio is installed."""

from __future__ import annotations

import os
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.mission_file.sections.world import BathymetryConfig
from auv_lse_common.support.user_error import brief
from auv_lse_sim.ground.band_meaning import Meaning, is_other, length_m, meaning, text_says_up
from auv_lse_sim.ground.depth_sign import SIGN_FLAGS
from auv_lse_sim.ground.grid_ground import GridGround, check_nodes
from auv_lse_sim.ground.ground import GroundError
from auv_lse_sim.ground.raster_ground import raster_ground

Array = NDArray[np.float64]

_CLASSIC_NETCDF = (b"CDF\1", b"CDF\2")
#: Drivers of GDAL that may open a file, by its first bytes; others, as VRT, name further files.
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
#: Steps of an axis differ by less than this share.
_UNEVEN = 0.1
_COLORS = ("red", "green", "blue", "alpha", "palette", "cyan", "magenta", "yellow", "black", "hue", "saturation")


def read_gdal_ground(path: Path, config: BathymetryConfig, origin: tuple[float, float] | None) -> GridGround:
    """Reads ground from a raster: scale, offset, unit, no-data values, masks, names and vertical axis count.

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
                    return _ground(data, path, config, origin)
                variable, driver = _variable(data.subdatasets, path), data.driver
            with rasterio.open(variable, driver=driver) as data:
                return _ground(data, path, config, origin)
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
            return rasterio.open(path, driver=driver)
        except RasterioIOError:
            continue
    return rasterio.open(path, driver=last)


def _check_header(path: Path) -> None:
    """Checks the header of a classic netCDF file: for a damaged one, GDAL asks for memory without limit and crashes.

    Raises:
        GroundError: if it is damaged.
    """
    from scipy.io import netcdf_file

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            netcdf_file(path, mmap=True).close()
    except (ValueError, LookupError, TypeError, OverflowError, MemoryError, ArithmeticError) as error:
        raise GroundError(f"{path} is a damaged netCDF file ({brief(error)}). Copy it again") from error


def _variable(names: list[str], path: Path) -> str:
    """The subdataset that holds depths or elevations, by its name.

    Raises:
        GroundError: if none or several do.
    """
    shown = {name: name.rpartition(":")[2].strip("/") for name in names}
    fit = [name for name, last in shown.items() if not is_other(last)]
    named = [name for name in fit if text_says_up(shown[name]) is not None] or fit
    if len(named) != 1:
        raise GroundError(
            f"{path} has the variables {', '.join(shown.values())}; which are the depths? Write that one to a "
            f"GeoTIFF: gdal_translate '{(named or names)[0]}' depth.tif"
        )
    return named[0]


def _ground(data: Any, path: Path, config: BathymetryConfig, origin: tuple[float, float] | None) -> GridGround:
    """Ground from an opened raster."""
    check_nodes(str(path), data.height, data.width)
    band, notes = _band(data, path)
    said, crs = _meaning(data, band, path)
    _check_no_picture(data, band, said, path, config)
    transform = data.transform
    if transform.b or transform.d or not transform.a or not transform.e:
        raise GroundError(f"{path}: it is rotated (transform {tuple(transform)[:6]}). Make it north-up with gdalwarp")
    if transform.is_identity:
        raise GroundError(f"{path}: it has no position on Earth. Use gdal_translate -a_ullr -a_srs")
    grid = data.read(band, masked=True)
    if np.iscomplexobj(grid):
        raise GroundError(f"{path}: its values are complex numbers, which are not depths")
    scale, offset = data.scales[band - 1], data.offsets[band - 1]
    values: Array = np.ma.filled(grid.astype(float), np.nan) * (scale * said.unit_m) + offset * said.unit_m
    if (scale, offset) != (1.0, 0.0):
        notes.append(f"scale {scale:g} and offset {offset:g} of the file applied")
    if said.unit_m != 1.0:
        notes.append(f"converted from units of {said.unit_m:g} m")
    rows, columns = values.shape
    x = transform.c + transform.a * (np.arange(columns) + 0.5)
    y = transform.f + transform.e * (np.arange(rows) + 0.5)
    unit = _checked_axes(data, path, x, y) if data.driver == "netCDF" else 1.0
    x, y = unit * x, unit * y
    if transform.e < 0.0:
        y, values = y[::-1], values[::-1]
    if transform.a < 0.0:
        x, values = x[::-1], values[:, ::-1]
    return raster_ground(path, x, y, values, crs, config, origin, replace(said, notes=tuple(notes)))


def _checked_axes(data: Any, path: Path, x: Array, y: Array) -> float:
    """Checks the axes of a netCDF file; returns the factor from their unit to that of the CRS.

    GDAL takes the last dimension for x, and even steps for granted.

    Raises:
        GroundError: if the axes are not those of the rows and columns, or have uneven steps.
    """
    tags = data.tags()
    names = [next((key.partition("#")[0] for key, text in tags.items() if text in marks), "") for marks in _AXES]
    for name, what, found in zip(names, ("rows", "columns"), (y, x), strict=True):
        axis, precision = _values(path, name) if name else (np.empty(0), 0.0)
        if not axis.size or len(found) < 2:
            continue
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
    return 1.0 if unit_m is None else unit_m / (data.crs.linear_units_factor[1] if data.crs else 1.0)


def _values(path: Path, name: str) -> tuple[Array, float]:
    """The values of a netCDF variable with one dimension, growing, and their precision; none of another one."""
    import rasterio

    with rasterio.open(f'netcdf:"{path}":{name}', driver="netCDF") as file:
        if 1 not in file.shape:
            return np.empty(0), 0.0
        axis = file.read(1).ravel()
    return np.sort(axis.astype(float)), float(np.spacing(np.abs(axis).max())) if axis.dtype.kind == "f" else 0.0


def _band(data: Any, path: Path) -> tuple[int, list[str]]:
    """The number of the band with depths or elevations, and a note if there are others.

    Raises:
        GroundError: if every band has another meaning.
    """
    said = [(text, data.tags(k).get("NETCDF_VARNAME")) for k, text in enumerate(data.descriptions, 1)]
    names = [" ".join(filter(None, texts)) for texts in said]
    fit = [k for k, name in enumerate(names, 1) if not is_other(name)]
    named = [k for k in fit if text_says_up(names[k - 1]) is not None] or fit
    if not named:
        shown = ", ".join(name[:40] for name in names[:30])
        raise GroundError(f"{path}: its bands are {shown}; none holds depths or elevations")
    if data.count == 1:
        return named[0], []
    return named[0], [f"band {named[0]} of {data.count}{f' ({names[named[0] - 1]})' if names[named[0] - 1] else ''}"]


def _meaning(data: Any, band: int, path: Path) -> tuple[Meaning, str | None]:
    """What the values of a band are, and the horizontal CRS as WKT."""
    tags = {key.lower(): value for key, value in data.tags(band).items()}
    texts = {key: tags.get(key, "") for key in ("positive", "standard_name", "long_name")}
    texts |= {"name": tags.get("netcdf_varname", ""), "description": data.descriptions[band - 1] or ""}
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


def _check_no_picture(data: Any, band: int, said: Meaning, path: Path, config: BathymetryConfig) -> None:
    """Refuses pictures: colors, and 8-bit values that nothing describes.

    Raises:
        GroundError: if the raster is a picture, or may be one.
    """
    colors = sorted({color.name for color in data.colorinterp} & set(_COLORS))
    if data.colorinterp[band - 1].name in _COLORS or {"red", "green", "blue"} <= set(colors):
        raise GroundError(f"{path} is a picture (bands {', '.join(colors)}), not depths. Export the depths themselves")
    plain = (data.scales[band - 1], data.offsets[band - 1]) == (1.0, 0.0) and said.is_silent
    if data.dtypes[band - 1] == "uint8" and plain and config.depth_sign == "auto" and config.water_level_m is None:
        raise GroundError(
            f"{path}: its values are whole numbers from 0 to 255, as in a picture. If these are depths in metres, "
            f"say so: {SIGN_FLAGS}"
        )


def is_raster_file(begin: bytes) -> bool:
    """Whether a file's first bytes are those of a TIFF, netCDF or HDF5 file."""
    return begin[:4] in _DRIVERS
