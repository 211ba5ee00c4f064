"""GeoPackage and shapefile, read by GDAL (pyogrio)."""

import io
import tempfile
import warnings
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.mission_file.parameters import ParameterError
from auv_lse_common.support.user_error import brief
from auv_lse_shore.areas.features import Feature, is_resource_fork, named_feature, with_geometry
from auv_lse_shore.areas.projection import to_degrees

#: Largest size of all files of a zipped shapefile.
_MAX_UNPACKED_BYTES = 50_000_000
_MAX_FEATURES = 10_000
_SHAPEFILE = (".shp", ".shx", ".dbf", ".prj", ".cpg")


def gdal_features(path: Path, where: str) -> Iterator[Feature]:
    """The features of every layer of a GeoPackage or shapefile; a layer's name counts as that of a folder.

    Raises:
        ParameterError: if pyogrio is not installed, or the file cannot be read.
    """
    try:
        import pyogrio
    except ImportError:
        raise ParameterError(
            f"{where}: reading it needs pyogrio, which is not installed. pip install pyogrio, or save it as GeoJSON"
        ) from None
    # an area has no heights and no measures
    warnings.filterwarnings("ignore", message="Measured .* not supported", module="pyogrio")
    try:
        layers = [(str(name), kind) for name, kind in pyogrio.list_layers(path)]
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError) as error:
        if path.suffix.lower() == ".shp" and ".shx" in str(error).lower():
            parts = ", ".join(f"{path.stem}{ending}" for ending in (".shx", ".dbf", ".prj"))
            raise ParameterError(f"{where} is one part of a shapefile. Copy {parts} beside it") from error
        raise ParameterError(f"{where}: cannot be read: {brief(error)}. Save it as GeoJSON") from error
    for layer, kind in layers:
        if kind is None:
            yield Feature(f"{layer} (a table without geometries)")
        else:
            yield from _layer(path, layer, where)


def _layer(path: Path, layer: str, where: str) -> Iterator[Feature]:
    import pyogrio
    import shapely
    from shapely.errors import ShapelyError
    from shapely.geometry import mapping

    try:
        known, _, shapes, columns = pyogrio.raw.read(path, layer=layer, force_2d=True, max_features=_MAX_FEATURES + 1)
        geometries = shapely.from_wkb(shapes)
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, pyogrio.errors.FeatureError) as error:
        raise ParameterError(f"{where}: the layer {layer!r} cannot be read: {brief(error)}") from error
    except (ShapelyError, ValueError) as error:
        raise ParameterError(
            f"{where}: the layer {layer!r} has a geometry that is not read: {brief(error)}. Save it with plain polygons"
        ) from error
    if len(geometries) > _MAX_FEATURES:
        raise ParameterError(f"{where}: the layer {layer!r} has more than {_MAX_FEATURES:,} features. Remove some")
    if not len(geometries):
        yield Feature(f"{layer} (an empty layer)")
    prj = f" ({path.stem}.prj is missing)" if path.suffix.lower() == ".shp" else ""
    if known["crs"] is None and _are_metres(geometries):
        raise ParameterError(
            f"{where}: the layer {layer!r} has no coordinate reference system{prj}, and its coordinates are not "
            "degrees. Set it in QGIS, and save the layer as EPSG:4326"
        )
    missing = f"the layer {layer!r} has no coordinate reference system{prj}; its degrees are taken as WGS84"
    assumed = missing if known["crs"] is None else ""
    convert = to_degrees(known["crs"], where)
    for number, geometry in enumerate(geometries):
        properties = {str(key): _plain(values[number]) for key, values in zip(known["fields"], columns, strict=True)}
        named = named_feature(properties, layer)
        if not named.name:
            named = named_feature({**properties, "name": f"{layer} {number + 1}"}, layer)
        named = replace(named, assumed=assumed)
        empty = geometry is None or geometry.is_empty
        yield from map(convert, with_geometry(named, None if empty else mapping(geometry), where))


def _are_metres(geometries: Any) -> bool:
    """Whether coordinates lie outside of all degrees."""
    import shapely

    bounds = np.abs(shapely.total_bounds(geometries))
    return bool((bounds > 360.0).any())


def _plain(value: object) -> object:
    """A NumPy scalar as a Python object."""
    return value.item() if hasattr(value, "item") else value


def zipped_features(data: bytes, where: str) -> Iterator[Feature]:
    """The features of the shapefiles in a ZIP file.

    Raises:
        ParameterError: if there is none, or one cannot be read.
    """
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
        parts = [info for info in archive.infolist() if not is_resource_fork(info.filename)]
        parts = [info for info in parts if Path(info.filename).suffix.lower() in _SHAPEFILE]
        if sum(info.file_size for info in parts) > _MAX_UNPACKED_BYTES:
            raise ParameterError(f"{where} has more than {_MAX_UNPACKED_BYTES / 1e6:.0f} MB when unpacked")
        contents = {info.filename.replace("/", "_"): archive.read(info) for info in parts}
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, OSError) as error:
        raise ParameterError(f"{where}: cannot be unpacked: {brief(error)}. Save it again") from error
    with tempfile.TemporaryDirectory() as folder:
        for name, content in contents.items():
            (Path(folder) / name).write_bytes(content)
        shapes = sorted(name for name in contents if name.lower().endswith(".shp"))
        if not shapes:
            raise ParameterError(f"{where}: contains neither KML nor a shapefile. Give the area file itself")
        for name in shapes:
            yield from gdal_features(Path(folder) / name, f"{where}: {name}")
