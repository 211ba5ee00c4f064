"""The posterior of the depth: the only module that conditions the Gaussian process.

The measurements X are first the data (kernel centers with depths z), then *planned locations*, to be measured later.
With K = k(X, X) + noise (RW2006: Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, algorithm 2.1):

    l. 2   L = chol(K)                             `Factor`, one row per measurement
    l. 3   mean(p) = m(p) + w(p)^T b,              b = L^-1 (z - m(X)), stored
    l. 5   w(p) = L^-1 k(X, p)                     the *whitened covariance* of location p with the measurements
    l. 6   cov(p, q) = k(p, q) - w(p)^T w(q)       and so var(p) = k(p, p) - |w(p)|^2

`mean_m` uses the equivalent mean(p) = k(p, X) alpha with alpha = L^-T b.

Uncertain positions: the positions of all centers have common errors in r modes. One standard deviation of a mode
changes the centers' depths by a column of E (n, r) (`Centers.position_effect_m`), and thus the mean at p by -w(p)^T
L^-1 E. Every variance therefore includes the *position variance* |w(p)^T L^-1 E|^2, a floor that planned measurements
do not reduce.

Where a shore is known, all of this concerns relative depths, which lie on the same side of the level as the depths
(`inference/banks.py`). Only `centers` and `slopes` are in depths.

Appending measurements does not change existing rows of L and w. The first rows of w give the variance given the data,
and the others the effect of planned locations. A planned measurement lowers the variance and leaves the expected mean
unchanged.
"""

from __future__ import annotations

import copy

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.blas import dsyrk

from auv_lse_common.mission_file.sections.gp import GpConfig
from auv_lse_common.support import compiled
from auv_lse_common.support.arrays import Array, Ints, Mask
from auv_lse_gp.compiled.modules import compiled_gp
from auv_lse_gp.covariance.kernels import Kernel
from auv_lse_gp.covariance.prior_mean import PriorMean, prior_mean
from auv_lse_gp.inference.banks import Banks
from auv_lse_gp.inference.centers import NO_CENTERS, Centers
from auv_lse_gp.inference.factor import Factor, IllConditionedError
from auv_lse_gp.inference.point_posteriors import PointPosteriors
from auv_lse_gp.inference.triangular import solve_lower
from auv_lse_gp.level_set.crossings import DepthAndSlope

#: Number of locations that `moments` processes together, so that the data fit in the processor's cache.
CHUNK = 2048
#: Number of covariances' slopes that are computed together.
_SLOPES = 2_000_000
#: Half of the distance (m) of the finite difference for a prior mean's slope.
_SLOPE_M = 0.5


