"""The coordinate system that a table's own columns state: an EPSG code, or a UTM zone with its hemisphere."""

import re
from dataclasses import dataclass

from auv_lse_shore.survey_import.parsing.columns import Table

_EPSG = re.compile(r"(?:EPSG\W*)?(\d{4,6})", re.IGNORECASE)
_ZONE = re.compile(r"(?:UTM\W*)?(\d{1,2})\W*([A-Z]?)", re.IGNORECASE)
_ZONES = range(1, 61)
#: Letters of UTM's bands of 8 degrees, from 80 degrees south on; N is also short for north, S for south.
_BANDS = "CDEFGHJKLMNPQRSTUVWX"
#: Northing (m) of the equator in southern zones, and metres of a band.
_EQUATOR_M, _BAND_M = 1e7, 8 * 111_000.0


@dataclass(frozen=True, slots=True)
class StatedCrs:
    """What a table says of the coordinate system of its metres.

    Attributes:
        crs: The system, such as "EPSG:32633"; "" if it is not stated, or not clearly.
        names: Names of the columns that state it.
        cure: For an error: how to name the system.
    """

    crs: str = ""
    names: str = ""
    cure: str = "Name their system, such as --crs EPSG:32632."


def stated_crs(table: Table, north_m: float) -> StatedCrs:
    """The coordinate system stated by columns; a system that is used is accounted for in the table.

    Args:
        north_m: The table's usual northing.
    """
    for roles in (("epsg",), ("utm_zone", "hemisphere"), ("utm_zone",)):
        if all(role in table.columns for role in roles):
            names = ", ".join(table.columns[role].name for role in roles)
            rows = sorted(set(zip(*(map(str.strip, map(str, table.values[role])) for role in roles), strict=True)))
            rows = [row for row in rows if any(row)]
            found = {_system(north_m, *row) if roles[0] == "utm_zone" else _code(*row) for row in rows}
            if len(found) > 1:
                return StatedCrs("", names, f"They are in several systems (column {names}). Split the table by them.")
            if crs := next(iter(found), ""):
                systems = crs.split(" or ")
                if len(systems) > 1:
                    return StatedCrs(
                        "", names, f"Zone {rows[0][0]} may be north or south: --crs {' or --crs '.join(systems)}."
                    )
                table.accounted.update(roles)
                return StatedCrs(crs, names)
    return StatedCrs()


def _code(text: str) -> str:
    match = _EPSG.fullmatch(text)
    return f"EPSG:{match[1]}" if match else ""


def _system(north_m: float, zone: str, hemisphere: str = "") -> str:
    """The system of a UTM zone (WGS 84), "A or B" if the hemisphere is not clear; "" if it is no zone.

    A number and a letter may also be the name of an area: the letter must be that of the northing's band, or a
    neighbor's.
    """
    match = _ZONE.fullmatch(zone)
    if not match or int(match[1]) not in _ZONES:
        return ""
    letter, side = match[2].upper(), hemisphere[:1].upper()
    north, south = f"EPSG:{32600 + int(match[1])}", f"EPSG:{32700 + int(match[1])}"
    if side in ("N", "S"):
        return north if side == "N" else south
    if letter in ("", "S"):
        return f"{north} or {south}"
    band, middle = _BANDS.find(letter), _BANDS.index("N")
    seen = middle + (north_m if band >= middle else north_m - _EQUATOR_M) / _BAND_M
    if letter != "N" and (band < 0 or not band - 1.0 <= seen < band + 2.0):
        return ""
    return north if band >= middle else south
