"""A plain dense Gaussian process: the certificate's own way from soundings to a map.

It shares no code with the map of vehicles and reports (`auv_lse_gp`), which is the point: it factorizes the full
covariance matrix once, and has no updates, cache or compiled code. A long mission has too many measurements for one
matrix; its map is computed square by square, from the measurements near each. RW2006: Rasmussen and Williams, Gaussian
Processes for Machine Learning, 2006, algorithm 2.1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.spatial.distance import cdist

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

#: Largest number of averages of soundings.
MAX_AVERAGES = 6000
#: With more soundings, an average counts as measured at their centroid. In a square of 10 m this moves a depth by
#: centimeters; the sum over all pairs of soundings would take minutes.
MAX_EXACT = 15_000
#: With more measurements, only those near a location count for it.
MAX_WHOLE = 1500
#: Limit of "near", in lengths of the kernel (of a Wendland kernel: supports).
NEAR = {"matern52": 4.0, "squared_exponential": 6.0, "wendland_c2": 1.3}
#: Entries of a covariance matrix that are computed together.
_ENTRIES = 4_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class DensePrior:
    """The prior that a mission file describes.

    Attributes:
        kernel: Name of the covariance function.
        std_m: Standard deviation of the depth.
        lengths_m: Length along the first and the second axis; of a Wendland kernel its support.
        rotation_deg: Direction of the first axis, clockwise from north.
        mean: Prior mean, locations (P, 2) -> depths (P,).
        std_soundings: Number of soundings that the standard deviation counts as (`gp.std_soundings`).
        length_m: Length scale by which the ground's roughness is estimated (`gp.length_scale_m`).
        bank: Factor s on the standard deviation near a known shore, locations (P, 2) -> (P,); None: all ground is open.
        shore_m: Depth along that shore.
    """

    kernel: str
    std_m: float
    lengths_m: tuple[float, float]
    rotation_deg: float
    mean: Callable[[Array], Array]
    std_soundings: float
    length_m: float
    bank: Callable[[Array], Array] | None = None
    shore_m: float = 0.0

    def variance(self, at_m: Array) -> Array:
        """Variance (P,) of the depth at locations (P, 2)."""
        return self.std_m**2 * (np.ones(len(at_m)) if self.bank is None else self.bank(at_m) ** 2)

    def width_scale(self, at_m: Array, mean_m: Array) -> Array:
        """Variance of depths (P,) from the unknown width of banks, relative to `variance`, before any sounding.

        With the logarithm of the width of standard deviation .5: (.5 (f - h) x exp(-x) / s / (std s))^2, x = d / 25 m.
        """
        if self.bank is None:
            return np.zeros(len(at_m))
        s = np.minimum(self.bank(at_m), 1.0 - 1e-12)
        x, rise_m = -np.log(1.0 - s), np.maximum(mean_m - self.shore_m, 0.0)
        return np.asarray((0.5 * rise_m * x * np.exp(-x) / (s * s * self.std_m)) ** 2)

    @property
    def squared_slope(self) -> float:
        """Mean squared slope of the depth on open ground."""
        along, across = self.lengths_m
        return -float(self.correlation_slope(np.zeros(1))[0]) * self.std_m**2 * (along**-2 + across**-2)

    def correlation_slope(self, r: Array) -> Array:
        """Slope of the correlation over the distance r, both in lengths, divided by r."""
        rest = np.clip(1.0 - r, 0.0, None)
        match self.kernel:
            case "matern52":
                return np.asarray(-5.0 / 3.0 * (1.0 + math.sqrt(5.0) * r) * np.exp(-math.sqrt(5.0) * r))
            case "squared_exponential":
                return np.asarray(-np.exp(-(r**2) / 2.0))
        return np.asarray(-20.0 * rest**3)  # wendland_c2

    def covariance(self, a_m: Array, b_m: Array) -> Array:
        """Covariance (A, B) of the depths at locations (A, 2) and (B, 2)."""
        r = cdist(self.scaled(a_m), self.scaled(b_m))
        rest = np.clip(1.0 - r, 0.0, None)
        root5 = math.sqrt(5.0) * r
        match self.kernel:
            case "matern52":
                correlation = (1.0 + root5 + 5.0 * r**2 / 3.0) * np.exp(-root5)
            case "squared_exponential":
                correlation = np.exp(-(r**2) / 2.0)
            case "wendland_c2":
                correlation = rest**4 * (4.0 * r + 1.0)
            case _:
                raise ValueError(f"gp.kernel {self.kernel!r} has no independent implementation in the certificate")
        if self.bank is not None:
            correlation = correlation * np.outer(self.bank(a_m), self.bank(b_m))
        return np.asarray(self.std_m**2 * correlation)

    def scaled(self, locations_m: Array) -> Array:
        """Locations (P, 2) along and across the first axis, in lengths."""
        angle = math.radians(self.rotation_deg)
        north, east = locations_m[:, 0], locations_m[:, 1]
        along, right = (
            math.cos(angle) * north + math.sin(angle) * east,
            math.cos(angle) * east - math.sin(angle) * north,
        )
        return np.column_stack([along / self.lengths_m[0], right / self.lengths_m[1]])


@dataclass(frozen=True, slots=True, kw_only=True)
class DenseMap:
    """A map at locations.

    Attributes:
        mean_m: Mean depth (P,).
        prior_std_m: Standard deviation (P,) with the prior's scale, uncertain positions included.
        std_m: Standard deviation (P,) with the roughness that the soundings show near each location.
        variance_scale: Mean factor by which that rescales the variance.
        count: Number of measurements: averages of soundings, or kernel centers.
    """

    mean_m: Array
    prior_std_m: Array
    std_m: Array
    variance_scale: float
    count: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurements:
    """Averages of soundings; without groups, each sounding is one.

    Attributes:
        locations_m: Where soundings were taken (S, 2), group by group.
        depths_m: Measured average depth of each group (n,).
        noise_m2: Variance of its error (n,).
        starts: First sounding of each group (n,).
        effect_m: Change of each average per standard deviation of each mode of common position errors (n, r).
    """

    locations_m: Array
    depths_m: Array
    noise_m2: Array
    starts: Ints
    effect_m: Array

    @classmethod
    def of_centers(
        cls, locations_m: Array, depths_m: Array, noise_std_m: Array, effect_m: Array | None
    ) -> Measurements:
        """Single measurements, such as recorded kernel centers."""
        n = len(depths_m)
        effect = np.zeros((n, 0)) if effect_m is None else effect_m
        return cls(
            locations_m=locations_m, depths_m=depths_m, noise_m2=noise_std_m**2, starts=np.arange(n), effect_m=effect
        )

    @classmethod
    def averaged(cls, locations_m: Array, depths_m: Array, noise_std_m: float, square_m: float) -> Measurements:
        """Soundings within one square of a grid become one measurement, their average.

        Averages are linear in the depth, so up to `MAX_EXACT` soundings nothing is approximated: the covariance of
        averages is the average of covariances. If there are more than `MAX_AVERAGES`, squares become larger.
        """
        n = len(depths_m)
        square, cells = max(square_m, 1e-3), np.empty((0, 2))
        while True:
            cells = np.floor(locations_m / square)
            _, group = np.unique(cells, axis=0, return_inverse=True)
            if n == 0 or group.max() < MAX_AVERAGES:
                break
            square *= 1.25
        group = group.reshape(-1)  # NumPy 2.0 returns a column
        order = np.argsort(group, kind="stable")
        starts = np.flatnonzero(np.diff(group[order], prepend=-1))
        counts = np.diff(np.append(starts, n))
        locations_m = locations_m[order]
        if n > MAX_EXACT:
            locations_m = np.add.reduceat(locations_m, starts, axis=0) / counts[:, None]
        return cls(
            locations_m=locations_m,
            depths_m=np.add.reduceat(depths_m[order], starts) / counts if n else np.zeros(0),
            noise_m2=noise_std_m**2 / counts,
            starts=np.arange(len(starts)) if n > MAX_EXACT else starts,
            effect_m=np.zeros((len(starts), 0)),
        )

    @property
    def counts(self) -> Ints:
        """Number of locations of each average (n,)."""
        return np.diff(np.append(self.starts, len(self.locations_m)))

    def take(self, numbers: Ints) -> Measurements:
        """The averages with these numbers, in ascending order."""
        counts, chosen = self.counts, np.zeros(len(self.starts), dtype=bool)
        chosen[numbers] = True
        return Measurements(
            locations_m=self.locations_m[np.repeat(chosen, counts)],
            depths_m=self.depths_m[numbers],
            noise_m2=self.noise_m2[numbers],
            starts=np.cumsum(counts[numbers]) - counts[numbers],
            effect_m=self.effect_m[numbers],
        )

    def covariance_with(self, prior: DensePrior, at_m: Array) -> Array:
        """Covariance (P, n) of the depths at locations (P, 2) with the averages."""
        counts = self.counts
        rows = max(1, _ENTRIES // max(len(self.locations_m), 1))
        parts = [
            np.add.reduceat(prior.covariance(at_m[first : first + rows], self.locations_m), self.starts, axis=1)
            / counts
            for first in range(0, len(at_m), rows)
        ]
        return np.concatenate(parts) if parts else np.zeros((0, len(self.starts)))

    def covariance(self, prior: DensePrior) -> Array:
        """Covariance (n, n) of the averages, without noise."""
        counts = self.counts
        full = self.covariance_with(prior, self.locations_m)
        return np.asarray(np.add.reduceat(full, self.starts, axis=0) / counts[:, None])


def dense_map(prior: DensePrior, given: Measurements, at_m: Array) -> DenseMap:
    """The posterior at locations (P, 2) given measurements; with more than `MAX_WHOLE`, square by square."""
    n = len(given.starts)
    mean, variance = np.array(prior.mean(at_m), dtype=float), prior.variance(at_m)
    floor, steep, errors = np.zeros(len(at_m)), np.full(len(at_m), 0.5), np.zeros(n)
    locations = (
        np.add.reduceat(given.locations_m, given.starts, axis=0) / given.counts[:, None] if n else np.zeros((0, 2))
    )
    parts = list(_squares(prior, locations, at_m))
    for near, home, cells in parts:
        local = given.take(near)
        covariance = local.covariance(prior) + np.diag(local.noise_m2)
        lower = cholesky(covariance, lower=True)  # RW2006, line 2
        residuals = local.depths_m - np.add.reduceat(prior.mean(local.locations_m), local.starts) / local.counts
        white = solve_triangular(lower, residuals, lower=True)
        effect = solve_triangular(lower, local.effect_m, lower=True)
        weights = solve_triangular(lower, white, lower=True, trans=1)
        rows = max(1, _ENTRIES // len(near))
        for first in range(0, len(cells), rows):
            part = cells[first : first + rows]
            v = solve_triangular(lower, local.covariance_with(prior, at_m[part]).T, lower=True)  # line 5
            mean[part] += v.T @ white  # line 4
            variance[part] -= (v**2).sum(axis=0)  # line 6
            floor[part] = ((v.T @ effect) ** 2).sum(axis=1)
            steep[part] += 0.5 * squared_slopes(prior, local, weights, at_m[part]) / prior.squared_slope
        covariance += local.effect_m @ local.effect_m.T
        own_steep = 0.5 + 0.5 * squared_slopes(prior, local, weights, locations[near[home]]) / prior.squared_slope
        left_out = left_out_errors(covariance, residuals, locations[near], np.flatnonzero(home), prior)
        errors[near[home]] = left_out / own_steep
    count = prior.std_soundings
    everywhere = (count + errors.sum()) / (count + n) if count > 0.0 else 1.0
    variance = np.maximum(variance, 0.0)
    steep += 0.5 * variance / prior.variance(at_m)
    scale = np.full(len(at_m), everywhere)
    for near, _, cells in parts if count > 0.0 else ():
        scale[cells] = steep[cells] * _variance_scales(errors[near], locations[near], at_m[cells], prior, everywhere)
    scale += prior.width_scale(at_m, mean)
    return DenseMap(
        mean_m=mean,
        prior_std_m=np.sqrt(variance + floor),
        std_m=np.sqrt(scale * variance + floor),
        variance_scale=float(scale.mean()),
        count=n,
    )


def squared_slopes(prior: DensePrior, given: Measurements, weights: Array, at_m: Array) -> Array:
    """Squared slope (P,) of the mean less the prior mean at locations (P, 2), on the scale of open ground.

    The mean less the prior mean is the sum of covariances with the measurements times their weights (n,).
    """
    each = np.repeat(weights / given.counts, given.counts) * np.sqrt(prior.variance(given.locations_m)) * prior.std_m
    data, locations, slopes = prior.scaled(given.locations_m), prior.scaled(at_m), np.empty((len(at_m), 2))
    rows = max(1, _ENTRIES // len(data))
    for first in range(0, len(at_m), rows):
        part = locations[first : first + rows]
        falls = prior.correlation_slope(cdist(part, data)) * each
        slopes[first : first + rows] = falls.sum(axis=1)[:, None] * part - falls @ data
    return np.asarray(((slopes / prior.lengths_m) ** 2).sum(axis=1))


def left_out_errors(covariance: Array, residuals: Array, locations_m: Array, numbers: Ints, prior: DensePrior) -> Array:
    """Squared standardized errors (m,) of the measurements `numbers` (m,), from those more than .3 length scales away.

    Errors of all the measurements left out together are S_BB^-1 (S r)_B, of covariance S_BB^-1, with the inverse S of
    the covariance of all residuals r (RW2006, section 5.4.2, for blocks).
    """
    inverse = cho_solve((cholesky(covariance, lower=True), True), np.eye(len(residuals)))
    weighted = inverse @ residuals
    squares = np.empty(len(numbers))
    for i, number in enumerate(numbers):
        block = np.flatnonzero(((locations_m - locations_m[number]) ** 2).sum(axis=1) <= (0.3 * prior.length_m) ** 2)
        own = block == number
        spread = np.linalg.solve(inverse[np.ix_(block, block)], own.astype(float))
        squares[i] = (spread @ weighted[block]) ** 2 / spread[own][0]
    return squares


def _variance_scales(squares: Array, locations_m: Array, at_m: Array, prior: DensePrior, everywhere: float) -> Array:
    """Factor (P,) at a steepness of 1: the mean of nearby `squares` and 3 more of the whole map's mean."""
    scales, rows = np.empty(len(at_m)), max(1, _ENTRIES // len(squares))
    for first in range(0, len(at_m), rows):
        part = slice(first, first + rows)
        weights = np.exp(-0.5 * (cdist(at_m[part], locations_m) / (0.5 * prior.length_m)) ** 2)
        scales[part] = (3.0 * everywhere + weights @ squares) / (3.0 + weights.sum(axis=1))
    return scales


def _squares(prior: DensePrior, measured_m: Array, at_m: Array) -> Iterator[tuple[Ints, Mask, Ints]]:
    """For each square: the measurements (n, 2) that count in it, which are inside, and the locations (P, 2) inside.

    Up to `MAX_WHOLE` measurements make one square. Distances are in the prior's lengths.
    """
    n = len(measured_m)
    if n <= MAX_WHOLE:
        if n:
            yield np.arange(n), np.ones(n, dtype=bool), np.arange(len(at_m))
        return
    margin = NEAR[prior.kernel]
    side = 0.5 * margin
    measured, locations = prior.scaled(measured_m), prior.scaled(at_m)
    homes, corners = np.floor(measured / side), np.floor(locations / side)
    for corner in np.unique(np.concatenate([homes, corners]), axis=0):
        middle = (corner + 0.5) * side
        gap = np.maximum(np.abs(measured - middle) - 0.5 * side, 0.0)
        near = np.flatnonzero((gap**2).sum(axis=1) <= margin**2)
        if len(near):
            yield near, (homes[near] == corner).all(axis=1), np.flatnonzero((corners == corner).all(axis=1))
