"""chart_s102.h5: depth and uncertainty as bathymetric surface, IHO S-102 edition 3.0.0, in UTM or WGS84 degrees."""

import io
import re
from datetime import UTC, datetime
from typing import Any

import numpy as np

from auv_lse_shore.export.content import NO_ORIGIN, Export, ExportError
from auv_lse_shore.export.projected import Chart, project

#: Value of cells without data, and the limits that S-102 states for its two attributes.
_NO_DATA = 1_000_000.0
_ATTRIBUTES = (
    ("depth", "depth", "metres", "1000000", "H5T_FLOAT", "-14", "11050", "closedInterval"),
    ("uncertainty", "uncertainty", "metres", "1000000", "H5T_FLOAT", "0", "", "geSemiInterval"),
)
_COLUMNS = ("code", "name", "uom.name", "fillValue", "datatype", "lower", "upper", "closure")
#: Codes of vertical datums in S-100; all others are "local datum".
_DATUMS = {
    "MLWS": 1, "MLLWS": 2, "MSL": 3, "MLW": 5, "ISLW": 8, "MLLW": 12, "MHW": 16, "MHWS": 17, "MHHW": 21, "LAT": 23,
    "IGLD1985": 25, "IGLD85": 25, "MWL": 26, "LLWLT": 27, "HHWLT": 28, "HAT": 30, "BSCD2000": 44, "IGLD2020": 46,
}  # fmt: skip
_LOCAL_DATUM = 24
#: EPSG codes that S-102 allows, besides the UTM zones.
_CRS = (4326, 5041, 5042)


def _h5py() -> Any:
    """The library, imported where it is used."""
    try:
        import h5py
    except ImportError as error:
        raise ExportError(
            f"S-102 needs h5py, which cannot be imported ({error}); fix: pip install h5py (on Ubuntu: sudo apt install "
            "python3-h5py)"
        ) from None
    return h5py


def check() -> None:
    """Raises ExportError if h5py is not installed."""
    _h5py()


def write(export: Export) -> str:
    """Writes depth (positive down) and the 95 % vertical uncertainty; no exchange set, no quality coverage."""
    path = export.folder / "chart_s102.h5"
    export.discard(path.name)
    if export.reference.origin is None:
        return f"{path.name}: {NO_ORIGIN}"
    chart = project(export)
    code = chart.crs.to_epsg()
    if code is None or not (code in _CRS or 32601 <= code <= 32660 or 32701 <= code <= 32760):
        return f"{path.name}: skipped, because S-102 allows UTM and WGS84 only, not {chart.crs.to_string()}"
    library = _h5py()
    datum = _DATUMS.get(re.sub(r"[\W_]", "", export.survey.datum.upper()), _LOCAL_DATUM)
    memory = io.BytesIO()  # on a full disk HDF5 raises errors of its own, and prints a page
    with library.File(memory, "w") as file:
        _write_root(file, chart, code, datum)
        _attributes(file, **export.metadata())  # S-102 has no attribute for them; readers skip unknown ones
        _write_features(file, library)
        _write_coverage(file, chart, library)
    path.write_bytes(memory.getbuffer())
    local = ", a local datum" if datum == _LOCAL_DATUM else ""
    return f"{path.name} ({chart.crs.to_string()}, {export.survey.vertical_datum}: S-100 code {datum}{local})"


def _attributes(node: Any, **values: Any) -> None:
    for name, value in values.items():
        node.attrs[name.replace("__", ".")] = value


