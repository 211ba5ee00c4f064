"""Roughness of the ground near a location: the factor c^2 on the prior's variance, estimated from the soundings there.

Steep ground is rougher than flat ground. The *steepness* t of a location is the mean of 1 and of its expected squared
slope relative to the prior's, S. With the slope s of the mean above the prior mean, and the share u of the prior's
variance that is left,

    t = (1 + |s|^2 / S + u) / 2

Every center is predicted from the centers farther away than `LEFT_OUT` length scales. With the prediction's error e and
its variance v under the prior, q = e^2 / (t v) is 1 on average if the prior fits. (A prediction from all other centers
would only show the ground's roughness over one spacing of soundings, not between tracks.) The factor at a location p is

    c^2(p) = t(p) (LOCAL_WORTH g + sum_i k_i q_i) / (LOCAL_WORTH + sum_i k_i),    g = (w + sum_i q_i) / (w + n)

with weights k_i = exp(-|p - p_i|^2 / 2 h^2), h = `NEARBY` length scales. Far from all soundings t is 1, and the factor
is g of the whole map. That is 1 without soundings: the prior's variance counts as w = `gp.std_soundings` soundings.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import lapack
from scipy.spatial import cKDTree

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_gp.inference.posterior import Posterior
from auv_lse_gp.inference.work import FUNCTION, Work, finish, rows_per_part

#: Distance within which centers are left out, and the standard deviation h of the weights, in `gp.length_scale_m`.
LEFT_OUT, NEARBY = 0.3, 0.5
#: Number of soundings that the factor of the whole map counts as at each location.
LOCAL_WORTH = 3.0
#: Weights of centers farther away are below 0.1 %; in h.
REACH = 4.0
#: Largest number of weights that are computed together.
_WEIGHTS = 2_000_000
#: Locations are treated as cells of a grid if that has at most this many cells per location.
_SPARSE = 6


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class Roughness:
    """Squared standardized errors of the centers' predictions.

    Attributes:
        locations_m: Locations (n, 2) of the centers.
        squares: q of each center (n,).
        length_m: The length scale of `LEFT_OUT` and `NEARBY`.
    """

    locations_m: Array
    squares: Array
    length_m: float

    @classmethod
    def of(cls, posterior: Posterior, length_m: float, own: Mask | None = None) -> Roughness:
        """Predicts each center of a posterior, or those of a mask (n,)."""
        return finish(cls.in_parts(posterior, length_m, own))

    @classmethod
    def in_parts(cls, posterior: Posterior, length_m: float, own: Mask | None = None) -> Work[Roughness]:
        """As `of`."""
        locations = posterior.centers.locations_m
        if own is not None:
            locations = locations[own]
        steep = steepness(posterior, locations, 0.0)  # hardly any variance is left at a center
        yield FUNCTION * len(locations) * posterior.data_rows
        squares = (yield from left_out_squares(posterior, LEFT_OUT * length_m, own)) / steep
        return cls(locations_m=locations, squares=squares, length_m=length_m)

    @classmethod
    def joined(cls, parts: Sequence[Roughness], length_m: float) -> Roughness:
        """The centers of several parts of a map."""
        locations, squares = [part.locations_m for part in parts], [part.squares for part in parts]
        return cls(
            locations_m=np.concatenate([np.zeros((0, 2)), *locations]),
            squares=np.concatenate([np.zeros(0), *squares]),
            length_m=length_m,
        )

    def near(self, locations_m: Array) -> Roughness:
        """The centers whose weights are not negligible at some of the locations (P, 2)."""
        reach_m = REACH * NEARBY * self.length_m
        low, high = locations_m.min(axis=0) - reach_m, locations_m.max(axis=0) + reach_m
        near = ((self.locations_m >= low) & (self.locations_m <= high)).all(axis=1)
        return Roughness(locations_m=self.locations_m[near], squares=self.squares[near], length_m=self.length_m)

    def sums(self, at_m: Array) -> Array:
        """Sums of k_i q_i and of k_i at locations (P, 2), shape (P, 2).

        The weights are products of a function of north and one of east. So at the cells of a grid the sums are matrix
        products, and few exponentials are needed.
        """
        if not len(self.squares) or not len(at_m):
            return np.zeros((len(at_m), 2))
        (north, row), (east, column) = (np.unique(at_m[:, axis], return_inverse=True) for axis in (0, 1))
        if len(north) * len(east) > _SPARSE * len(at_m):
            return self._sums_at(at_m)
        by_north, by_east = self._weights(north, 0), self._weights(east, 1)
        layers = [(by_north.T * values) @ by_east for values in (self.squares, np.ones(len(self.squares)))]
        return np.stack([layer[row.ravel(), column.ravel()] for layer in layers], axis=1)

    def _weights(self, at_m: Array, axis: int) -> Array:
        """Factors (n, A) of the weights at coordinates (A,) along an axis."""
        off = (self.locations_m[:, axis, None] - at_m) / (NEARBY * self.length_m)
        return np.asarray(np.exp(-0.5 * off * off))

    def _sums_at(self, at_m: Array) -> Array:
        """As `sums`, at locations (P, 2) that lie on no common grid."""
        found, values = np.zeros((len(at_m), 2)), np.column_stack([self.squares, np.ones(len(self.squares))])
        rows = max(1, _WEIGHTS // len(self.squares))
        for first in range(0, len(at_m), rows):
            part = at_m[first : first + rows]
            apart = ((part[:, None] - self.locations_m) ** 2).sum(axis=2)
            found[first : first + rows] = np.exp(apart / (-2.0 * (NEARBY * self.length_m) ** 2)) @ values
        return found


def variance_scales(posterior: Posterior, config: GpConfig, at_m: Array, variance_m2: Array) -> Array:
    """Factor c^2 (P,) on the variances (P,) of a posterior at locations (P, 2)."""
    return finish(variance_scales_in_parts(posterior, config, at_m, variance_m2))


def variance_scales_in_parts(posterior: Posterior, config: GpConfig, at_m: Array, variance_m2: Array) -> Work[Array]:
    """As `variance_scales`."""
    found = yield from Roughness.in_parts(posterior, config.length_scale_m)
    steep, each = np.empty(len(at_m)), FUNCTION * max(posterior.data_rows, 1)
    rows = rows_per_part(each)
    for first in range(0, len(at_m), rows):
        part = slice(first, min(first + rows, len(at_m)))
        steep[part] = steepness(posterior, at_m[part], variance_m2[part])
        yield each * (part.stop - first)
    sums = found.sums(at_m)
    yield 4.0 * len(at_m) * len(found.squares)
    return scale_of(sums, steep, float(found.squares.sum()), len(found.squares), config.std_soundings)


def degrees_of_freedom(posterior: Posterior, config: GpConfig) -> float:
    """Number of independent errors from which the factor of the whole map is estimated, the prior's worth included.

    Errors of two centers depend on each other if the centers left out overlap, within twice `LEFT_OUT`: they count as
    one. The prior's worth counts in the same proportion. Infinite without rescaling.
    """
    locations, worth = posterior.centers.locations_m, config.std_soundings
    if worth <= 0.0:
        return math.inf
    if not len(locations):
        return worth
    overlapping = cKDTree(locations).query_ball_point(
        locations, 2.0 * LEFT_OUT * config.length_scale_m, return_length=True
    )
    return (worth + len(locations)) * float(np.mean(1.0 / overlapping))


def steepness(posterior: Posterior, at_m: Array, variance_m2: Array | float) -> Array:
    """Steepness t (P,) at locations (P, 2) where the depth has a variance (P,) with the prior's scale."""
    slopes, kernel = posterior.slopes_above_prior(at_m), posterior.kernel
    left = variance_m2 / kernel.signal_variance_m2
    return np.asarray(0.5 * (1.0 + (slopes**2).sum(axis=1) / np.trace(kernel.slope_covariance) + left))