class Posterior:
    """Posterior of the depth given data and planned locations.

    Attributes:
        banks: The banks of the area; None: all ground is open.
        prior_mean: Prior mean, locations (P, 2) -> depths (P,).
        noise_var_m2: Noise variance of a planned measurement.
    """

    def __init__(self, config: GpConfig, mean: PriorMean | None = None, banks: Banks | None = None) -> None:
        """Starts with no data.

        Args:
            mean: Prior mean (P, 2) -> (P,) of open ground; by default the one that `config` describes.
            banks: The banks of the area; None: all ground is open.
        """
        self.kernel = Kernel(config)
        self.banks = banks
        mean = mean or prior_mean(config)
        self.prior_mean = mean if banks is None else banks.mean(mean)
        self.noise_var_m2 = config.noise_std_m**2
        self._std_soundings = config.std_soundings
        self._factor = Factor()
        self._centers = NO_CENTERS
        self._scaled = np.zeros((0, 2))  # of all measurements
        self._rows = np.zeros(0, dtype=np.int64)  # a number for each row, never reused: see `rows`
        self._appended = 0
        self._whitened = np.zeros(0)  # b = L^-1 (z - m(X))
        self._position_white: Array | None = None  # L^-1 E, computed on first use
        self._position_weights: Array | None = None  # L^-T L^-1 E, likewise

    # ---------------------------------------------------------------- measurements

    def __len__(self) -> int:
        """Number of measurements, data and planned."""
        return len(self._scaled)

    @property
    def data_rows(self) -> int:
        """Number of centers: the first rows of L and w."""
        return len(self._centers)

    @property
    def planned_rows(self) -> int:
        """Number of planned locations: the rows after the centers."""
        return len(self._scaled) - len(self._centers)

    @property
    def centers(self) -> Centers:
        """The data; its arrays are read-only."""
        return self._centers

    def relative(self, centers: Centers) -> Centers:
        """Measurements as this posterior uses them: of relative depths, if there are banks."""
        return centers if self.banks is None or not len(centers) else self.banks.relative(centers)

    def extend(self, centers: Centers) -> None:
        """Conditions on more data.

        Raises:
            ValueError: if locations are planned.
            IllConditionedError: if the covariance cannot be factorized; nothing is changed.
        """
        if self.planned_rows:
            raise ValueError(
                f"extend: this posterior has {self.planned_rows} planned locations. Extend the posterior that "
                "with_planned() was called on."
            )
        self._append(self.kernel.scale(centers.locations_m), self.relative(centers).noise_std_m ** 2)
        self._set_data(self._centers.joined(centers), self.data_rows)

    def with_planned(self, locations_m: Array) -> Posterior:
        """A copy that is also conditioned on future measurements at `locations_m` (O, 2), which may contain a location
        twice.

        Raises:
            IllConditionedError: if the covariance cannot be factorized.
        """
        other = copy.copy(self)
        other._factor = self._factor.copy(room=len(locations_m))
        scaled = self.kernel.scale(np.asarray(locations_m, dtype=float).reshape(-1, 2))
        other._append(scaled, np.full(len(scaled), self.noise_var_m2))
        return other

    def truncate(self, size: int) -> None:
        """Drops all measurements but the first `size`."""
        self._factor.truncate(size)
        self._scaled, self._rows = self._scaled[:size], self._rows[:size]
        if size < self.data_rows:
            self._centers = self._centers.slice(0, size)
            self._position_white = self._position_weights = None
            self._whitened = self._whitened[:size]

    def follow(self, centers: Centers) -> int:
        """Replaces the data by `centers` and drops planned locations.

        Only rows from the first changed center on are recomputed; if only depths change, the factor is kept.

        Returns:
            Number of leading centers whose location and noise are unchanged.

        Raises:
            IllConditionedError: if they cannot be factorized; the posterior then has only the unchanged centers.
        """
        old = self._centers
        common = min(len(old), len(centers))
        same_row = (old.locations_m[:common] == centers.locations_m[:common]).all(axis=1) & (
            old.noise_std_m[:common] == centers.noise_std_m[:common]
        )
        keep = _leading(same_row)
        same_depths = _leading(old.depths_m[:keep] == centers.depths_m[:keep])
        self.truncate(keep)
        effect = centers.position_effect_m
        taken = Centers(
            np.array(centers.locations_m, dtype=float),
            np.array(centers.depths_m, dtype=float),
            np.array(centers.noise_std_m, dtype=float),
            None if effect is None else np.array(effect, dtype=float),
        )
        try:
            new = self.relative(taken.slice(keep, len(taken)))
            self._append(self.kernel.scale(new.locations_m), new.noise_std_m**2)
        except IllConditionedError:
            self._set_data(taken.slice(0, keep), same_depths)
            raise
        self._set_data(taken, same_depths)
        return keep

    def blank(self) -> Posterior:
        """A posterior with the same prior, without data."""
        other = copy.copy(self)
        other._factor = Factor()
        other.truncate(0)
        return other

    def _append(self, scaled: Array, noise_m2: Array) -> None:
        """Appends measurements at scaled locations (m, 2) to the factor: RW2006 algorithm 2.1, line 2, for new rows."""
        if not len(scaled):
            return
        own = self.kernel.of_scaled(scaled, scaled)
        own[np.diag_indices(len(scaled))] += noise_m2
        self._factor.append(self.kernel.of_scaled(scaled, self._scaled), own)
        self._scaled = np.concatenate([self._scaled, scaled])
        self._rows = np.concatenate([self._rows, self._appended + np.arange(len(scaled))])
        self._appended += len(scaled)

    def _set_data(self, centers: Centers, same: int) -> None:
        """Sets the depths of `centers`, whose rows are in the factor; the first `same` depths are unchanged."""
        self._centers = centers
        self._position_white = self._position_weights = None
        if same == len(centers) == len(self._whitened):
            return
        changed = self.relative(centers.slice(same, len(centers)))
        residuals = changed.depths_m
        if len(residuals):
            residuals = residuals - self.prior_mean(changed.locations_m)
        self._whitened = self._factor.solve_from(same, np.concatenate([self._whitened[:same], residuals]))

    # ---------------------------------------------------------------- the posterior at points

    def at(self, locations_m: Array) -> PointPosteriors:
        """The posterior at locations (P, 2)."""
        locations = np.asarray(locations_m, dtype=float).reshape(-1, 2)
        scaled = self.kernel.scale(locations)
        # RW2006 algorithm 2.1, line 5: v = L \ k_*, here a row for each location
        white = self._factor.solve_rows_in_place(self.kernel.of_scaled(scaled, self._scaled))
        n = self.data_rows
        data, planned = white[:, :n], white[:, n:]
        data_var = np.maximum(self.kernel.variance(locations) - np.einsum("pn,pn->p", data, data), 0.0)  # line 6
        planned_var = data_var
        if self.planned_rows:
            planned_var = np.maximum(data_var - np.einsum("pn,pn->p", planned, planned), 0.0)
        if self.positions_uncertain:
            floor = np.einsum("pr,pr->p", *[data @ self.white_position_effect] * 2)
            data_var, planned_var = data_var + floor, planned_var + floor
        mean = np.asarray(self.prior_mean(locations), dtype=float)
        if n:
            mean = mean + data @ self._whitened  # line 4
        return PointPosteriors(scaled, white, mean, data_var, planned_var)

    def moments(self, locations_m: ArrayLike) -> tuple[Array, Array]:
        """Mean given the data, and variance given data and planned locations, (P,) each, at locations (P, 2).

        Unlike `at`, it needs no memory for the whitened covariance, so P may be large.
        """
        locations = checked_locations(locations_m)
        mean = np.array(self.prior_mean(locations), dtype=float)
        variance = np.array(self.kernel.variance(locations))
        scaled = self.kernel.scale(locations)
        self.condition_moments(scaled, mean, variance)
        return mean, np.maximum(variance, 0.0) + self.position_variance(scaled)

    @property
    def positions_uncertain(self) -> bool:
        """Whether the positions of the centers are uncertain."""
        return self._centers.position_effect_m is not None and bool(len(self._centers))

    @property
    def white_position_effect(self) -> Array:
        """L^-1 E (n, r) of the centers' position effects; (n, 0) if positions are assumed exact."""
        if self._position_white is None:
            n, effect = self.data_rows, self.relative(self._centers).position_effect_m
            if effect is None:
                effect = np.zeros((n, 0))
            lower = self._factor.lower[:n, :n]
            self._position_white = solve_lower(lower, effect) if effect.size else effect
        return self._position_white

    @property
    def residual_ratio(self) -> float:
        """|b|^2 / n for n data with whitened residuals b: 1 on average if the prior is correct, and 1 without data.

        With uncertain positions, |b|^2 is b' (1 + W W')^-1 b with W = L^-1 E.
        """
        n = self.data_rows
        if not n:
            return 1.0
        b = self.whitened_residuals[:n]
        squares = float(b @ b)
        if self.positions_uncertain:
            white = self.white_position_effect
            along = white.T @ b
            squares -= float(along @ np.linalg.solve(np.eye(len(along)) + white.T @ white, along))
        return squares / n

    @property
    def variance_scale(self) -> float:
        """Factor c^2 on the prior's variance over the whole map; `Roughness` estimates it from location to location.

        c^2 has an inverse gamma prior about 1 with the weight of w soundings (`gp.std_soundings`). Its mean given the
        data is (w + |b|^2) / (w + n) up to terms of 1 / n (Gelman et al., Bayesian Data Analysis, 2013, section 2.6),
        with |b|^2 as in `residual_ratio`. Noise is scaled with the signal.
        """
        worth, n = self._std_soundings, self.data_rows
        return (worth + n * self.residual_ratio) / (worth + n) if worth > 0.0 and n else 1.0

    def position_variance(self, scaled: Array) -> Array:
        """Variance (P,) that uncertain positions of the centers add at scaled locations (P, 2)."""
        if not self.positions_uncertain:
            return np.zeros(len(scaled))
        if self._position_weights is None:
            self._position_weights = self._factor.solve_transposed(self.white_position_effect, self.data_rows)
        off = np.zeros((self._position_weights.shape[1], len(scaled)))
        self.kernel.subtract_weighted(self._scaled[: self.data_rows], self._position_weights, scaled, off)
        return np.asarray(np.einsum("rp,rp->p", off, off))

    def slopes(self, locations_m: ArrayLike) -> Array:
        """Slope (P, 2) of the mean depth at locations (P, 2), metres per metre north and east."""
        locations = checked_locations(locations_m)
        n = self.data_rows
        weights = self._factor.solve_transposed(self._whitened, n) if n else np.zeros(0)
        slopes = depth_slopes(self.kernel, self.prior_mean, self._scaled[:n], weights, locations)
        if self.banks is None or not len(locations):
            return slopes
        return self.banks.slopes(locations, self.mean_m(locations), slopes)

    def slopes_above_prior(self, locations_m: Array) -> Array:
        """Slope (P, 2) at locations (P, 2) of the mean less the prior mean, of the relative depth near a known
        shore."""
        n = self.data_rows
        weights = self._factor.solve_transposed(self._whitened, n) if n else np.zeros(0)
        return slopes_above_prior(self.kernel, self._scaled[:n], weights, locations_m)

    def depth_and_slope(self, locations_m: ArrayLike) -> DepthAndSlope:
        """Joint distribution of depth and slope at locations (P, 2) given the data; positions of centers count as
        known."""
        locations = checked_locations(locations_m)
        kernel, n = self.kernel, self.data_rows
        scaled, data = kernel.scale(locations), self._scaled[:n]
        covariances = kernel.of_scaled(scaled, data)
        slopes = kernel.slopes_of_scaled(scaled, data)
        white, *white_slopes = (self._factor.solve_rows_in_place(c) for c in (covariances, *slopes))
        own = kernel.slope_covariance
        slope_covariance = np.array(
            [[own[i, j] - np.einsum("pn,pn->p", white_slopes[i], white_slopes[j]) for j in (0, 1)] for i in (0, 1)]
        )
        return DepthAndSlope(
            mean_m=np.asarray(self.prior_mean(locations), dtype=float) + white @ self._whitened,
            variance_m2=np.maximum(kernel.variance(locations) - np.einsum("pn,pn->p", white, white), 0.0),
            slope=prior_slopes(self.prior_mean, locations)
            + np.stack([w @ self._whitened for w in white_slopes], axis=1),
            covariance_m=-np.stack([np.einsum("pn,pn->p", white, w) for w in white_slopes], axis=1),
            slope_covariance=np.moveaxis(slope_covariance, 2, 0),
        )

    def condition_moments(self, scaled: Array, mean: Array, variance: Array) -> None:
        """Replaces the prior mean (P,) and variance (P,) at scaled locations (P, 2) by the posterior's, in place."""
        n = len(self)
        if not n:
            return
        residuals = self.whitened_residuals
        memory = np.empty(n * min(CHUNK, len(scaled)))
        for begin in range(0, len(scaled), CHUNK):
            part = slice(begin, min(begin + CHUNK, len(scaled)))
            columns = part.stop - begin
            white = memory[: n * columns].reshape(n, columns)
            self._factor.solve_in_place(self.kernel.of_scaled(self._scaled, scaled[part], white))
            add_whitened(white, residuals, mean[part], variance[part])

    def mean_m(self, locations_m: ArrayLike) -> Array:
        """Mean depth (P,) at locations (P, 2) given the data, without computing variances."""
        locations = checked_locations(locations_m)
        mean = np.array(self.prior_mean(locations), dtype=float)
        n = self.data_rows
        if not n:
            return mean
        weights = self._factor.solve_transposed(-self._whitened, n)  # line 3: alpha = L^T \ (L \ y)
        scaled = self.kernel.scale(locations)
        self.kernel.subtract_weighted(self._scaled[:n], weights[:, None], scaled, mean[None])  # line 4
        return mean

    # ---------------------------------------------------------------- joint covariance

    def covariance(self, a: PointPosteriors, b: PointPosteriors) -> Array:
        """Covariance (A, B) of the depths given the data and the planned locations."""
        if a is b and a.white.shape[1]:
            lower = self.lower_covariance(a)
            return np.tril(lower) + np.tril(lower, -1).T
        return self.kernel.of_scaled(a.scaled, b.scaled) - a.white @ b.white.T

    def lower_covariance(self, a: PointPosteriors) -> Array:
        """Covariance (A, A) among points; only its lower triangle is valid."""
        own = self.kernel.of_scaled(a.scaled, a.scaled).T  # symmetric; Fortran-ordered, so BLAS works in place
        if not a.white.shape[1]:
            return own
        if a.white.flags.c_contiguous:
            return np.asarray(dsyrk(-1.0, a.white.T, beta=1.0, c=own, trans=1, lower=1, overwrite_c=1))
        return np.asarray(dsyrk(-1.0, np.asfortranarray(a.white), beta=1.0, c=own, lower=1, overwrite_c=1))

    def measured_covariance(self, a: PointPosteriors) -> Array:
        """Covariance (A, A) of measurements at points, including noise; only its lower triangle is valid."""
        matrix = self.lower_covariance(a)
        np.einsum("ii->i", matrix)[:] += self.noise_var_m2
        return matrix

    def measured_covariances(self, paths: PointPosteriors, count: int) -> Array:
        """Covariances (B, c, c) of measurements along each of several paths of equal length.

        Args:
            paths: Points of all paths, one path after the other, B * c in total.
            count: Number of paths B.
        """
        length = len(paths) // count
        white = paths.white.reshape(count, length, paths.white.shape[1])
        scaled = paths.scaled.reshape(count, length, 2)
        apart = scaled[:, :, None, :] - scaled[:, None, :, :]
        matrices = self.kernel.of_scaled(np.zeros((1, 2)), apart.reshape(-1, 2)).reshape(count, length, length)
        matrices -= white @ white.transpose(0, 2, 1)
        np.einsum("bii->bi", matrices)[:] += self.noise_var_m2
        return matrices

    # ---------------------------------------------------------------- parts for solvers

    @property
    def factor(self) -> Factor:
        """L of data and planned locations; read-only."""
        return self._factor

    @property
    def scaled(self) -> Array:
        """Locations (n + o, 2) of all measurements in the kernel's axes and lengths; read-only."""
        return self._scaled

    @property
    def rows(self) -> Ints:
        """A number for each measurement (n + o,); as long as it is unchanged, so are the rows of L and w."""
        return self._rows

    @property
    def whitened_residuals(self) -> Array:
        """b (n + o,); zero for planned locations, whose measurements have the mean as their expectation."""
        if not self.planned_rows:
            return self._whitened
        return np.concatenate([self._whitened, np.zeros(self.planned_rows)])


