"""Means over seeds, proportions and paired differences, with their confidence intervals."""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from auv_lse_common.support.arrays import Array

#: Keyword of `scipy.stats.bootstrap` for its generator; its name has changed with SciPy 1.15.
_GENERATOR = "rng" if "rng" in inspect.signature(stats.bootstrap).parameters else "random_state"


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A mean and its 95 % confidence interval (Student's t); NaN limits for fewer than two values.

    Attributes:
        mean: The mean; NaN without values.
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
        if not math.isfinite(self.half) or self.half <= 1e-12 * abs(self.mean):
            return f"{self.mean:.4g}"
        decimals = max(0, min(6, 1 - math.floor(math.log10(self.half))))
        return f"{self.mean:.{decimals}f} ± {self.half:.{decimals}f}"


def proportion(flags: Sequence[bool | None]) -> str:
    """Share of the true flags with its 95 % Wilson interval: `0.31 (0.14 to 0.56)`; None is left out.

    Student's interval would have no width for 0 of 16, and a negative limit for 1 of 16.
    """
    known = [bool(f) for f in flags if f is not None]
    if not known:
        return "–"
    limits = stats.binomtest(sum(known), len(known)).proportion_ci(0.95, method="wilson")
    return f"{sum(known) / len(known):.2f} ({limits.low:.2f} to {limits.high:.2f})"


def interval(values: Sequence[float | None]) -> Interval:
    """Mean and 95 % confidence interval of values; None and NaN are left out."""
    known = [v for v in values if v is not None and math.isfinite(v)]
    mean = float(np.mean(known)) if known else math.nan
    low, high = math.nan, math.nan
    if len(known) > 1:
        half = float(stats.t.ppf(0.975, len(known) - 1) * stats.sem(known))
        low, high = mean - half, mean + half
    return Interval(mean=mean, low=low, high=high, count=len(known))


def paired(a: Mapping[int, float | None], b: Mapping[int, float | None]) -> Interval:
    """Mean of a - b over the seeds that both have: seeds share their lakes, so differences vary less than means."""
    pairs = [(value, b.get(seed)) for seed, value in a.items()]
    return interval([x - y for x, y in pairs if x is not None and y is not None])


def bootstrap(
    samples: Sequence[Array], statistic: Callable[..., Array], resamples: int, seed: int = 0
) -> tuple[float, float]:
    """95 % percentile interval of a statistic of paired samples, resampled together.

    Args:
        samples: Arrays of the same length, at least 2.
        statistic: Function of these arrays with the keyword `axis`.
    """
    generator: dict[str, Any] = {_GENERATOR: np.random.default_rng(seed)}
    found = stats.bootstrap(
        samples, statistic, paired=True, vectorized=True, n_resamples=resamples, method="percentile", **generator
    ).confidence_interval
    return float(found.low), float(found.high)