def _write_root(file: Any, chart: Chart, code: int, datum: int) -> None:
    """Writes the file's attributes: product, extent and vertical datum."""
    from rasterio.warp import transform_bounds

    now = datetime.now(UTC)
    west, south, east, north = transform_bounds(chart.crs, "EPSG:4326", *_bounds(chart))
    _attributes(
        file,
        productSpecification="INT.IHO.S-102.3.0.0",
        issueDate=f"{now:%Y%m%d}",
        issueTime=f"{now:%H%M%S}Z",
        horizontalCRS=np.int32(code),
        westBoundLongitude=np.float32(west),
        eastBoundLongitude=np.float32(east),
        southBoundLatitude=np.float32(south),
        northBoundLatitude=np.float32(north),
        verticalCS=np.int32(6498),  # depth in metres, positive down
        verticalCoordinateBase=np.uint8(2),  # vertical datum
        verticalDatumReference=np.uint8(1),  # of S-100's list
        verticalDatum=np.uint16(datum),
    )


def _bounds(chart: Chart) -> tuple[float, float, float, float]:
    """West, south, east, north of the cells' centers, in the chart's coordinates."""
    rows, columns = chart.depth_m.shape
    cell = chart.transform  # north up; affine 2 has no `@`, and affine 3 deprecates `*`
    west, north = cell.c + 0.5 * cell.a, cell.f + 0.5 * cell.e
    return west, north + (rows - 1) * cell.e, west + (columns - 1) * cell.a, north


def _write_features(file: Any, library: Any) -> None:
    """The table of features and their attributes."""
    text = library.string_dtype()
    group = file.create_group("Group_F")
    group["featureCode"] = np.array(["BathymetryCoverage"], dtype=text)
    group["BathymetryCoverage"] = np.array(list(_ATTRIBUTES), dtype=[(name, text) for name in _COLUMNS])


def _write_coverage(file: Any, chart: Chart, library: Any) -> None:
    """The grid: its geometry, and the values from south to north."""
    west, south, east, north = _bounds(chart)
    depth, tvu = (values[::-1] for values in (chart.depth_m, chart.tvu_m))
    rows, columns = depth.shape
    known = np.isfinite(depth)
    values = np.zeros((rows, columns), dtype=[("depth", "<f4"), ("uncertainty", "<f4")])
    values["depth"] = np.where(known, depth, _NO_DATA)
    values["uncertainty"] = np.where(known & np.isfinite(tvu), tvu, _NO_DATA)
    feature = file.create_group("BathymetryCoverage")
    axes = ("Easting", "Northing") if chart.crs.is_projected else ("Longitude", "Latitude")
    feature["axisNames"] = np.array(axes, dtype=library.string_dtype())
    codes = {"dataCodingFormat": 2, "dimension": 2, "commonPointRule": 2, "numInstances": 1, "dataOffsetCode": 5}
    codes |= {"interpolationType": 1, "sequencingRule__type": 1}
    _attributes(feature, **{name: np.uint8(code) for name, code in codes.items()})
    _attributes(
        feature,
        horizontalPositionUncertainty=np.float32(-1.0),  # unknown
        verticalUncertainty=np.float32(-1.0),
        sequencingRule__scanDirection=", ".join(axes),
    )
    instance = feature.create_group("BathymetryCoverage.01")
    _attributes(
        instance,
        gridOriginLongitude=west,
        gridOriginLatitude=south,
        gridSpacingLongitudinal=float(chart.transform.a),
        gridSpacingLatitudinal=float(-chart.transform.e),
        numPointsLongitudinal=np.uint32(columns),
        numPointsLatitudinal=np.uint32(rows),
        numGRP=np.uint8(1),
        startSequence="0,0",
        westBoundLongitude=np.float32(west),
        eastBoundLongitude=np.float32(east),
        southBoundLatitude=np.float32(south),
        northBoundLatitude=np.float32(north),
    )
    group = instance.create_group("Group_001")
    group.create_dataset("values", data=values, compression="gzip", chunks=values.shape)
    for name, field in (("Depth", "depth"), ("Uncertainty", "uncertainty")):
        there = values[field][values[field] != _NO_DATA]
        low, high = (there.min(), there.max()) if there.size else (_NO_DATA, _NO_DATA)
        _attributes(group, **{f"minimum{name}": np.float32(low), f"maximum{name}": np.float32(high)})
    _attributes(group, timePoint="00010101T000000Z")
