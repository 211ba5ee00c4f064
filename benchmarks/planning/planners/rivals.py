"""Public planners for level sets, one class each; parameters as their authors recommend.

All choose locations; our steering flies to them, and soundings on the way count. None knows travel costs except
`TruncatedVarianceReduction`, whose authors divide by a cost.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.planning.planners.interface import Planner, View

Array = NDArray[np.float64]

#: Most cells at which the joint covariance of truncated variance reduction is computed.
MAX_CELLS = 700


def _moments(view: View) -> tuple[Array, Array]:
    """Mean and standard deviation at the cells, with the mates' planned locations as measured."""
    planned = np.concatenate([np.empty((0, 2)), *view.mates_m])
    posterior = view.posterior.with_planned(planned) if len(planned) else view.posterior
    mean, variance = posterior.moments(view.cells_m)
    return mean, np.sqrt(variance)


class Straddle:
    """Bryan et al. 2006, Active learning for identifying function threshold boundaries: 1.96 s - |m - l|."""

    replan_legs: int | None = None

    def path(self, view: View) -> Array:
        """The location of the largest score."""
        mean, std = _moments(view)
        return view.cells_m[[int(np.argmax(self.width(view) * std - np.abs(mean - view.level_m)))]]

    def width(self, view: View) -> float:
        """Factor on the standard deviation."""
        return 1.96


class RandomizedStraddle(Straddle):
    """Inatsu et al. 2024, Active learning for level set estimation using randomized straddle algorithms.

    The squared factor is drawn from a chi-squared distribution with two degrees of freedom at each choice.
    """

    def width(self, view: View) -> float:
        """A random factor."""
        return math.sqrt(float(view.rng.chisquare(2.0)))


class LevelSetUcb(Straddle):
    """Gotovos et al. 2013, Active learning for level set estimation: the most ambiguous location, with GP-UCB's factor.

    beta = 2 log(n pi^2 t^2 / 6 d), d = 0.1, for n cells at the t-th choice.
    """

    def __init__(self) -> None:
        self._choices = 0

    def width(self, view: View) -> float:
        """The factor of the next choice."""
        self._choices += 1
        return math.sqrt(2.0 * math.log(len(view.cells_m) * (math.pi * self._choices) ** 2 / (6.0 * 0.1)))


class TruncatedVarianceReduction:
    """Bogunovic et al. 2016, Truncated variance reduction: beta^(1/2) = 3, r = 0.1, the cost is the distance."""

    replan_legs: int | None = None

    def __init__(self) -> None:
        self._eta_m = 0.0

    def path(self, view: View) -> Array:
        """The location whose sounding reduces the truncated variance of undecided cells most per metre."""
        self._eta_m = self._eta_m or view.prior.signal_std_m
        every = max(1, math.ceil(len(view.cells_m) / MAX_CELLS))
        cells = view.cells_m[::every]
        planned = np.concatenate([np.empty((0, 2)), *view.mates_m])
        at = view.posterior.with_planned(planned).at(cells)
        kernel = view.posterior.kernel
        covariance = kernel.of_scaled(at.scaled, at.scaled) - at.white @ at.white.T
        variance = np.maximum(np.diag(covariance), 1e-9)
        undecided = np.abs(at.mean_m - view.level_m) <= 3.0 * np.sqrt(variance)
        if not undecided.any():
            undecided[:] = True
        while 3.0 * np.sqrt(variance[undecided].max()) <= 1.1 * self._eta_m and self._eta_m > 0.05:
            self._eta_m *= 0.5
        floor = (self._eta_m / 3.0) ** 2
        after = variance[undecided] - covariance[:, undecided] ** 2 / (variance + view.prior.noise_std_m**2)[:, None]
        gain = (np.maximum(variance[undecided], floor) - np.maximum(after, floor)).sum(axis=1)
        cost_m = np.hypot(*(cells - view.position_m).T) + view.leg_m
        return cells[[int(np.argmax(gain / cost_m))]]


#: Rivals by name.
RIVALS: dict[str, Callable[[], Planner]] = {
    "straddle": Straddle,
    "randomized_straddle": RandomizedStraddle,
    "level_set_ucb": LevelSetUcb,
    "truvar": TruncatedVarianceReduction,
}
