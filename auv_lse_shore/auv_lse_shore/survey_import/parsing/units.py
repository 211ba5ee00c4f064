"""Units of a table's columns, as their headers state them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from auv_lse_shore.survey_import.log_content import LogContent

#: Metres per unit of length.
UNITS = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "metro": 1.0, "metros": 1.0, "metri": 1.0,
    "mtr": 1.0, "mtrs": 1.0, "mts": 1.0, "ft": 0.3048, "feet": 0.3048, "foot": 0.3048,
    "fathom": 1.8288, "fathoms": 1.8288, "fm": 1.8288, "fms": 1.8288, "fth": 1.8288, "ftm": 1.8288, "cm": 0.01,
    "mm": 0.001, "dm": 0.1, "km": 1000.0, "in": 0.0254, "yd": 0.9144, "yard": 0.9144, "yards": 0.9144,
}  # fmt: skip
#: Seconds per unit of time.
TIME_UNITS = {
    "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0,
    "minutes": 60.0, "h": 3600.0, "hours": 3600.0,
}  # fmt: skip
#: Degrees per unit of an angle.
ANGLE_UNITS = {"rad": 57.29577951308232, "radians": 57.29577951308232}
#: Names of a property or attribute that states the unit of the depth beside it.
_UNIT_KEYS = ("unit", "units", "uom", "depth_unit", "depth_units", "depthunit", "depthunits")
#: What else stands where a unit is expected.
OTHER_UNITS = ("deg", "degrees", "°", "dd", "decimaldegrees", "utc", "gmt", "z", "local", "%", "percent", "wgs84",
               "e7", "dege7", "ddmm", "dddmm")  # fmt: skip
#: Metres of a foot of the United States' land survey.
_SURVEY_FOOT_M = 1200.0 / 3937.0
#: A number that is no part of a name, such as that of "ft/10".
_FREE_NUMBER = re.compile(r"(?<![a-z\d])\d")
#: A unit per another one, such as "ft/s".
_RATE = re.compile(r"[a-z]\s*/\s*(s|sec|min|h|hr)\b")


def factor_of(text: str, units: Mapping[str, float]) -> float:
    """The factor of a unit that a text names among other words, such as "ft MLLW"; 0 if it names none of them."""
    words = re.findall(r"[a-z]+", text.lower())
    found = [word for word in words if word in units]
    if not found or _FREE_NUMBER.search(text.lower()) or _RATE.search(text.lower()):
        return 0.0
    if found == ["in"] != words:  # a preposition
        return 0.0
    factor = units[next((word for word in found if word != "in"), found[0])]  # "in feet"
    return _SURVEY_FOOT_M if factor == UNITS["ft"] and "survey" in text.lower() else factor


class StatedUnits:
    """The units that a log states beside its depths, as properties or attributes.

    Attributes:
        unclear: Number of depths whose unit is not understood.
    """

    def __init__(self) -> None:
        self.unclear = 0
        self._factors: dict[str, float] = {}

    def factor(self, beside: Mapping[str, Any]) -> float:
        """Metres per unit of a depth: 1 if no unit is stated, NaN for one that is not understood."""
        unit = next((str(value).strip() for key, value in beside.items() if key.lower() in _UNIT_KEYS and value), "")
        if not unit.strip("-") or unit.lower() in ("n/a", "na", "nan", "none", "null"):
            return 1.0
        factor = self._factors.setdefault(unit, factor_of(unit, UNITS) or math.nan)
        self.unclear += math.isnan(factor)
        return factor

    def report(self, content: LogContent) -> None:
        """Adds to a log's content which units count, and how many depths are left out."""
        known = sorted(unit for unit, factor in self._factors.items() if not math.isnan(factor))
        content.notes += [f"depths in {unit[:20]}, {self._factors[unit]:g} m" for unit in known]
        content.left_out["depths in a unit that is not understood"] += self.unclear
