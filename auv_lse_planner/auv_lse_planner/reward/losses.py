"""The losses that a map's reward sums: the loss of each cell as a function of the depth's variance left there.

`RiskLoss` is the paper's Bayes risk (the goal `chart`), `line.LineLoss` the isobath's unlocated length (the goal
`line`). Both telescope, so budget and bound of `methods/tour.py` hold for both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from auv_lse_common.mission_file.sections.level_set import LevelSetConfig
from auv_lse_common.support.arrays import Array, Ints
from auv_lse_gp.inference.cached_points import CachedPoints
from auv_lse_gp.level_set.bayes_risk import LevelSet


class Losses(Protocol):
    """Losses of M cells as functions of the variance left.

    Attributes:
        before: Expected losses before the first leg, (M,).
        largest: Largest possible loss of a cell, to which negligible ones are compared.
    """

    @property
    def before(self) -> Array: ...  # noqa: D102

    @property
    def largest(self) -> float: ...  # noqa: D102

    def take(self, kept: Ints) -> Losses:
        """The losses of some cells."""
        ...

    def sums(self, left_m2: Array) -> Array:
        """Sums (J,) over the cells of the losses at remaining variances (J, M)."""
        ...

    def sums_and_slopes(self, left_m2: Array) -> tuple[Array, Array]:
        """`sums`, and the derivatives (J, M) by the remaining variances."""
        ...


class Loss(Protocol):
    """A kind of loss; `inflates`: whether standard deviations may be inflated (`std_inflation.py`)."""

    inflates: bool

    def of(self, points: CachedPoints, scale: float = 1.0, inflation: float = 1.0) -> Losses:
        """The losses at locations, each of which stands for `scale` cells of the map; not multiplied by it."""
        ...


@dataclass(frozen=True, slots=True)
class RiskLosses:
    """Expected Bayes risk of cells; the expected risk is always the exact one.

    Attributes:
        mean_m: Means (M,); their distance from the level is divided by the inflation.
        variance_m2: Variance given the data (M,).
    """

    level_set: LevelSet
    mean_m: Array
    variance_m2: Array
    before: Array

    @property
    def largest(self) -> float:
        """The largest possible risk."""
        return self.level_set.largest_risk

    def take(self, kept: Ints) -> RiskLosses:
        """The losses of some cells."""
        return RiskLosses(self.level_set, self.mean_m[kept], self.variance_m2[kept], np.asarray(self.before[kept]))

    def sums(self, left_m2: Array) -> Array:
        """See `Losses`."""
        return self.level_set.risk_sums(self.mean_m, self.variance_m2, left_m2)

    def sums_and_slopes(self, left_m2: Array) -> tuple[Array, Array]:
        """See `Losses`."""
        return self.level_set.risk_sums_and_slopes(self.mean_m, self.variance_m2, left_m2)


class RiskLoss:
    """The Bayes risk of a level set."""

    inflates = True

    def __init__(self, level_set: LevelSetConfig) -> None:
        self._level_set = replace(LevelSet.of(level_set), method="exact")

    def of(self, points: CachedPoints, scale: float = 1.0, inflation: float = 1.0) -> RiskLosses:
        """See `Loss`."""
        now, level_set = points.current(), self._level_set
        after = np.minimum(now.planned_var_m2, now.data_var_m2)
        mean = now.mean_m
        if inflation != 1.0:  # the risk depends on (mean - level) / standard deviation alone
            mean = level_set.level_m + (now.mean_m - level_set.level_m) / inflation
        risk = level_set.expected_risk(mean, np.sqrt(now.data_var_m2 - after), np.sqrt(after))
        return RiskLosses(level_set, mean, now.data_var_m2, np.asarray(risk))
