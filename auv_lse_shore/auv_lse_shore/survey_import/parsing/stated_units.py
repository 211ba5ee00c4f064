"""The units that logs state beside their depths."""

import math
from collections.abc import Mapping
from typing import Any

from auv_lse_gp.tables.units import is_unit_name, is_unstated, stated_m
from auv_lse_shore.survey_import.log_content import LogContent


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