def depth_slopes(kernel: Kernel, mean: PriorMean, scaled: Array, weights: Array, locations_m: Array) -> Array:
    """Slope (P, 2) at locations (P, 2) of the depth m(p) + sum_j weights_j k(p, p_j), for scaled locations p_j (n,
    2)."""
    return slopes_above_prior(kernel, scaled, weights, locations_m) + prior_slopes(mean, locations_m)


def slopes_above_prior(kernel: Kernel, scaled: Array, weights: Array, locations_m: Array) -> Array:
    """Slope (P, 2) at locations (P, 2) of sum_j weights_j k(p, p_j), for scaled locations p_j (n, 2)."""
    at, rows = kernel.scale(locations_m), max(1, _SLOPES // max(len(scaled), 1))
    parts = [at[first : first + rows] for first in range(0, len(at), rows)]
    sums = [kernel.gradient_sums(part, weights[None], scaled) for part in parts]
    return np.concatenate([np.zeros((0, 2)), *sums])


def prior_slopes(mean: PriorMean, locations_m: Array) -> Array:
    """Slope (P, 2) of the prior mean at locations (P, 2)."""
    steps = _SLOPE_M * np.eye(2)
    return np.stack([(mean(locations_m + s) - mean(locations_m - s)) / (2.0 * _SLOPE_M) for s in steps], axis=1)


def add_whitened(white: Array, residuals: Array, mean: Array, variance: Array) -> None:
    """mean (P,) += b^T w and variance (P,) -= sum of w^2, for whitened covariance w (n, P) and residuals b (n,)."""
    if compiled.USE_NUMBA:
        compiled_gp().add_whitened(white, residuals, mean, variance)
        return
    mean += residuals @ white
    variance -= np.einsum("np,np->p", white, white)


def checked_locations(locations_m: ArrayLike) -> Array:
    """Locations as an array (P, 2).

    Raises:
        ValueError: for another shape.
    """
    locations = np.asarray(locations_m, dtype=float)
    if locations.ndim != 2 or locations.shape[1] != 2:
        raise ValueError(f"locations_m must be north, east (m) of shape (P, 2), not {locations.shape}")
    return locations


def _leading(same: Mask) -> int:
    """Number of leading values that are true."""
    return len(same) if same.all() else int(np.argmin(same))
