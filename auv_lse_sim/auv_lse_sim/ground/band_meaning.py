"""What a file states about a raster's values: depths, elevations or another quantity, and their unit."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from auv_lse_gp.tables.units import METRES
from auv_lse_sim.ground.ground import GroundError

_DOWN = re.compile(r"\b(depths?|soundings?|fathoms?)\b")
_UP = re.compile(r"\b(elevations?|altitudes?|heights?|dem|dtm|dsm|topo|topography)\b")
#: Quantities beside depths in bathymetry files, also of depths; and others, unless depths are named with them.
_OTHER = re.compile(
    r"\b(uncertainty|std|stddev|deviation|error|tvu|thu|quality|tid|count|density|hits|intensity|backscatter|slope"
    r"|aspect|hillshade|shade|curvature|roughness|rugosity|mask|flag|time)\b"
)
_BESIDE = re.compile(
    r"\b(temperature|salinity|turbidity|chlorophyll|oxygen|pressure|speed|velocity|percent|percentage|fraction|share"
    r"|ratio|probability)\b"
)
#: Names that programs give to bands.
_NUMBERED = re.compile(r"(?:band|layer)[\W_]*\d+", re.IGNORECASE)
#: Quantities after which files are named, and no lakes.
_OF_FILES = re.compile(
    r"\b(uncertainty|backscatter|hillshade|rugosity|temperature|salinity|turbidity|chlorophyll|oxygen|pressure|speed"
    r"|velocity|percent|percentage|probability)\b"
)


@dataclass(frozen=True)
class Meaning:
    """What a raster's values are.

    Attributes:
        up: Whether they are elevations; None if nothing states it.
        unit_m: Metres per unit.
        notes: How the values were read, for `describe`.
        is_undescribed: Whether neither a name nor a unit nor a scale describes them.
        has_unit: Whether their unit is stated; otherwise they are taken as metres.
    """

    up: bool | None = None
    unit_m: float = 1.0
    name: str = "values"
    is_undescribed: bool = True
    has_unit: bool = False
    notes: tuple[str, ...] = ()


def is_elevation(text: str) -> bool | None:
    """Whether a name means elevations (True) or depths (False); None if it means neither, or both."""
    plain = _words(text)
    down, up = _DOWN.search(plain) is not None, _UP.search(plain) is not None
    return None if down == up else up


def is_other(text: str) -> bool:
    """Whether a band's name means another quantity than depth or elevation."""
    plain = _words(text)
    return _OTHER.search(plain) is not None or (_BESIDE.search(plain) is not None and is_elevation(text) is None)


def is_other_file(name: str) -> bool:
    """Whether a file is named after another quantity than depth or elevation."""
    return _OF_FILES.search(_words(name)) is not None and "bathy" not in name.lower()


def _words(text: str) -> str:
    """The words of a name in small letters, with blanks between them, also of one in camel case."""
    return re.sub(r"[\W_]+|(?<=[a-z])(?=[A-Z])|(?<=[^\W\d_])(?=\d)", " ", text).lower()


def is_bare(name: str) -> bool:
    """Whether a name is just a word for depth or elevation, such as `depth` but not `depth_min`."""
    return any(pattern.fullmatch(name.lower()) for pattern in (_DOWN, _UP))


def _unit_in(text: str) -> str:
    """The unit at the end of a name, such as depth_ft; "" without one. A unit after a number is a resolution's."""
    found = [word for word in re.split(r"[\W_]+", text.lower()) if word]
    is_unit = len(found) > 1 and found[-1] in METRES and found[-1] != "in" and not found[-2][-1].isdigit()
    return found[-1] if is_unit else ""


def length_m(unit: str) -> float | None:
    """Metres per unit; None if it is not a unit of length."""
    return METRES.get(unit.strip().lower())


def metres_per(unit: str, where: str) -> float:
    """Metres per unit; 1 without a unit.

    Raises:
        GroundError: if it is not a unit of length.
    """
    unit_m = length_m(unit)
    if unit.strip() and unit_m is None:
        raise GroundError(f"{where}: its unit is {unit!r}, which is not a length. Convert it to metres (gdal_calc.py)")
    return unit_m or 1.0


def meaning(
    texts: Mapping[str, str], unit: str, vertical: tuple[bool, float] | None, file_name: str, where: str
) -> Meaning:
    """The meaning of a raster's values; the statement closest to the values takes precedence.

    Args:
        texts: Name, description and attributes of the band; `positive` is CF's "up" or "down".
        unit: The band's unit, "" if it has none.
        vertical: Whether the vertical axis of the file's CRS points up, and its metres per unit; None if it has none.
        file_name: The file's name without its suffix.

    Raises:
        GroundError: if the unit is not a length.
    """
    positive = texts.get("positive", "").strip().lower()
    said: list[bool | None] = [{"up": True, "down": False}.get(positive)]
    said += [is_elevation(texts.get(key, "")) for key in ("description", "standard_name", "long_name", "name", "unit")]
    said += [False if unit.lower().startswith("fathom") else None, None if vertical is None else vertical[0]]
    said += [is_elevation(file_name)]
    in_names = [_unit_in(texts.get(key, "")) for key in ("description", "long_name", "name")]
    in_names += [_unit_in(file_name)] if vertical is None else []
    named = unit or next(filter(None, in_names), "")
    unit_m = metres_per(named, where) if named or vertical is None else vertical[1]
    names = [texts.get(key, "") for key in ("description", "name", "long_name")]
    name = next((one for one in names if one and not _NUMBERED.fullmatch(one)), "values")
    up = next((one for one in said if one is not None), None)
    is_undescribed = up is None and not unit and name == "values"
    has_unit = bool(named) or vertical is not None
    return Meaning(up=up, unit_m=unit_m, name=name, is_undescribed=is_undescribed, has_unit=has_unit)
