"""Means over seeds with their confidence intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtrit


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A mean and its 95 % confidence interval (Student's t); NaN limits for fewer than two values.

    Attributes:
        mean: The mean; NaN without values.
        low: Lower limit.
        high: Upper limit.
        count: Number of values.
    """

    mean: float
    low: float
    high: float
    count: int

    @property
    def half(self) -> float:
        """Half the width."""
        return (self.high - self.low) / 2.0

    def __str__(self) -> str:
        """`0.123 ± 0.004`, with as many digits as the interval warrants."""
        if not self.count:
            return "–"
        if not math.isfinite(self.half) or self.half <= 0.0:
            return f"{self.mean:.4g}"
        places = max(0, min(6, 1 - math.floor(math.log10(self.half))))
        return f"{self.mean:.{places}f} ± {self.half:.{places}f}"


def proportion(flags: Sequence[bool | None], confidence: float = 0.95) -> str:
    """Share of the true flags with its Wilson interval: `0.31 (0.14 to 0.56)`; None is left out.

    Student's interval would have no width for 0 of 16, and a negative limit for 1 of 16.
    """
    known = [bool(f) for f in flags if f is not None]
    count = len(known)
    if not count:
        return "–"
    share, z = sum(known) / count, float(ndtri(0.5 + confidence / 2.0))
    middle = (share + z * z / (2.0 * count)) / (1.0 + z * z / count)
    half = z / (1.0 + z * z / count) * math.sqrt(share * (1.0 - share) / count + (z / (2.0 * count)) ** 2)
    return f"{share:.2f} ({max(middle - half, 0.0):.2f} to {min(middle + half, 1.0):.2f})"


def interval(values: Sequence[float | None], confidence: float = 0.95) -> Interval:
    """Mean and confidence interval of values; None and NaN are left out."""
    known = np.array([v for v in values if v is not None and math.isfinite(v)], dtype=float)
    count = len(known)
    if count == 0:
        return Interval(mean=math.nan, low=math.nan, high=math.nan, count=0)
    mean = float(known.mean())
    if count == 1:
        return Interval(mean=mean, low=math.nan, high=math.nan, count=1)
    half = float(stdtrit(count - 1, 0.5 + confidence / 2.0) * known.std(ddof=1) / math.sqrt(count))
    return Interval(mean=mean, low=mean - half, high=mean + half, count=count)


def paired(a: Mapping[int, float | None], b: Mapping[int, float | None]) -> Interval:
    """Mean of a - b over the seeds that both have: seeds share their lakes, so differences vary less than means."""
    pairs = []
    for seed, value in a.items():
        other = b.get(seed)
        if value is not None and other is not None:
            pairs.append(value - other)
    return interval(pairs)
