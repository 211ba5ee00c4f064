"""The objective of the goal `line`: the expected length of isobath that a path leaves unlocated.

A location of the isobath is *located* if the line's position across itself is known to `MAX_STD_M[FOUND]` = 10 m (one
standard deviation; 95 % within 20 m). With depth known to s (m) on ground of slope g (m per m), that is s / g. The
variance that a path leaves does not depend on the depths it measures, so the Kac-Rice formula gives the expected length
that stays unlocated on the cell p of size A in closed form:

    R_p(s) = A N(l; m, v + b^2) E[|g| 1(|g| < s / 10 m) given f = l]

m, v: mean and variance of the depth on the data; b: spread of the depth inside the cell, |slope| a / sqrt(12) for cells
of side a. R telescopes: its expectation over the data to come is R at the variance that they leave.

Approximation: the slope's two components on f = l get one common standard deviation c, so that |g| has a Rice
distribution with density r / c^2 exp(-(r^2 + n^2) / 2 c^2) I_0(r n / c^2), n the length of the mean slope. The partial
mean is integrated once per decision at `NODES` values of s and interpolated by cubic Hermite polynomials with the exact
derivatives. Tests compare it with contours of draws from the posterior.

`of_estimate` gives R of the *estimated* isobath, the mean's contour: A N(l; m, b^2) in place of the density, the slope
of the mean in place of the expected one, each cell weighted by the share of the prior's variance that the data removed.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from scipy.special import i0e

from auv_lse_common.support.arrays import Array, Ints
from auv_lse_common.support.growing_rows import GrowingRows
from auv_lse_gp.inference.cached_points import CachedPoints, unchanged_rows
from auv_lse_gp.inference.point_posteriors import PointPosteriors
from auv_lse_gp.inference.posterior import prior_slopes
from auv_lse_gp.inference.triangular import solve_lower
from auv_lse_gp.map.certainty import FOUND, MAX_STD_M

#: Intervals of s between 0 and its present value, and points of the Gauss-Legendre rule in each.
NODES, POINTS = 16, 3
#: Least standard deviation of a slope component: smaller ones would make the gradient vanish almost everywhere.
LEAST_SLOPE_STD = 0.02
#: Least standard deviation (m) of a depth at which R's derivative by the variance is computed.
LEAST_STD_M = 1e-3
#: Least variance (m^2) of the mean depth inside a cell.
LEAST_INSIDE_M2 = 1e-10


@dataclass(frozen=True, slots=True)
class LineLosses:
    """R of each of M cells as a function of the variance left: values and derivatives at `NODES` + 1 values of s.

    Attributes:
        before: R at the present variance, (M,).
        step_m: Distance between the nodes of each cell, (M,).
        values: R at the nodes, (M, NODES + 1).
        slopes: Its derivative by s, times `step_m`, (M, NODES + 1).
    """

    before: Array
    step_m: Array
    values: Array
    slopes: Array

    @property
    def largest(self) -> float:
        """Largest possible loss of a cell, to which negligible ones are compared."""
        return float(self.values.max(initial=0.0))

    def take(self, kept: Ints) -> LineLosses:
        """The losses of some cells."""
        return LineLosses(self.before[kept], self.step_m[kept], self.values[kept], self.slopes[kept])

    def sums(self, left_m2: Array) -> Array:
        """Sums (J,) over the cells of R at remaining variances (J, M)."""
        return np.array([float(self._at(np.sqrt(row))[0].sum()) for row in left_m2])

    def sums_and_slopes(self, left_m2: Array) -> tuple[Array, Array]:
        """`sums`, and the derivatives (J, M) by the remaining variances."""
        sums, slopes = np.empty(len(left_m2)), np.empty(left_m2.shape)
        for j, row in enumerate(left_m2):
            std_m = np.sqrt(row)
            values, by_std = self._at(std_m)
            sums[j] = values.sum()
            slopes[j] = 0.5 * by_std / np.maximum(std_m, LEAST_STD_M)
        return sums, slopes

    def _at(self, std_m: Array) -> tuple[Array, Array]:
        """R and its derivative by s at standard deviations (M,)."""
        at = std_m / self.step_m
        node = np.minimum(at.astype(np.int64), NODES - 1)
        t = at - node
        flat = node + np.arange(len(node)) * (NODES + 1)
        low, high = self.values.ravel()[flat], self.values.ravel()[flat + 1]
        by_low, by_high = self.slopes.ravel()[flat], self.slopes.ravel()[flat + 1]
        rise = high - low
        square, cube = 3.0 * rise - 2.0 * by_low - by_high, by_low + by_high - 2.0 * rise
        values = low + t * (by_low + t * (square + t * cube))
        return values, (by_low + t * (2.0 * square + 3.0 * t * cube)) / self.step_m


class LineLoss:
    """Losses of a map's cells for the goal `line`; an inflation would not fit the slope's distribution."""

    inflates = False

    def __init__(self, level_m: float, cell_m: float) -> None:
        """For an isobath at `level_m` and cells of side `cell_m` on the fine grid."""
        self._level_m, self._cell_m, self._estimated = level_m, cell_m, False
        self._slopes: WeakKeyDictionary[CachedPoints, CachedSlopes] = WeakKeyDictionary()

    def of_estimate(self) -> LineLoss:
        """The same for the estimated isobath. Both share what they cache."""
        other = copy.copy(self)
        other._estimated = True
        return other

    def of(self, points: CachedPoints, scale: float = 1.0, inflation: float = 1.0) -> LineLosses:
        """The losses per cell of the fine grid; each of `points` stands for `scale` of them."""
        if points not in self._slopes:
            self._slopes[points] = CachedSlopes(points)
        now = points.current()
        cell_m2 = self._cell_m**2 * scale
        density, mean_slope, slope_std = self._slopes[points].on_level(now, self._level_m, cell_m2, self._estimated)
        after_m2 = np.minimum(now.planned_var_m2, now.data_var_m2)
        step_m = np.maximum(np.sqrt(after_m2), LEAST_STD_M) / NODES
        losses = _tabulated(self._cell_m**2 * density, mean_slope, slope_std, step_m)
        return LineLosses(losses[0][:, -1], step_m, *losses)


class CachedSlopes:
    """Slopes of the posterior at the locations of a `CachedPoints`, updated with it."""

    def __init__(self, points: CachedPoints) -> None:
        self._posterior = points.posterior
        self._scaled = self._posterior.kernel.scale(points.locations_m)
        self._white = [GrowingRows(len(points.locations_m)) for _ in range(2)]
        self._rows = self._posterior.rows[:0]
        self._prior = prior_slopes(self._posterior.prior_mean, points.locations_m)

    def on_level(
        self, now: PointPosteriors, level_m: float, cell_m2: float, estimated: bool = False
    ) -> tuple[Array, Array, Array]:
        """For cells of `cell_m2`: density of the depth at the level (M,), and given that it is there, the length of the
        mean slope (M,) and its common standard deviation (M,).

        Args:
            now: The current posterior at the locations.
            estimated: Whether both are those of the mean, times the share of the variance that the data removed.
        """
        posterior, n = self._posterior, self._posterior.data_rows
        self._update(n)
        white = now.white.T[:n]
        north, east = (rows.buffer[:n] for rows in self._white)
        own = float(np.trace(posterior.kernel.slope_covariance))
        total = own - np.einsum("np,np->p", north, north) - np.einsum("np,np->p", east, east)
        residuals = posterior.whitened_residuals[:n]
        slope = self._prior + np.stack([residuals @ north, residuals @ east], axis=1)
        covariance = -np.stack([np.einsum("np,np->p", white, w) for w in (north, east)], axis=1)
        inside_m2 = np.einsum("pi,pi->p", slope, slope) * cell_m2 / 12.0
        variance = np.maximum(now.data_var_m2 + inside_m2, 1e-12)
        off = level_m - now.mean_m
        if estimated:
            removed = 1.0 - now.data_var_m2 / posterior.kernel.signal_variance_m2
            inside = np.maximum(inside_m2, LEAST_INSIDE_M2)
            density = np.clip(removed, 0.0, 1.0) * _density(off, inside)
            return density, np.hypot(*slope.T), np.full(len(off), LEAST_SLOPE_STD)
        slope = slope + covariance * (off / variance)[:, None]
        total = total - np.einsum("pi,pi->p", covariance, covariance) / variance
        return _density(off, variance), np.hypot(*slope.T), np.sqrt(np.maximum(0.5 * total, LEAST_SLOPE_STD**2))

    def _update(self, end: int) -> None:
        """Recomputes the rows from the first changed one to `end` - 1, as `CachedPoints` does."""
        posterior = self._posterior
        begin = unchanged_rows(self._rows, posterior.rows[:end])
        if end <= begin:
            return
        lower = posterior.factor.lower
        slopes = posterior.kernel.slopes_of_scaled(self._scaled, posterior.scaled[begin:end])
        for store, slope in zip(self._white, slopes, strict=True):
            store.resize(begin)
            store.resize(end)
            right = slope.T - lower[begin:end, :begin] @ store.rows[:begin]
            store.rows[begin:] = solve_lower(lower[begin:end, begin:end], right)
        self._rows = posterior.rows[:end]


def _density(off_m: Array, variance_m2: Array) -> Array:
    """Density (M,) of a normal distribution at distances (M,) from its mean."""
    return np.asarray(np.exp(-0.5 * off_m * off_m / variance_m2) / np.sqrt(2.0 * math.pi * variance_m2))


def _tabulated(weight: Array, mean: Array, std: Array, step_m: Array) -> tuple[Array, Array]:
    """R at the nodes (M, NODES + 1), and its derivative by s times `step_m`, likewise.

    Args:
        weight: Size of the cell times the density of the level (M,).
        mean: Length of the mean slope (M,).
        std: Standard deviation of the slope's components (M,).
        step_m: Distance of the nodes (M,).
    """
    limit = MAX_STD_M[FOUND]
    points, rule = np.polynomial.legendre.leggauss(POINTS)
    inner = (np.arange(NODES)[:, None] + 0.5 * (points + 1.0)).ravel()
    rates = weight[:, None] * step_m[:, None] / limit
    between = rates * _slope_times_density(inner * step_m[:, None] / limit, mean[:, None], std[:, None])
    parts = between.reshape(len(weight), NODES, POINTS) @ (0.5 * rule)
    values = np.concatenate([np.zeros((len(weight), 1)), np.cumsum(parts, axis=1)], axis=1)
    nodes = np.arange(NODES + 1.0) * step_m[:, None] / limit
    return values, rates * _slope_times_density(nodes, mean[:, None], std[:, None])


def _slope_times_density(slope: Array, mean: Array, std: Array) -> Array:
    """r times the Rice density of r: the rate at which the mean slope below r grows."""
    z = slope / std**2
    return np.asarray(slope * z * np.exp(-0.5 * ((slope - mean) / std) ** 2) * i0e(z * mean))
