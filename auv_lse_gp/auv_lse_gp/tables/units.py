"""Units as files name them, and the column of a table that states the unit of its depths."""

import functools
import math
import re
from collections.abc import Container, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from auv_lse_common.support.arrays import Array

_FOOT_M, _SURVEY_FOOT_M, _FATHOM_M = 0.3048, 1200.0 / 3937.0, 1.8288
#: Metres per unit, by its names in lower case.
METRES = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres", "mètre", "metro", "metros", "metri", "metern", "mtr",
                     "mtrs", "mts"), 1.0),
    **dict.fromkeys(("ft", "feet", "foot", "ft_i", "international foot"), _FOOT_M),
    **dict.fromkeys(("us survey foot", "us_survey_foot", "ussft", "ft_us", "foot_us", "ftus"), _SURVEY_FOOT_M),
    **dict.fromkeys(("fathom", "fathoms", "fm", "fms", "fth", "ftm"), _FATHOM_M),
    **dict.fromkeys(("dm", "decimetre", "decimetres", "decimeter", "decimeters"), 0.1),
    **dict.fromkeys(("cm", "centimetre", "centimetres", "centimeter", "centimeters", "zentimeter",
                     "zentimetern"), 0.01),
    **dict.fromkeys(("mm", "millimetre", "millimetres", "millimeter", "millimeters"), 0.001),
    **dict.fromkeys(("km", "kilometre", "kilometres", "kilometer", "kilometers"), 1000.0),
    **dict.fromkeys(("in", "inch", "inches"), 0.0254),
    "yd": 0.9144, "yard": 0.9144, "yards": 0.9144,
}  # fmt: skip
#: Seconds per unit of time.
TIME_UNITS = {
    "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0,
    "minutes": 60.0, "h": 3600.0, "hours": 3600.0,
}  # fmt: skip
#: Degrees per unit of an angle. Grad are degrees in German, and gon in English: they are in `OTHER_UNITS`.
ANGLE_UNITS = {
    "rad": 57.29577951308232, "radians": 57.29577951308232, "gon": 0.9, "gons": 0.9, "gradian": 0.9, "gradians": 0.9,
}  # fmt: skip
#: Other texts where a unit is expected.
OTHER_UNITS = ("deg", "degrees", "grad", "°", "dd", "decimaldegrees", "utc", "gmt", "z", "local", "%", "percent",
               "wgs84", "e7", "dege7", "ddmm", "dddmm")  # fmt: skip
#: Names, without blanks and signs, of columns and attributes that state the unit of the depth beside them.
UNIT_NAMES = ("depthunit", "depthunits", "depthuom", "unit", "units", "uom")
#: Texts there that state no unit.
_NONE_STATED = ("", "n/a", "na", "nan", "none", "null")
#: A number that is no part of a name, such as that of "ft/10".
_FREE_NUMBER = re.compile(r"(?<![a-z\d])\d")
#: A unit per another one, such as "ft/s".
_RATE = re.compile(r"[a-z]\s*/\s*(s|sec|min|h|hr)\b")


def factor_of(text: str, units: Mapping[str, float] = METRES) -> float:
    """The factor of a unit that a text names among other words, such as "ft MLLW"; 0 if it names none of them."""
    text = text.strip().lower()
    if text in units:
        return units[text]
    words = re.findall(r"[a-z]+", text)
    found = [word for word in words if word in units]
    if not found or _FREE_NUMBER.search(text) or _RATE.search(text):
        return 0.0
    if found == ["in"] != words:  # a preposition
        return 0.0
    factor = units[next((word for word in found if word != "in"), found[0])]  # "in feet"
    return _SURVEY_FOOT_M if factor == _FOOT_M and "survey" in text else factor


def is_unstated(text: str) -> bool:
    """Whether a text where a unit is expected states none."""
    return text.strip().strip("-").lower() in _NONE_STATED


def stated_m(text: str) -> float:
    """Metres per unit that a text beside a depth states: 1 if it states none, NaN if it is not understood."""
    return 1.0 if is_unstated(text) else factor_of(text) or math.nan


@functools.lru_cache(maxsize=256)
def is_unit_name(name: str) -> bool:
    """Whether a column or attribute of this name states the unit of the depth beside it."""
    return re.sub(r"[^a-z\d]", "", name.lower()) in UNIT_NAMES


class UnitColumn(NamedTuple):
    """The column of a table that states the unit of its depths.

    Attributes:
        number: Its number in the table.
        is_named: Whether its name is that of a depth's unit.
        is_clear: Whether it can be of no other column than the depths.
    """

    number: int
    is_named: bool
    is_clear: bool


def unit_column(names: Mapping[int, str], depth: int, without_unit: Container[int]) -> UnitColumn | None:
    """The column of units of a table's depths; None if there is none, or none of several is the depths'.

    Args:
        names: Names of the columns of units, by their numbers.
        depth: Number of the column of depths.
        without_unit: Numbers of columns whose unit needs no column, such as times.
    """
    named = [number for number, name in names.items() if "depth" in name.lower()]
    beside = [number for number in names if number == depth + 1]
    only = [*names] if len(names) == 1 else []
    number = next(iter(named or beside or only), None)
    if number is None:
        return None
    is_clear = bool(named) or number - 1 == depth or number - 1 in without_unit
    return UnitColumn(number=number, is_named=bool(named), is_clear=is_clear)


def stated_units(cells: Sequence[str] | NDArray[np.str_], column: UnitColumn) -> Array | None:
    """Metres per unit of each row (n,), NaN where its cell is not clear; None if the cells are no units of depths.

    An empty cell is one in metres only if no other states another unit. In a column that does not name the depths,
    "in" is a word.
    """
    texts, rows = np.unique(np.char.strip(np.asarray(cells, dtype=np.str_)), return_inverse=True)
    factors = np.array([stated_m(text) for text in texts.tolist()])
    if not column.is_named:
        factors[np.char.lower(texts) == "in"] = np.nan
    silent = np.array([is_unstated(text) for text in texts.tolist()], dtype=bool)
    is_unknown = np.isnan(factors)
    if silent.all() or (is_unknown.any() and not column.is_named and (factors[~is_unknown] == 1.0).all()):
        return None
    if (factors != 1.0).any():
        factors[silent] = np.nan
    stated: Array = factors[rows]
    return stated
