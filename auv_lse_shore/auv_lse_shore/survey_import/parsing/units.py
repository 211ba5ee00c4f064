"""Units of a table's columns, as their headers state them."""

import math
from collections.abc import Mapping
from typing import Any

from auv_lse_gp.length_units import is_unit_name, is_unstated, stated_m
from auv_lse_shore.survey_import.log_content import LogContent

#: Seconds per unit of time.
TIME_UNITS = {
    "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0,
    "minutes": 60.0, "h": 3600.0, "hours": 3600.0,
}  # fmt: skip
#: Degrees per unit of an angle. Grad are degrees in German, and gon in English: they are in `OTHER_UNITS`.
ANGLE_UNITS = {
    "rad": 57.29577951308232, "radians": 57.29577951308232, "gon": 0.9, "gons": 0.9, "gradian": 0.9, "gradians": 0.9,
}  # fmt: skip
#: What else stands where a unit is expected.
OTHER_UNITS = ("deg", "degrees", "grad", "°", "dd", "decimaldegrees", "utc", "gmt", "z", "local", "%", "percent",
               "wgs84", "e7", "dege7", "ddmm", "dddmm")  # fmt: skip


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
        unit = next((str(value).strip() for key, value in beside.items() if is_unit_name(key) and value), "")
        if is_unstated(unit):
            return 1.0
        factor = self._factors.setdefault(unit, stated_m(unit))
        self.unclear += math.isnan(factor)
        return factor

    def report(self, content: LogContent) -> None:
        """Adds to a log's content which units count, and how many depths are left out."""
        known = sorted(unit for unit, factor in self._factors.items() if not math.isnan(factor))
        content.notes += [f"depths in {unit[:20]}, {self._factors[unit]:g} m" for unit in known]
        content.left_out["depths in a unit that is not understood"] += self.unclear
