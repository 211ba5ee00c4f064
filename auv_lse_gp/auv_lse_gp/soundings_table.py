"""Reads tables of soundings (CSV).

A table has a header and rows with fields separated by comma, semicolon, tab or blanks. Lines that begin with # are
comments, and columns with other names are listed as not used. Positions are in metres (north_m, east_m, or northing,
easting), in degrees (lat, lon), or both. Depths are depth_m, positive down, or elevation_m, positive up; units may be
in brackets. A column of units, such as depth_unit, counts for depths whose name has none.
"""

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.input_bounds import MAX_SOUNDINGS, MAX_TEXT_BYTES, over_size
from auv_lse_common.support.plurals import counted, listed
from auv_lse_common.support.text import decoded
from auv_lse_gp.no_data import fill_values, is_no_data
from auv_lse_gp.tables.units import is_unit_name, stated_units, unit_column

#: Accepted column names, in lower case.
_NORTH = ("north_m", "n_m", "y_m", "northing_m", "northing")
_EAST = ("east_m", "e_m", "x_m", "easting_m", "easting")
_LAT = ("lat", "latitude", "lat_deg", "latitude_deg")
_LON = ("lon", "lng", "longitude", "lon_deg", "longitude_deg")
_DEPTH = ("depth_m", "depth")
_ELEVATION = ("elevation_m", "elevation", "z_m")

#: Their units in brackets.
_BRACKETS = re.compile(r"(.*?)[ _]*[(\[](m|met(?:er|re)s?|deg|degrees?|°)[)\]]")
#: Keys of columns whose fields may be empty.
_UNCERTAINTIES = ("north_std", "east_std", "tvu")

#: Columns of hemispheres, which are not read: without them, a survey in the south would lie in the north.
_HEMISPHERES = ("n/s", "e/w", "ns", "ew", "lat_dir", "lon_dir", "lat_hemisphere", "lon_hemisphere")

#: A depth of the water, beside which another one is that of a vehicle under water.
_WATER_DEPTH = re.compile(r"(bottom|water|total)[\W_]*depth([\W_].*)?")

#: Columns of this project's own tables for other programs.
_OF_EXPORT = ("thu_m", "s44_order", "latitude_deg", "longitude_deg", "time_s", "")

#: The most columns that are listed as not used.
_MOST_LISTED = 8

_NEEDED_COLUMNS = (
    "east_m,north_m,depth_m (or easting, northing) or lat,lon,depth_m (elevation_m instead of depth_m for values that "
    "are positive up)"
)


