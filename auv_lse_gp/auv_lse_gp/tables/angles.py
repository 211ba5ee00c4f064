"""Latitudes and longitudes in the notations of tables: hemispheres, minutes, and other units than degrees."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from auv_lse_common.support.arrays import Array
from auv_lse_gp.tables.column_names import Column
from auv_lse_gp.tables.table_error import TableError
from auv_lse_gp.tables.units import ANGLE_UNITS, factor_of

_ANGLE = re.compile(r"\s*([NSEWO])?\s*([+-]?\d+(?:\.\d*)?)(?:-(?=\d)|[°º d:]*)\s*"
                    r"(?:(\d+(?:\.\d*)?)(?:-(?=\d)|['′ m:]*))?\s*"
                    r"(?:(\d+(?:\.\d*)?)((?:[\"″'′ ]|s(?=\s*[NSEWO]\s*$))*))?\s*([NSEWO])?\s*$",
                    re.IGNORECASE)  # fmt: skip
#: Units of 1e-7 degrees, of degrees and minutes in one number, and of unsigned degrees south or west.
_E7 = re.compile(r"(deg)?\W*1?e-?7")
PACKED = re.compile(r"d{1,3}mm?\b.*")
_NEGATIVE = re.compile(r"(°|º|deg|degrees|dd)?[ .]?(s|south|w|west)")
#: Parts of the names of units of degrees, and of geodetic datums.
_DEGREES = re.compile(r"deg|dms|grad\b|°|º|d{2}|wgs|etrs|nad|epsg|gcs|dec|\b(n|s|e|w|north|south|east|west)\b")
#: Share of the positions that shows what all of them are.
_MOST = 0.9


def angle(text: str, path: Path) -> float:
    """Degrees of a text such as N 46 30.5 or 46°30'12"S; NaN for another.

    Raises:
        TableError: if the hemisphere is not clear.
    """
    match = _ANGLE.match(text)
    if not match:
        return float("nan")
    before, degrees, minutes, rest, mark, after = match.groups()
    if max(float(minutes or 0.0), float(rest or 0.0)) > 60.0:
        return float("nan")
    if rest and "s" not in mark.lower() and ("m" if after == "s" else "M" if after == "S" else "?") in text:
        after = None  # of seconds, as in 33d51m12s
    value = abs(float(degrees)) + float(minutes or 0.0) / 60.0 + float(rest or 0.0) / 3600.0
    return -value if degrees.startswith("-") else value * _side(before or after or "", repr(text.strip()), path)


def _side(letter: str, where: str, path: Path) -> float:
    """-1 for S and W, 1 for others."""
    if letter.upper() == "O":
        raise TableError(f"{path}: the O in {where} is east in German and west in French and Spanish. Write E or W.")
    return -1.0 if letter.upper() in ("S", "W") else 1.0


def degrees_of(columns: Mapping[str, Column], values: Mapping[str, Any], path: Path, notes: list[str]) -> Array:
    """Latitude and longitude (deg), shape (n, 2), of a table's columns; their notation goes into `notes`.

    Raises:
        TableError: if no position can be in degrees, or a hemisphere is not clear.
    """
    names = ("lat", "lon")
    units = [columns[name].unit for name in names]
    factors = [1e-7 if _E7.fullmatch(unit) else factor_of(unit, ANGLE_UNITS) or 1.0 for unit in units]
    positions = np.column_stack([values[name] for name in names]) * factors
    notes += [
        f"column {columns[name].name} taken as degrees: the unit {unit!r} is not understood"
        for name, unit, factor in zip(names, units, factors, strict=True)
        if factor == 1.0 and unit.strip("- ") and not _DEGREES.search(unit)
    ]
    are_whole = (np.nan_to_num(positions) % 1.0 == 0.0).all()
    for number, name in enumerate(names):
        minutes, degrees = values.get(f"{name}_min"), positions[:, number]
        if are_whole and minutes is None and f"{names[1 - number]}_min" in values:
            raise TableError(
                f"{path}: column {columns[name].name} has whole degrees, and there is no column of its minutes. Add it "
                f"as {name}_min."
            )
        # beside a whole position they are a part of it
        if minutes is not None and np.array_equal(degrees, np.trunc(degrees), equal_nan=True):
            seconds = values.get(f"{name}_sec", 0.0)
            minutes, seconds = (np.where((part >= 0.0) & (part <= 60.0), part, np.nan) for part in (minutes, seconds))
            minutes = minutes + seconds / 60.0
            positions[:, number] = degrees + np.copysign(minutes / 60.0, degrees)
    known = np.abs(positions[np.isfinite(positions).all(axis=1) & (positions != 0.0).any(axis=1)])
    are_degrees = (known <= (90.0, 180.0)).all()  # also below a header of minutes: angle() has read their cells
    if (any(map(PACKED.fullmatch, units)) and not are_degrees) or _look_packed(known):
        whole = np.trunc(positions / 100.0)
        minutes = positions - 100.0 * whole
        positions = np.where(np.abs(minutes) < 60.0, whole + minutes / 60.0, np.nan)
        notes.append("positions as degrees and minutes (4630.0000)")
    elif len(known) and (over := (known > (90.0, 360.0))).any(axis=1).all():
        number = 0 if over[:, 0].any() else 1
        value = values[names[number]][np.isfinite(values[names[number]])][0]
        raise TableError(
            f"{path}: {('latitudes', 'longitudes')[number]} such as {value:.10g} are no degrees. Name the columns "
            "(auv_lse import: with --columns) lon,lat if they are swapped, lat_e7,lon_e7 for 1e-7 degrees, east,north "
            "for metres."
        )
    for number, name in enumerate(names):
        if _NEGATIVE.fullmatch(units[number]) and not (positions[:, number] < 0.0).any():
            positions[:, number] *= -1.0
            notes.append(f"column {columns[name].name} negated")
    return _hemispheres(columns, values, path, positions)


def _look_packed(known: Array) -> bool:
    """Whether latitude and longitude (n, 2) can be degrees and minutes in one number, and not degrees."""
    if not len(known):
        return False
    can_be = (known <= (9000.0, 18_000.0)).all(axis=1) & (known % 100.0 < 60.0).all(axis=1)
    return bool(can_be.mean() > _MOST and (known > (90.0, 360.0)).any(axis=1).mean() > _MOST)


def _hemispheres(columns: Mapping[str, Column], values: Mapping[str, Any], path: Path, positions: Array) -> Array:
    """Degrees (n, 2) with the signs that columns of hemispheres give them.

    Raises:
        TableError: if a hemisphere is not clear.
    """
    for number, name in enumerate(("lat", "lon")):
        sides = values.get(f"{name}_side")
        if sides is None:
            continue
        letters = np.char.upper(np.char.strip(sides).astype("U1"))
        for letter in np.unique(letters[np.isin(letters, ("N", "S", "E", "W", "O"))]).tolist():
            rows = letters == letter
            sign = _side(letter, f"column {columns[f'{name}_side'].name}", path)
            positions[rows, number] = sign * np.abs(positions[rows, number])
    return positions
