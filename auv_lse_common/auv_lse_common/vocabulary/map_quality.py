"""The quality of a vehicle's map: how much of the isobath it has found, and how well."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """The quality of a map.

    Attributes:
        stamp_s: Time (s) at which it was judged.
        revision: Revision of the map that was judged.
        found_share: Length of isobath found / (that length + expected length undiscovered); 0 without any.
        undiscovered_m: 95 % upper limit of the length undiscovered (m).
        deviation_m: Distance (m) within which 95 % of the line found is expected; NaN if none is found.
    """

    stamp_s: float = -math.inf
    revision: int = 0
    found_share: float
    undiscovered_m: float
    deviation_m: float


#: No map was judged yet.
UNKNOWN = Quality(found_share=math.nan, undiscovered_m=math.nan, deviation_m=math.nan)