class SoundingsError(ValueError):
    """An unusable file of soundings; names the file, the line or array, and what was expected."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SoundingsTable:
    """The columns of a table of soundings; depths are converted to metres. All arrays have shape (n,).

    Attributes:
        lines: Line number of each sounding.
        depth_name: Name of the column of depths or elevations.
        upward: Whether the values are elevations, positive up.
        values: Depths or elevations (m).
        north_m, east_m: Positions (m), if the table has them.
        lat_deg, lon_deg: Positions (WGS84), if the table has them.
        time_s: Times (s), if the table has them.
        vehicles: Which vehicle took each sounding, if the table has a column `vehicle`.
        position_std_m: Standard deviations of the positions north and east (m), (n, 2), NaN where a field is empty, if
            the table has north_std_m and east_std_m.
        tvu_m: Total vertical uncertainty at 95 % (m), NaN where a field is empty, if the table has it.
        unused: Names of columns that are not read, without those that this project writes for others.
    """

    path: Path
    lines: Ints
    depth_name: str
    upward: bool
    values: Array
    north_m: Array | None
    east_m: Array | None
    lat_deg: Array | None
    lon_deg: Array | None
    time_s: Array | None = None
    vehicles: NDArray[np.str_] | None = None
    position_std_m: Array | None = None
    tvu_m: Array | None = None
    unused: tuple[str, ...] = ()

    @property
    def unused_note(self) -> str:
        """The columns that are not read, in words; "" without any."""
        names = listed([name[:40] for name in self.unused], _MOST_LISTED)
        return f"columns not used: {names}" if names else ""


def read_table(path: Path) -> SoundingsTable:
    """Reads a table of soundings.

    Raises:
        OSError: if the file cannot be read.
        SoundingsError: naming the file, the line, what was found and what was expected.
    """
    if too_large := over_size(path, MAX_TEXT_BYTES):
        raise SoundingsError(f"{too_large}. Thin the soundings out, or grid them (.npz, .asc, .tif)")
    return _parse_table(path, decoded(path.read_bytes()))


def _parse_table(path: Path, text: str) -> SoundingsTable:
    rows = [(i, s) for i, s in enumerate(text.splitlines(), 1) if s.strip() and not s.lstrip().startswith("#")]
    if len(rows) < 2:
        raise SoundingsError(
            f"{path} has {counted(len(rows), 'line')}; write a header such as east_m,north_m,depth_m, then the "
            "soundings"
        )
    if len(rows) - 1 > MAX_SOUNDINGS:
        raise SoundingsError(
            f"{path} has {len(rows) - 1:,} soundings, more than {MAX_SOUNDINGS:,}. Thin them out, or grid them "
            "(.npz, .asc, .tif)"
        )
    header_line, header_text = rows[0]
    separator = next((c for c in ",;\t" if c in header_text), None)
    header = [_plain(name) for name in _fields(header_text, separator, f"{path}:{header_line}")]
    indices = _columns(header, f"{path}:{header_line}")
    values: dict[str, list[float]] = {key: [] for key in indices}
    texts: dict[int, list[str]] = {i: [] for i, name in enumerate(header) if name == "vehicle" or is_unit_name(name)}
    for number, line in rows[1:]:
        fields = _fields(line, separator, f"{path}:{number}")
        if len(fields) != len(header):
            raise SoundingsError(
                f"{path}:{number}: {counted(len(fields), 'field')} {line.strip()[:60]!r}, but the header "
                f"has {len(header)}"
            )
        for key, index in indices.items():
            field = fields[index] if separator == "," else fields[index].replace(",", ".")
            values[key].append(_number(field, key, f"{path}:{number}: {header[index]}"))
        for index, found in texts.items():
            found.append(fields[index])
    arrays = {key: np.array(found) for key, found in values.items()}
    lines = np.array([number for number, _ in rows[1:]], dtype=np.int64)
    depth_name = header[indices["depth"]]
    upward = depth_name not in _DEPTH
    _check_marks(arrays["depth"], lines, f"{path}:", depth_name)
    unit_m, by_column = _stated_units(path, header, indices, texts, lines)
    arrays["depth"] *= unit_m
    vehicle = [i for i in texts if header[i] == "vehicle"][:1]
    used = {*indices.values(), *by_column, *vehicle}
    stds = [arrays[key] for key in ("north_std", "east_std") if key in arrays]
    return SoundingsTable(
        path=path,
        lines=lines,
        depth_name=depth_name,
        upward=upward,
        values=arrays["depth"],
        north_m=arrays.get("north"),
        east_m=arrays.get("east"),
        lat_deg=arrays.get("lat"),
        lon_deg=arrays.get("lon"),
        time_s=arrays.get("time"),
        vehicles=np.array(texts[vehicle[0]]) if vehicle else None,
        position_std_m=np.column_stack(stds) if stds else None,
        tvu_m=arrays.get("tvu"),
        unused=tuple(n for i, n in enumerate(header) if n not in _OF_EXPORT and i not in used),
    )


def _plain(name: str) -> str:
    """A column's name in lower case; "Depth (m)" is depth_m."""
    name = name.lower()
    match = _BRACKETS.fullmatch(name)
    plain = f"{match[1].replace(' ', '_')}_{'m' if match[2][0] == 'm' else 'deg'}" if match else name
    return plain if plain in _NORTH + _EAST + _LAT + _LON + _DEPTH + _ELEVATION else name


def _stated_units(
    path: Path, header: list[str], indices: dict[str, int], texts: dict[int, list[str]], lines: Ints
) -> tuple[Array | float, list[int]]:
    """Metres per unit of each depth (n,), or of all of them, and the number of the column that states them, if any."""
    names = {i: header[i] for i in texts if is_unit_name(header[i])}
    depth, without_unit = indices["depth"], {i for key, i in indices.items() if key != "depth"}
    column = None if header[depth].endswith("_m") else unit_column(names, depth, without_unit)
    stated = None if column is None else stated_units(texts[column.number], column)
    if column is None or stated is None:
        return 1.0, []
    name, cells = header[column.number], texts[column.number]
    cure = "Convert the depths to metres, and name their column depth_m"
    for i in np.flatnonzero(np.isnan(stated))[:1]:
        why = f"{cells[i][:20]!r}, which is no unit of depths" if cells[i] else "empty, but not on every line"
        raise SoundingsError(f"{path}:{lines[i]}: {name} is {why}. {cure}")
    for i in np.flatnonzero(stated != 1.0)[: not column.is_clear]:
        what = f"the column {name}, with {cells[i][:20]!r}, may state the unit of another column than {header[depth]}"
        raise SoundingsError(f"{path}: {what}. {cure}")
    return stated, [column.number]