def scale_of(sums: Array, steep: Array, total: float, count: int, worth: float) -> Array:
    """Factor c^2 (P,) from `Roughness.sums` (P, 2), the steepness (P,), the sum of all q, and their number.

    `worth` is `gp.std_soundings`.
    """
    if worth <= 0.0:  # no rescaling
        return np.ones(len(sums))
    whole = (worth + total) / (worth + count)
    return np.asarray(steep * (LOCAL_WORTH * whole + sums[:, 0]) / (LOCAL_WORTH + sums[:, 1]))


def left_out_squares(posterior: Posterior, radius_m: float, own: Mask | None = None) -> Work[Array]:
    """Squared standardized error of each center, predicted from the centers farther away than `radius_m`.

    With the inverse S of the data's covariance, uncertain positions included, and the centers B left out, the errors
    of all of B are S_BB^-1 (S r)_B and their covariance is S_BB^-1 (RW2006 section 5.4.2, for blocks).

    Args:
        own: Mask (n,) of the centers to predict; None: all.
    """
    n = posterior.data_rows
    predicted = np.arange(n) if own is None else np.flatnonzero(own)
    if not len(predicted):
        return np.zeros(0)
    locations, factor, residuals = posterior.centers.locations_m, posterior.factor, posterior.whitened_residuals[:n]
    near = cKDTree(locations).query_ball_point(locations[predicted], radius_m)
    used = np.unique(np.concatenate([np.asarray(found, dtype=np.int64) for found in near]))
    precision = yield from _precision(posterior, used)
    if posterior.positions_uncertain:
        white = posterior.white_position_effect
        within, back = np.eye(white.shape[1]) + white.T @ white, factor.solve_transposed(white, n)
        residuals = residuals - white @ np.linalg.solve(within, white.T @ residuals)
        precision -= back[used] @ np.linalg.solve(within, back[used].T)
        yield 2.0 * n * n * white.shape[1]
    weighted = factor.solve_transposed(residuals, n)[used]
    counts = np.array([len(found) for found in near])
    squares = np.empty(len(predicted))
    for count in np.unique(counts):  # blocks of one size are solved together
        alike = np.flatnonzero(counts == count)
        blocks = np.searchsorted(used, np.array([near[i] for i in alike]))
        is_own = (used[blocks] == predicted[alike][:, None]).astype(float)
        solved = np.linalg.solve(precision[blocks[:, :, None], blocks[:, None, :]], is_own[:, :, None])[:, :, 0]
        error, variance = (solved * weighted[blocks]).sum(axis=1), (solved * is_own).sum(axis=1)
        squares[alike] = error**2 / variance
        yield 10.0 * len(alike) * float(count) ** 3
    return squares


def _precision(posterior: Posterior, used: Ints) -> Work[Array]:
    """Rows and columns `used` (u,) of the inverse of the data's covariance, (u, u); in parts."""
    n = posterior.data_rows
    if len(used) == n:
        inverse, _ = lapack.dtrtri(np.array(posterior.factor.lower[:n, :n], order="F"), lower=1, overwrite_c=1)
        yield n**3 / 3.0
        half, _ = lapack.dlauum(inverse, lower=1, overwrite_c=1)
        yield n**3 / 3.0
        return np.asarray(np.tril(half) + np.tril(half, -1).T)
    units = np.zeros((n, len(used)))
    units[used, np.arange(len(used))] = 1.0
    columns, each = np.empty((n, len(used))), 0.5 * n * n
    width = rows_per_part(each)
    for first in range(0, len(used), width):
        part = slice(first, min(first + width, len(used)))
        columns[:, part] = posterior.factor.solve_in_place(np.ascontiguousarray(units[:, part]))
        yield each * (part.stop - first)
    product = columns.T @ columns
    yield float(n) * len(used) ** 2
    return np.asarray(product)