def _check_marks(values: Array, lines: Ints, where: str, name: str) -> None:
    """Raises SoundingsError if some values (n,) of a table mark missing data."""
    is_marked = is_no_data(values)
    marks = np.flatnonzero(is_marked | np.isin(values, fill_values(values[~is_marked])))
    if len(marks):
        raise SoundingsError(
            f"{where}{lines[marks[0]]}: {name} is {values[marks[0]]:g}, as on {len(marks):,} of "
            f"{counted(len(lines), 'line')}: a common mark for missing data. Remove these lines"
        )


def _columns(header: list[str], where: str) -> dict[str, int]:
    """Numbers of the columns of positions, depths or elevations, times, and uncertainties."""

    def column(names: tuple[str, ...]) -> int | None:
        return next((header.index(name) for name in names if name in header), None)

    wanted = {"north": column(_NORTH), "east": column(_EAST), "lat": column(_LAT), "lon": column(_LON)}
    wanted |= {"north_std": column(("north_std_m",)), "east_std": column(("east_std_m",)), "tvu": column(("tvu_m",))}
    for a, b in (("north", "east"), ("lat", "lon"), ("north_std", "east_std")):
        if wanted[a] is None or wanted[b] is None:
            del wanted[a], wanted[b]
    depth = column(_DEPTH)
    wanted |= {"depth": column(_ELEVATION) if depth is None else depth, "time": column(("time_s",))}
    sides = [name for name in header if name in _HEMISPHERES]
    if sides and "lat" in wanted:
        raise SoundingsError(
            f"{where}: the column {sides[0]} is not read. Write degrees south and west as negative numbers, and "
            "remove it"
        )
    waters = [name for name in header if _WATER_DEPTH.fullmatch(name)]
    if waters and depth is not None:
        raise SoundingsError(
            f"{where}: {header[depth]} and {waters[0]} are two depths, and the first may be that of a vehicle under "
            "water. Remove one, and call the other depth_m"
        )
    indices = {key: index for key, index in wanted.items() if index is not None}
    if "depth" not in indices or not {"north", "lat"} & set(indices):
        shown = ", ".join(name[:40] for name in header[:30])
        raise SoundingsError(
            f"{where}: the columns {shown} are not enough; needed are {_NEEDED_COLUMNS}. auv_lse import makes such a "
            "table of many others"
        )
    return indices


def _fields(line: str, separator: str | None, where: str) -> list[str]:
    """The fields of a line; separator None: any blanks."""
    if separator is None:
        return line.split()
    try:
        return [f.strip() for f in next(csv.reader([line], delimiter=separator))]
    except csv.Error as error:  # a field longer than csv.field_size_limit()
        raise SoundingsError(
            f"{where}: {line[:60]!r}... cannot be read as numbers ({error}). Check the line"
        ) from error


def _number(text: str, key: str, where: str) -> float:
    if key in _UNCERTAINTIES:
        return _uncertainty(text, where)
    try:
        value = math.nan if "_" in text else float(text)  # Python reads 1_000
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise SoundingsError(f"{where} is {text[:40]!r}. Write a finite number.")
    if (key == "lat" and abs(value) > 90.0) or (key == "lon" and abs(value) > 360.0):
        raise SoundingsError(f"{where} is {value:g}, which is not in degrees")
    return value


def _uncertainty(text: str, where: str) -> float:
    """An uncertainty of at least 0; NaN if it is empty: unknown."""
    try:
        value = float(text or math.nan)
    except ValueError:
        value = -1.0
    if value < 0.0 or math.isinf(value):
        raise SoundingsError(f"{where} is {text[:40]!r}. Write a number of at least 0, or nothing.")
    return value
